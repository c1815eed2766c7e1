//! Cost of one model evaluation beside the bare limit, in one run: `cargo bench --bench cycle [-- --json | --check]`.
//!
//! The bare limit is a hand-written loop for the same machine: one sine/cosine pair per axis, angle-addition
//! recurrence, dot products for six motions, lever terms; for tables two neighbouring values of each array. All run
//! in short alternating blocks, so that noise of the computer and the size of its caches hit both sides; ratios of
//! the medians count, never absolute times. `--check` exits with 1 where a ratio is above its limit in two runs.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
#![expect(
    clippy::expect_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a benchmark is a program for people"
)]

use std::hint::black_box;
use std::time::Instant;

use volcomp::model::axes::{AxisName, MAX_AXES};
use volcomp::model::curve::{Curve, ErrorFunction, Fourier, Interpolation, Table};
use volcomp::model::geometry::Vec3;
use volcomp::model::{AxisSpec, Chain, Component, ErrorSymbol, Model, ModelSpec, Pose};

const ORDER: usize = 5;
const SPAN: f64 = 500.0;
const PERIOD: f64 = 1000.0;
const BLOCK: usize = 2_000;
const BLOCKS: usize = 400;
const INPUTS: usize = 499;
const LONG: usize = 10_001;
/// Three axes to the bare loop, five axes to three, tables of 10001 points to those of 11 and what a bare loop
/// pays for the memory of the long ones.
const LIMITS: [f64; 3] = [2.0, 5.0, 1.5];
const ATTEMPTS: usize = 2;

fn coefficient(axis: usize, component: usize, n: usize) -> f64 {
    let scale = if component < 3 { 5e-3 } else { 2e-5 };
    scale * ((axis * 31 + component * 7 + n * 3) as f64).sin() / (n + 1) as f64
}

fn fourier(axis: usize, component: usize) -> Curve {
    let cos: Vec<f64> = (0..ORDER).map(|n| coefficient(axis, component, 2 * n)).collect();
    let sin: Vec<f64> = (0..ORDER).map(|n| coefficient(axis, component, 2 * n + 1)).collect();
    Curve::Fourier(Fourier::new(0.0, SPAN, PERIOD, 0.0, 0.0, &cos, &sin).expect("valid series"))
}

fn values(axis: usize, component: usize, points: usize) -> Vec<f64> {
    (0..points).map(|i| coefficient(axis, component, i % 10)).collect()
}

fn table(axis: usize, component: usize, points: usize) -> Curve {
    let x: Vec<f64> = (0..points).map(|i| SPAN * i as f64 / (points - 1) as f64).collect();
    let v = values(axis, component, points);
    Curve::Table(Table::new(x, v, None, Interpolation::Linear).expect("valid table"))
}

fn model(chain: &str, curve: impl Fn(usize, usize) -> Curve) -> Model {
    let mut spec = ModelSpec::new("bench", Chain::parse(chain).expect("chain"));
    spec.tool_tip = Vec3::new(0.0, 0.0, -150.0);
    let names: Vec<AxisName> = spec.chain.axes().iter().map(|a| a.name).collect();
    for (i, name) in names.iter().enumerate() {
        let mut axis = AxisSpec::new(*name);
        axis.travel = Some([0.0, SPAN]);
        spec.axes.push(axis);
        for component in Component::ALL {
            let symbol = ErrorSymbol::Motion { component, axis: *name };
            spec.errors.push((symbol, ErrorFunction::single(curve(i, component.index()))));
        }
    }
    for (symbol, value) in [("ec0y", 2e-5), ("eb0z", -3e-5), ("ea0z", 1e-5)] {
        let symbol = ErrorSymbol::parse(symbol).expect("symbol");
        spec.errors.push((symbol, ErrorFunction::single(Curve::Constant(value))));
    }
    Model::new(&spec).expect("valid model")
}

