//! The loop closed over TCP: real control side, real daemon process, and machines whose truth is known.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads and writes files")]

use std::fmt::Write as _;
use std::path::Path;

use simulator::control::CycleRecord;
use simulator::demo::programs::Programs;
use simulator::demo::shop::Shop;
use simulator::motion::paths::{Targets, line_with_targets};
use simulator::truth::{GANTRY_5AX, GRINDER_AB, TruthMachine};
use volcomp::model::axes::{AxisArray, AxisKind, MAX_AXES};

/// Support points of a table of the known model.
const POINTS: usize = 1500;

fn programs() -> Programs {
    Programs::at(env!("CARGO_BIN_EXE_cncsim"))
}

fn list(values: impl IntoIterator<Item = f64>) -> String {
    let words: Vec<String> = values.into_iter().map(|v| format!("{v:?}")).collect();
    format!("[{}]", words.join(", "))
}

/// The truth written down as a model file: dense tables between the coordinates that the path uses.
fn known_model(machine: &TruthMachine, low: &AxisArray, high: &AxisArray) -> String {
    const ARCSEC: f64 = 3600.0 * 180.0 / std::f64::consts::PI;
    let (squareness, joints) = machine.true_geometry();
    let mut text = format!(
        "format = \"volcomp-model/1\"\nmachine = \"{}\"\nchain = \"{}\"\n[frame]\nworkpiece-origin-mm = {}\ntool-tip-mm = {}\n",
        machine.machine(),
        machine.chain().text(),
        list(machine.workpiece_origin_mm()),
        list(machine.tool_tip_mm()),
    );
    let mut errors = String::new();
    for (k, name) in machine.axes().into_iter().enumerate() {
        let joint = joints.iter().find(|j| j.axis == name).unwrap();
        let lower = name.lower();
        let linear = name.kind() == AxisKind::Linear;
        writeln!(text, "[axes.{lower}]").unwrap();
        if linear {
            let [x, y, z] = joint.reference_mm.map(list);
            writeln!(text, "reference-points-mm = {{ x = {x}, y = {y}, z = {z} }}").unwrap();
        } else {
            writeln!(text, "point-mm = {}", list(joint.point_mm)).unwrap();
        }
        let at = |i: usize| low[k] + (high[k] - low[k]) * i as f64 / (POINTS - 1) as f64;
        for (c, letter) in ['x', 'y', 'z', 'a', 'b', 'c'].into_iter().enumerate() {
            let (unit, scale) = if c < 3 { ("um", 1e3) } else { ("arcsec", ARCSEC) };
            let position = if linear { "position-mm" } else { "position-deg" };
            let values = list((0..POINTS).map(|i| machine.true_motion(k, at(i), 1)[c] * scale));
            writeln!(
                errors,
                "[errors.e{letter}{lower}.table]\n{position} = {}\nvalue-{unit} = {values}",
                list((0..POINTS).map(at))
            )
            .unwrap();
            let location = joint.location[c];
            if !linear && location != 0.0 {
                writeln!(
                    errors,
                    "[errors.e{letter}0{lower}.constant]\nvalue-{unit} = {:?}",
                    location * scale
                )
                .unwrap();
            }
        }
    }
    for (symbol, rad) in
        [("ec0y", squareness.c0y_rad), ("eb0z", squareness.b0z_rad), ("ea0z", squareness.a0z_rad)]
    {
        if rad != 0.0 {
            writeln!(errors, "[errors.{symbol}.constant]\nvalue-arcsec = {:?}", rad * ARCSEC).unwrap();
        }
    }
    text + &errors
}

/// The daemon's configuration with generous limits.
fn machine_file(shop: &Shop) -> String {
    let mut text = format!(
        "format = \"volcomp-machine/1\"\nmachine = \"{}\"\nmodel = \"model.toml\"\n\
         [link]\naddress = \"{}\"\n[engine]\nstart = \"on-connect\"\nramp-s = 0.5\nstale-ms = 10000.0\n\
         [realtime]\npriority = 0\nlock-memory = false\n[status]\nsocket = \"\"\n[log]\ntarget = \"stderr\"\n",
        shop.machine().machine(),
        shop.address(),
    );
    for name in shop.machine().axes() {
        let unit = if name.kind() == AxisKind::Linear { "um" } else { "arcsec" };
        writeln!(
            text,
            "[axes.{}]\nlimit-{unit} = 1000.0\nrate-{unit}-per-s = 5000.0\nacceleration-{unit}-per-s2 = 100000.0",
            name.lower()
        )
        .unwrap();
    }
    text
}

