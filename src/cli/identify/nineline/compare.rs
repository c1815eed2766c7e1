//! Two methods on the same axis: differences of the error motions at the same positions.

use std::path::Path;

use serde_json::{Value, json};

use crate::identify::motion_curves::{in_print_units, read_motions};
use crate::{EX_DATAERR, Failure};
use volcomp_identify::motion::{Gauged, means, symbols};
use volcomp_model::Component;
use volcomp_units::axes::AxisName;

/// Differences over the positions that both have, own minus other, about their mean.
pub(super) struct Comparison {
    positions: usize,
    /// Root mean square, mm or rad.
    rms: [f64; 6],
    /// Largest, mm or rad.
    largest: [f64; 6],
    /// Standard deviation of one of the own means, mm or rad.
    own: [f64; 6],
    /// Standard deviation of one of the other's means from its repeats; `None` without repeats.
    other: [Option<f64>; 6],
}

/// Positions closer than this (mm) are the same.
const SAME_POSITION: f64 = 1e-3;

pub(super) fn with(path: &Path, axis: AxisName, gauged: &Gauged) -> Result<Comparison, Failure> {
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
        return Err(Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {}: {} positions in common; measure both methods at the same positions",
                path.display(),
                differences.len()
            ),
        ));
    }
    let count = differences.len() as f64;
    // a constant is free: each method has its own zero
    let offset: [f64; 6] = core::array::from_fn(|i| differences.iter().map(|d| d[i]).sum::<f64>() / count);
    let of = |i: usize| differences.iter().map(move |d| d[i] - offset[i]);
    Ok(Comparison {
        positions: differences.len(),
        rms: core::array::from_fn(|i| (of(i).map(|d| d * d).sum::<f64>() / (count - 1.0)).sqrt()),
        largest: core::array::from_fn(|i| of(i).fold(0.0f64, |m, d| m.max(d.abs()))),
        own: Component::ALL.map(|c| gauged.std(c) / per_position.sqrt()),
        other: core::array::from_fn(|i| {
            (free > 0).then(|| (squares[i] / free as f64 / (repeats as f64 / count)).sqrt())
        }),
    })
}

impl Comparison {
    pub(super) fn print(&self, axis: AxisName) {
        say!();
        say!("compared at {} positions, means over repeats, without a common constant:", self.positions);
        say!("{:<8}{:>12}{:>12}{:>16}{:>16}", "error", "rms", "largest", "std here", "std there");
        for c in Component::ALL {
            let i = c.index();
            let show = |v: f64| format!("{:.3}", in_print_units(c, v));
            say!(
                "{:<8}{:>12}{:>12}{:>16}{:>16}  {}",
                symbols(axis)[i].to_string(),
                show(self.rms[i]),
                show(self.largest[i]),
                show(self.own[i]),
                self.other[i].map_or_else(|| "-".to_owned(), show),
                if c.is_angle() { "arcsec" } else { "um" }
            );
        }
        say!("ex ey ez compare only where both files state them at the same reference point");
    }

    pub(super) fn json(&self) -> Value {
        json!({
            "positions": self.positions,
            "rms": self.rms,
            "largest": self.largest,
            "std_here": self.own,
            "std_there": self.other,
        })
    }
}
