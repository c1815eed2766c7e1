//! Deviations at the targets of a positioning test as a random process.

use super::curves::{are_targets, coefficients};
use crate::prelude::*;

/// Variants of `positioning` with a value at each target.
pub(super) fn tables(axis: Axis, targets: &[f64]) -> Vec<Shape> {
    if !(4..=WIDTH_MAX + 1).contains(&targets.len()) {
        return Vec::new();
    }
    let of = |process| PitchTable { axis, targets_mm: targets.to_vec(), process }.into();
    [Process::White, Process::WhiteFromLine, Process::Walk, Process::WalkFromLine].map(of).into()
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

/// Values at the targets, straight lines between. The parameters are independent and equally large.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PitchTable {
    pub axis: Axis,
    pub targets_mm: Vec<f64>,
    pub process: Process,
}

impl PitchTable {
    /// The column `k` (from 1) at a target.
    fn at_target(&self, k: usize, target: usize) -> f64 {
        let t = &self.targets_mm;
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
    fn recursive_residual(&self, k: usize, target: usize) -> f64 {
        let (before, at) = (&self.targets_mm[..=k], self.targets_mm[k + 1]);
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
    fn reference(&self, k: usize, mean_mm: f64) -> [f64; 2] {
        if matches!(self.process, Process::White | Process::WhiteFromLine) {
            return [0.0; 2];
        }
        let values = (0..self.targets_mm.len()).map(|target| self.at_target(k, target));
        let mean = values.clone().sum::<f64>() / self.targets_mm.len() as f64;
        if self.process == Process::Walk {
            return [mean, 0.0];
        }
        let from_mean = self.targets_mm.iter().map(|t| t - mean_mm);
        let square: f64 = from_mean.clone().map(|d| d * d).sum();
        [mean, from_mean.zip(values).map(|(d, v)| d * v).sum::<f64>() / square]
    }
}

impl Form for PitchTable {
    fn parameters(&self) -> Vec<String> {
        coefficients(1..=self.width())
    }

    fn width(&self) -> usize {
        let determined = if self.process.is_from_line() { 2 } else { 1 };
        self.targets_mm.len().saturating_sub(determined)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let t = &self.targets_mm;
        let [Some(low), Some(high)] = [t.first(), t.last()] else { return };
        // held beyond the targets
        let x = m.position[self.axis.slot()].clamp(*low, *high);
        let after = t.partition_point(|t| *t <= x).clamp(1, t.len().max(2) - 1);
        let share = (x - t[after - 1]) / (t[after] - t[after - 1]);
        let mean_mm = t.iter().sum::<f64>() / t.len() as f64;
        for (o, k) in out.iter_mut().zip(1..=self.width()) {
            let [from, to] = [after - 1, after].map(|target| self.at_target(k, target));
            let [mean, slope] = self.reference(k, mean_mm);
            let reference = mean + slope * (x - mean_mm);
            *o = unit(self.axis.direction()) * (from + share * (to - from) - reference);
        }
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.axis, Sampling::At(&self.targets_mm))
    }

    fn is_valid(&self) -> bool {
        are_targets(&self.targets_mm) && (1..=WIDTH_MAX).contains(&self.width())
    }

    fn acts_along(&self) -> Option<Axis> {
        Some(self.axis)
    }

    fn over(&self) -> Option<Axis> {
        Some(self.axis)
    }

    fn is_free_curve(&self) -> bool {
        true
    }

    fn is_process(&self) -> bool {
        true
    }
}
