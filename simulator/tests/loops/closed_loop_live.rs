//! A machine whose model knows nothing, a tracker on the tool, and the real daemon: what is learned while the machine
//! works takes the error of the tool tip away.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads and writes files, starts programs and waits")]

use std::fmt::Write as _;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};

use simulator::demo::programs::Programs;
use simulator::truth::{TruthMachine, VMC_850};
use volcomp::model::axes::MAX_AXES;

/// A port that is free.
fn port() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

fn files(folder: &Path, control: &str, sensors: &str) {
    let mut model =
        "format = \"volcomp-model/1\"\nmachine = \"vmc-850\"\nchain = \"[w X' Y' b Z t]\"\n".to_owned();
    let machine = TruthMachine::from_toml(VMC_850).unwrap();
    writeln!(
        model,
        "[frame]\nworkpiece-origin-mm = {:?}\ntool-tip-mm = {:?}",
        machine.workpiece_origin_mm(),
        machine.tool_tip_mm()
    )
    .unwrap();
    for (symbol, unit, limit) in [
        ("exz", "um", 150),
        ("eyz", "um", 150),
        ("ezz", "um", 150),
        ("eaz", "arcsec", 30),
        ("ebz", "arcsec", 30),
        ("ecz", "arcsec", 30),
    ] {
        writeln!(model, "[errors.{symbol}.live]\nsensor = \"ram.{symbol}\"\nlimit-{unit} = {limit}").unwrap();
    }
    let mut machine = format!(
        "format = \"volcomp-machine/1\"\nmachine = \"vmc-850\"\nmodel = \"model.toml\"\n\
         [link]\naddress = \"{control}\"\n[engine]\nstart = \"on-connect\"\nramp-s = 0.5\n\
         [realtime]\npriority = 0\nlock-memory = false\n[status]\nsocket = \"sock\"\n[log]\ntarget = \"stderr\"\n\
         [sensors]\nlisten = \"{sensors}\"\n\
         [[map]]\nname = \"ram\"\nx-mm = [250, 350, 450]\ny-mm = [150, 250, 350]\nz-mm = [-300, -200]\n\
         std-um = 60\nstd-arcsec = 12\ncorrelation-mm = 300\nlimit-um = 150\nlimit-arcsec = 30\n\
         [[sensor]]\nname = \"tracker\"\nkind = \"tool\"\nstd-um = 15\nstd-arcsec = 4\nrange-um = 5000\njump-um = 500\n\
         jump-arcsec = 60\n"
    );
    for axis in ["x", "y", "z"] {
        writeln!(
            machine,
            "[axes.{axis}]\nlimit-um = 500.0\nrate-um-per-s = 2000.0\nacceleration-um-per-s2 = 40000.0"
        )
        .unwrap();
    }
    std::fs::write(folder.join("model.toml"), model).unwrap();
    std::fs::write(folder.join("machine.toml"), machine).unwrap();
    let mut program = "G21 G90 G94\nG1 F6000 X260 Y160 Z-290\n".to_owned();
    for _ in 0..3 {
        for (x, y, z) in
            [(440, 160, -290), (440, 340, -210), (260, 340, -290), (350, 250, -210), (260, 160, -290)]
        {
            writeln!(program, "G1 F6000 X{x} Y{y} Z{z}").unwrap();
        }
    }
    program += "M30\n";
    std::fs::write(folder.join("tour.nc"), program).unwrap();
}

/// Error of the tool tip against where the axes really stand without their offsets, um, over time.
fn errors(trace: &Path) -> Vec<(f64, f64)> {
    let machine = TruthMachine::from_toml(VMC_850).unwrap();
    let mut reader = csv::Reader::from_path(trace).unwrap();
    let headers = reader.headers().unwrap().clone();
    let column = |name: String| headers.iter().position(|h| h == name).unwrap_or_else(|| panic!("{name}"));
    let of = |end: &str| ["x", "y", "z"].map(|a| column(format!("{a}_{end}")));
    let (stands, offset) = (of("true_mm"), of("offset_mm"));
    let tip = ["x", "y", "z"].map(|a| column(format!("tip_{a}_mm")));
    let t = column("t_s".to_owned());
    reader
        .records()
        .map(|row| {
            let row = row.unwrap();
            let number = |k: usize| row[k].parse::<f64>().unwrap();
            let mut q = [0.0; MAX_AXES];
            for (k, name) in machine.axes().iter().enumerate() {
                let i = name.direction();
                q[k] = number(stands[i]) - number(offset[i]);
            }
            let nominal = machine.nominal(&q).tip_mm;
            let square: f64 = (0..3).map(|i| (number(tip[i]) - nominal[i]).powi(2)).sum();
            (number(t), 1e3 * square.sqrt())
        })
        .collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = values.map(|v| v * v).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

#[test]
fn what_the_tracker_sees_is_taken_out_while_the_machine_works() {
    let _alone = crate::processors();
    let folder = tempfile::tempdir().unwrap();
    let (control, sensors) = (port(), port());
    files(folder.path(), &control, &sensors);
    let trace = folder.path().join("trace.csv");
    let mut machine = Command::new(env!("CARGO_BIN_EXE_cncsim"))
        .args(["serve", "--machine", "vmc-850", "--wait-s", "20", "--settle-s", "0.5"])
        .args(["--listen", &control, "--sensors", &sensors, "--tracker-every-ms", "10"])
        .args(["--tracker-outliers", "0.01", "--tracker-dropouts", "0.0005"])
        .args(["--ram-um", "60", "--ram-drift-um-per-h", "200"])
        .arg("--program")
        .arg(folder.path().join("tour.nc"))
        .arg("--out")
        .arg(&trace)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let programs = Programs::at(env!("CARGO_BIN_EXE_cncsim"));
    let log = folder.path().join("log");
    let mut daemon = programs.volcompd(&folder.path().join("machine.toml"), &log).unwrap();
    assert!(machine.wait().unwrap().success());
    let status = daemon.is_running();
    daemon.kill().unwrap();
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(status && text.contains("the sensor is believed"), "{text}");
    let errors = errors(&trace);
    let end = errors.last().unwrap().0;
    let before = rms(errors.iter().filter(|(t, _)| *t < 1.0).map(|(_, e)| *e));
    let after = rms(errors.iter().filter(|(t, _)| *t > end - 5.0).map(|(_, e)| *e));
    println!("tip error {before:.1} um without, {after:.1} um with what was learned, {end:.1} s");
    assert!(after < 0.3 * before, "{before:.1} um, then {after:.1} um\n{text}");
}
