//! `volcomp identify ballbar`: causes of the deviations on ballbar circles, ranked.

pub(crate) mod report;

use std::path::{Path, PathBuf};

use crate::arg_parsers::{numbers, point};
use crate::identify::case;
use crate::model_writer::{ModelWriter, Sources, axis_entry, default_chain, put};
use crate::{EX_DATAERR, EX_USAGE, Failure, table};
use volcomp_config::{ModelFile, Provenance};
use volcomp_identify::ballbar::{
    Analysis, Assembled, Circles, Pitch, Plane, Request, Sample, analyse, assemble, cut_overshoot,
};
use volcomp_model::curve::{CurveError, Table};
use volcomp_model::geometry::Vec3;
use volcomp_model::{Curve, ErrorFunction, ErrorSymbol, Sense};
use volcomp_units::axes::AxisName;
use volcomp_units::{mm_from_um, rad_from_deg};

/// Causes of the deviations on ballbar circles, all at once and ranked by what they add to the circularity.
///
/// A ballbar (telescoping bar between two balls) reads how much too long the radius is while the machine runs circles.
/// Found are squareness, scale mismatch, servo mismatch, and per axis backlash and lateral play (both ends of travel),
/// straightness, reversal spikes, and with a pitch the cyclic error: each with uncertainty, share, and the effects that
/// these data cannot tell from it. Names and units are those of ballbar result files (AF_..).
///
/// Columns of --data: angle_deg (from the first axis of the plane towards the second), deviation_um (actual minus
/// nominal length), direction (1 in that sense, -1 back), optional feed_mm_per_min and run; in the order they were taken.
/// Overshoot may be in the file: what is more than one turn is cut, half at either end; for arcs give --overshoot-deg.
///
/// Run both directions (else squareness and servo mismatch are one) and two feeds. With --out or --into squareness,
/// scale, straightness, backlash and cyclic errors go to a model file where they are significant.
///
/// Example: volcomp identify ballbar --data xy=xy.csv --data zx=zx.csv --radius-mm 150 --centre-mm=425,250,-250
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Readings of a plane (xy, yz or zx) in one mounting of the instrument; once per plane.
    #[arg(long, value_name = "PLANE=CSV", required_unless_present = "files", value_parser = plane_file)]
    data: Vec<(Plane, PathBuf)>,
    /// The files of --data.
    #[arg(value_name = "PLANE=CSV", conflicts_with = "data", value_parser = plane_file)]
    files: Vec<(Plane, PathBuf)>,
    #[command(flatten)]
    setup: SetUp,
    /// The ballbar's length is calibrated to this standard uncertainty: the radius then gives the scale of both axes.
    #[arg(long, value_name = "UM")]
    length_std_um: Option<f64>,
    #[command(flatten)]
    out: ModelWriter,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

/// How the circles were run, and what is looked for.
#[derive(Debug, clap::Args)]
pub(crate) struct SetUp {
    /// Nominal length of the ballbar.
    #[arg(long, value_name = "MM")]
    radius_mm: f64,
    /// Programmed X, Y, Z at the centre of the circles.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "0,0,0")]
    centre_mm: Vec3,
    /// Feed, where the files have no column for it.
    #[arg(long, value_name = "MM/MIN")]
    feed_mm_per_min: Option<f64>,
    /// Overshoot to cut at both ends of each run; default: what is more than one turn.
    #[arg(long, value_name = "DEG")]
    overshoot_deg: Option<f64>,
    /// Screw pitch of an axis, such as x=10; its cyclic error is then among the effects.
    #[arg(long, value_name = "AXIS=MM", value_parser = pitch)]
    pitch_mm: Vec<(AxisName, f64)>,
    /// Look for the pitch of axes without --pitch-mm between these limits.
    #[arg(long, value_name = "LOW,HIGH", value_parser = pair)]
    pitch_search_mm: Option<[f64; 2]>,
    /// Time from a reversal to the peak of its spike; default: fitted.
    #[arg(long, value_name = "MS")]
    spike_ms: Option<f64>,
}

