//! Readings of one axis into a model file: sense, reference points, reference line, curves. Used by every method that
//! measures the error motions of one axis along a run.

use crate::fit::basis::{Auto, BASES};
use crate::fit::report::Fitted;
use crate::identify::CurveFits;
use crate::model_writer::{ModelWriter, axis_entry, default_chain};
use crate::prelude::*;
use volcomp_identify::curve::{Basis, CurveFit};
use volcomp_identify::reading::group_by_position;
use volcomp_identify::straightness::runs::{Reversal, as_one_direction, reversal};
use volcomp_identify::straightness::{Line, Rule};
use volcomp_model::ReferencePoint;
use volcomp_model::spec::ReferenceBody;

/// How a run becomes curves of a model.
#[derive(Debug, clap::Args)]
pub(in crate::identify) struct AxisWriter {
    #[command(flatten)]
    pub(in crate::identify) model: ModelWriter,
    /// Whose motion the readings show. carriage: the optics ride on the carriage and the instrument stands on the bed
    /// side. relative: tool side against workpiece side. Needed where the axis carries the workpiece.
    #[arg(long, value_parser = one_of(SENSES))]
    sense: Option<Sense>,
    /// In which sense the curves are stored; default: that of the axis in the model, else relative.
    #[arg(long, value_parser = one_of(SENSES))]
    store: Option<Sense>,
    /// Where the optics was: the point of all linear components, in M at home.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    point_mm: Option<Vec3>,
    /// The point of the positioning component alone (Abbe).
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    abbe_mm: Option<Vec3>,
    /// The point of the straightness components alone (Bryan).
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    bryan_mm: Option<Vec3>,
    /// The body on which these points ride: optics on the moving part, or standing with the bed side.
    #[arg(long, value_parser = one_of(BODIES), default_value = "carriage")]
    body: ReferenceBody,
    /// Line that the straightnesses refer to; all curves of a machine must use one rule.
    #[arg(long, value_parser = one_of(RULES), default_value = "end-point")]
    pub(super) rule: Rule,
    /// Family of curves.
    #[arg(long, value_parser = one_of(BASES), default_value = "auto")]
    basis: Auto<Basis>,
}

const SENSES: &[(&str, &str, Sense)] =
    &[("carriage", "", Sense::Carriage), ("relative", "", Sense::Relative)];
const BODIES: &[(&str, &str, ReferenceBody)] =
    &[("carriage", "", ReferenceBody::Carriage), ("bed", "", ReferenceBody::Bed)];
const RULES: &[(&str, &str, Rule)] = &[
    ("end-point", "", Rule::EndPoint),
    ("least-squares", "", Rule::LeastSquares),
    ("minimum-zone", "", Rule::MinimumZone),
];

/// Readings of one error motion over the programmed coordinate, in the sense in which they were measured.
pub(in crate::identify) struct Measured {
    pub(in crate::identify) component: Component,
    pub(in crate::identify) readings: Vec<Reading>,
    /// Standard uncertainty of one reading from the instrument, where known.
    pub(in crate::identify) std: Option<f64>,
}

impl Measured {
    pub(in crate::identify) const fn symbol(&self, axis: AxisName) -> ErrorSymbol {
        ErrorSymbol::Motion { component: self.component, axis }
    }
}

/// Where the readings came from.
pub(in crate::identify) struct Origin {
    pub(in crate::identify) method: &'static str,
    pub(in crate::identify) files: Vec<PathBuf>,
    pub(in crate::identify) instrument: Option<String>,
}

impl AxisWriter {
    /// The points at which the three linear components of a run were measured, where stated.
    pub(in crate::identify) fn points(&self, axis: AxisName) -> [Option<Vec3>; 3] {
        std::array::from_fn(|i| {
            let own = if i == axis.direction() { self.abbe_mm } else { self.bryan_mm };
            own.or(self.point_mm)
        })
    }

    /// True where the points stay with the bed side.
    pub(in crate::identify) fn on_bed(&self) -> bool {
        self.body == ReferenceBody::Bed
    }

