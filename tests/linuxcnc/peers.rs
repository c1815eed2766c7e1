//! Beside what LinuxCNC's users have: its own `COMP_FILE`, and a height-map component in Python polled at 20 Hz.
//!
//! Measures, on the same machine and the same motions, and prints the table of `docs/how-to/linuxcnc.md`.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::control::{Cnc, Wiring};
use crate::daemon::{Daemon, program};
use crate::namespaces::{in_namespaces, load_component, run};
use crate::run_both;
use crate::trace::Trace;

/// Ticks of the times in `/proc`.
const TICKS_PER_S: f64 = 100.0;
const JOINTS: [(char, &str); 3] = [('x', "[JOINT_0]"), ('y', "[JOINT_1]"), ('z', "[JOINT_2]")];

struct Line {
    name: &'static str,
    circle: [f64; 2],
    diagonal: [f64; 2],
    updates_per_s: f64,
    cpu_percent: Option<f64>,
}

fn model() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples/linuxcnc/model.toml").display().to_string()
}

fn volcomp(arguments: &[&str]) -> String {
    run(&program("volcomp").display().to_string(), arguments)
}

/// Processor time of processes so far, s.
fn cpu_s(ids: &[u32]) -> f64 {
    let of = |id: &u32| -> f64 {
        let stat = fs::read_to_string(format!("/proc/{id}/stat")).expect("process");
        let after = stat.rsplit_once(')').expect("name").1;
        let words: Vec<&str> = after.split_whitespace().collect();
        words[11..13].iter().map(|w| w.parse::<f64>().expect("ticks")).sum::<f64>() / TICKS_PER_S
    };
    ids.iter().map(of).sum()
}

fn process(name: &str) -> u32 {
    run("pgrep", &["-x", name]).lines().next().and_then(|l| l.parse().ok()).expect("process")
}

/// How often an offset changes, per second of motion.
fn updates(trace: &Trace) -> f64 {
    let changed = trace.rows.windows(2).filter(|r| r[0].applied != r[1].applied).count();
    changed as f64 * 1000.0 / trace.rows.len() as f64
}

/// Circle and diagonal, judged; `processes` do the compensating.
fn measure(name: &'static str, cnc: &mut Cnc, lag: usize, processes: &[u32]) -> Line {
    let (start, before) = (Instant::now(), cpu_s(processes));
    run_both(cnc, 3);
    let cpu = 100.0 * (cpu_s(processes) - before) / start.elapsed().as_secs_f64();
    let trace = cnc.trace();
    let [circle, diagonal] = [3, 4].map(|mark| {
        let size = trace.moving(mark).error(lag);
        [size.rms_um, size.max_um]
    });
    let updates_per_s = updates(&trace.moving(3));
    Line { name, circle, diagonal, updates_per_s, cpu_percent: (!processes.is_empty()).then_some(cpu) }
}

fn without_and_with_volcompd(lines: &mut Vec<Line>) -> usize {
    let mut cnc = Cnc::start(Wiring::ExternalOffsets, |_| {});
    lines.push(measure("nothing", &mut cnc, 2, &[]));
    let lag = cnc.trace().moving(3).lag();
    drop(cnc);
    for (name, wiring) in [
        ("volcompd, external offsets", Wiring::ExternalOffsets),
        ("volcompd, behind the motion controller", Wiring::Injection),
    ] {
        let mut cnc = Cnc::start(wiring, |_| {});
        let daemon = Daemon::start(wiring, |text| text);
        daemon.wait_for_state("active");
        lines.push(measure(name, &mut cnc, lag, &[daemon.id(), process("volcomp_bridge")]));
    }
    lag
}

fn comp_file(lag: usize) -> Line {
    let mut cnc = Cnc::start(Wiring::ExternalOffsets, |machine| {
        let ini = machine.join(Wiring::ExternalOffsets.ini());
        let mut text = fs::read_to_string(&ini).expect("INI file");
        for (axis, section) in JOINTS {
            let file = machine.join(format!("{axis}.comp")).display().to_string();
            let axis = axis.to_string();
            volcomp(&[
                "export",
                &model(),
                "--format",
                "linuxcnc",
                "--axis",
                &axis,
                "--comp-type",
                "0",
                "--tolerance-um",
                "0.2",
                "--out",
                &file,
            ]);
            let lines = format!("{section}\nCOMP_FILE = {file}\nCOMP_FILE_TYPE = 0");
            text = text.replace(section, &lines);
        }
        fs::write(ini, text).expect("INI file");
    });
    measure("COMP_FILE", &mut cnc, lag, &[])
}

fn height_map(lag: usize) -> Line {
    let mut cnc = Cnc::start(Wiring::ExternalOffsets, |_| {});
    let points = cnc.dir.path().join("points.csv");
    let grid: Vec<String> =
        (-13..=13).flat_map(|i| (-13..=13).map(move |j| format!("{},{},0", 10 * i, 10 * j))).collect();
    fs::write(&points, format!("x_mm,y_mm,z_mm\n{}\n", grid.join("\n"))).expect("points");
    let points = points.display().to_string();
    let table = volcomp(&["predict", "--model", &model(), "--points", &points, "--out", "-"]);
    let rows: Vec<String> = table
        .lines()
        .skip(1)
        .map(|line| {
            let words: Vec<&str> = line.split(',').collect();
            format!("{} {} {} {} {}", words[0], words[1], words[9], words[10], words[11])
        })
        .collect();
    let map = cnc.dir.path().join("map.txt");
    fs::write(&map, rows.join("\n")).expect("map");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/linuxcnc/height_map.py");
    let (script, map) = (script.display().to_string(), map.display().to_string());
    for axis in ["x", "y", "z"] {
        run("halcmd", &["unlinkp", &format!("volcomp.count-{axis}")]);
        run("halcmd", &["setp", &format!("axis.{axis}.eoffset-scale"), "0.001"]);
    }
    load_component(&["heightmap", "/usr/bin/python3", &script, &map]);
    for axis in ["x", "y", "z"] {
        run("halcmd", &["net", &format!("volcomp-count-{axis}"), &format!("heightmap.count-{axis}")]);
        run("halcmd", &["net", &format!("volcomp-nominal-{axis}"), &format!("heightmap.pos-{axis}")]);
    }
    std::thread::sleep(Duration::from_secs(1));
    measure("height map in Python, 20 Hz", &mut cnc, lag, &[process("python3")])
}

#[test]
#[ignore = "a measurement for docs/how-to/linuxcnc.md, about five minutes"]
fn side_by_side() {
    in_namespaces("peers::side_by_side", || {
        let mut lines = Vec::new();
        let lag = without_and_with_volcompd(&mut lines);
        lines.insert(1, comp_file(lag));
        lines.insert(2, height_map(lag));
        println!(
            "| | circle RMS / um | largest / um | diagonal RMS / um | largest / um | updates / s | processor / % |"
        );
        println!("|---|---|---|---|---|---|---|");
        for l in &lines {
            let cpu = l.cpu_percent.map_or("-".to_owned(), |c| format!("{c:.1}"));
            // what LinuxCNC does by itself shows in no offset
            let updates = l.cpu_percent.map_or("-".to_owned(), |_| format!("{:.0}", l.updates_per_s));
            println!(
                "| {} | {:.2} | {:.2} | {:.2} | {:.2} | {updates} | {cpu} |",
                l.name, l.circle[0], l.circle[1], l.diagonal[0], l.diagonal[1]
            );
        }
        let best = lines.last().expect("lines");
        assert!(lines[..3].iter().all(|l| l.circle[0] > best.circle[0]), "volcompd is not the best of them");
    });
}