/// Position error in the workpiece frame (um) and tilt of the tool (arcsec) of a cycle, and the commanded position.
struct Error {
    position_um: [f64; 3],
    tilt_arcsec: f64,
    commanded: AxisArray,
}

fn errors(machine: &TruthMachine, cycles: &[CycleRecord]) -> Vec<Error> {
    cycles
        .iter()
        .map(|r| {
            let nominal = machine.nominal(&r.commanded);
            let (a, b) = (r.sample.direction, nominal.direction);
            let cross = [0, 1, 2].map(|i| {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                a[j] * b[k] - a[k] * b[j]
            });
            Error {
                position_um: [0, 1, 2].map(|i| 1e3 * (r.sample.tip_mm[i] - nominal.tip_mm[i])),
                tilt_arcsec: cross.iter().map(|c| c * c).sum::<f64>().sqrt().to_degrees() * 3600.0,
                commanded: r.commanded,
            }
        })
        .collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0f64);
    for v in values {
        sum += v * v;
        count += 1.0;
    }
    (sum / count.max(1.0)).sqrt()
}

/// Runs a program without and with the daemon on a machine with ideal drives and a known model.
fn without_and_with(truth: &str, program: &str, margins: [f64; 2]) -> [Vec<Error>; 2] {
    let folder = tempfile::tempdir().unwrap();
    let machine = || TruthMachine::from_toml(truth).unwrap().with_ideal_drives();
    let mut shop = Shop::open(machine(), 1, 0.001).unwrap();
    let before = shop.program(program).unwrap();

    let mut low = [f64::INFINITY; MAX_AXES];
    let mut high = [f64::NEG_INFINITY; MAX_AXES];
    for r in &before {
        for k in 0..MAX_AXES {
            low[k] = low[k].min(r.commanded[k]);
            high[k] = high[k].max(r.commanded[k]);
        }
    }
    for (k, name) in machine().axes().into_iter().enumerate() {
        let margin = if name.kind() == AxisKind::Linear { margins[0] } else { margins[1] };
        low[k] -= margin;
        high[k] += margin;
    }
    std::fs::write(folder.path().join("model.toml"), known_model(&machine(), &low, &high)).unwrap();

    let mut shop = Shop::open(machine(), 1, 0.001).unwrap();
    let config = folder.path().join("machine.toml");
    std::fs::write(&config, machine_file(&shop)).unwrap();
    programs().volcomp(&["check", config.to_str().unwrap()]).unwrap();
    let daemon = shop.start_daemon(&programs(), &config, &folder.path().join("log")).unwrap();
    let after = shop.program(program).unwrap();
    shop.control().close();
    drop(daemon);
    [errors(&machine(), &before), errors(&machine(), &after)]
}

#[test]
fn a_five_axis_gantry_with_a_known_model_loses_98_percent_of_its_error() {
    let program = "G21 G90 G64\n(SCORE OFF)\nG0 X1300 Y900 Z-500 C10 A25\n(SCORE ON)\n\
                     F3000\nG1 X1500 Y1100 Z-420 C70 A50\nG1 X1650 Y1000 Z-560 C130 A35\n\
                     G1 X1400 Y950 Z-480 C40 A70\nG1 X1300 Y900 Z-500 C10 A25\n(SCORE OFF)\nM30\n";
    let [before, after] = without_and_with(GANTRY_5AX, program, [5.0, 2.0]);
    let size = |list: &[Error]| rms(list.iter().flat_map(|e| e.position_um));
    let tilt = |list: &[Error]| rms(list.iter().map(|e| e.tilt_arcsec));
    eprintln!(
        "gantry: position {:.2} -> {:.3} um RMS, direction {:.2} -> {:.3} arcsec RMS over {} cycles",
        size(&before),
        size(&after),
        tilt(&before),
        tilt(&after),
        after.len()
    );
    assert!(before.len() > 1000 && size(&before) > 20.0 && tilt(&before) > 2.0);
    assert!(size(&after) < 0.02 * size(&before));
    assert!(tilt(&after) < 0.02 * tilt(&before));
}