    /// Fits the readings and writes the model; returns the table of the fits. `moved` is the point at which the components
    /// hold after a change of reference point.
    pub(in crate::identify) fn write(
        &self,
        axis: AxisName,
        measured: &[Measured],
        moved: Option<Vec3>,
        origin: &Origin,
    ) -> Result<String> {
        let model = self.model.base(|| default_chain([axis]))?;
        if model.spec.chain.index_of(axis).is_none() {
            let chain = &model.spec.chain;
            return Err(usage!("axis {axis} is not in the chain {chain}; correct --axis or --chain"));
        }
        let primed = model.spec.is_workpiece_side(axis);
        let symbols: Vec<ErrorSymbol> = measured.iter().map(|m| m.symbol(axis)).collect();
        let (measured_sense, stored) = self.senses(&model.spec, axis, primed, &symbols)?;
        let mut fits = CurveFits::new(model, &origin.files);
        for (m, symbol) in measured.iter().zip(symbols) {
            let mut readings = gauged(m.readings.clone(), m.component, axis, self.rule);
            if primed {
                readings = stored_readings(readings, measured_sense, stored);
            }
            let judged = reversal(&readings);
            note_reversal(symbol, judged);
            if !judged.keeps_both() {
                readings = as_one_direction(&readings);
            }
            // only a table holds two directions
            let both = Some(Basis::Table).filter(|_| judged.keeps_both());
            // readings scatter by no less than the instrument states
            let std = |fit: &CurveFit| match (fit.standard_uncertainty(), fit.figures.rmse_dof, m.std) {
                (Some(u), Some(rmse), Some(instrument)) if rmse > 0.0 => {
                    Some(u * (instrument / rmse).max(1.0))
                }
                (u, _, instrument) => u.into_iter().chain(instrument).reduce(f64::max),
            };
            // sign table and tilt test are no data of the curve
            let own = fits.sources.only(|i| i == 0).provenance();
            let from = Provenance { instrument: origin.instrument.clone(), ..own };
            fits.add(symbol, readings, self.basis.or(both), std, from)?;
        }
        self.place(&mut fits.model.spec, axis, &fits.fitted, moved, stored);
        let mut comment = fits.sources.heading(&format!("identify {}", origin.method));
        comment.push(format!(
            "axis {axis}: measured in the {} sense, straightness about the {} line",
            measured_sense.name(),
            self.rule.name().replace('_', "-")
        ));
        fits.write(&self.model, &comment)
    }

    /// Measured and stored sense; for a tool-side axis they are the same thing.
    fn senses(
        &self,
        spec: &ModelSpec,
        axis: AxisName,
        primed: bool,
        replaced: &[ErrorSymbol],
    ) -> Result<(Sense, Sense)> {
        let measured = match self.sense {
            Some(sense) => sense,
            None if !primed => Sense::Relative,
            None => {
                return Err(usage!(
                    "axis {axis} carries the workpiece, so its readings have opposite signs in the two senses; say --sense carriage (optics on the carriage, instrument on the bed side) or --sense relative (tool side against workpiece side)"
                ));
            }
        };
        let entry = spec.axis(axis);
        let others = spec.errors.iter().any(|(s, _)| {
            matches!(s, ErrorSymbol::Motion { axis: a, .. } if *a == axis) && !replaced.contains(s)
        });
        let stored = self.store.unwrap_or(entry.sense);
        if others && stored != entry.sense {
            return Err(usage!(
                "axis {axis} of the model has other error motions in the {} sense; all six share one sense: leave --store out",
                entry.sense.name()
            ));
        }
        Ok((measured, stored))
    }

    /// Sense and reference points of the axis.
    fn place(
        &self,
        spec: &mut ModelSpec,
        axis: AxisName,
        fitted: &[Fitted],
        moved: Option<Vec3>,
        stored: Sense,
    ) {
        let points = self.points(axis).map(|p| moved.or(p));
        let body = if moved.is_none() { self.body } else { ReferenceBody::Carriage };
        let entry = axis_entry(spec, axis);
        entry.sense = stored;
        for f in fitted.iter().filter(|f| !f.symbol.is_angle()) {
            let i = f.symbol.component().index();
            match points[i] {
                Some(point) => entry.reference_points[i] = ReferencePoint { point, body },
                None => note!(
                    "note: {}: no --point-mm: the reference point stays at {:?} mm; 100 mm beside it cost 5 um for every 10 arcsec",
                    f.symbol,
                    entry.reference_points[i].point.as_slice()
                ),
            }
        }
    }
}

