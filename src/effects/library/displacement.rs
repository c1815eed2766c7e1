//! Thermal displacements of the spindle and of the structure.

use crate::data::Hidden;
use crate::extend::growth;
use crate::prelude::*;

/// Time constants of spindles, s; pairs of a fast and a slow one; of structures.
pub const SPINDLE_S: [f64; 9] = [120.0, 300.0, 600.0, 1200.0, 2400.0, 3600.0, 5400.0, 9000.0, 14400.0];
/// Exponents of the speed by which a spindle heats: friction that does not depend on it, and that of a lubricated bearing, whose
/// moment goes with the speed to the power 2/3.
const POWERS: [f64; 2] = [1.0, 5.0 / 3.0];
/// Between them, and a little beyond, the heat is that of friction; no structure takes longer.
const FRICTION: [f64; 2] = [0.8, 2.5];
const LONGEST_S: f64 = 172_800.0;
const PAIRS_S: [[f64; 2]; 5] =
    [[120.0, 1200.0], [300.0, 2400.0], [600.0, 5400.0], [1200.0, 9000.0], [2400.0, 14400.0]];
const STRUCTURE_S: [f64; 6] = [0.0, 600.0, 1200.0, 2400.0, 5400.0, 14400.0];

/// Variants of `spindle-growth`.
pub(super) fn spindle_growth(data: &Data, _: &Subject) -> Variants {
    if !data.spindle_runs() {
        return Err(Hidden::unrecorded("no speed of the spindle is logged, or it does not change"));
    }
    let ways = [vec![Axis::Z], vec![Axis::Y], vec![Axis::X], vec![Axis::Y, Axis::Z], Axis::LINEAR.to_vec()];
    let seen = ways.iter().filter(|w| w.iter().all(|a| data.sees[a.slot()]));
    let shape = |along: &[Axis], taus_s: &[f64], power| {
        let signal = |tau_s: &f64| Signal { power, ..Signal::of(Source::Spindle, *tau_s) };
        let signals = taus_s.iter().map(signal).collect();
        Growth { signals, along: along.to_vec(), reference: 0.0 }.into()
    };
    let mut shapes = Vec::new();
    for (along, power) in seen.clone().flat_map(|along| POWERS.map(|power| (along, power))) {
        shapes.extend(SPINDLE_S.map(|t| shape(along, &[t], power)));
        shapes.extend(PAIRS_S.map(|pair| shape(along, &pair, power)));
    }
    for (source, reference) in data.temperatures().filter(|(s, _)| data.is_of_spindle(s)) {
        let signals = vec![Signal::of(source.clone(), 0.0)];
        let of = |along: &Vec<Axis>| Growth { signals: signals.clone(), along: along.clone(), reference };
        shapes.extend(seen.clone().map(|along| of(along).into()));
    }
    data.structural(shapes)
}

/// Variants of `ambient-drift`.
pub(super) fn ambient_drift(data: &Data, _: &Subject) -> Variants {
    let along: Vec<Axis> = Axis::LINEAR.into_iter().filter(|a| data.sees[a.slot()]).collect();
    let mut shapes = Vec::new();
    for (source, reference) in data.temperatures().filter(|(s, _)| !data.is_of_spindle(s)) {
        shapes.extend(STRUCTURE_S.map(|tau_s| {
            let signals = vec![Signal::of(source.clone(), tau_s)];
            Growth { signals, along: along.clone(), reference }.into()
        }));
    }
    if shapes.is_empty() {
        return Err(Hidden::unrecorded("no temperature that changes by 0.2 K is logged"));
    }
    data.structural(shapes)
}

/// `d = SUM k_i (s_i - s_0)` along the directions listed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Growth {
    pub signals: Vec<Signal>,
    pub along: Vec<Axis>,
    pub reference: f64,
}

impl Form for Growth {
    fn parameters(&self) -> Vec<String> {
        let name = |s: &Signal, a: &Axis| {
            let after = if s.tau_s > 0.0 { format!("_after_{:.0}s", s.tau_s) } else { String::new() };
            let per = match s.source {
                Source::Spindle if is_linear(s) => "um_per_1000rpm",
                Source::Spindle => "um_per_1000rpm_to_the_power",
                Source::Temperature(_) => "um_per_k",
                Source::Velocity(_) => "um_per_mm_per_s",
            };
            format!("growth_{a}{after}_{per}")
        };
        self.signals.iter().flat_map(|s| self.along.iter().map(move |a| name(s, a))).collect()
    }

    fn width(&self) -> usize {
        self.signals.len() * self.along.len()
    }

    fn evaluate(&self, _: &MachineState, read: &Read<'_>, out: &mut [Vec3]) {
        for (i, s) in self.signals.iter().enumerate() {
            let v = read(s) - self.reference;
            for (j, a) in self.along.iter().enumerate() {
                out[i * self.along.len() + j] = unit(a.direction()) * v;
            }
        }
    }

    fn columns(&self) -> Vec<String> {
        self.signals.iter().map(|s| s.source.to_string()).collect()
    }

    fn drawing(&self) -> Drawing {
        Drawing::from(Over::Time).by(Branch::File)
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        growth(model, entry, &self.signals, &self.along, self.reference)
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        let lagged = self.signals.iter().zip(1..).filter(|(s, _)| s.tau_s > 0.0);
        let times = lagged.map(|(s, i)| (format!("time_constant_{i}_s"), s.tau_s));
        let is_warmth = self.signals.iter().any(|s| matches!(s.source, Source::Temperature(_)));
        let power = self.signals.iter().find(|s| !is_linear(s)).map(|s| ("exponent_1".to_owned(), s.power));
        times.chain(power).chain(is_warmth.then(|| ("reference_degc".to_owned(), self.reference))).collect()
    }

    fn is_valid(&self) -> bool {
        self.signals.iter().all(|s| s.tau_s >= 0.0 && s.power > 0.0)
    }

    fn changed(&self, f: f64) -> Vec<Shape> {
        let lags = self.signals.iter().enumerate().filter(|(_, s)| s.tau_s > 0.0);
        let lags = lags.map(|(i, _)| with(self, |g| g.signals[i].tau_s *= f));
        let is_speed = self.signals.iter().any(|s| s.source == Source::Spindle);
        let power = is_speed.then(|| with(self, |g| g.signals.iter_mut().for_each(|s| s.power *= f)));
        lags.chain(power).collect()
    }

    fn is_itself(&self) -> bool {
        let within = |s: &Signal| {
            s.tau_s <= LONGEST_S && (is_linear(s) || (FRICTION[0]..=FRICTION[1]).contains(&s.power))
        };
        self.signals.iter().all(within)
    }

    fn traits(&self) -> Traits {
        Traits { acts_along: (self.along.len() == 1).then(|| self.along[0]), ..Traits::default() }
    }

    fn signals(&self) -> Vec<&Signal> {
        self.signals.iter().collect()
    }
}

/// True where the lag follows the source itself, not a power of it.
fn is_linear(signal: &Signal) -> bool {
    (signal.power - 1.0).abs() < 1e-12
}
