//! `filter`: what live estimation has learned, and how well its sensors do.

mod picture;

use std::fmt::Write as _;

use super::operator_commands::{Common, refusal};
use super::recordings;
use super::status::{Which, failure, json, socket};
use crate::prelude::*;
use volcomp_daemon::client;
use volcomp_daemon::socket::{Ask, Verb};
use volcomp_daemon::{FilterStatus, MapStatus, SensorStatus, ThermalDisplacementStatus};
use volcomp_units::NS_PER_S;

subcommands! {
    /// Live estimation: what was learned from sensors, with its uncertainty.
    #[command(after_help = include_str!("help.txt"))]
    pub(super) enum What {
        /// Sensors and maps: innovations, noise, acceptance, nodes with their standard deviations.
        Show(ShowArgs) => show,
        /// Begin a map anew from the offline map; its sensors are initialised again.
        Forget(ForgetArgs) => forget,
    }
}

#[derive(Debug, clap::Args)]
pub(super) struct ShowArgs {
    #[command(flatten)]
    which: Which,
    /// What a recording says, at its end, instead of a running daemon; the picture shows how it went, too.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["config", "socket"])]
    recording: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Draw the maps: values at the nodes over X, bars of one standard deviation.
    #[arg(long, value_name = "FILE.svg", alias = "picture")]
    svg: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub(super) struct ForgetArgs {
    /// The map.
    #[arg(value_name = "MAP")]
    map: String,
    #[command(flatten)]
    common: Common,
}

fn forget(ForgetArgs { map, common }: &ForgetArgs) -> Result<()> {
    let reason = common.reason.clone();
    let ask = Ask { command: Verb::Forget, map: Some(map.clone()), reason, ..Ask::default() };
    let answer = client::ask(&socket(&common.which)?, &ask).map_err(|e| refusal(&e))?;
    if common.json {
        say!("{}", json(&answer)?);
    } else {
        say!("map {map} restarts from the offline map");
    }
    for note in &answer.notes {
        note!("note: {note}");
    }
    Ok(())
}

fn show(args: &ShowArgs) -> Result<()> {
    let course = match &args.recording {
        Some(path) => recorded(path)?,
        None => vec![(0.0, client::filter(&socket(&args.which)?).map_err(|e| failure(&e))?)],
    };
    let Some((_, filter)) = course.last() else { return Ok(()) };
    if let Some(path) = &args.svg {
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("svg")) {
            return Err(usage!("--svg: the name must end in .svg"));
        }
        let text = picture::picture(&course)
            .map_err(|e| failure!(EX_SOFTWARE, "the picture cannot be drawn: {e}"))?;
        write_text(path, &text)?;
    }
    if args.json {
        say!("{}", json(filter)?);
        return Ok(());
    }
    let mut text = String::new();
    let written = write(&mut text, &filter.sensors, &filter.maps, &filter.notes)
        .and_then(|()| write_growths(&mut text, &filter.growths))
        .and_then(|()| filter.maps.iter().try_for_each(|map| write_nodes(&mut text, map)));
    written.map_err(|e| Failure::new(EX_IOERR, e))?;
    say!("{}", text.trim_end());
    Ok(())
}

/// Time (s, from the first) and health as a recording has it, the newest last.
fn recorded(path: &Path) -> Result<Vec<(f64, FilterStatus)>> {
    let parsed = recordings::read(&[path.to_owned()])?;
    let wrong = |what: String| data!(path, "{what}");
    let mut course: Vec<(f64, FilterStatus)> = Vec::new();
    let mut first = None;
    for (ns, text) in parsed.iter().flat_map(|file| &file.health) {
        let health = serde_json::from_str(text).map_err(|e| wrong(format!("health at {ns} ns: {e}")))?;
        let begin = *first.get_or_insert(*ns);
        course.push((ns.saturating_sub(begin) as f64 / NS_PER_S, health));
    }
    if course.is_empty() {
        return Err(wrong("it says nothing about sensors\n  hint: it was recorded without [[sensor]], or by an older version".to_owned()));
    }
    Ok(course)
}

