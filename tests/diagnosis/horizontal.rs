//! A horizontal boring mill: its ram drops against Y as it comes out against Z, by formulas of this file.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use serde_json::Value;

const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "borer"
chain = "[w B' X' b Y Z t]"
[frame]
tool-tip-mm = [0, 0, -120]
gauge-point-mm = [0, 0, 0]
VERTICAL
[axes.b]
travel-deg = [-400, 400]
point-mm = [300, 0, 0]
[axes.x]
travel-mm = [0, 600]
[axes.y]
travel-mm = [0, 450]
[axes.z]
travel-mm = [0, 400]
"#;

/// Along x, y, z, um: a ram of 700 mm that hangs over by 300 mm when it is drawn in, with a weight at its end, and a tool of `long` mm.
fn drop_um(z: f64, long: f64) -> [f64; 3] {
    let s = (700.0 - z) / 700.0;
    let slope_um_per_mm = 60.0 * 1.5 * s.powi(2) / 700.0;
    [0.0, -60.0 * s.powi(3) - slope_um_per_mm * long, 0.0]
}

/// Lines over Z at four heights and with two tools, over Y and over X, read along all three directions.
fn session() -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let noise = Normal::new(0.0, 0.6).unwrap();
    let mut text =
        "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,tool_length_mm,u_x,u_y,u_z,deviation_um\n".to_owned();
    let (mut t, mut run) = (0.0, 0);
    for (place, long) in (0..4).flat_map(|place| [120.0, 320.0].map(|long| (place, long))) {
        let at = f64::from(place) / 3.0;
        for (axis, repeat) in (0..3).flat_map(|axis| [1, 2].map(|repeat| (axis, repeat))) {
            run += 1;
            for k in 0..21 {
                let mut p = [600.0 * at, 450.0 * at, 400.0 * at];
                p[axis] = [600.0, 450.0, 400.0][axis] * f64::from(k) / 20.0;
                let drop = drop_um(p[2], long);
                t += 4.0;
                for (u, name) in [[1, 0, 0], [0, 1, 0], [0, 0, 1]].into_iter().zip(0..3) {
                    let um = drop[name] + noise.sample(&mut rng);
                    let [x, y, z] = p;
                    writeln!(
                        text,
                        "{t},tracker,{place},{run},{repeat},{x},{y},{z},{long},{},{},{},{um:.3}",
                        u[0], u[1], u[2]
                    )
                    .unwrap();
                }
            }
        }
    }
    text
}

/// What `volcomp` says in a folder.
fn volcomp(folder: &Path, args: &[&str]) {
    let out = Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).current_dir(folder).output().unwrap();
    assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
}

/// The report of the session beside a model.
fn diagnosed(folder: &Path, model: &str) -> Value {
    std::fs::write(folder.join("d.csv"), session()).unwrap();
    volcomp(folder, &["diagnose", "--model", model, "--data", "d.csv", "--out", "gap"]);
    serde_json::from_str(&std::fs::read_to_string(folder.join("gap/report.json")).unwrap()).unwrap()
}

/// Names of the causes declared, and the notes, with this line in `[frame]`.
fn said(vertical: &str) -> (Vec<String>, String) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("m.toml"), MODEL.replace("VERTICAL", vertical)).unwrap();
    let report = diagnosed(folder.path(), "m.toml");
    let causes = report["causes"].as_array().unwrap().iter().filter(|c| c["declared"] == true);
    let label = |c: &Value| format!("{}:{}", c["effect"].as_str().unwrap(), c["subject"].as_str().unwrap());
    (causes.map(label).collect(), report["notes"].to_string())
}

#[test]
fn the_drop_of_a_horizontal_ram_has_its_name() {
    const ASSUMED: &str = "y is taken for the axis that points up";
    let (causes, notes) = said("");
    assert_eq!(causes, ["sag:z"]);
    assert!(notes.contains(ASSUMED), "{notes}");
    let (causes, notes) = said("vertical = \"y\"");
    assert!(causes == ["sag:z"] && !notes.contains(ASSUMED), "{causes:?} {notes}");
    // of an upright machine it is something else
    let (causes, notes) = said("vertical = \"z\"");
    assert!(!causes.contains(&"sag:z".to_owned()) && !notes.contains(ASSUMED), "{causes:?} {notes}");
}

#[test]
fn a_model_with_the_drop_of_a_ram_leaves_nothing_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("m.toml"), MODEL.replace("VERTICAL", "vertical = \"y\"")).unwrap();
    let before = diagnosed(folder, "m.toml");
    volcomp(
        folder,
        &["model", "extend", "--model", "m.toml", "--add", "gap/addition.toml", "--out", "n.toml"],
    );
    let after = diagnosed(folder, "n.toml");
    let [was, is] = [&before, &after].map(|r| r["gap"]["rms_um"].as_f64().unwrap());
    // the noise
    assert!(was > 9.0 && is < 0.62, "{was} um, then {is} um");
    assert_eq!(after["verdict"], "no-gap");
}
