//! What the n-point method says about an axis.

use super::of_geometry;
use crate::identify::prelude::*;
use volcomp_identify::threepoint::{SeriesFit, Side, Sides};

/// Everything there is to say beside the motions.
pub(super) struct Threepoint {
    pub(super) names: Vec<String>,
    pub(super) fit: SeriesFit,
    pub(super) frame: Frame,
    pub(super) workpiece_side: bool,
}

/// Where the residuals are larger than the stated noise, or none was stated, the covariances follow the residuals.
pub(super) fn scale_by_misfit(fit: &mut SeriesFit, noise_is_stated: bool) {
    let Some(factor) = fit.noise_factor else { return };
    let factor = if noise_is_stated { factor.max(1.0) } else { factor };
    for row in &mut fit.rows {
        row.covariance *= factor * factor;
    }
}

impl Threepoint {
    /// Probability of the residuals, where noise was stated to compare them with.
    fn p_value(&self) -> Option<f64> {
        (self.frame.noise_is_stated && self.fit.dof > 0).then_some(self.fit.p_value)
    }

    fn suspect(&self) -> Option<(&str, f64)> {
        self.fit.suspect.map(|(i, lead)| (self.names[i].as_str(), lead))
    }

    /// Share of the positions that fail the test on their own.
    fn failing(&self) -> usize {
        self.fit.poses.iter().filter(|p| p.p_value < SIGNIFICANT).count()
    }

    /// Index of the row that fails most.
    fn worst_row(&self) -> Option<usize> {
        let failing = self.fit.poses.iter().enumerate().filter(|(_, p)| p.p_value < SIGNIFICANT);
        failing.max_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2)).map(|(i, _)| i)
    }

    /// That row, for a message.
    fn worst_row_text(&self) -> String {
        self.worst_row().map_or_else(String::new, |i| {
            let (pose, row) = (&self.fit.poses[i], &self.fit.rows[i]);
            let cycle = if row.cycle > 0 { format!(", cycle {}", row.cycle) } else { String::new() };
            format!(
                ", worst row {} at {} mm{cycle}, chi2 {:.0} of {} degrees of freedom",
                i + 1,
                row.position,
                pose.chi2,
                pose.dof
            )
        })
    }

    /// Largest difference of the linear and the rigid model on unweighted data has no meaning where weights differ;
    /// here it bounds both causes together.
    fn linear_against_rigid(&self) -> (f64, f64) {
        self.fit.poses.iter().fold((0.0, 0.0), |(d, e), p| {
            let difference = p.motion - p.rigid;
            (d.max(difference.fixed_rows::<3>(0).amax()), e.max(difference.fixed_rows::<3>(3).amax()))
        })
    }
}

impl Report for Threepoint {
    fn print(&self, motions: &Motions<'_>) {
        let (axis, r, g) = (motions.origin.axis, motions.origin.reference, &self.fit.poses[0].geometry);
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
            say_text!(
                "  at the reference point it means up to {:.2} um (k=1)",
                um_from_mm(registered.std_at(&r))
            );
        }
        say!(
            "points: rms radius {:.1} mm, {:.1} mm off their line; condition {:.1} at the platform origin, {:.1} at the centroid; rotation about the line {:.1} times less certain than across",
            g.rms_radius,
            g.off_line_rms,
            g.condition_scaled,
            g.condition_centroid,
            g.roll_growth
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
        let (shift, turn) = self.linear_against_rigid();
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
            let failing = self.failing();
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
            "rigidity": {
                "chi2": self.fit.chi2,
                "dof": self.fit.dof,
                "p_value": self.p_value(),
                "noise_factor": self.fit.noise_factor,
                "worst_row": self.p_value().and_then(|_| self.worst_row()).map(|i| i + 1),
                "failing_rows": self.p_value().map(|_| self.failing()),
                "suspect_point": self.suspect().map(|s| s.0),
                "suspect_lead": self.suspect().map(|s| s.1),
            },
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
    let side = |s: &Side| {
        let mut side = fields!(s; poses, mean, std, std_sample, peak_to_peak);
        side["from"] = json!(names[s.from]);
        side["to"] = json!(names[s.to]);
        side
    };
    json!({
        "poses": poses,
        "sides": sides.sides.iter().map(side).collect::<Vec<_>>(),
        "sigma": sides.sigma,
        "suspect_point": sides.suspect.map(|(i, _)| &names[i]),
    })
}