/// The bare limit for `[w b X Y Z t]`.
struct Bare {
    /// per axis: for each harmonic cos and sin weights of the six motions
    weights: [[[[f64; 6]; 2]; ORDER]; 3],
    squareness: [f64; 3],
    tip: [f64; 3],
}

impl Bare {
    fn new() -> Self {
        let weights = std::array::from_fn(|a| {
            std::array::from_fn(|n| {
                std::array::from_fn(|part| std::array::from_fn(|c| coefficient(a, c, 2 * n + part)))
            })
        });
        Self { weights, squareness: [2e-5, -3e-5, 1e-5], tip: [0.0, 0.0, -150.0] }
    }

    fn series(&self, q: [f64; 3]) -> [f64; 3] {
        let omega = core::f64::consts::TAU / PERIOD;
        self.correction(q, |a| {
            let (s1, c1) = (omega * q[a]).sin_cos();
            let (mut s, mut c) = (s1, c1);
            let mut m = [0.0; 6];
            for [wc, ws] in &self.weights[a] {
                for k in 0..6 {
                    m[k] += wc[k] * c + ws[k] * s;
                }
                (s, c) = (s * c1 + c * s1, c * c1 - s * s1);
            }
            m
        })
    }

    /// From values at equally spaced points, linear between two of them: `values[axis][motion][point]`.
    fn tables(&self, q: [f64; 3], values: &[[Vec<f64>; 6]; 3]) -> [f64; 3] {
        self.correction(q, |a| {
            let last = values[a][0].len() - 1;
            let place = q[a] * (last as f64 / SPAN);
            let i = (place as usize).min(last - 1);
            let share = place - i as f64;
            std::array::from_fn(|k| {
                let v = &values[a][k];
                v[i] + share * (v[i + 1] - v[i])
            })
        })
    }

    /// The correction at `q` from six motions of each axis.
    fn correction(&self, q: [f64; 3], motions: impl Fn(usize) -> [f64; 6]) -> [f64; 3] {
        let mut e = [0.0; 3];
        let mut lever = [self.tip[0], self.tip[1] + q[1], self.tip[2] + q[2]];
        for a in 0..3 {
            let m = motions(a);
            e[0] += m[0] + m[4] * lever[2] - m[5] * lever[1];
            e[1] += m[1] + m[5] * lever[0] - m[3] * lever[2];
            e[2] += m[2] + m[3] * lever[1] - m[4] * lever[0];
            if a < 2 {
                lever[a + 1] -= q[a + 1];
            }
        }
        let [c0y, b0z, a0z] = self.squareness;
        [-(e[0] - c0y * q[1] + b0z * q[2]), -(e[1] - a0z * q[2]), -e[2]]
    }
}

