//! Error motions of a linear axis to curves, a model file and a motion table: the last step of the methods that find
//! all six at every position.

use std::fmt::Write as _;

use crate::fit::basis::{Auto, BASES};
use crate::fit::report::comments;
use crate::identify::prelude::*;
use volcomp_identify::curve::{Basis, CurveFit};
use volcomp_identify::motion::{Gauged, Line, MotionRow, gauge, means, symbols};
use volcomp_model::spec::{ReferenceBody, ReferencePoint};

/// What becomes of the error motions.
#[derive(Debug, clap::Args)]
pub(super) struct CurveArgs {
    #[command(flatten)]
    pub(super) model: ModelWriter,
    /// Family of the curves in the model.
    #[arg(long, value_parser = one_of(BASES), default_value = "auto")]
    basis: Auto<Basis>,
    /// The line taken out of the straightnesses; its slope is reported.
    #[arg(long, value_parser = one_of(LINES), default_value = "end-point")]
    straightness: Line,
    /// Coordinate at which all six are zero; default 0, or the nearest end of the measured range.
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    zero_at_mm: Option<f64>,
    /// Write the error motions as a table for volcomp fit.
    #[arg(long, value_name = "FILE")]
    motions: Option<PathBuf>,
}

/// Lines that can be taken out of straightnesses.
const LINES: &[(&str, &str, Line)] = &[
    ("end-point", "Through the first and the last position", Line::EndPoint),
    ("least-squares", "Least squares", Line::LeastSquares),
    ("as-measured", "None: the frame of the instrument is trusted", Line::AsMeasured),
];

/// Where the motions hold and what they were made from.
pub(super) struct Origin {
    /// The axis.
    pub(super) axis: AxisName,
    /// Point of the carriage at which EX EY EZ hold, M at home, mm.
    pub(super) reference: Vec3,
    /// What measured.
    pub(super) method: &'static str,
    /// The data files.
    pub(super) files: Vec<PathBuf>,
}

/// What a method says about its motions beside their values.
pub(super) trait Report {
    /// The object, of which `motions` becomes a part.
    fn json(&self, motions: Value) -> Value;

    /// The report above the table of the motions.
    fn print(&self, motions: &Motions<'_>);

    /// Below it.
    fn print_below(&self) {}

    /// What needs attention.
    fn warn(&self, rows: usize);
}

/// The motions of an axis in the gauge of a model, with what a method says about them.
pub(super) struct Motions<'a> {
    pub(super) args: &'a CurveArgs,
    pub(super) gauged: Gauged,
    pub(super) origin: Origin,
    /// The model before.
    pub(super) base: ModelFile,
    pub(super) report: Box<dyn Report + 'a>,
}

impl CurveArgs {
    /// The options of a method that finds motions.
    pub(super) fn front<'a>(&'a self, case: &'a super::case::CaseArgs) -> Front<'a> {
        Front { writes_more: self.motions.is_some(), ..case.front(&self.model) }
    }

    /// Brings the motions (relative sense) into the gauge of a model.
    pub(super) fn gauge(&self, rows: Vec<MotionRow>, origin: &Origin) -> Result<Gauged> {
        gauge(rows, origin.axis, self.zero_at_mm, self.straightness).map_err(|e| data_error(&origin.files, e))
    }
}

