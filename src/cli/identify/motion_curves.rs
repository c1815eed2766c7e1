//! Error motions of a linear axis to curves, a model file and a motion table: the last step of the methods that find
//! all six at every position.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::files::write_text;
use crate::fit::report::{Fitted, comments, note_text, print_table};
use crate::model_writer::{ModelWriter, Sources, axis_entry, put};
use crate::{EX_DATAERR, Failure};
use volcomp_config::ModelFile;
use volcomp_identify::curve::{self, Basis, Request};
use volcomp_identify::motion::{Gauged, Line, MotionRow, gauge, means, symbols};
use volcomp_model::geometry::Vec3;
use volcomp_model::spec::{ReferenceBody, ReferencePoint};
use volcomp_model::{Component, ErrorFunction, Sense};
use volcomp_units::axes::{AxisName, Travel};
use volcomp_units::{arcsec_from_rad, um_from_mm};

/// What becomes of the error motions.
#[derive(Debug, clap::Args)]
pub(super) struct CurveArgs {
    #[command(flatten)]
    pub(super) model: ModelWriter,
    /// Family of the curves in the model.
    #[arg(long, value_enum, default_value = "auto")]
    basis: BasisArg,
    /// The line taken out of the straightnesses; its slope is reported.
    #[arg(long, value_enum, default_value = "end-point")]
    straightness: LineArg,
    /// Coordinate at which all six are zero; default 0, or the nearest end of the measured range.
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    zero_at_mm: Option<f64>,
    /// Write the error motions as a table for volcomp fit.
    #[arg(long, value_name = "FILE")]
    motions: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum BasisArg {
    /// Half-range or Chebyshev, or a fitted period or table where the data call for it.
    Auto,
    /// Mean, linear part and sine half waves.
    HalfRange,
    /// Chebyshev polynomials.
    Chebyshev,
    /// The mean at every position, with a reverse curve where both directions were measured.
    Table,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum LineArg {
    /// Through the first and the last position.
    EndPoint,
    /// Least squares.
    LeastSquares,
    /// None: the frame of the instrument is trusted.
    AsMeasured,
}

/// Where the motions hold and what they were made from.
pub(super) struct Origin<'a> {
    /// The axis.
    pub(super) axis: AxisName,
    /// Point of the carriage at which EX EY EZ hold, M at home, mm.
    pub(super) reference: Vec3,
    /// What measured.
    pub(super) method: &'static str,
    /// The data files.
    pub(super) files: &'a [PathBuf],
}

impl CurveArgs {
    /// True where a model or a table of motions is wanted.
    pub(super) fn writes(&self) -> bool {
        self.model.target().is_some() || self.motions.is_some()
    }

    /// Brings the motions (relative sense) into the gauge of a model.
    pub(super) fn gauge(&self, rows: Vec<MotionRow>, origin: &Origin<'_>) -> Result<Gauged, Failure> {
        let line = match self.straightness {
            LineArg::EndPoint => Line::EndPoint,
            LineArg::LeastSquares => Line::LeastSquares,
            LineArg::AsMeasured => Line::AsMeasured,
        };
        gauge(rows, origin.axis, self.zero_at_mm, line)
            .map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {}: {e}", names(origin.files))))
    }

    /// Fits curves and writes what was asked for; the table of fits goes to stdout where `say` and a model is written.
    pub(super) fn write(
        &self,
        gauged: &Gauged,
        origin: &Origin<'_>,
        base: ModelFile,
        say: bool,
    ) -> Result<(), Failure> {
        if let Some(path) = &self.motions {
            write_text(path, &motion_table(gauged, origin))?;
        }
        if self.model.target().is_none() {
            return Ok(());
        }
        let fitted = self.fit(gauged, origin)?;
        let sources = Sources::of(origin.files);
        let mut comment = comments(&format!("identify {}", origin.method), &sources, &fitted);
        let r = origin.reference;
        comment.push(format!(
            "{}: zero at {} mm, reference point of EX EY EZ ({:.3} {:.3} {:.3}) mm in M at home",
            origin.axis, gauged.reference_position, r.x, r.y, r.z
        ));
        self.model.write(
            &self.model_with(gauged, origin, base, &fitted, &sources),
            &comment,
            &names(origin.files),
        )?;
        for f in &fitted {
            for note in &f.fit.notes {
                note!("note: {}: {}", f.symbol, note_text(f.symbol, *note));
            }
        }
        if say && !self.model.takes_stdout() {
            say!();
            print_table(&fitted);
        }
        Ok(())
    }

    fn fit(&self, gauged: &Gauged, origin: &Origin<'_>) -> Result<Vec<Fitted>, Failure> {
        let request = Request {
            basis: match self.basis {
                BasisArg::Auto => None,
                BasisArg::HalfRange => Some(Basis::HalfRange),
                BasisArg::Chebyshev => Some(Basis::Chebyshev),
                BasisArg::Table => Some(Basis::Table),
            },
            ..Request::default()
        };
        symbols(origin.axis)
            .into_iter()
            .map(|symbol| {
                let readings = gauged.readings(symbol.component());
                let fit = curve::fit(&readings, &request).map_err(|e| {
                    Failure::new(EX_DATAERR, format_args!("error: {}: {symbol}: {e}", names(origin.files)))
                })?;
                Ok(Fitted::new(symbol, readings.into(), fit))
            })
            .collect()
    }

