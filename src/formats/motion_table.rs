//! Table of the motion errors of an axis, as `volcomp fit` reads them: position and every error, in both directions where
//! they differ.

use crate::prelude::*;
use volcomp_units::arcsec_from_rad;

/// Any number of points, both directions.
pub(crate) const FREE: Limits = Limits {
    format: "csv",
    equidistant: false,
    points: 200_000,
    two_directions: true,
    decimals: DECIMALS_MAX,
};

/// Writes the table; with the points that are in it.
///
/// # Errors
/// The axis has no error, or cannot be sampled so.
pub fn write(
    spec: &ModelSpec,
    axis: AxisName,
    sampling: &Sampling,
) -> Result<(String, AxisTable), ExportError> {
    let motions = Motions::new(spec, axis, false)?;
    let components = motions.present();
    if components.is_empty() {
        return Err(ExportError::NoError { what: "error motion", axis });
    }
    let table = sample_axis(&motions, &components, sampling, &FREE)?;
    let two_way = table.columns.iter().any(|c| c.reverse.is_some());
    let rotary = axis.kind() == AxisKind::Rotary;
    let mut header = vec![if rotary { "position_deg" } else { "position_mm" }.to_owned()];
    header.extend(components.iter().map(|c| {
        let unit = if c.is_angle() { "arcsec" } else { "um" };
        format!("e{}{}_{unit}", c.letter().to_ascii_lowercase(), axis.lower())
    }));
    header.extend(two_way.then(|| "direction".to_owned()));
    let mut out = header.join(",") + "\n";
    for (reverse, direction) in [(false, "1"), (true, "-1")] {
        if reverse && !two_way {
            break;
        }
        for (i, q) in table.positions.iter().enumerate() {
            let mut row = vec![rounded(if rotary { deg_from_rad(*q) } else { *q }, 0)];
            row.extend(table.columns.iter().map(|c| {
                let values = c.reverse.as_ref().filter(|_| reverse).unwrap_or(&c.forward);
                rounded(
                    if c.component.is_angle() { arcsec_from_rad(values[i]) } else { um_from_mm(values[i]) },
                    0,
                )
            }));
            row.extend(two_way.then(|| direction.to_owned()));
            out.push_str(&row.join(","));
            out.push('\n');
        }
    }
    Ok((out, table))
}
