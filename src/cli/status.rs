//! `volcomp status`: state of a running daemon.

mod paint;
mod recent;

use std::fmt::Write;
use std::io::IsTerminal;
use std::time::Duration;

use crate::prelude::*;
use volcomp_daemon::client::{self, ClientError};
use volcomp_daemon::{Fault, RealtimeStatus, ShadowAxis, ShadowStatus, Status};

use paint::Paint;

/// Where the daemon of the shipped unit listens.
const DEFAULT_SOCKET: &str = "/run/volcomp/volcompd.sock";
/// Interval of `--watch`.
const WATCH_INTERVAL: Duration = Duration::from_secs(1);

/// Which daemon.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct Which {
    /// The daemon's machine file, which names its socket.
    #[arg(long, value_name = "FILE", conflicts_with = "socket")]
    config: Option<PathBuf>,
    /// The daemon's socket [default: /run/volcomp/volcompd.sock].
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
}

/// Show what the daemon is doing: state, health, offsets, latency, warnings, faults.
#[derive(Debug, clap::Parser)]
#[command(after_help = include_str!("status/help.txt"))]
pub(super) struct StatusArgs {
    #[command(flatten)]
    which: Which,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Print the latency of the present link as full histograms, one JSON object: age, round trip, compute, lateness.
    #[arg(long)]
    histograms: bool,
    /// Redraw every second until interrupted; waits while the daemon restarts.
    #[arg(long)]
    watch: bool,
}

/// Show the state of the daemon and redraw it every second until interrupted: `volcomp status --watch`.
#[derive(Debug, clap::Parser)]
pub(super) struct WatchArgs {
    #[command(flatten)]
    which: Which,
    /// Print one JSON object a second instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn watch(args: &WatchArgs) -> Result<()> {
    let WatchArgs { which, json } = args;
    status(&StatusArgs { which: which.clone(), json: *json, histograms: false, watch: true })
}

#[expect(clippy::disallowed_methods, reason = "--watch waits between two prints")]
pub(super) fn status(args: &StatusArgs) -> Result<()> {
    let socket = socket(&args.which)?;
    let paint = Paint::of_stdout();
    let mut answered = false;
    loop {
        let result = show(args, &socket, paint);
        let again = args.watch && !super::exit::reader_gone();
        match result {
            Ok(exit_code) if !again => {
                // the exit code alone is the answer
                let judged = exit_code != 0 && !args.watch;
                return if judged { Err(Failure::new(exit_code, "")) } else { Ok(()) };
            }
            Ok(_) => answered = true,
            // a daemon that restarts: its socket is gone for a moment
            Err(ClientError::NotRunning { .. } | ClientError::Io { .. } | ClientError::Ended { .. })
                if again && answered =>
            {
                wait_for_restart(args, &socket);
            }
            Err(error) => return Err(failure(&error)),
        }
        std::thread::sleep(WATCH_INTERVAL);
    }
}

/// Prints once; gives the exit code that belongs to what was printed.
fn show(args: &StatusArgs, socket: &Path, paint: Paint) -> Result<u8, ClientError> {
    if args.histograms {
        say!("{}", line(socket, &client::histograms(socket)?)?);
        return Ok(0);
    }
    let status = client::status(socket)?;
    if args.json {
        say!("{}", line(socket, &status)?);
    } else {
        draw(args.watch, render(&status, paint).trim_end());
    }
    Ok(status.health.exit_code)
}

fn line(socket: &Path, object: &impl serde::Serialize) -> Result<String, ClientError> {
    serde_json::to_string(object)
        .map_err(|source| ClientError::NotUnderstood { socket: socket.to_owned(), source })
}

/// Prints a text; with `--watch` on a terminal over the one before, line by line, so that nothing flickers.
#[expect(clippy::disallowed_methods, reason = "whether stdout is a terminal")]
fn draw(watch: bool, text: &str) {
    if !watch || !std::io::stdout().is_terminal() {
        say!("{text}");
        return;
    }
    // cursor to the top, each line cleared to its end, then all below
    let lines: String = text.lines().map(|line| format!("{line}\x1b[K\n")).collect();
    say!("\x1b[H{}\x1b[J", lines.trim_end_matches('\n'));
}