    fn model_with(
        &self,
        gauged: &Gauged,
        origin: &Origin<'_>,
        mut model: ModelFile,
        fitted: &[Fitted],
        sources: &Sources,
    ) -> ModelFile {
        for f in fitted {
            // the scatter about the curve holds noise and what the curve misses; without it, the noise alone
            let std = f.fit.figures.rmse_dof.or(Some(gauged.std(f.symbol.component())));
            let function = ErrorFunction { std, ..ErrorFunction::single(f.fit.curve.clone()) };
            put(&mut model, f.symbol, function, sources.provenance());
        }
        let axis = axis_entry(&mut model.spec, origin.axis);
        // all six of the axis are new, and they are in this sense
        axis.sense = Sense::Relative;
        axis.reference_points =
            [ReferencePoint { point: origin.reference, body: ReferenceBody::Carriage }; 3];
        if axis.travel.is_none() {
            let ends =
                |f: fn(f64, f64) -> f64, from: f64| gauged.rows.iter().fold(from, |m, r| f(m, r.position));
            axis.travel = Some([ends(f64::min, f64::MAX), ends(f64::max, f64::MIN)]);
        }
        model
    }
}

/// The files of a message.
pub(super) fn names(files: &[PathBuf]) -> String {
    files.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// Factor from mm or rad to um or arcsec.
pub(super) fn in_print_units(component: Component, value: f64) -> f64 {
    if component.is_angle() { arcsec_from_rad(value) } else { um_from_mm(value) }
}

/// One row per reading, as `volcomp fit` takes it.
fn motion_table(gauged: &Gauged, origin: &Origin<'_>) -> String {
    let r = origin.reference;
    let mut text = format!(
        "# {} by {}: reference point of ex ey ez at x={} y={} z={} mm in M at home, zero at {} mm\nposition_mm,cycle,direction",
        origin.axis, origin.method, r.x, r.y, r.z, gauged.reference_position
    );
    for symbol in symbols(origin.axis) {
        let unit = if symbol.is_angle() { "arcsec" } else { "um" };
        let _ = write!(text, ",{}_{unit}", symbol.to_string().to_lowercase());
    }
    text.push('\n');
    for row in &gauged.rows {
        let direction = if row.travel == Travel::Forward { 1 } else { -1 };
        let _ = write!(text, "{},{},{direction}", row.position, row.cycle);
        for component in Component::ALL {
            let _ = write!(text, ",{:.6}", in_print_units(component, row.motion[component.index()]));
        }
        text.push('\n');
    }
    text
}

/// The means at the positions, for people.
pub(super) fn print_motions(gauged: &Gauged, axis: AxisName) {
    let (positions, means) = means(&gauged.rows);
    let mut head = format!("{:>12}", "position mm");
    for symbol in symbols(axis) {
        let unit = if symbol.is_angle() { "arcsec" } else { "um" };
        let _ = write!(head, "{:>12}", format!("{symbol} {unit}"));
    }
    say!("{head}");
    for (position, motion) in positions.iter().zip(&means) {
        let mut line = format!("{position:>12.3}");
        for component in Component::ALL {
            let _ = write!(line, "{:>12.3}", in_print_units(component, motion[component.index()]));
        }
        say!("{line}");
    }
    let mut line = format!("{:>12}", "std (k=1)");
    for component in Component::ALL {
        let _ = write!(line, "{:>12.3}", in_print_units(component, gauged.std(component)));
    }
    say!("{line}   of one reading at one position");
    let slopes: Vec<String> = (0..3)
        .filter(|i| *i != axis.direction())
        .map(|i| format!("{} {:+.3}", symbols(axis)[i], arcsec_from_rad(gauged.slope[i])))
        .collect();
    say!(
        "zero at {} mm; slopes removed from the straightnesses (arcsec): {}",
        gauged.reference_position,
        slopes.join(", ")
    );
}

/// The gauged motions for machines, mm and rad.
pub(super) fn motions_json(gauged: &Gauged, origin: &Origin<'_>) -> Value {
    let (positions, means) = means(&gauged.rows);
    json!({
        "axis": origin.axis.to_string().to_lowercase(),
        "reference_point": origin.reference.as_slice(),
        "zero_at": gauged.reference_position,
        "constant_removed": gauged.constant.as_slice(),
        "slope_removed": gauged.slope,
        "positions": positions,
        "motion": means.iter().map(|m| m.as_slice().to_vec()).collect::<Vec<_>>(),
        "sigma": Component::ALL.map(|c| gauged.std(c)),
        "rows": gauged.rows.len(),
    })
}

/// A motion table written by another method, one row per reading: positions and the six motions (mm, rad).
pub(super) fn read_motions(path: &Path, axis: AxisName) -> Result<Vec<(f64, [f64; 6])>, Failure> {
    let mut table = crate::table::open(path)?;
    let position = table.require("position_mm")?;
    let mut columns = Vec::with_capacity(6);
    for symbol in symbols(axis) {
        let unit = if symbol.is_angle() { "arcsec" } else { "um" };
        columns.push(table.require(&format!("{}_{unit}", symbol.to_string().to_lowercase()))?);
    }
    let mut rows = Vec::new();
    while table.advance()? {
        let mut motion = [0.0; 6];
        for (component, column) in Component::ALL.into_iter().zip(&columns) {
            // the inverse of what goes out
            motion[component.index()] = table.number(*column)? / in_print_units(component, 1.0);
        }
        rows.push((table.number(position)?, motion));
    }
    Ok(rows)
}