/// Sensors and maps as a person reads them; nothing where there are none.
pub(super) fn write(
    f: &mut String,
    sensors: &[SensorStatus],
    maps: &[MapStatus],
    notes: &[String],
) -> std::fmt::Result {
    for (k, sensor) in sensors.iter().enumerate() {
        let label = if k == 0 { "sensors     " } else { "            " };
        writeln!(f, "{label}{}", sensor_words(sensor))?;
    }
    for (k, map) in maps.iter().enumerate() {
        let label = if k == 0 { "maps        " } else { "            " };
        write!(f, "{label}{} {}", map.name, map.state)?;
        if map.state == "held" && map.updates > 0 {
            write!(f, " for {:.0} s", map.idle_s)?;
        }
        let limited = if map.limited { ", at its limit (VC-8019)" } else { "" };
        write!(f, "{limited}, {} readings;", map.updates)?;
        for ((name, largest), unit) in map.components.iter().zip(&map.largest).zip(&map.units) {
            write!(f, " {name} {largest:.2} {unit}")?;
        }
        writeln!(f)?;
    }
    for note in notes {
        writeln!(f, "NOTE        {note}")?;
    }
    Ok(())
}

/// How a sensor stands.
fn sensor_words(s: &SensorStatus) -> String {
    let mut text = format!("{} ({}) {}", s.name, s.kind, s.state);
    match (&s.cause, &s.code) {
        (Some(cause), Some(code)) => text += &format!(": {cause} ({code}) for {:.0} s", s.state_s),
        (None, Some(code)) => text += &format!(" ({code})"),
        _ => {}
    }
    let angles = s.noise_factor_angles.map_or(String::new(), |a| format!(" (angles x{a:.2})"));
    let left = s.acquaintance_left.filter(|_| s.state != "waiting");
    let coverage = s.coverage.filter(|_| s.referenced == Some(false));
    let parts = [
        s.rests_s.map(|rests| format!("looked at again in {rests:.0} s")),
        left.map(|left| format!("{left} readings until it is known")),
        s.noise_factor.map(|noise| format!("noise x{noise:.2}{angles}")),
        s.nis.map(|nis| format!("nis {nis:.2}")),
        coverage.map(|seen| format!("{:.0} % of the travel seen", 100.0 * seen)),
        Some(format!("{} of {} used, {} rejected", s.used, s.readings, s.rejected)),
        (s.without_position > 0).then(|| format!("{} without position", s.without_position)),
        (s.skipped > 0).then(|| format!("{} left out", s.skipped)),
    ];
    parts.iter().flatten().for_each(|part| text += &format!(", {part}"));
    text
}

/// Thermal displacements as text; empty without any.
pub(super) fn write_growths(f: &mut String, growths: &[ThermalDisplacementStatus]) -> std::fmt::Result {
    for (k, growth) in growths.iter().enumerate() {
        let label = if k == 0 { "growths     " } else { "            " };
        write!(f, "{label}{} {:+.2} {}", growth.name, growth.value, growth.unit)?;
        if let Some(std) = growth.std {
            write!(f, " +- {std:.2}")?;
        }
        let input = growth.input.as_deref().unwrap_or_default();
        let code = growth.code.as_deref().unwrap_or_default();
        match growth.state.as_str() {
            "waiting" => write!(f, ", waiting for {input}")?,
            "outside" => write!(f, ", {input} is outside of what the fit has seen ({code})")?,
            "lost" => write!(f, ", {input} is lost ({code})")?,
            _ => {}
        }
        if growth.share < 1.0 && growth.state != "waiting" {
            write!(f, ", {:.0} % of it used", 100.0 * growth.share)?;
        }
        writeln!(f)?;
    }
    Ok(())
}

