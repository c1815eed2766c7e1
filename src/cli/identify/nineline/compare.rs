//! Two methods on the same axis: differences of the error motions at the same positions.

use crate::identify::motion_curves::read_motions;
use crate::prelude::*;
use volcomp_identify::motion::{Comparison, Gauged, symbols};

/// Compares motions with those of a motion table of another method.
pub(super) fn with(path: &Path, axis: AxisName, gauged: &Gauged) -> Result<Comparison> {
    Comparison::of(gauged, &read_motions(path, axis)?)
        .map_err(|n| data!(path, "{n} positions in common; measure both methods at the same positions"))
}

pub(super) fn as_json(c: &Comparison) -> Value {
    fields!(c; positions, rms, largest, std_here, std_there)
}

pub(super) fn print(c: &Comparison, axis: AxisName) {
    say!();
    say!("compared at {} positions, means over repeats, without a common constant:", c.positions);
    say!("error            rms     largest        std here       std there");
    for (i, symbol) in symbols(axis).into_iter().enumerate() {
        let units = Units::of(symbol);
        let [rms, largest, here, there] =
            [Some(c.rms[i]), Some(c.largest[i]), Some(c.std_here[i]), c.std_there[i]]
                .map(|v| or_dash(v.map(units.of_value), 3));
        say_text!("{symbol:<8}{rms:>12}{largest:>12}{here:>16}{there:>16}  {}", units.value);
    }
    say!("ex ey ez compare only where both files state them at the same reference point");
}
