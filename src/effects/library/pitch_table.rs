//! Deviations at the targets of a positioning test as a random process.

use super::curves::{are_targets, bracket, coefficients};
use crate::prelude::*;

/// Targets of a table with a value at each.
const TARGETS: core::ops::RangeInclusive<usize> = 4..=WIDTH_MAX + 1;

/// Variants of `positioning` with a value at each target.
pub(super) fn tables(data: &Data, axis: Axis) -> Vec<Shape> {
    let targets = &data.tested[axis.slot()][axis.direction()];
    if !TARGETS.contains(&targets.len()) {
        return Vec::new();
    }
    let frame = data.frame(axis).filter(|_| !axis.is_linear());
    let of = |process| match &frame {
        Some(frame) => RotaryTable { frame: frame.clone(), targets_rad: targets.clone(), process }.into(),
        None => PitchTable { axis, along: None, targets_mm: targets.clone(), process }.into(),
    };
    [Process::White, Process::WhiteFromLine, Process::Walk, Process::WalkFromLine].map(of).into()
}

/// Variants of `straightness` with a value at each target, counted from the line whose slope is a squareness.
pub(super) fn tables_across(data: &Data, along: Axis, over: Axis) -> Vec<Shape> {
    let targets = &data.tested[over.slot()][along.direction()];
    if !TARGETS.contains(&targets.len()) {
        return Vec::new();
    }
    let of =
        |process| PitchTable { axis: over, along: Some(along), targets_mm: targets.clone(), process }.into();
    [Process::WhiteFromLine, Process::WalkFromLine].map(of).into()
}

/// Variants of `angular` with a value at each target: its slope has no other name.
pub(super) fn tables_of_angles(data: &Data, about: Axis, over: Axis, lever: Lever) -> Vec<Shape> {
    let across = (0..3).filter(|k| *k != about.direction());
    let tested = across.map(|k| &data.tested[over.slot()][k]).max_by_key(|t| t.len());
    let Some(targets) = tested.filter(|t| TARGETS.contains(&t.len())) else { return Vec::new() };
    let of = |process| AngularTable { about, over, targets_mm: targets.clone(), process, lever }.into();
    [Process::White, Process::Walk].map(of).into()
}

/// How the values at the targets come about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Process {
    /// They have nothing to do with each other: the parameters are contrasts (Helmert), counted from the mean.
    White,
    /// The same counted from the least-squares line, whose slope is a scale: recursive residuals (Brown, Durbin, Evans 1975).
    WhiteFromLine,
    /// Steps from target to target: the errors of a screw's pitch add up along it. Counted from the mean.
    Walk,
    /// The same counted from the least-squares line: the independent parts of a Brownian bridge.
    WalkFromLine,
}

impl Process {
    /// True where the slope of the values is left to a scale.
    #[must_use]
    pub const fn is_from_line(self) -> bool {
        matches!(self, Self::WhiteFromLine | Self::WalkFromLine)
    }
}

/// The columns of a process over targets; straight lines between them, held beyond. The parameters are independent and equally large.
#[derive(Debug, Clone, Copy)]
struct Contrasts<'a> {
    targets: &'a [f64],
    process: Process,
}