fn wait_for_restart(args: &StatusArgs, socket: &Path) {
    let text = format!("{}: volcompd does not answer; waiting for it", socket.display());
    if args.json || args.histograms {
        note!("{text}");
    } else {
        draw(true, &text);
    }
}

pub(super) fn json(object: &impl serde::Serialize) -> Result<String> {
    serde_json::to_string(object).map_err(|e| Failure::new(EX_SOFTWARE, e))
}

pub(super) fn socket(which: &Which) -> Result<PathBuf> {
    if let Some(socket) = &which.socket {
        return Ok(socket.clone());
    }
    let Some(config) = &which.config else { return Ok(PathBuf::from(DEFAULT_SOCKET)) };
    match machine(config) {
        Ok(machine) => socket_of(config, &machine),
        // a mistake elsewhere in the file must not keep anybody from a daemon that runs
        Err(failure) => {
            let bytes = input::read(config, InputKind::Machine).map_err(without_file)?;
            let Some(socket) = stated_socket(&String::from_utf8_lossy(&bytes)) else {
                return Err(without_file(failure));
            };
            let file = config.display();
            note!("{file}: mistakes in it (volcomp check lists them); its status socket {socket} is used");
            Ok(config.with_file_name(socket))
        }
    }
}

/// A failure of the machine file, with the way to the daemon that needs none.
fn without_file(mut failure: Failure) -> Failure {
    failure.message.push_str("\n  hint: a running daemon is reached without its machine file by --socket PATH; by default PATH is ");
    failure.message.push_str(DEFAULT_SOCKET);
    failure
}

/// The socket that the table `[status]` of a machine file names, whatever else is wrong in the file; the default where it
/// names none, nothing where it is switched off or is no text.
fn stated_socket(text: &str) -> Option<String> {
    if let Some(socket) = volcomp_config::text_at(text, &["status", "socket"]) {
        return (!socket.is_empty()).then_some(socket);
    }
    // what the TOML reader could not make out of a broken file
    let mut table = "";
    for line in text.lines().map(str::trim) {
        if line.starts_with('[') {
            table = line.split(['#', ' ']).next().unwrap_or(line);
        }
        let value = line.strip_prefix("socket").and_then(|rest| rest.trim_start().strip_prefix('='));
        if let (Some(value), "[status]" | "[status") = (value, table) {
            let value = value.trim_start();
            let quote = value.chars().next().filter(|q| ['"', '\''].contains(q))?;
            let (socket, _) = value[1..].split_once(quote)?;
            // switched off
            return (!socket.is_empty()).then(|| socket.to_owned());
        }
    }
    Some(DEFAULT_SOCKET.to_owned())
}

/// The socket that a machine file names.
pub(super) fn socket_of(config: &Path, machine: &MachineConfig) -> Result<PathBuf> {
    volcomp_daemon::socket_path(config, machine).ok_or_else(|| {
        mistake!(config, "the status socket is switched off\n  hint: set `socket` in its `[status]`")
    })
}

/// The machine file of a daemon.
pub(super) fn machine(config: &Path) -> Result<MachineConfig> {
    let text = input::read_text(config, InputKind::Machine)?;
    Ok(MachineConfig::parse(&config.display().to_string(), &text)?)
}

pub(super) fn failure(error: &ClientError) -> Failure {
    let code = match error {
        ClientError::NotRunning { .. }
        | ClientError::Denied { .. }
        | ClientError::Io { .. }
        | ClientError::Ended { .. }
        | ClientError::Refused { .. } => EX_IOERR,
        ClientError::NotUnderstood { .. } => EX_SOFTWARE,
    };
    Failure::new(code, error)
}

/// The status as a person reads it.
fn render(status: &Status, paint: Paint) -> String {
    let mut text = String::new();
    // writing to a string cannot fail
    let _ = write_head(&mut text, status, paint);
    let _ = write_figures(&mut text, status);
    let _ = recent::write_latency(&mut text, status);
    let _ = write_axes(&mut text, status);
    let _ = write_shadow(&mut text, status);
    let _ = super::filter::write(&mut text, &status.sensors, &status.maps, &status.sensor_notes);
    let _ = super::filter::write_growths(&mut text, &status.growths);
    let _ = recent::write_warnings(&mut text, status, paint);
    let _ = write_tail(&mut text, status, paint);
    micro(&text)
}