/// Says what was done with the two directions.
fn note_reversal(symbol: ErrorSymbol, judged: Reversal) {
    let show = |v: f64| Units::of(symbol).text(v, 2);
    let (rms, what) = match judged {
        Reversal::OneDirection => return,
        Reversal::NotRepeated { rms } => {
            (rms, ", not repeated: cannot be judged, both directions are kept".to_owned())
        }
        Reversal::Insignificant { rms, repeatability: r } => {
            (rms, format!(" is within the repeatability of {}: both directions are averaged", show(r)))
        }
        Reversal::Significant { rms, repeatability: r } => {
            (rms, format!(" against a repeatability of {}: forward and reverse are kept", show(r)))
        }
    };
    note!("note: {symbol}: reversal {} rms{what}", show(rms));
}

/// Mean of the readings at each position, both directions alike.
pub(super) fn means(readings: &[Reading]) -> (Vec<f64>, Vec<f64>) {
    let (positions, group) = group_by_position(readings);
    let mut sums = vec![[(0.0, 0usize); 2]; positions.len()];
    for (r, &g) in readings.iter().zip(&group) {
        let slot = &mut sums[g][usize::from(r.travel == Travel::Reverse)];
        slot.0 += r.value;
        slot.1 += 1;
    }
    let values = sums
        .iter()
        .map(|both| {
            let there: Vec<f64> = both.iter().filter(|(_, n)| *n > 0).map(|(s, n)| s / *n as f64).collect();
            there.iter().sum::<f64>() / there.len() as f64
        })
        .collect();
    (positions, values)
}

/// Takes the reference line out of a straightness, and lets every curve start from zero at the position nearest to home.
fn gauged(mut readings: Vec<Reading>, component: Component, axis: AxisName, rule: Rule) -> Vec<Reading> {
    let (x, mut y) = means(&readings);
    let is_straightness = !component.is_angle() && component.index() != axis.direction();
    if is_straightness && let Ok(line) = Line::fit(&x, &y, rule) {
        y = line.deviations(&x, &y);
        for r in &mut readings {
            r.value -= line.intercept + line.slope * r.position;
        }
    }
    let home = x.iter().zip(&y).min_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).map_or(0.0, |(_, v)| *v);
    for r in &mut readings {
        r.value -= home;
    }
    readings
}

/// Readings of an axis that carries the workpiece in the sense in which they are stored (equations 1.4).
fn stored_readings(readings: Vec<Reading>, measured: Sense, stored: Sense) -> Vec<Reading> {
    let sign = if measured == stored { 1.0 } else { -1.0 };
    readings
        .into_iter()
        .map(|r| match stored {
            Sense::Relative => Reading { value: sign * r.value, ..r },
            Sense::Carriage => {
                Reading { value: sign * r.value, position: -r.position, travel: r.travel.reversed(), ..r }
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(position: f64, value: f64, travel: Travel) -> Reading {
        Reading { cycle: 1, travel, position, value }
    }

    #[test]
    fn senses_of_an_axis_that_carries_the_workpiece() {
        let readings = vec![at(100.0, 0.01, Travel::Forward)];
        let of = |m, s| stored_readings(readings.clone(), m, s)[0];
        assert_eq!(of(Sense::Carriage, Sense::Relative), at(100.0, -0.01, Travel::Forward));
        assert_eq!(of(Sense::Carriage, Sense::Carriage), at(-100.0, 0.01, Travel::Reverse));
        assert_eq!(of(Sense::Relative, Sense::Carriage), at(-100.0, -0.01, Travel::Reverse));
        assert_eq!(of(Sense::Relative, Sense::Relative), at(100.0, 0.01, Travel::Forward));
    }

    #[test]
    fn the_gauge_takes_slope_and_value_at_home() {
        let line: Vec<Reading> =
            [-100.0, 0.0, 100.0].map(|x| at(x, 0.5 + 1e-4 * x + x.abs() * 1e-3, Travel::Forward)).to_vec();
        let straight = gauged(line.clone(), Component::Y, AxisName::X, Rule::EndPoint);
        let expected = [0.1, 0.0, 0.1];
        assert!(straight.iter().zip(expected).all(|(r, e)| (r.value - e).abs() < 1e-12), "{straight:?}");
        let scale = gauged(line, Component::X, AxisName::X, Rule::EndPoint);
        assert!((scale[2].value - 0.11).abs() < 1e-12 && scale[1].value == 0.0);
    }
}
