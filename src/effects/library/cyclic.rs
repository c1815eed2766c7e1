//! Periodic error of a screw, a worm or an encoder.

use core::ops::RangeInclusive;

use volcomp_estimate::SpectralWindow;

use crate::prelude::*;

/// Pitches of screws and scales, mm.
const PITCHES: [f64; 29] = [
    0.008, 0.01, 0.02, 0.04, 0.1, 0.2, 0.5, 1.0, 2.0, 2.5, 2.54, 3.0, 4.0, 5.0, 5.08, 6.0, 6.35, 8.0, 10.0,
    12.0, 12.7, 15.0, 16.0, 20.0, 25.0, 25.4, 30.0, 32.0, 40.0,
];
/// Modules of racks, mm: their pitch is pi times that.
const MODULES: [f64; 4] = [1.0, 2.0, 3.0, 4.0];
/// Most teeth of a worm wheel whose every number is tried, and finer divisions of wheels and scales.
const TEETH_MAX: usize = 180;
const LINES: [usize; 26] = [
    192, 200, 216, 225, 240, 256, 270, 288, 300, 320, 360, 400, 480, 500, 512, 600, 720, 900, 1000, 1024,
    1800, 2048, 3600, 5000, 9000, 18_000,
];
/// Steps shorter than a quarter of a period that show it.
const FINE_STEPS: usize = 24;
/// Longest pitch, as a share of half the range.
const LONGEST: f64 = 0.8;
/// Farther from a pitch of the catalogue, in periods over the travel, it is another one.
const SAME_PITCH: f64 = 0.5;
/// A pitch is known to a small part of a period over the travel: its share of a step of refinement.
const PITCH_STEP: f64 = 0.04;

/// Variants of `cyclic`.
pub(super) fn cyclic(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    let Some([low, high]) = data.moved(axis)? else { return Ok(Vec::new()) };
    let positions = if axis.is_linear() { &data.positions[axis.slot()] } else { &data.targets[axis.slot()] };
    let mut steps: Vec<f64> = positions.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    // some of the positions lie close together, wherever, or they are so unequal that no slower wave looks the same
    let step = steps.get(FINE_STEPS).copied().unwrap_or(f64::INFINITY);
    let window = SpectralWindow::new(&data.targets[axis.slot()]);
    let seen = |p: f64| p < LONGEST * 0.5 * (high - low) && (p > 4.0 * step || !window.is_aliased(p));
    let shapes = if axis.is_linear() { screw(axis, &seen) } else { worm(data, axis, &seen) };
    if shapes.is_empty() {
        return Err("at these positions the error of a screw's pitch looks like a slower one; measure at unequal distances".into());
    }
    Ok(shapes)
}

/// Waves of a linear axis whose pitch and harmonics the positions show.
fn screw(axis: Axis, seen: &dyn Fn(f64) -> bool) -> Vec<Shape> {
    let mut pitches: Vec<f64> = catalogue().filter(|p| seen(*p)).collect();
    pitches.sort_by(f64::total_cmp);
    let each = pitches.into_iter().flat_map(|p| [(p, 1), (p, 2)]);
    let shown = each.filter(|(p, harmonics)| seen(p / *harmonics as f64));
    shown.map(|(pitch_mm, harmonics)| Cyclic { axis, along: axis, pitch_mm, harmonics }.into()).collect()
}

/// Waves of a rotary axis: whole numbers in a turn, beyond those of an eccentric scale.
fn worm(data: &Data, axis: Axis, seen: &dyn Fn(f64) -> bool) -> Vec<Shape> {
    let Some(frame) = data.frame(axis) else { return Vec::new() };
    let all = (3..=TEETH_MAX).chain(LINES).flat_map(|waves| [(waves, 1), (waves, 2)]);
    let shown = all.filter(|(waves, harmonics)| (1..=*harmonics).all(|n| seen(TAU / (waves * n) as f64)));
    shown.map(|(waves, harmonics)| RotaryCyclic { frame: frame.clone(), waves, harmonics }.into()).collect()
}