fn write_head(f: &mut String, status: &Status, paint: Paint) -> std::fmt::Result {
    let wanted = if status.enabled { "compensation enabled" } else { "compensation disabled" };
    writeln!(f, "{}: {} ({wanted})", status.machine, status.state)?;
    recent::write_health(f, status, paint)?;
    let hash = status.model_hash.get(..12).unwrap_or(&status.model_hash);
    write!(f, "model       {} (blake3 {hash})", status.model)?;
    recent::write_coverage(f, status)?;
    if let Some(why) = &status.start_inhibit {
        writeln!(f, "not started {why}")?;
    }
    write_choice(f, status)?;
    let link = &status.link;
    let (since, address) = (duration(link.since_s), &link.address);
    match (&link.error, link.up) {
        (_, true) => {
            let (control, tls) =
                (link.control.as_deref().unwrap_or("control"), if link.tls { " (TLS)" } else { "" });
            let cycle_ms = link.cycle_s * 1e3;
            writeln!(f, "link        {address}{tls} up for {since}, {control}, cycle {cycle_ms} ms")?;
        }
        (Some(error), false) => writeln!(f, "link        {address} down for {since}: {error}")?,
        (None, false) => writeln!(f, "link        {address} connecting for {since}")?,
    }
    if let (Some(read), Some(write), true) = (link.read_us, link.write_us, link.up) {
        writeln!(f, "calls       read {read:.0} us, write {write:.0} us, means")?;
    }
    if link.up {
        writeln!(f, "machine     {}", list(&status.machine_state))?;
    }
    Ok(())
}

/// Who chose the model, and what speaks against using it.
fn write_choice(f: &mut String, status: &Status) -> std::fmt::Result {
    let choice = &status.model_choice;
    if let Some(who) = &choice.who {
        let why = choice.why.as_deref().unwrap_or("no reason given");
        writeln!(f, "            loaded by {who} on {}: {why}", choice.since)?;
    }
    if let Some(expiry) = &choice.expiry {
        writeln!(f, "            good until {expiry}")?;
    }
    for note in &choice.notes {
        writeln!(f, "NOTE        {note}")?;
    }
    for hindrance in &status.hindrances {
        writeln!(f, "AGAINST IT  {hindrance}")?;
    }
    if status.gain != 1.0 {
        writeln!(f, "gain        {}", status.gain)?;
    }
    Ok(())
}

/// What shadow mode has found.
fn write_shadow(f: &mut String, status: &Status) -> std::fmt::Result {
    let Some(shadow) = &status.shadow else { return Ok(()) };
    let ShadowStatus { state, cycles, faults, interruptions, .. } = shadow;
    let share = percent(shadow.active_cycles, *cycles);
    writeln!(
        f,
        "SHADOW      nothing is applied; compensation would be {state}, was on for {share:.1} % of {cycles} cycles, {faults} faults, {interruptions} holds",
    )?;
    for (axis, a) in &shadow.axes {
        let ShadowAxis { unit, before_rms, before_max, after_rms, after_max, limited_cycles } = a;
        let [before_rms, before_max, after_rms, after_max] =
            [before_rms, before_max, after_rms, after_max].map(|v| plain(*v, 3));
        writeln!(
            f,
            "{axis:>4}        error known to the model {before_rms} rms {before_max} max, would be left {after_rms} rms {after_max} max {unit}, limited in {limited_cycles} cycles",
        )?;
    }
    Ok(())
}

/// A time of the cycle, from us: us, ms from one, s from one.
fn latency(us: f64) -> String {
    match us {
        us if us < 1e3 => format!("{us:.1} us"),
        us if us < 1e6 => format!("{:.1} ms", us / 1e3),
        us => format!("{:.1} s", us / 1e6),
    }
}