#[test]
fn the_grinder_loses_98_percent_of_what_its_axes_can_reach() {
    let program = "G21 G90 G64\n(SCORE OFF)\nG0 X100 Y40 A10 B-20\n(SCORE ON)\n\
                     F1500\nG1 X180 Y80 A60 B15\nG1 X120 Y20 A110 B-35\nG1 X60 Y-30 A30 B25\n(SCORE OFF)\nM30\n";
    let [before, after] = without_and_with(GRINDER_AB, program, [5.0, 2.0]);
    // there is no Z: what lies across X and Y, turned into W by the workpiece axis A, stays
    let split = |e: &Error| {
        let a = -e.commanded[0].to_radians();
        let across = [0.0, a.sin(), a.cos()];
        let along: f64 = (0..3).map(|i| e.position_um[i] * across[i]).sum();
        (along, [0, 1, 2].map(|i| e.position_um[i] - along * across[i]))
    };
    let reach = |list: &[Error]| rms(list.iter().flat_map(|e| split(e).1));
    let stays = |list: &[Error]| rms(list.iter().map(|e| split(e).0));
    let tilt = |list: &[Error]| rms(list.iter().map(|e| e.tilt_arcsec));
    eprintln!(
        "grinder: within reach {:.2} -> {:.3} um RMS, direction {:.2} -> {:.3} arcsec RMS, across (no axis) {:.2} -> {:.2} um",
        reach(&before),
        reach(&after),
        tilt(&before),
        tilt(&after),
        stays(&before),
        stays(&after)
    );
    assert!(before.len() > 1000 && reach(&before) > 3.0 && tilt(&before) > 1.0);
    assert!(reach(&after) < 0.02 * reach(&before));
    assert!(tilt(&after) < 0.02 * tilt(&before));
}

/// A positioning test of a real axis: mm, one entry per reading of a cycle.
struct RealCycle {
    targets_mm: Vec<f64>,
    forward_um: Vec<f64>,
    reverse_um: Vec<f64>,
}

/// Cycle `wanted` of an ISO 230-2 record (`REF_DATA_FWD[i,j]=`), read here and not by the product's importer.
fn real_cycle(text: &str, wanted: usize) -> RealCycle {
    let mut cycle = RealCycle { targets_mm: Vec::new(), forward_um: Vec::new(), reverse_um: Vec::new() };
    let number = |line: &str| line.split('=').nth(1).unwrap().trim().parse::<f64>().unwrap();
    let index = |line: &str| {
        let inner = line.split(['[', ']']).nth(1).unwrap();
        let mut parts = inner.split(',').map(|p| p.trim().parse::<usize>().unwrap());
        (parts.next().unwrap(), parts.next())
    };
    let mut found: Vec<(bool, usize, f64)> = Vec::new();
    for line in text.lines().map(str::trim) {
        if line.starts_with("TGT_DATA[") {
            cycle.targets_mm.push(number(line));
        } else if line.starts_with("REF_DATA_FWD[") || line.starts_with("REF_DATA_BWD[") {
            let (i, j) = index(line);
            if j == Some(wanted) {
                found.push((line.starts_with("REF_DATA_FWD["), i, number(line)));
            }
        }
    }
    for i in 1..=cycle.targets_mm.len() {
        let target = cycle.targets_mm[i - 1];
        let at = |forward: bool| found.iter().find(|f| f.0 == forward && f.1 == i).unwrap().2;
        cycle.forward_um.push(1e3 * (at(true) - target));
        cycle.reverse_um.push(1e3 * (at(false) - target));
    }
    cycle
}

/// The truth of the left-out cycle: Y does exactly what it did then; nothing else is wrong.
fn truth_of(cycle: &RealCycle) -> String {
    format!(
        "format = \"volcomp-truth/1\"\nmachine = \"b02\"\nchain = \"[w b X Y Z t]\"\nseed = 1\n\
         [frame]\nworkpiece-origin-mm = [0, 0, 0]\ntool-tip-mm = [0, 0, 0]\n\
         [[axes]]\nname = \"X\"\ntravel-mm = [-30, 30]\nservo = {{ lag-ms = 5.0 }}\n\
         [[axes]]\nname = \"Y\"\ntravel-mm = [-21, 21]\nservo = {{ lag-ms = 5.0 }}\n\
         [[axes]]\nname = \"Z\"\ntravel-mm = [-30, 30]\nservo = {{ lag-ms = 5.0 }}\n\
         [[errors.eyy]]\nsamples = {{ at-mm = {}, value-um = {}, reverse-um = {} }}\n",
        list(cycle.targets_mm.iter().copied()),
        list(cycle.forward_um.iter().copied()),
        list(cycle.reverse_um.iter().copied()),
    )
}