/// The pitches that are tried, mm.
fn catalogue() -> impl Iterator<Item = f64> {
    PITCHES.into_iter().chain(MODULES.map(|m| m * PI))
}

/// Cosine, less 1, and sine of each order of a phase: waves that are zero at phase 0.
pub(super) fn harmonics(orders: RangeInclusive<usize>, phase: f64) -> impl Iterator<Item = f64> {
    let each = orders.map(move |n| (n as f64 * phase).sin_cos());
    each.flat_map(|(s, c)| [c - 1.0, s])
}

/// `SUM c_n cos(2 pi n x/pitch) - c_n + s_n sin(2 pi n x/pitch)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cyclic {
    pub axis: Axis,
    pub along: Axis,
    pub pitch_mm: f64,
    pub harmonics: usize,
}

impl Form for Cyclic {
    fn parameters(&self) -> Vec<String> {
        (1..=self.harmonics).flat_map(|n| [format!("cos{n}_um"), format!("sin{n}_um")]).collect()
    }

    fn width(&self) -> usize {
        self.harmonics.saturating_mul(2)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let phase = TAU * m.position[self.axis.slot()] / self.pitch_mm;
        let along = unit(self.along.direction());
        out.iter_mut().zip(harmonics(1..=self.harmonics, phase)).for_each(|(o, v)| *o = along * v);
    }

    fn drawing(&self) -> Drawing {
        Over::Period(self.axis, self.pitch_mm).into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.axis, Sampling::Waves(self.pitch_mm / self.harmonics as f64))
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        named(&[("pitch_mm", self.pitch_mm)])
    }

    fn is_valid(&self) -> bool {
        self.pitch_mm > 0.0
    }

    fn is_within(&self, span: &Span<'_>, _: [f64; 3]) -> bool {
        let [low, high] = span(self.axis);
        catalogue().any(|p| ((high - low) * (1.0 / self.pitch_mm - 1.0 / p)).abs() <= SAME_PITCH)
    }

    fn changed(&self, f: f64) -> Vec<Shape> {
        vec![with(self, |s| s.pitch_mm *= 1.0 + (f - 1.0) * PITCH_STEP)]
    }

    fn traits(&self) -> Traits {
        Traits { is_of_drive: true, is_free_curve: true, ..Traits::motion(self.along, self.axis) }
    }
}

/// `SUM c_k (cos(k n q) - 1) + s_k sin(k n q)` about a rotary axis itself, times the radius: `n` waves in a turn, `k` harmonics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RotaryCyclic {
    pub frame: RotaryFrame,
    pub waves: usize,
    pub harmonics: usize,
}

impl RotaryCyclic {
    /// Columns at a position of the axis.
    fn at(&self, q: f64) -> impl Iterator<Item = f64> {
        harmonics(1..=self.harmonics, self.waves as f64 * q)
    }
}

impl Form for RotaryCyclic {
    fn parameters(&self) -> Vec<String> {
        (1..=self.harmonics).flat_map(|k| [format!("cos{k}_arcsec"), format!("sin{k}_arcsec")]).collect()
    }

    fn width(&self) -> usize {
        self.harmonics.saturating_mul(2)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        self.frame.turn_by(m, self.at(m.position[self.frame.axis.slot()]), out);
    }

    fn drawing(&self) -> Drawing {
        Over::Period(self.frame.axis, TAU / self.waves as f64).into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let angle = |q: f64| self.at(q).zip(&entry.values).map(|(c, v)| c * v).sum();
        let axis = self.frame.axis;
        rotation(
            model,
            entry,
            axis,
            (axis, None),
            Sampling::Waves(TAU / (self.waves * self.harmonics) as f64),
            &angle,
        )
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        named(&[("waves_per_turn_1", self.waves as f64), ("pitch_deg", 360.0 / self.waves as f64)])
    }

    fn is_valid(&self) -> bool {
        self.waves > 0 && (1..=2).contains(&self.harmonics)
    }

    fn traits(&self) -> Traits {
        Traits { is_free_curve: true, ..Traits::rotation(self.frame.axis) }
    }
}