fn write_figures(f: &mut String, status: &Status) -> std::fmt::Result {
    let Status { cycles, late_cycles, skipped_cycles, .. } = status;
    let share = percent(*late_cycles, *cycles);
    writeln!(f, "cycles      {cycles}, late {late_cycles} ({share:.4} %), skipped {skipped_cycles}")?;
    let rows = [
        ("age", status.age_us_p50, status.age_us_p99),
        ("round trip", status.roundtrip_us_p50, status.roundtrip_us_p99),
        ("compute", status.compute_us_p50, status.compute_us_p99),
        ("late by", status.lateness_us_p50, status.lateness_us_p99),
    ];
    for (name, p50, p99) in rows {
        if let (Some(p50), Some(p99)) = (p50, p99) {
            writeln!(f, "{name:<10}  p50 {}, p99 {}", latency(p50), latency(p99))?;
        }
    }
    Ok(())
}

fn write_axes(f: &mut String, status: &Status) -> std::fmt::Result {
    let groups = [
        ("um", &status.correction_um, &status.applied_um),
        ("arcsec", &status.correction_arcsec, &status.applied_arcsec),
    ];
    for (unit, asked, applied) in groups {
        let axes: BTreeSet<&String> = asked.keys().chain(applied.keys()).collect();
        for axis in axes {
            match asked.get(axis) {
                Some(value) => write!(f, "{axis:>4}        {} {unit}", offset(*value))?,
                None => write!(f, "{axis:>4}        nothing is sent")?,
            }
            if let Some(applied) = applied.get(axis) {
                write!(f, "   applied {} {unit}", offset(*applied))?;
            }
            for (axes, word) in [
                (&status.limited, "LIMITED"),
                (&status.lagging, "BEHIND"),
                (&status.unlisted, "NOT IN THE MACHINE FILE"),
                (&status.warning, "WARNING"),
                (&status.out_of_range, "OUT OF RANGE"),
            ] {
                if axes.contains(axis) {
                    write!(f, "   {word}")?;
                }
            }
            writeln!(f)?;
        }
    }
    Ok(())
}

/// An offset with its sign in a column.
fn offset(value: f64) -> String {
    let sign = if value.is_sign_negative() { "" } else { "+" };
    format!("{:>10}", format!("{sign}{}", plain(value, 3)))
}

fn write_tail(f: &mut String, status: &Status, paint: Paint) -> std::fmt::Result {
    for Fault { code, reason, text, numbers, age_s } in &status.faults {
        let numbers = numbers.as_ref().map_or_else(String::new, |numbers| format!(": {numbers}"));
        let (fault, age) = (paint.red("FAULT"), duration(*age_s));
        writeln!(f, "{fault}       {code} {reason}: {text}{numbers} ({age} ago)")?;
    }
    if status.faults.is_empty() {
        writeln!(f, "faults      none")?;
    }
    let RealtimeStatus { fifo, affinity, memory_lock } = &status.realtime;
    writeln!(f, "real time   SCHED_FIFO {fifo}; processor {affinity}; memory lock {memory_lock}")?;
    write_kept(f, status)?;
    let Status { records_dropped, reports_dropped, readings_refused, version, pid, .. } = status;
    if *readings_refused > 0 {
        writeln!(
            f,
            "refused     {readings_refused} messages of sensors (each was answered with the reason)"
        )?;
    }
    if records_dropped + reports_dropped > 0 {
        writeln!(
            f,
            "dropped     {records_dropped} records, {reports_dropped} log reports (queues were full)"
        )?;
    }
    writeln!(f, "daemon      volcompd {version}, pid {pid}, up {}", duration(status.uptime_s))
}