impl Contrasts<'_> {
    const fn width(self) -> usize {
        let determined = if self.process.is_from_line() { 2 } else { 1 };
        self.targets.len().saturating_sub(determined)
    }

    /// The column `k` (from 1) at a target.
    fn at_target(self, k: usize, target: usize) -> f64 {
        let t = self.targets;
        let (first, last) = (t[0], t[t.len() - 1]);
        match self.process {
            Process::Walk | Process::WalkFromLine if target < k => 0.0,
            // a step counts with the root of its length
            Process::Walk => ((t[k] - t[k - 1]) / (last - first)).sqrt(),
            Process::WalkFromLine => {
                let variance = (t[k] - t[k - 1]) * (last - t[k]) / ((last - t[k - 1]) * (last - first));
                variance.sqrt() * (last - t[target]) / (last - t[k])
            }
            Process::WhiteFromLine => self.recursive_residual(k, target),
            Process::White => {
                let size = 1.0 / ((k * (k + 1)) as f64).sqrt();
                match target.cmp(&k) {
                    core::cmp::Ordering::Less => size,
                    core::cmp::Ordering::Equal => -(k as f64) * size,
                    core::cmp::Ordering::Greater => 0.0,
                }
            }
        }
    }

    /// The column `k` of recursive residuals at a target: the target `k + 1` against the line through those before it.
    fn recursive_residual(self, k: usize, target: usize) -> f64 {
        let (before, at) = (&self.targets[..=k], self.targets[k + 1]);
        let mean = before.iter().sum::<f64>() / before.len() as f64;
        let square: f64 = before.iter().map(|t| (t - mean).powi(2)).sum();
        let size = (1.0 + 1.0 / before.len() as f64 + (at - mean).powi(2) / square).sqrt();
        match target.cmp(&(k + 1)) {
            core::cmp::Ordering::Less => {
                -(1.0 / before.len() as f64 + (at - mean) * (before[target] - mean) / square) / size
            }
            core::cmp::Ordering::Equal => 1.0 / size,
            core::cmp::Ordering::Greater => 0.0,
        }
    }

    /// Mean of the column `k` over the targets, and the slope of its least-squares line where it is counted from that.
    fn reference(self, k: usize, centre: f64) -> [f64; 2] {
        if matches!(self.process, Process::White | Process::WhiteFromLine) {
            return [0.0; 2];
        }
        let values = (0..self.targets.len()).map(|target| self.at_target(k, target));
        let mean = values.clone().sum::<f64>() / self.targets.len() as f64;
        if self.process == Process::Walk {
            return [mean, 0.0];
        }
        let from_mean = self.targets.iter().map(|t| t - centre);
        let square: f64 = from_mean.clone().map(|d| d * d).sum();
        [mean, from_mean.zip(values).map(|(d, v)| d * v).sum::<f64>() / square]
    }

    /// All columns at a position.
    fn at(self, position: f64) -> impl Iterator<Item = f64> {
        let t = self.targets;
        let ends = t.first().zip(t.last());
        let x = ends.map_or(f64::NAN, |(low, high)| position.clamp(*low, *high));
        let (after, share) = bracket(t, position);
        let centre = t.iter().sum::<f64>() / t.len() as f64;
        (1..=self.width()).map(move |k| {
            let [from, to] = [after - 1, after].map(|target| self.at_target(k, target));
            let [mean, slope] = self.reference(k, centre);
            from + share * (to - from) - (mean + slope * (x - centre))
        })
    }

    fn is_valid(self) -> bool {
        are_targets(self.targets) && (1..=WIDTH_MAX).contains(&self.width())
    }
}

/// Deviations of a linear axis at the targets, along itself or across.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PitchTable {
    pub axis: Axis,
    /// Direction of the deviations; none: along the axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub along: Option<Axis>,
    pub targets_mm: Vec<f64>,
    pub process: Process,
}

impl PitchTable {
    fn contrasts(&self) -> Contrasts<'_> {
        Contrasts { targets: &self.targets_mm, process: self.process }
    }

    fn direction(&self) -> Axis {
        self.along.unwrap_or(self.axis)
    }
}

impl Form for PitchTable {
    fn parameters(&self) -> Vec<String> {
        coefficients(1..=self.width())
    }

    fn width(&self) -> usize {
        self.contrasts().width()
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let along = unit(self.direction().direction());
        let columns = self.contrasts().at(m.position[self.axis.slot()]);
        out.iter_mut().zip(columns).for_each(|(o, v)| *o = along * v);
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.axis, Sampling::At(&self.targets_mm))
    }

    fn is_valid(&self) -> bool {
        self.contrasts().is_valid()
    }

    fn traits(&self) -> Traits {
        Traits { is_free_curve: true, is_process: true, ..Traits::motion(self.direction(), self.axis) }
    }
}

