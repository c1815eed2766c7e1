//! Plans of any kind, drawn: one to three axes, feeds, tools, instruments and columns in any combination. Whatever was measured has an
//! answer, or a refusal that says what is missing.

#![expect(clippy::disallowed_methods, reason = "the test writes files and runs the program")]

use core::f64::consts::TAU;
use std::process::Command;

use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::support::normal;

/// Plans that are drawn; `VOLCOMP_PLANS` asks for more.
const PLANS: u64 = 60;
const INSTRUMENTS: [&str; 8] =
    ["laser", "probe", "ballbar", "tracker", "cmm", "rtest", "straightedge", "level"];
const AXES: [&str; 3] = ["x", "y", "z"];

/// Where the rotary axes stand.
const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "trunnion"
chain = "[w C' A' b X Y Z t]"
[frame]
workpiece-origin-mm = [0, 0, 0]
tool-tip-mm = [0, 0, 0]
gauge-point-mm = [0, 0, 0]
[axes.x]
travel-mm = [-200, 1300]
[axes.y]
travel-mm = [-200, 1300]
[axes.z]
travel-mm = [-200, 1300]
[axes.a]
travel-deg = [-120, 120]
point-mm = [250, 200, 50]
[axes.c]
travel-deg = [-400, 400]
point-mm = [250, 200, 0]
"#;

/// What the readings of one plan have in common.
struct Plan {
    axes: Vec<usize>,
    rotary: Option<&'static str>,
    tools: Option<usize>,
    feeds: Option<usize>,
    columns: Vec<String>,
    is_circle: bool,
}

impl Plan {
    fn new(draw: &mut ChaCha8Rng) -> Self {
        let mut axes: Vec<usize> = vec![0, 1, 2];
        axes.swap(0, draw.random_range(0..3));
        axes.truncate([1, 1, 2, 3][draw.random_range(0..4)]);
        let rotary = [None, None, Some("c"), Some("a")][draw.random_range(0..4)];
        let [tools, feeds] = [0, 1].map(|_| [None, Some(1), Some(2), Some(3)][draw.random_range(0..4)]);
        let mut columns: Vec<String> =
            ["t_s", "instrument", "setup", "run", "repeat", "u_x", "u_y", "u_z", "deviation_um"]
                .map(str::to_owned)
                .to_vec();
        columns.extend(axes.iter().map(|a| format!("{}_mm", AXES[*a])));
        columns.extend(rotary.map(|r| format!("{r}_deg")));
        let mut maybe = |share: f64, names: &[&str]| {
            if draw.random_bool(share) {
                columns.extend(names.iter().map(|n| (*n).to_owned()));
            }
        };
        maybe(0.6, &["pair"]);
        maybe(0.15, &["force_x_n"]);
        maybe(0.2, &["range_mm"]);
        maybe(if tools.is_some() { 1.0 } else { 0.0 }, &["tool_length_mm"]);
        maybe(if feeds.is_some() { 1.0 } else { 0.0 }, &["moving"]);
        if draw.random_bool(0.3) {
            columns.extend(axes.iter().map(|a| format!("dir_{}", AXES[*a])));
        }
        let is_circle = axes.len() > 1 && draw.random_bool(0.3);
        Self { axes, rotary, tools, feeds, columns, is_circle }
    }

    /// Positions of the linear axes and the direction of measurement at the k-th of `n` readings.
    fn place(&self, moves: usize, speed: f64, sign: f64, (k, n): (usize, usize)) -> ([f64; 3], [f64; 3]) {
        let (mut at, mut u) = ([100.0; 3], [0.0; 3]);
        if self.is_circle {
            let (sin, cos) = (TAU * (k as f64 + 0.5) / n as f64 * sign).sin_cos();
            for (axis, v) in self.axes.iter().zip([cos, sin]) {
                (at[*axis], u[*axis]) = (100.0 * v, v);
            }
        } else {
            let turned = if sign > 0.0 { k } else { n - 1 - k };
            at[moves] = if speed > 0.0 {
                250.0 + speed * 0.05 * sign * (k as f64 - 0.5 * n as f64)
            } else {
                30.0 * turned as f64
            };
            u[moves] = 1.0;
        }
        (at, u)
    }

