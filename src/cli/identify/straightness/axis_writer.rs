//! Readings of one axis into a model file: sense, reference points, reference line, curves. Used by every method that
//! measures the error motions of one axis along a run.

use crate::fit::basis::{Auto, BASES};
use crate::identify::prelude::*;
use volcomp_identify::curve::{Basis, CurveFit};
use volcomp_identify::straightness::Rule;
use volcomp_identify::straightness::runs::{Reversal, as_one_direction, gauged, in_stored_sense, reversal};
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
        let (measured_sense, stored) = self.senses(&model.spec, axis, &symbols)?;
        let mut fits = CurveFits::new(model, &origin.files);
        for (m, symbol) in measured.iter().zip(symbols) {
            let mut readings = gauged(m.readings.clone(), m.component, axis, self.rule);
            if primed {
                readings = in_stored_sense(readings, measured_sense, stored);
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
        self.place(&mut fits, axis, moved, stored);
        let mut comment = fits.sources.heading(&format!("identify {}", origin.method));
        let (sense, rule) = (measured_sense.name(), self.rule.name().replace('_', "-"));
        comment
            .push(format!("axis {axis}: measured in the {sense} sense, straightness about the {rule} line"));
        fits.write(&self.model, &comment)
    }

    /// Measured and stored sense; for a tool-side axis they are the same thing.
    fn senses(&self, spec: &ModelSpec, axis: AxisName, replaced: &[ErrorSymbol]) -> Result<(Sense, Sense)> {
        let measured = match self.sense {
            Some(sense) => sense,
            None if !spec.is_workpiece_side(axis) => Sense::Relative,
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
    fn place(&self, fits: &mut CurveFits<'_>, axis: AxisName, moved: Option<Vec3>, stored: Sense) {
        let points = self.points(axis).map(|p| moved.or(p));
        let body = if moved.is_none() { self.body } else { ReferenceBody::Carriage };
        let entry = fits.model.spec.axis_mut(axis);
        entry.sense = stored;
        for symbol in fits.fitted.iter().map(|f| f.symbol).filter(|symbol| !symbol.is_angle()) {
            let i = symbol.component().index();
            match points[i] {
                Some(point) => entry.reference_points[i] = ReferencePoint { point, body },
                None => note!(
                    "note: {symbol}: no --point-mm: the reference point stays at {:?} mm; 100 mm beside it cost 5 um for every 10 arcsec",
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
