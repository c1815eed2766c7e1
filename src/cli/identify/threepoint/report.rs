//! What the n-point method says about an axis.

use super::of_geometry;
use crate::identify::prelude::*;
use volcomp_identify::threepoint::{Geometry, PoseErrors, SeriesFit, Side, Sides};

/// Everything there is to say beside the motions.
pub(super) struct Threepoint {
    pub(super) names: Vec<String>,
    pub(super) fit: SeriesFit,
    pub(super) frame: Frame,
    pub(super) workpiece_side: bool,
}

impl Threepoint {
    /// Probability of the residuals, where noise was stated to compare them with.
    fn p_value(&self) -> Option<f64> {
        (self.frame.noise_is_stated && self.fit.dof > 0).then_some(self.fit.p_value)
    }

    fn suspect(&self) -> Option<(&str, f64)> {
        self.fit.suspect.map(|(i, lead)| (self.names[i].as_str(), lead))
    }

    /// That row, for a message.
    fn worst_row_text(&self) -> String {
        self.fit.worst_row().map_or_else(String::new, |i| {
            let (PoseErrors { chi2, dof, .. }, row) = (&self.fit.poses[i], &self.fit.rows[i]);
            let cycle = if row.cycle > 0 { format!(", cycle {}", row.cycle) } else { String::new() };
            let (number, position) = (i + 1, row.position);
            format!(
                ", worst row {number} at {position} mm{cycle}, chi2 {chi2:.0} of {dof} degrees of freedom"
            )
        })
    }
}

impl Report for Threepoint {
    fn print(&self, motions: &Motions<'_>) {
        let (axis, r) = (motions.origin.axis, motions.origin.reference);
        let SeriesFit { chi2, dof, .. } = self.fit;
        let (points, rows) = (self.names.len(), motions.gauged.rows.len());
        let [x, y, z]: [f64; 3] = r.into();
        say!("{axis} of {points} points at {rows} rows; ex ey ez at ({x:.3} {y:.3} {z:.3}) mm in M at home");
        if self.workpiece_side {
            say!(
                "the carriage is on the workpiece side: motions of the tool relative to it (minus what the tracker saw)"
            );
        }
        if let Some(registered) = &self.frame.registered {
            registered.print();
            let std = um_from_mm(registered.std_at(&r));
            say_text!("  at the reference point it means up to {std:.2} um (k=1)");
        }
        let Geometry { rms_radius, off_line_rms, condition_scaled, condition_centroid, roll_growth, .. } =
            &self.fit.poses[0].geometry;
        say!(
            "points: rms radius {rms_radius:.1} mm, {off_line_rms:.1} mm off their line; condition {condition_scaled:.1} at the platform origin, {condition_centroid:.1} at the centroid; rotation about the line {roll_growth:.1} times less certain than across"
        );
        match (self.p_value(), self.fit.noise_factor) {
            (Some(p), Some(factor)) => {
                let verdict = if p < SIGNIFICANT { "FAILED" } else { "passed" };
                say!(
                    "rigidity: chi2 {chi2:.1}, {dof} degrees of freedom, p {p:.3}, noise {factor:.2} times the stated one: {verdict}"
                );
            }
            (_, Some(sigma)) => say_text!(
                "rigidity: no noise stated; the residuals say {:.2} um per coordinate ({dof} degrees of freedom)",
                um_from_mm(sigma)
            ),
            _ => say!("rigidity: not testable"),
        }
        let (shift, turn) = self.fit.linear_against_rigid();
        let (shift, turn) = (um_from_mm(shift), arcsec_from_rad(turn));
        say_text!("linear against rigid fit: at most {shift:.4} um, {turn:.5} arcsec");
        say!();
    }

    fn warn(&self, rows: usize) {
        if let Some(warning) = self.fit.poses[0].geometry.warning() {
            note!("warning: {warning}");
        }
        if self.p_value().is_some_and(|p| p < SIGNIFICANT)
            && let (Some((name, lead)), Some(factor)) = (self.suspect(), self.fit.noise_factor)
        {
            let failing = self.fit.failing();
            let worst = self.worst_row_text();
            if lead > 1.5 {
                note!(
                    "warning: the points do not move as a rigid body ({failing} of {rows} rows fail{worst}): point {name} explains most of it (without it {lead:.1} times less is left than without the next one); is it loose, or its line of sight disturbed?"
                );
            } else {
                note!(
                    "warning: the residuals are {factor:.2} times the stated noise ({failing} of {rows} rows fail{worst}), spread over the points (most at {name}): is the noise stated too small?"
                );
            }
            note!("note: the uncertainties given are enlarged by that factor");
        }
    }

    fn json(&self, motions: Value) -> Value {
        let g = &self.fit.poses[0].geometry;
        let mut geometry = of_geometry(g);
        geometry["off_line_rms"] = json!(g.off_line_rms);
        json!({
            "motions": motions,
            "workpiece_side": self.workpiece_side,
            "points": self.names,
            "geometry": geometry,
            "rigidity": fields!(self.fit; chi2, dof, noise_factor;
                "p_value": self.p_value(),
                "worst_row": self.p_value().and_then(|_| self.fit.worst_row()).map(|i| i + 1),
                "failing_rows": self.p_value().map(|_| self.fit.failing()),
                "suspect_point": self.suspect().map(|s| s.0),
                "suspect_lead": self.suspect().map(|s| s.1),
            ),
            "registration": self.frame.registered.as_ref().map(Registered::json),
        })
    }
}

/// Distances for people.
pub(super) fn print_sides(sides: &Sides, names: &[String], poses: usize) {
    say!("side                      poses       mean mm      std mm peak-to-peak mm");
    for s in &sides.sides {
        let Side { poses, mean, std, peak_to_peak, .. } = s;
        let side = format!("{} - {}", names[s.from], names[s.to]);
        say!("{side:<24}{poses:>7}{mean:>14.3}{std:>12.3}{peak_to_peak:>16.3}");
    }
    let sigma = um_from_mm(sides.sigma);
    say_text!("noise of one coordinate over {poses} poses: {sigma:.1} um (k=1), if the body is rigid");
    match sides.suspect {
        Some((i, lead)) => {
            let (name, times) = (&names[i], lead.min(1e9));
            say!("point {name} is loose: without it the other sides have {times:.0} times less variance");
        }
        None => say!("no point stands out"),
    }
}

/// Distances for machines, mm.
pub(super) fn sides_json(sides: &Sides, names: &[String], poses: usize) -> Value {
    let side = |s: &Side| fields!(s; poses, mean, std, std_sample, peak_to_peak; "from": names[s.from], "to": names[s.to]);
    json!({
        "poses": poses,
        "sides": sides.sides.iter().map(side).collect::<Vec<_>>(),
        "sigma": sides.sigma,
        "suspect_point": sides.suspect.map(|(i, _)| &names[i]),
    })
}