/// The recording and the counters that outlive the daemon.
fn write_kept(f: &mut String, status: &Status) -> std::fmt::Result {
    if let Some(recording) = &status.recording {
        let file = recording.file.as_deref().unwrap_or("no file yet");
        let megabytes = recording.bytes as f64 / 1e6;
        writeln!(f, "recording   {file}, {} records, {megabytes:.1} MB", recording.records)?;
        if let Some(error) = &recording.error {
            writeln!(f, "NOT RECORDED {error}")?;
        }
    }
    let all = &status.lifetime;
    let many = |(n, what): (u64, &str)| counted(usize::try_from(n).unwrap_or(usize::MAX), what);
    let faults = all.faults.values().sum();
    let [cycles, times, faults, starts] =
        [(all.cycles, "cycle"), (all.enables, "time"), (faults, "fault"), (all.starts, "start")].map(many);
    let (late, share) = (all.late_cycles, percent(all.late_cycles, all.cycles));
    let since = all.since.split('T').next().unwrap_or("-");
    writeln!(
        f,
        "lifetime    {cycles}, late {late} ({share:.4} %), enabled {times}, {faults}, {starts} since {since}"
    )?;
    for (unit, largest) in [("um", &all.largest_um), ("arcsec", &all.largest_arcsec)] {
        for (axis, value) in largest {
            let (value, limited_s) = (plain(*value, 3), all.limited_s.get(axis).copied().unwrap_or(0.0));
            writeln!(f, "{axis:>4}        largest offset {value} {unit}, limited for {limited_s:.3} s")?;
        }
    }
    if all.audit_lines_lost > 0 {
        writeln!(f, "AUDIT LOG   {} lines are missing: the disk did not take them", all.audit_lines_lost)?;
    }
    match &all.note {
        Some(note) => writeln!(f, "counters    {note}"),
        None => Ok(()),
    }
}

/// A share of a count in percent.
fn percent(part: u64, all: u64) -> f64 {
    if all == 0 { 0.0 } else { 100.0 * part as f64 / all as f64 }
}

fn list(words: &[String]) -> String {
    if words.is_empty() { "-".to_owned() } else { words.join(", ") }
}

/// Seconds as `12.3 s` or `h:mm:ss`.
fn duration(seconds: f64) -> String {
    if seconds < 60.0 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds as u64;
    format!("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_socket_is_found_in_files_with_mistakes() {
        let stated = |text: &str| stated_socket(text);
        let found = Some("/run/a.sock".to_owned());
        for text in [
            "limmit = 1\n[status]\nsocket = \"/run/a.sock\"\n",
            "status.socket = \"/run/a.sock\"\n[axes.x]\nlimit-um = 1,5\n",
            "status = { socket = '/run/a.sock' }\n",
            "[ status ]\nsocket = \"/run/a.sock\"\n[status]\n",
            "= no TOML\n[status] # where\nsocket='/run/a.sock'\n",
            "[status]\nsocket = /run/a.sock\n",
            "[status\nsocket = \"/run/a.sock\" # here\n",
            "\u{feff}[status]\nsocket = \"/run/a.sock\"\nother = \u{fffd}\n",
        ] {
            assert_eq!(stated(text), found, "{text}");
        }
        for text in ["", "[axes.x]\nlimit-um = 5\n", "[log]\nsocket = \"/run/b.sock\"\n"] {
            assert_eq!(stated(text).as_deref(), Some(DEFAULT_SOCKET), "{text}");
        }
        for text in ["[status]\nsocket = \"\"\n", "[status]\nsocket = 5\n"] {
            assert_eq!(stated(text), None, "{text}");
        }
    }

    #[test]
    fn offsets_stand_in_a_column_whatever_the_control_says() {
        let shown = [0.0, -0.0, -12.3456, 1e308].map(offset);
        assert_eq!(shown, ["    +0.000", "     0.000", "   -12.346", "+1.0000e308"]);
    }

    #[test]
    fn a_machine_file_without_a_socket_names_the_option() {
        let dir = tempfile::tempdir().unwrap();
        let config = dir.path().join("machine.toml");
        let refused = || {
            let which = Which { config: Some(config.clone()), socket: None };
            socket(&which).unwrap_err().message
        };
        let hint = "--socket PATH; by default PATH is /run/volcomp/volcompd.sock";
        assert!(refused().contains(hint), "{}", refused());
        std::fs::write(&config, "limmit = 1\n[status]\nsocket = 5\n").unwrap();
        assert!(refused().contains("limmit") && refused().contains(hint), "{}", refused());
        std::fs::write(&config, b"# \xff\n[status]\nsocket = \"a.sock\"\n").unwrap();
        let which = Which { config: Some(config.clone()), socket: None };
        assert_eq!(socket(&which).unwrap(), dir.path().join("a.sock"));
    }
}
