//! Two methods on the same axis: differences of the error motions at the same positions.

use crate::identify::motion_curves::read_motions;
use crate::prelude::*;
use volcomp_identify::motion::{Gauged, means, symbols};

/// Differences over the positions that both have, own minus other, about their mean; mm and rad.
#[derive(serde::Serialize)]
pub(super) struct Comparison {
    #[serde(skip)]
    axis: AxisName,
    positions: usize,
    /// Root mean square.
    rms: [f64; 6],
    largest: [f64; 6],
    /// Standard deviation of one of the own means.
    std_here: [f64; 6],
    /// Standard deviation of one of the other's means from its repeats; `None` without repeats.
    std_there: [Option<f64>; 6],
}

/// Positions closer than this (mm) are the same.
const SAME_POSITION: f64 = 1e-3;

impl Comparison {
    pub(super) fn with(path: &Path, axis: AxisName, gauged: &Gauged) -> Result<Self> {
        let other = read_motions(path, axis)?;
        let (positions, own) = means(&gauged.rows);
        let per_position = gauged.rows.len() as f64 / positions.len() as f64;
        let mut differences: Vec<[f64; 6]> = Vec::new();
        let (mut squares, mut free, mut repeats) = ([0.0; 6], 0usize, 0usize);
        for (position, mean) in positions.iter().zip(&own) {
            let there: Vec<&[f64; 6]> =
                other.iter().filter(|(p, _)| (p - position).abs() < SAME_POSITION).map(|(_, m)| m).collect();
            if there.is_empty() {
                continue;
            }
            let n = there.len() as f64;
            let average: [f64; 6] = core::array::from_fn(|i| there.iter().map(|m| m[i]).sum::<f64>() / n);
            for (i, s) in squares.iter_mut().enumerate() {
                *s += there.iter().map(|m| (m[i] - average[i]).powi(2)).sum::<f64>();
            }
            free += there.len() - 1;
            repeats += there.len();
            differences.push(core::array::from_fn(|i| mean[i] - average[i]));
        }
        if differences.len() < 2 {
            let n = differences.len();
            return Err(data!(path, "{n} positions in common; measure both methods at the same positions"));
        }
        let count = differences.len() as f64;
        // a constant is free: each method has its own zero
        let offset: [f64; 6] =
            core::array::from_fn(|i| differences.iter().map(|d| d[i]).sum::<f64>() / count);
        let of = |i: usize| differences.iter().map(move |d| d[i] - offset[i]);
        Ok(Self {
            axis,
            positions: differences.len(),
            rms: core::array::from_fn(|i| (of(i).map(|d| d * d).sum::<f64>() / (count - 1.0)).sqrt()),
            largest: core::array::from_fn(|i| of(i).fold(0.0f64, |m, d| m.max(d.abs()))),
            std_here: Component::ALL.map(|c| gauged.std(c) / per_position.sqrt()),
            std_there: core::array::from_fn(|i| {
                (free > 0).then(|| (squares[i] / free as f64 / (repeats as f64 / count)).sqrt())
            }),
        })
    }

    pub(super) fn print(&self) {
        say!();
        say!("compared at {} positions, means over repeats, without a common constant:", self.positions);
        say!("error            rms     largest        std here       std there");
        for (i, symbol) in symbols(self.axis).into_iter().enumerate() {
            let units = Units::of(symbol);
            let show = |v: f64| or_dash(Some((units.of_value)(v)), 3);
            let [rms, largest, here] = [self.rms[i], self.largest[i], self.std_here[i]].map(show);
            let there = or_dash(self.std_there[i].map(units.of_value), 3);
            say!("{symbol:<8}{rms:>12}{largest:>12}{here:>16}{there:>16}  {}", units.value);
        }
        say!("ex ey ez compare only where both files state them at the same reference point");
    }
}