impl Found for Motions<'_> {
    fn json(&self) -> Value {
        let (gauged, origin) = (&self.gauged, &self.origin);
        let (positions, means) = means(&gauged.rows);
        self.report.json(json!({
            "axis": origin.axis.lower().to_string(),
            "reference_point": origin.reference.as_slice(),
            "zero_at": gauged.reference_position,
            "constant_removed": gauged.constant.as_slice(),
            "slope_removed": gauged.slope,
            "positions": positions,
            "motion": means.iter().map(|m| m.as_slice()).collect::<Vec<_>>(),
            "sigma": Component::ALL.map(|c| gauged.std(c)),
            "rows": gauged.rows.len(),
        }))
    }

    fn print(&self) {
        self.report.print(self);
        self.print_means();
        self.report.print_below();
    }

    fn warn(&self) {
        self.report.warn(self.gauged.rows.len());
    }

    fn write(&self, end: &mut String) -> Result<()> {
        if let Some(path) = &self.args.motions {
            write_text(path, &self.table())?;
        }
        if self.args.model.target().is_none() {
            return Ok(());
        }
        let (origin, rows) = (&self.origin, &self.gauged.rows);
        let mut fits = CurveFits::new(self.base.clone(), &origin.files);
        for symbol in symbols(origin.axis) {
            let component = symbol.component();
            // without degrees of freedom the curve runs through the readings and is as uncertain as one of them
            let std = |fit: &CurveFit| fit.standard_uncertainty().or(Some(self.gauged.std(component)));
            let from = fits.sources.provenance();
            fits.add(symbol, self.gauged.readings(component), self.args.basis, std, from)?;
        }
        let axis = fits.model.spec.axis_mut(origin.axis);
        // all six of the axis are new, and they are in this sense
        axis.sense = Sense::Relative;
        let point = ReferencePoint { point: origin.reference, body: ReferenceBody::Carriage };
        axis.reference_points = [point; 3];
        axis.travel.get_or_insert_with(|| hull(rows.iter().map(|r| r.position)));
        let mut comment = comments(&format!("identify {}", origin.method), &fits.sources, &fits.fitted);
        let r = origin.reference;
        comment.push(format!(
            "{}: zero at {} mm, reference point of EX EY EZ ({:.3} {:.3} {:.3}) mm in M at home",
            origin.axis, self.gauged.reference_position, r.x, r.y, r.z
        ));
        *end = format!("\n{}", fits.write(&self.args.model, &comment)?);
        Ok(())
    }
}

impl Motions<'_> {
    /// One row per reading, as `volcomp fit` takes it.
    fn table(&self) -> String {
        let (origin, r) = (&self.origin, self.origin.reference);
        let mut text = format!(
            "# {} by {}: reference point of ex ey ez at x={} y={} z={} mm in M at home, zero at {} mm\nposition_mm,cycle,direction,",
            origin.axis, origin.method, r.x, r.y, r.z, self.gauged.reference_position
        );
        text.push_str(&symbols(origin.axis).map(column).join(","));
        for row in &self.gauged.rows {
            let direction = if row.travel == Travel::Forward { 1 } else { -1 };
            let _ = write!(text, "\n{},{},{direction}", row.position, row.cycle);
            for component in Component::ALL {
                let _ = write!(text, ",{:.6}", in_print_units(component, row.motion[component.index()]));
            }
        }
        text.push('\n');
        text
    }

    /// The means at the positions, for people.
    fn print_means(&self) {
        let (gauged, axis) = (&self.gauged, self.origin.axis);
        let (positions, means) = means(&gauged.rows);
        let cells = |of: &dyn Fn(Component) -> f64| {
            Component::ALL.map(|c| format!("{:>12.3}", in_print_units(c, of(c)))).concat()
        };
        let heads = symbols(axis).map(|s| format!("{:>12}", format!("{s} {}", Units::of(s).value)));
        say_text!("{:>12}{}", "position mm", heads.concat());
        for (position, motion) in positions.iter().zip(&means) {
            say!("{position:>12.3}{}", cells(&|c| motion[c.index()]));
        }
        let std = cells(&|c| gauged.std(c));
        say!("{:>12}{std}   of one reading at one position", "std (k=1)");
        let slope = |i: usize| format!("{} {:+.3}", symbols(axis)[i], arcsec_from_rad(gauged.slope[i]));
        let slopes = (0..3).filter(|i| *i != axis.direction()).map(slope).joined(", ");
        let zero = gauged.reference_position;
        say!("zero at {zero} mm; slopes removed from the straightnesses (arcsec): {slopes}");
    }
}

/// Factor from mm or rad to um or arcsec.
pub(super) fn in_print_units(component: Component, value: f64) -> f64 {
    (Units::of_component(component).of_value)(value)
}

/// A motion table written by another method, one row per reading: positions and the six motions (mm, rad).
pub(super) fn read_motions(path: &Path, axis: AxisName) -> Result<Vec<(f64, [f64; 6])>> {
    let mut table = table::open(path)?;
    let position = table.column("position_mm")?;
    let columns = symbols(axis).into_iter().map(|symbol| table.column(&column(symbol)));
    let columns = columns.collect::<Result<Vec<_>>>()?;
    table.rows(|row| {
        let mut motion = [0.0; 6];
        for (value, column) in motion.iter_mut().zip(&columns) {
            *value = row.value(*column)?;
        }
        Ok((row.value(position)?, motion))
    })
}