fn median(mut v: Vec<f64>) -> f64 {
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

fn main() {
    let flag = |name: &str| std::env::args().any(|a| a == name);
    let bare = Bare::new();
    let three = model("[w b X Y Z t]", fourier);
    let five = model("[w b X Y Z C A t]", fourier);
    let short = model("[w b X Y Z t]", |a, c| table(a, c, 11));
    let long = model("[w b X Y Z t]", |a, c| table(a, c, LONG));
    let arrays: [[Vec<f64>; 6]; 3] = std::array::from_fn(|a| std::array::from_fn(|c| values(a, c, LONG)));
    check(&three, |q| bare.series(q));
    check(&long, |q| bare.tables(q, &arrays));

    let at = |i: usize| [(i % 499) as f64, (i * 7 % 487) as f64, (i * 3 % 491) as f64];
    let pose = |i: usize| {
        let [x, y, z] = at(i);
        let mut position = [0.0; MAX_AXES];
        position[..5].copy_from_slice(&[x, y, z, x * 0.005, 0.2 + y * 0.002]);
        Pose::at(position)
    };
    // inputs are ready before the clock runs, for both sides
    let points: Vec<[f64; 3]> = (0..INPUTS).map(at).collect();
    let poses: Vec<Pose> = (0..INPUTS).map(pose).collect();
    let measure = || {
        let mut times: [Vec<f64>; 6] = Default::default();
        for _ in 0..BLOCKS {
            times[0].push(block(|i| bare.series(black_box(points[i % INPUTS]))));
            times[1].push(block(|i| three.correct(black_box(&poses[i % INPUTS])).1.offset));
            times[2].push(block(|i| five.correct(black_box(&poses[i % INPUTS])).1.offset));
            times[3].push(block(|i| short.correct(black_box(&poses[i % INPUTS])).1.offset));
            times[4].push(block(|i| bare.tables(black_box(points[i % INPUTS]), &arrays)));
            times[5].push(block(|i| long.correct(black_box(&poses[i % INPUTS])).1.offset));
        }
        Figures { ns: times.map(median) }
    };
    let mut figures = measure();
    if flag("--check") {
        for _ in 1..ATTEMPTS {
            if figures.within_limits() {
                break;
            }
            eprintln!("retried: bench cycle");
            figures = measure();
        }
    }
    if flag("--json") {
        figures.print_json()
    } else {
        figures.print()
    }
    if flag("--check") && !figures.within_limits() {
        std::process::exit(1);
    }
}

/// Median ns per call: bare loop, three axes, five axes, short tables, bare loop over long tables, long tables.
struct Figures {
    ns: [f64; 6],
}

impl Figures {
    /// Three axes to the bare loop, five axes to three, long tables to short ones and a bare loop over the long ones.
    fn ratios(&self) -> [f64; 3] {
        let [bare, three, five, short, arrays, long] = self.ns;
        [three / bare, five / three, long / (short + arrays)]
    }

    fn within_limits(&self) -> bool {
        self.ratios().iter().zip(LIMITS).all(|(ratio, limit)| *ratio <= limit)
    }

    fn print_json(&self) {
        let [three, five, tables] = self.ratios();
        println!(
            "{{\"bare_ns\": {:.1}, \"three_axis_ratio\": {three:.3}, \"five_axis_ratio\": {five:.3}, \"long_table_ratio\": {tables:.3}}}",
            self.ns[0]
        );
    }

    fn print(&self) {
        let ([bare, three, five, short, arrays, long], [r3, r5, rt]) = (self.ns, self.ratios());
        let [l3, l5, lt] = LIMITS;
        println!("bare loop, 18 Fourier motions of order 5     {bare:7.1} ns");
        println!("three-axis model, the same                   {three:7.1} ns   {r3:.2} x bare (limit {l3})");
        println!(
            "five-axis model, 30 motions                  {five:7.1} ns   {r5:.2} x three-axis (limit {l5})"
        );
        println!("three-axis, 18 tables of 11 points           {short:7.1} ns");
        println!("bare loop, 18 arrays of 10001 points         {arrays:7.1} ns");
        println!(
            "three-axis, 18 tables of 10001 points        {long:7.1} ns   {rt:.2} x both above (limit {lt})"
        );
    }
}

/// ns per call over one block.
fn block<T>(mut call: impl FnMut(usize) -> T) -> f64 {
    let start = Instant::now();
    for i in 0..BLOCK {
        black_box(call(i));
    }
    start.elapsed().as_nanos() as f64 / BLOCK as f64
}

/// The bare loop must compute the same correction, or it is no limit.
fn check(model: &Model, bare: impl Fn([f64; 3]) -> [f64; 3]) {
    for q in [[0.0, 0.0, 0.0], [100.0, 200.0, 300.0], [499.0, 3.0, 250.0]] {
        let mut position = [0.0; MAX_AXES];
        position[..3].copy_from_slice(&q);
        let (_, c) = model.correct(&Pose::at(position));
        let b = bare(q);
        for (model, bare) in c.offset.iter().zip(b) {
            assert!((model - bare).abs() < 1e-12, "at {q:?}: {model} and {bare}");
        }
    }
}