fn plane_file(text: &str) -> Result<(Plane, PathBuf), String> {
    match text.split_once('=').map(|(p, f)| (Plane::parse(p), f)) {
        Some((Some(plane), file)) if !file.is_empty() => Ok((plane, PathBuf::from(file))),
        _ => Err(format!(
            "'{text}' names no plane and file; write for example xy=circle.csv (planes: xy yz zx)"
        )),
    }
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    numbers(text).ok_or_else(|| format!("invalid pair of numbers '{text}'; write for example 4,40"))
}

fn pitch(text: &str) -> Result<(AxisName, f64), String> {
    let wrong = || format!("invalid pitch of an axis '{text}'; write for example x=10");
    let (axis, value) = text.split_once('=').ok_or_else(wrong)?;
    let mut letters = axis.chars();
    let name = letters.next().and_then(AxisName::from_letter).filter(|_| letters.next().is_none());
    let value = value.parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0);
    name.zip(value).ok_or_else(wrong)
}

/// The readings of a plane and what was made of them.
pub(crate) struct Plan {
    pub(crate) path: PathBuf,
    pub(crate) circles: Circles,
    pub(crate) analysis: Analysis,
}

impl Plan {
    /// Reads and analyses the circles of a plane.
    pub(crate) fn read(setup: &SetUp, plane: Plane, path: &Path) -> Result<Self, Failure> {
        let circles = read(setup, plane, path)?;
        let analysis = analyse(&circles, &request(setup, plane))
            .map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {}: {e}", path.display())))?;
        Ok(Self { path: path.to_owned(), circles, analysis })
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let data = if args.data.is_empty() { &args.files } else { &args.data };
    for (i, (plane, _)) in data.iter().enumerate() {
        if data[..i].iter().any(|(p, _)| p == plane) {
            let what = format_args!("error: plane {plane} is given twice; join its files, one mounting each");
            return Err(Failure::new(EX_USAGE, what));
        }
    }
    let mut plans = Vec::with_capacity(data.len());
    for (plane, path) in data {
        plans.push(Plan::read(&args.setup, *plane, path)?);
    }
    if args.out.target().is_some() {
        write_model(args, &plans)?;
    }
    if args.out.takes_stdout() {
        return Ok(());
    }
    if args.json {
        let planes: Vec<_> = plans.iter().map(|p| report::as_json(p, args.length_std_um)).collect();
        case::print_json(&serde_json::json!({ "planes": planes }));
    } else {
        for plan in &plans {
            report::print(plan);
        }
    }
    Ok(())
}

fn request(args: &SetUp, plane: Plane) -> Request {
    let of = |axis: AxisName| {
        let given = args.pitch_mm.iter().find(|(a, _)| *a == axis).map(|(_, p)| Pitch::Given(*p));
        given.or_else(|| args.pitch_search_mm.map(Pitch::Search)).unwrap_or_default()
    };
    Request { pitch: plane.axes().map(of), spike_time: args.spike_ms.map(|ms| ms / 1e3) }
}

fn read(args: &SetUp, plane: Plane, path: &Path) -> Result<Circles, Failure> {
    let mut table = table::open(path)?;
    let (angle, deviation, direction) =
        (table.require("angle_deg")?, table.require("deviation_um")?, table.require("direction")?);
    let (feed, run) = (table.find("feed_mm_per_min"), table.find("run"));
    let known = ["angle_deg", "deviation_um", "direction", "feed_mm_per_min", "run"];
    if let Some(i) = table.columns().iter().position(|c| !known.contains(&c.as_str())) {
        return Err(table.fail(i, format_args!("unknown column; columns are {}", known.join(", "))));
    }
    let mut samples = Vec::new();
    while table.advance()? {
        let feed = feed.map(|c| table.number(c)).transpose()?.or(args.feed_mm_per_min);
        samples.push(Sample {
            angle: rad_from_deg(table.number(angle)?),
            deviation: mm_from_um(table.number(deviation)?),
            travel: table.travel(direction)?,
            feed: feed.map(|f| f / 60.0),
            run: run.map_or(Ok(0), |c| table.count(c))?,
        });
    }
    let samples = cut_overshoot(&samples, args.overshoot_deg.map(rad_from_deg));
    let centre = plane.axes().map(|a| args.centre_mm[a.direction()]);
    Ok(Circles { plane, radius: args.radius_mm, centre, samples })
}

/// Squareness and curves that a static model can hold.
fn write_model(args: &Args, plans: &[Plan]) -> Result<(), Failure> {
    let analyses: Vec<Analysis> = plans.iter().map(|p| p.analysis.clone()).collect();
    let names = plans.iter().map(|p| p.path.display().to_string()).collect::<Vec<_>>().join(", ");
    let bad = |e: CurveError| Failure::new(EX_DATAERR, format_args!("error: {names}: {e}"));
    let found = assemble(&analyses, args.length_std_um.map(mm_from_um)).map_err(bad)?;
    if found.is_empty() {
        note!("note: no squareness, scale, straightness, backlash or cyclic error is significant");
    }
    let axes = plans.iter().flat_map(|p| p.circles.plane.axes());
    let mut model = args.out.base(|| default_chain(axes))?;
    let files: Vec<PathBuf> = plans.iter().map(|p| p.path.clone()).collect();
    let sources = Sources::of(&files);
    for one in &found {
        if let Some(apart) = one.disagreement.filter(|d| *d > 3.0) {
            note!(
                "note: {}: the planes disagree by {apart:.1} standard deviations; their mean was written",
                one.symbol
            );
        }
        store(&mut model, one, sources.provenance()).map_err(bad)?;
    }
    let angular = model.spec.errors.iter().any(|(s, _)| s.is_angle() && !s.is_constant());
    if angular {
        note!(
            "note: the model holds angular errors; what they do at the place of the circles is in the values found, too"
        );
    }
    args.out.write(&model, &sources.comments(), &names)
}

/// Puts an error into the model, in the sense of its axis.
fn store(model: &mut ModelFile, found: &Assembled, from: Provenance) -> Result<(), CurveError> {
    let axis = found.symbol.axis();
    let carriage = model.spec.axis(axis).sense == Sense::Carriage && model.spec.is_workpiece_side(axis);
    let curve = match (&found.curve, found.symbol) {
        (Curve::Table(table), ErrorSymbol::Motion { .. }) if carriage => Curve::Table(mirrored(table)?),
        (curve, _) => curve.clone(),
    };
    put(model, found.symbol, ErrorFunction { std: Some(found.std), ..ErrorFunction::single(curve) }, from);
    axis_entry(&mut model.spec, axis);
    Ok(())
}

/// `E_carriage(x) = -E_relative(-x)`; travel towards plus of one is towards minus of the other.
fn mirrored(table: &Table) -> Result<Table, CurveError> {
    let (positions, forward, reverse) = table.columns();
    let flip = |v: &[f64]| v.iter().rev().map(|x| -x).collect::<Vec<f64>>();
    let other = reverse.unwrap_or(forward);
    Table::new(flip(positions), flip(other), reverse.map(|_| flip(forward)), table.interpolation())
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::curve::Interpolation;
    use volcomp_units::axes::Travel;

    #[test]
    fn arguments_are_read() {
        assert_eq!(plane_file("ZX=a.csv"), Ok((Plane::Zx, PathBuf::from("a.csv"))));
        assert!(plane_file("xz=a.csv").is_err() && plane_file("xy").is_err());
        assert!(pair("1,nan").is_err());
        assert_eq!(pitch("x=10"), Ok((AxisName::X, 10.0)));
        assert!(pitch("x=0").is_err() && pitch("xy=10").is_err());
    }

    #[test]
    fn the_carriage_sense_mirrors_place_sign_and_direction() {
        let relative = Table::new(
            vec![0.0, 100.0, 300.0],
            vec![1.0, 2.0, 4.0],
            Some(vec![3.0, 5.0, 7.0]),
            Interpolation::Linear,
        )
        .unwrap();
        let carriage = mirrored(&relative).unwrap();
        for x in [0.0, 50.0, 100.0, 250.0, 300.0] {
            assert_eq!(carriage.value(-x, Travel::Reverse), -relative.value(x, Travel::Forward));
            assert_eq!(carriage.value(-x, Travel::Forward), -relative.value(x, Travel::Reverse));
        }
    }
}