/// Angular deviations of a rotary axis about itself at the targets, times the radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct RotaryTable {
    pub frame: RotaryFrame,
    pub targets_rad: Vec<f64>,
    pub process: Process,
}

impl RotaryTable {
    fn contrasts(&self) -> Contrasts<'_> {
        Contrasts { targets: &self.targets_rad, process: self.process }
    }
}

impl Form for RotaryTable {
    fn parameters(&self) -> Vec<String> {
        (1..=self.width()).map(|k| format!("p{k}_arcsec")).collect()
    }

    fn width(&self) -> usize {
        self.contrasts().width()
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        self.frame.turn_by(m, self.contrasts().at(m.position[self.frame.axis.slot()]), out);
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let angle = |q: f64| self.contrasts().at(q).zip(&entry.values).map(|(c, v)| c * v).sum();
        rotation(
            model,
            entry,
            self.frame.axis,
            (self.frame.axis, None),
            Sampling::At(&self.targets_rad),
            &angle,
        )
    }

    fn is_valid(&self) -> bool {
        self.contrasts().is_valid()
    }

    fn traits(&self) -> Traits {
        Traits { is_free_curve: true, is_process: true, ..Traits::rotation(self.frame.axis) }
    }
}

/// `d = eps x lever` about one direction with values at the targets, zero at the zero of the axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct AngularTable {
    pub about: Axis,
    pub over: Axis,
    pub targets_mm: Vec<f64>,
    pub process: Process,
    pub lever: Lever,
}

impl AngularTable {
    /// The columns as angles.
    fn angles(&self, q: f64) -> impl Iterator<Item = f64> {
        let contrasts = Contrasts { targets: &self.targets_mm, process: self.process };
        contrasts.at(q).zip(contrasts.at(0.0)).map(|(at, zero)| at - zero)
    }
}

impl Form for AngularTable {
    fn parameters(&self) -> Vec<String> {
        (1..=self.width()).map(|k| format!("e{k}_arcsec")).collect()
    }

    fn width(&self) -> usize {
        Contrasts { targets: &self.targets_mm, process: self.process }.width()
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        self.lever.turn_by(self.about, m, self.angles(m.position[self.over.slot()]), out);
    }

    fn drawing(&self) -> Drawing {
        Drawing::from(Over::Position(self.over)).scaled(Weight::Lever(self.about, self.lever))
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let angle = |q: f64| self.angles(q).zip(&entry.values).map(|(v, e)| v * e).sum();
        let sampling = Sampling::At(&self.targets_mm);
        rotation(model, entry, self.over, (self.about, Some(&self.lever)), sampling, &angle)
    }

    fn is_valid(&self) -> bool {
        are_targets(&self.targets_mm) && (1..=WIDTH_MAX).contains(&self.width())
    }

    fn traits(&self) -> Traits {
        Traits {
            over: Some(self.over),
            turns: Some(Axis::ROTARY[self.about.direction()]),
            is_free_curve: true,
            is_process: true,
            ..Traits::default()
        }
    }
}

impl Shape {
    /// True for a table of independent values without the slope that has a name of its own.
    #[must_use]
    pub const fn is_plain_table(&self) -> bool {
        match self {
            Self::PitchTable(PitchTable { process, .. }) | Self::RotaryTable(RotaryTable { process, .. }) => {
                matches!(process, Process::WhiteFromLine)
            }
            Self::AngularTable(AngularTable { process, .. }) => matches!(process, Process::White),
            _ => false,
        }
    }

    /// The axis whose scale the slope of a table of values may be, where the table is not counted from its line.
    #[must_use]
    pub const fn holds_scale_of(&self) -> Option<Axis> {
        let (axis, process) = match self {
            Self::PitchTable(t) if t.along.is_none() => (t.axis, t.process),
            Self::RotaryTable(t) => (t.frame.axis, t.process),
            _ => return None,
        };
        if process.is_from_line() { None } else { Some(axis) }
    }
}