/// Deviations at the targets, forward and reverse, about their mean: the zero of the instrument is free.
fn positioning(shop: &mut Shop, targets_mm: &[f64]) -> Vec<f64> {
    let (first, last) = (targets_mm[0], targets_mm[targets_mm.len() - 1]);
    let ends = [[0.0, first, 0.0], [0.0, last, 0.0]];
    let count = u32::try_from(targets_mm.len()).unwrap();
    let targets = Targets { count, dwell_s: 0.2, cycles: 1, feed_mm_per_min: 600.0 };
    // over-run both ends, so that every target is approached from its own side
    let run_in = format!("(SCORE OFF)\nG21 G90\nG0 X0 Y{} Z0\nM30\n", first - 0.5);
    shop.program(&run_in).unwrap();
    let cycles = shop.program(&line_with_targets(ends[0], ends[1], &targets)).unwrap();
    let standing: Vec<&CycleRecord> = cycles.iter().filter(|r| r.feed_mm_per_min == 0.0).collect();
    let mut found: Vec<f64> = Vec::new();
    for (i, r) in standing.iter().enumerate() {
        if standing.get(i + 1).is_none_or(|next| next.line != r.line) {
            found.push(1e3 * (r.sample.tip_mm[1] - r.commanded[1]));
        }
    }
    let mean = found.iter().sum::<f64>() / found.len() as f64;
    found.iter().map(|d| d - mean).collect()
}

#[test]
#[cfg_attr(
    not(data_iso230_2_linear_axes),
    ignore = "needs ../shared/data/iso230_2_linear_axes or VOLCOMP_DATA"
)]
fn a_real_axis_is_compensated_with_a_cycle_that_the_model_has_not_seen() {
    let path = Path::new(env!("VOLCOMP_DATA_FOLDER"))
        .join("iso230_2_linear_axes/ess_target_b02_report_target_y.md_ISO230.dat");
    let text = std::fs::read_to_string(&path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let data = path.to_str().unwrap();
    for (left_out, others) in [(5, "1-4"), (3, "1,2,4,5")] {
        let model = folder.path().join("model.toml");
        let report = folder.path().join("report.json");
        let (model_path, report_path) = (model.to_str().unwrap(), report.to_str().unwrap());
        let fit = ["fit", "--errors", data, "--axis", "y", "--cycles", others, "--basis", "table"];
        let into =
            ["--machine", "b02", "--chain", "[w b X Y Z t]", "--out", model_path, "--json", report_path];
        programs().volcomp(&[&fit[..], &into[..]].concat()).unwrap();
        let figures: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
        let repeatability =
            figures.pointer("/eyy/repeatability_um").and_then(serde_json::Value::as_f64).unwrap();

        let cycle = real_cycle(&text, left_out);
        let truth = truth_of(&cycle);
        let machine = || TruthMachine::from_toml(&truth).unwrap();
        let mut shop = Shop::open(machine(), 1, 0.001).unwrap();
        let before = positioning(&mut shop, &cycle.targets_mm);
        let mut shop = Shop::open(machine(), 1, 0.001).unwrap();
        let config = folder.path().join("machine.toml");
        std::fs::write(&config, machine_file(&shop)).unwrap();
        let daemon = shop.start_daemon(&programs(), &config, &folder.path().join("log")).unwrap();
        let after = positioning(&mut shop, &cycle.targets_mm);
        shop.control().close();
        drop(daemon);

        let (before, after) = (rms(before.into_iter()), rms(after.into_iter()));
        eprintln!(
            "b02 Y, cycle {left_out} unseen: {before:.1} -> {after:.1} um RMS over TCP; the axis repeats to {repeatability:.1} um, \
             which no static map can remove"
        );
        assert!(before > 15.0 && after < 0.4 * before, "cycle {left_out}: {before} -> {after}");
        // the map may not leave more than the axis' own scatter allows
        assert!(after < 2.0 * repeatability, "cycle {left_out}: {after} against {repeatability}");
    }
}