fn write_nodes(f: &mut String, map: &MapStatus) -> std::fmt::Result {
    writeln!(
        f,
        "\nmap {}: difference from the offline map +- standard deviation (what is used of it)",
        map.name
    )?;
    write!(f, "{:>9} {:>9} {:>9}", "x_mm", "y_mm", "z_mm")?;
    for (name, unit) in map.components.iter().zip(&map.units) {
        write!(f, " {:>24}", format!("{name}_{unit}"))?;
    }
    writeln!(f)?;
    for node in &map.nodes {
        let [x, y, z] = node.position_mm;
        write!(f, "{x:>9.1} {y:>9.1} {z:>9.1}")?;
        for ((value, std), used) in node.value.iter().zip(&node.std).zip(&node.used) {
            write!(f, " {:>24}", format!("{value:.2} +- {std:.2} ({used:.2})"))?;
        }
        writeln!(f)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::picture::{lines, picture};
    use super::*;
    use volcomp_daemon::NodeStatus;

    fn filter() -> FilterStatus {
        let node = |k: usize| NodeStatus {
            position_mm: [(k % 3) as f64 * 500.0, (k / 3) as f64 * 400.0, 0.0],
            value: vec![k as f64, 0.5],
            std: vec![0.3, 0.1],
            used: vec![0.9 * k as f64, 0.0],
        };
        let map = MapStatus {
            name: "ram".to_owned(),
            state: "alarm".to_owned(),
            limited: true,
            idle_s: 12.0,
            memory_s: Some(7200.0),
            updates: 7,
            components: vec!["ezz".to_owned(), "eaz".to_owned()],
            units: vec!["um".to_owned(), "arcsec".to_owned()],
            weight: 0.9,
            largest: vec![4.5, 0.0],
            nodes: (0..6).map(node).collect(),
        };
        let sensor = SensorStatus {
            name: "tracker".to_owned(),
            kind: "tool".to_owned(),
            state: "excluded".to_owned(),
            cause: Some("disagrees".to_owned()),
            code: Some("VC-8010".to_owned()),
            noise_factor: Some(1.2),
            noise_factor_angles: Some(0.5),
            innovation: Some(1.4),
            innovation_expected: Some(1.1),
            readings: 50,
            used: 40,
            rejected: 3,
            without_position: 2,
            skipped: 5,
            ..SensorStatus::default()
        };
        let growth = ThermalDisplacementStatus {
            name: "spindle-z".to_owned(),
            state: "outside".to_owned(),
            input: Some("t4".to_owned()),
            code: Some("VC-8014".to_owned()),
            unit: "um".to_owned(),
            value: -12.3,
            share: 0.4,
            std: Some(2.0),
        };
        FilterStatus {
            sensors: vec![sensor],
            maps: vec![map],
            growths: vec![growth],
            ..FilterStatus::default()
        }
    }

    #[test]
    fn people_read_states_nodes_and_uncertainty() {
        let filter = filter();
        let mut text = String::new();
        write(&mut text, &filter.sensors, &filter.maps, &["a note".to_owned()]).unwrap();
        write_nodes(&mut text, &filter.maps[0]).unwrap();
        write_growths(&mut text, &filter.growths).unwrap();
        for words in [
            "tracker (tool) excluded: disagrees (VC-8010)",
            "noise x1.20 (angles x0.50)",
            "40 of 50 used, 3 rejected, 2 without position, 5 left out",
            "ram alarm, at its limit (VC-8019), 7 readings",
            "NOTE",
            "5.00 +- 0.30 (4.50)",
            "eaz_arcsec",
            "spindle-z -12.30 um +- 2.00, t4 is outside of what the fit has seen (VC-8014), 40 % of it used",
        ] {
            assert!(text.contains(words), "{words}\n{text}");
        }
    }

    #[test]
    fn the_picture_has_a_panel_per_component() {
        let text = picture(&[(0.0, filter())]).unwrap();
        assert!(text.starts_with("<svg") && text.contains("ram.ezz") && text.contains("ram.eaz"));
        assert_eq!(lines(&filter().maps[0]), [vec![0, 1, 2], vec![3, 4, 5]]);
        assert!(picture(&[]).is_ok());
        let mut later = filter();
        later.sensors[0].nis = Some(1.1);
        let text = picture(&[(0.0, filter()), (5.0, later)]).unwrap();
        assert!(text.contains("squared innovation") && text.contains("tracker"), "over time");
        for words in [
            "innovation",
            "expected",
            "used of those that came",
            "learned",
            "standard deviation",
            "what is used",
        ] {
            assert!(text.contains(words), "{words}");
        }
        let text = picture(&[(0.0, filter())]).unwrap();
        for words in [
            "tracker excluded",
            "innovation 1.40, expected 1.10",
            "40 of 50 readings used, 3 beyond the gate",
        ] {
            assert!(text.contains(words), "{words}\n{text}");
        }
    }
}
