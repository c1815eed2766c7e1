//! What `cncsim serve --sensors` sends of its 5-DOF lasers is the motion of the carriage, as `docs/how-to/sensors.md` says, and
//! nothing else where the tracker is left out.
#![expect(clippy::disallowed_methods, reason = "the test writes files and listens like a daemon")]

use std::io::{BufRead as _, BufReader};
use std::net::TcpListener;
use std::process::{Command, Stdio};

use serde_json::Value;
use simulator::truth::chain::Side;
use simulator::truth::{TruthMachine, VMC_850};
use volcomp::model::axes::AxisName;

/// RMS of what a straight line leaves of values over positions.
fn about_line(rows: &[(f64, f64)]) -> f64 {
    let n = rows.len() as f64;
    let (mx, my) = (rows.iter().map(|r| r.0).sum::<f64>() / n, rows.iter().map(|r| r.1).sum::<f64>() / n);
    let xx: f64 = rows.iter().map(|r| (r.0 - mx).powi(2)).sum();
    let slope = rows.iter().map(|r| (r.0 - mx) * (r.1 - my)).sum::<f64>() / xx;
    (rows.iter().map(|r| (r.1 - my - slope * (r.0 - mx)).powi(2)).sum::<f64>() / n).sqrt()
}

#[test]
fn lasers_send_the_motion_of_their_carriage() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("p.nc");
    // one axis after the other through its travel, so that the time of a line says where its axis stood
    std::fs::write(
        &program,
        "G21 G90 G94\nG0 X0 Y0 Z-500\nG1 F20000 X850\nG1 X0\nG1 Y500\nG1 Y0\nG1 Z0\nG1 Z-500\nM30\n",
    )
    .unwrap();
    let trace = folder.path().join("trace.csv");
    let daemon = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = daemon.local_addr().unwrap().to_string();
    let mut control = Command::new(env!("CARGO_BIN_EXE_cncsim"))
        .args(["serve", "--listen", "127.0.0.1:0", "--as-fast-as-possible", "--settle-s", "0"])
        .args(["--cycle-ms", "5", "--sensors", &address, "--no-tracker"])
        .args(["--laser-x", "x", "--laser-y", "y", "--laser-z", "z", "--laser-every-ms", "5"])
        .arg("--program")
        .arg(&program)
        .arg("--out")
        .arg(&trace)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let (stream, _) = daemon.accept().unwrap();
    let lines: Vec<Value> =
        BufReader::new(stream).lines().map(|l| serde_json::from_str(&l.unwrap()).unwrap()).collect();
    assert!(control.wait().unwrap().success());
    assert!(lines.iter().all(|l| ["x", "y", "z"].contains(&l["sensor"].as_str().unwrap())), "no tracker");
    let machine = TruthMachine::from_toml(VMC_850).unwrap();
    let mut reader = csv::Reader::from_path(&trace).unwrap();
    let headers = reader.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|h| h == name).unwrap();
    let (t, at) = (column("t_s"), ["x_true_mm", "y_true_mm", "z_true_mm"].map(column));
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    for (k, axis) in [AxisName::X, AxisName::Y, AxisName::Z].into_iter().enumerate() {
        let name = axis.lower().to_string();
        let sign = if machine.drawing(k).unwrap().side == Side::Workpiece { -1.0 } else { 1.0 };
        let own: Vec<&Value> = lines.iter().filter(|l| l["sensor"] == name.as_str()).collect();
        assert!(own.len() > 100, "{axis}: {}", own.len());
        let d = axis.direction();
        for (key, component) in [
            ("ey_um", (d + 1) % 3),
            ("ez_um", (d + 2) % 3),
            ("ea_arcsec", 3 + d),
            ("eb_arcsec", 3 + (d + 1) % 3),
            ("ec_arcsec", 3 + (d + 2) % 3),
        ] {
            let scale = if component < 3 { 1e3 } else { 206_264.806 };
            let rest = |sign: f64| {
                let rows: Vec<(f64, f64)> = own
                    .iter()
                    .map(|line| {
                        let time = line["t_s"].as_f64().unwrap() - 4711.0;
                        let row = &rows[(time / 0.005).round() as usize];
                        assert!((row[t].parse::<f64>().unwrap() - time).abs() < 1e-3);
                        let q: f64 = row[at[k]].parse().unwrap();
                        let value = line["five_dof"][key].as_f64().unwrap();
                        (q, value - sign * scale * machine.true_motion(k, q, 0)[component])
                    })
                    .collect();
                about_line(&rows)
            };
            let (carriage, other) = (rest(sign), rest(-sign));
            // noise of the laser: 0.3 um, 0.1 arcsec; reversal of the machine
            assert!(carriage < 0.5 && carriage <= other + 1e-9, "{axis} {key}: {carriage} {other}");
        }
    }
}
