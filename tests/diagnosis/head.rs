//! A machine whose head turns the tool: what the head does to a lever, written here with matrices of its own, comes back
//! under its name.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write as _;
use std::process::Command;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "fork"
chain = "[w b X Z Y C A t]"
[frame]
tool-tip-mm = [0, 0, -100]
gauge-point-mm = [0, 0, 0]
[axes.x]
travel-mm = [0, 4000]
[axes.y]
travel-mm = [0, 1500]
[axes.z]
travel-mm = [0, 1000]
[axes.c]
travel-deg = [-200, 200]
point-mm = [0, 0, 300]
[axes.a]
travel-deg = [-110, 110]
point-mm = [0, 0, 300]
"#;

const HEADER: &str = "t_s,instrument,setup,run,repeat,pair,x_mm,y_mm,z_mm,c_deg,a_deg,tool_length_mm,u_x,u_y,u_z,deviation_um\n";
/// The axes of the head meet here, mm above the spindle nose.
const PIVOT_MM: f64 = 300.0;
const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;

type V = [f64; 3];
/// A deviation, um, by the pose.
type Truth<'a> = &'a dyn Fn(&Pose) -> V;

fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A head at C and A (rad), a tool of some length.
struct Pose {
    position: V,
    c: f64,
    a: f64,
    long: f64,
}

impl Pose {
    /// Turned by A, then by C.
    fn turned(&self, v: V) -> V {
        let (sa, ca) = self.a.sin_cos();
        let (sc, cc) = self.c.sin_cos();
        let w = [v[0], ca * v[1] - sa * v[2], sa * v[1] + ca * v[2]];
        [cc * w[0] - sc * w[1], sc * w[0] + cc * w[1], w[2]]
    }

    /// From the nose of the head at zero to the tip.
    fn tip(&self) -> V {
        let t = self.turned([0.0, 0.0, -PIVOT_MM - self.long]);
        [t[0], t[1], t[2] + PIVOT_MM]
    }
}

/// A ball that the head looks at from all sides, and a grid of a tracker with the head straight and turned; two tools.
fn poses() -> Vec<(&'static str, Pose)> {
    let mut all = Vec::new();
    for long in [100.0, 250.0] {
        let sweep = (-6..=6).map(|k| (f64::from(k) * 30.0, 0.0));
        let sweep = sweep.chain((-6..=6).map(|k| (f64::from(k) * 30.0, 50.0)));
        let sweep = sweep.chain((-6..=6).map(|k| (20.0, f64::from(k) * 15.0)));
        for (c, a) in sweep.chain((-6..=6).map(|k| (110.0, f64::from(k) * 15.0))) {
            let mut pose = Pose { position: [0.0; 3], c: f64::to_radians(c), a: f64::to_radians(a), long };
            let tip = pose.tip();
            pose.position = [2000.0 - tip[0], 700.0 - tip[1], 300.0 - tip[2]];
            all.push(("rtest", pose));
        }
        for (i, x) in [0.0, 1000.0, 2100.0, 3000.0, 4000.0].into_iter().enumerate() {
            for y in [0.0, 240.0, 500.0, 770.0, 1010.0, 1260.0, 1500.0] {
                for z in [0.0, 520.0, 1000.0] {
                    let (c, a) = if i % 2 == 0 { (0.0, 0.0) } else { (40.0, 30.0) };
                    let (c, a) = (f64::to_radians(c), f64::to_radians(a));
                    all.push(("tracker", Pose { position: [x, y, z], c, a, long }));
                }
            }
        }
    }
    all
}

/// Measures everything twice; the report.
fn diagnosed(truth: Truth<'_>) -> serde_json::Value {
    let folder = tempfile::tempdir().unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let noise = Normal::new(0.0, 1.0).unwrap();
    let mut text = HEADER.to_owned();
    let all = poses();
    for repeat in 1..=2 {
        for (n, (instrument, p)) in all.iter().enumerate() {
            let d = truth(p);
            let run = repeat * 100 + n / 13;
            let t = 8 * (repeat * all.len() + n);
            let setup = i32::from(*instrument == "tracker");
            for k in 0..3 {
                let mut u = [0; 3];
                u[k] = 1;
                let measured = d[k] + noise.sample(&mut random);
                let [x, y, z] = p.position;
                writeln!(
                    text,
                    "{t},{instrument},{setup},{run},{repeat},{n},{x},{y},{z},{},{},{},{},{},{},{measured}",
                    p.c.to_degrees(),
                    p.a.to_degrees(),
                    p.long,
                    u[0],
                    u[1],
                    u[2]
                )
                .unwrap();
            }
        }
    }
    std::fs::write(folder.path().join("m.toml"), MODEL).unwrap();
    std::fs::write(folder.path().join("d.csv"), text).unwrap();
    let out = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["diagnose", "--model", "m.toml", "--data", "d.csv", "--out", "gap"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_str(&std::fs::read_to_string(folder.path().join("gap/report.json")).unwrap()).unwrap()
}

fn declared(report: &serde_json::Value) -> Vec<String> {
    let causes = report["causes"].as_array().unwrap().iter().filter(|c| c["declared"] == true);
    let label = |c: &serde_json::Value| {
        let [effect, subject] = ["effect", "subject"].map(|k| c[k].as_str().unwrap_or_default());
        if subject.is_empty() { effect.to_owned() } else { format!("{effect}:{subject}") }
    };
    causes.map(label).collect()
}

#[test]
fn what_acts_through_a_head_is_found_under_its_name() {
    let um = 1e3;
    let tilt =
        |p: &Pose| p.turned(cross([4.0 * ARCSEC, -3.0 * ARCSEC, 0.0], [0.0, 0.0, -p.long])).map(|v| v * um);
    let longer = |p: &Pose| p.turned([0.0, 0.0, -p.long]).map(|v| v * 25e-6 * um);
    // a carriage that runs out on a beam, whose slope is the derivative of its drop
    let sag = |p: &Pose| {
        let s = p.position[1] / 1500.0;
        let turn = cross([-2.5 * s.powf(1.5) / 1500.0, 0.0, 0.0], p.tip());
        [turn[0], turn[1], turn[2] - s.powf(2.5)].map(|v| 8.0 * v)
    };
    let yaw =
        |p: &Pose| cross([0.0, 0.0, 5.0 * ARCSEC * (p.position[1] / 330.0).sin()], p.tip()).map(|v| v * um);
    // the axis C leans, and the head with it
    let lean = |p: &Pose| cross([3.0 * ARCSEC, 2.0 * ARCSEC, 0.0], p.tip()).map(|v| v * um);
    let cases: [(&str, Truth<'_>); 5] = [
        ("spindle-tilt", &tilt),
        ("tool-length", &longer),
        ("sag:y", &sag),
        ("angular:ecy", &yaw),
        ("rotary-location:c", &lean),
    ];
    for (label, truth) in cases {
        let report = diagnosed(truth);
        assert_eq!(declared(&report), [label], "{:#}", report["causes"]);
    }
}