    fn table(&self, seed: u64, draw: &mut ChaCha8Rng) -> String {
        let mut noise = normal(seed);
        let mut any = |of: &[usize]| of[draw.random_range(0..of.len())];
        let (n, repeats, instruments) = (any(&[2, 5, 11, 21, 40]), any(&[1, 1, 2, 3, 5]), any(&[1, 1, 2]));
        let (first, step_um) = (any(&[0, 1, 2, 3, 4, 5, 6, 7]), [0.0, 0.1, 3.0][any(&[0, 0, 1, 2])]);
        let slope_um = any(&[0, 5, 20]) as f64 * 1e-3;
        let reversal_um = any(&[0, 3, 10]) as f64;
        let mut rows = vec![self.columns.join(",")];
        let (mut t, mut run) = (0.0, 0);
        for setup in 0..instruments {
            let instrument = INSTRUMENTS[(first + 3 * setup) % INSTRUMENTS.len()];
            for repeat in 0..repeats {
                for part in 0..self.tools.unwrap_or(1).max(self.feeds.unwrap_or(1)) {
                    for sign in [1.0, -1.0] {
                        run += 1;
                        t += [5.0, 60.0, 3600.0][run % 3];
                        let moves = self.axes[run % self.axes.len()];
                        let speed = self.feeds.map_or(0.0, |f| [10.0, 30.0, 90.0][part % f]);
                        for k in 0..n {
                            t += if speed > 0.0 { 0.05 } else { 8.0 };
                            let (at, u) = self.place(moves, speed, sign, (k, n));
                            let mut read_um = 0.5 * noise();
                            for (at, u) in at.iter().zip(u) {
                                read_um += u * (slope_um * at + 0.5 * reversal_um * sign);
                            }
                            if step_um > 0.0 {
                                read_um = (read_um / step_um).round() * step_um;
                            }
                            let value = |column: &String| match column.as_str() {
                                "t_s" => format!("{t:.3}"),
                                "instrument" => instrument.to_owned(),
                                "setup" => (setup + 1).to_string(),
                                "run" => run.to_string(),
                                "repeat" => (repeat + 1).to_string(),
                                "pair" => {
                                    (200 * (10 * setup + 2 * part + usize::from(sign > 0.0)) + k).to_string()
                                }
                                "u_x" | "u_y" | "u_z" => {
                                    u[usize::from(column.as_bytes()[2] - b'x')].to_string()
                                }
                                "deviation_um" => format!("{read_um:.4}"),
                                "force_x_n" => (100 * (k % 2)).to_string(),
                                "range_mm" => (1000 + 10 * k).to_string(),
                                "tool_length_mm" => {
                                    [100, 150, 250][part % self.tools.unwrap_or(1)].to_string()
                                }
                                "moving" => u8::from(speed > 0.0).to_string(),
                                "x_mm" | "y_mm" | "z_mm" => {
                                    format!("{:.4}", at[usize::from(column.as_bytes()[0] - b'x')])
                                }
                                "dir_x" | "dir_y" | "dir_z" => sign.to_string(),
                                _ => (30 * (k % 4)).to_string(),
                            };
                            rows.push(self.columns.iter().map(value).collect::<Vec<_>>().join(","));
                        }
                    }
                }
            }
        }
        rows.join("\n") + "\n"
    }
}

#[test]
fn plans_of_any_kind_have_an_answer_or_a_refusal() {
    let plans = std::env::var("VOLCOMP_PLANS").map_or(PLANS, |n| n.parse().unwrap());
    let mut answered = 0;
    for seed in 0..plans {
        let mut draw = ChaCha8Rng::seed_from_u64(seed);
        let plan = Plan::new(&mut draw);
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("session.csv");
        std::fs::write(&path, plan.table(seed, &mut draw)).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_volcomp"));
        command.args(["diagnose", "--json"]).arg(&path);
        if plan.rotary.is_some() {
            let model = directory.path().join("model.toml");
            std::fs::write(&model, MODEL).unwrap();
            command.arg("--model").arg(model);
        }
        let done = command.output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr);
        let which = format!("{seed}: {} {:?} {:?}", plan.columns.join(","), plan.tools, plan.rotary);
        match done.status.code() {
            Some(0) => {
                let report: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
                assert!(report["verdict"].is_string(), "{which}");
                answered += 1;
            }
            Some(65) => assert!(said.starts_with("error: "), "{which}: {said}"),
            _ => panic!("{which}: {said}"),
        }
    }
    assert!(4 * answered > 3 * plans, "{answered} of {plans}");
}
