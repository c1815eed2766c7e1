//! `volcomp identify ballbar`: causes of the deviations on ballbar circles, ranked.

pub(crate) mod report;

use crate::identify::prelude::*;
use volcomp_evaluate::circle_prediction::predict;
use volcomp_evaluate::circular::{CircularReading, READINGS_NEEDED};
use volcomp_formats::axis_table::positioning_symbol;
use volcomp_identify::assemble::mirrored_curve;
use volcomp_identify::ballbar::{
    Analysis, Assembled, Circles, Pitch, Plane, Request, Sample, analyse, assemble, cut_overshoot,
    run_starts, travelled,
};
use volcomp_model::SENSORS_MAX;

/// Causes of the deviations on ballbar circles, all at once and ranked by what they add to the bidirectional circular error G(b).
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
/// scale, straightness, backlash and cyclic errors go to a model file where they are significant. With --into, what the
/// model predicts at the circles is subtracted first, and what is found is added to its errors.
///
/// Example: volcomp identify ballbar --data xy=xy.csv --data zx=zx.csv --radius-mm 150 --centre-mm=425,250,-250
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
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
    /// Programmed X, Y, Z at the centre of the circles; default: 0,0,0, with a note.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub(crate) centre_mm: Option<Vec3>,
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

impl SetUp {
    /// Programmed position of the centre.
    fn centre(&self) -> Vec3 {
        self.centre_mm.unwrap_or_else(Vec3::zeros)
    }

    /// Refuses the pitch of an axis that moves in none of the planes, and notes that the centre is not stated.
    pub(crate) fn check(&self, planes: &[Plane]) -> Result<()> {
        let moves = |axis: &AxisName| planes.iter().any(|p| p.axes().contains(axis));
        if let Some((axis, pitch)) = self.pitch_mm.iter().find(|(axis, _)| !moves(axis)) {
            let planes = planes.iter().joined(", ");
            return Err(usage!(
                "--pitch-mm {}={pitch}: axis {axis} does not move in plane {planes}; leave it out, or correct the letter or the plane",
                axis.lower()
            ));
        }
        if self.centre_mm.is_none() {
            note!(
                "note: no --centre-mm given: the centre of the circles is taken as X 0, Y 0, Z 0; errors of place are placed about it"
            );
        }
        Ok(())
    }
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
    let pitch = text.split_once('=').map(|(axis, value)| (axis_letter(axis), above_zero(value)));
    match pitch {
        Some((Ok(axis), Ok(value))) => Ok((axis, value)),
        _ => Err(format!("invalid pitch of an axis '{text}'; write for example x=10")),
    }
}

/// The readings of a plane and what was made of them.
pub(crate) struct Plan {
    pub(crate) path: PathBuf,
    pub(crate) circles: Circles,
    pub(crate) analysis: Analysis,
}

impl Plan {
    /// Reads and analyses the circles of a plane, less what a known model predicts there.
    pub(crate) fn read(setup: &SetUp, plane: Plane, path: &Path, known: Option<&Known>) -> Result<Self> {
        let mut circles = read(setup, plane, path)?;
        if let Some(known) = known {
            known.subtract(&mut circles, setup.centre()).map_err(|e| Failure::data(path, e))?;
        }
        let analysis = analyse(&circles, &request(setup, plane)).map_err(|e| Failure::data(path, e))?;
        Ok(Self { path: path.to_owned(), circles, analysis })
    }
}

/// The model that the result goes into. Its errors stay in it, so that what it predicts at the circles is no part of what
/// is found there.
pub(crate) struct Known {
    model: Model,
    /// Some of its terms follow sensors or motion, of which the circles say nothing.
    has_live: bool,
}

impl Known {
    /// The model of a file; `None` where it holds no errors.
    fn read(path: &Path) -> Result<Option<Self>> {
        let spec = read_model_file(path)?.spec;
        if spec.errors.is_empty() {
            return Ok(None);
        }
        let has_live = spec.errors.iter().any(|(_, f)| !f.live.is_empty() || !f.dynamics.is_empty());
        let model = Model::new(&spec).map_err(|e| Failure::data(path, e))?;
        Ok(Some(Self { model, has_live }))
    }

    /// Subtracts the predicted radial deviation from every reading.
    fn subtract(&self, circles: &mut Circles, centre_mm: Vec3) -> Result<(), String> {
        let readings: Vec<CircularReading> = circles.samples.iter().map(reading).collect();
        let circle = (centre_mm, circles.radius);
        let axes = circles.plane.axes();
        let predicted = predict(&self.model, &[0.0; SENSORS_MAX], &readings, circle, axes, false)
            .ok_or_else(|| {
                format!(
                    "the chain of the model of --into has no axes {} and {}, which plane {} needs",
                    axes[0], axes[1], circles.plane
                )
            })?;
        circles.samples.iter_mut().zip(predicted).for_each(|(s, mm)| s.deviation -= mm);
        Ok(())
    }
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        Front { file: None, json: self.json, model: Some(&self.out), writes_more: false, case_writes: false }
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        let data = if self.data.is_empty() { &self.files } else { &self.data };
        for (i, (plane, _)) in data.iter().enumerate() {
            if data[..i].iter().any(|(p, _)| p == plane) {
                let what = format_args!("plane {plane} is given twice; join its files, one mounting each");
                return Err(Failure::usage(what));
            }
        }
        self.setup.check(&data.iter().map(|(plane, _)| *plane).collect::<Vec<_>>())?;
        let known = self.out.into.as_deref().map(Known::read).transpose()?.flatten();
        let read = |(plane, path): &(Plane, PathBuf)| Plan::read(&self.setup, *plane, path, known.as_ref());
        let plans = data.iter().map(read).collect::<Result<_, _>>()?;
        Ok(Some(Box::new(Outcome { args: self, plans, known })))
    }
}

/// What was found in all planes.
struct Outcome<'a> {
    args: &'a Args,
    plans: Vec<Plan>,
    /// The model whose prediction was subtracted from the readings.
    known: Option<Known>,
}

impl Found for Outcome<'_> {
    fn json(&self) -> Value {
        let planes = self.plans.iter().map(|p| report::as_json(p, self.args.length_std_um));
        let mut json = json!({ "planes": planes.collect::<Vec<_>>() });
        if self.known.is_some() {
            json["prediction_subtracted"] = json!(self.args.out.into);
        }
        json
    }

    fn print(&self) {
        self.plans.iter().for_each(report::print);
    }

    fn warn(&self) {
        let (Some(known), Some(path)) = (&self.known, &self.args.out.into) else { return };
        note!(
            "note: the prediction of {} at the circles was subtracted from the readings; the values are what the circles show \
             beyond it, and they are added to the model",
            path.display()
        );
        if known.has_live {
            note!(
                "note: {}: its terms of sensors and of motion were taken as zero; measure the circles at the reference temperature",
                path.display()
            );
        }
    }

    /// Squareness and curves that a static model can hold.
    fn write(&self, _end: &mut String) -> Result<()> {
        let (args, plans) = (self.args, &self.plans);
        let analyses: Vec<Analysis> = plans.iter().map(|p| p.analysis.clone()).collect();
        let files: Vec<PathBuf> = plans.iter().map(|p| p.path.clone()).collect();
        let found =
            assemble(&analyses, args.length_std_um.map(mm_from_um)).map_err(|e| data_error(&files, e))?;
        if found.is_empty() {
            note!("note: no squareness, scale, straightness, backlash or cyclic error is significant");
        }
        let axes = plans.iter().flat_map(|p| p.circles.plane.axes());
        if args.length_std_um.is_none()
            && found.iter().any(|one| one.symbol == positioning_symbol(one.symbol.axis()))
        {
            note!(
                "note: without --length-std-um the mean scale of the axes of a plane is taken for zero; std-um does not hold it"
            );
        }
        let mut model = args.out.base(|| default_chain(axes))?;
        let sources = Sources::of(&files);
        for one in &found {
            if let Some(apart) = one.disagreement.filter(|d| *d > 3.0) {
                note!(
                    "note: {}: the planes disagree by {apart:.1} standard deviations; their mean was written",
                    one.symbol
                );
            }
            add(&mut model, one, sources.provenance());
        }
        args.out.write(&model, &sources.comments(), &files)
    }
}

fn request(args: &SetUp, plane: Plane) -> Request {
    let of = |axis: AxisName| {
        let given = args.pitch_mm.iter().find(|(a, _)| *a == axis).map(|(_, p)| Pitch::Given(*p));
        given.or_else(|| args.pitch_search_mm.map(Pitch::Search)).unwrap_or_default()
    };
    Request { pitch: plane.axes().map(of), spike_time: args.spike_ms.map(|ms| ms / 1e3) }
}

/// The reading of a sample.
pub(crate) const fn reading(s: &Sample) -> CircularReading {
    CircularReading { angle: s.angle, deviation: s.deviation, travel: s.travel }
}

/// The samples of a circular test, each with its line; feeds as `read_feed` gives them from a row, mm/min.
pub(crate) fn lines_and_samples(
    path: &Path,
    read_feed: impl Fn(&Columns, Column) -> Result<f64>,
) -> Result<Vec<(u64, Sample)>> {
    let mut table = table::open(path)?;
    let [angle, deviation, direction] = table.three(["angle_deg", "deviation_um", "direction"])?;
    let (feed, run) = (table.find_column("feed_mm_per_min"), table.find_column("run"));
    table.only_known()?;
    table.rows(|row| {
        let sample = Sample {
            angle: row.value(angle)?,
            deviation: row.deviation(deviation)?,
            travel: row.travel_of(Some(direction))?,
            feed: feed.map(|c| read_feed(row, c)).transpose()?,
            run: row.count_of(run)?,
        };
        Ok((row.line(), sample))
    })
}

fn read(args: &SetUp, plane: Plane, path: &Path) -> Result<Circles> {
    let (lines, mut samples): (Vec<u64>, Vec<Sample>) =
        lines_and_samples(path, Columns::value)?.into_iter().unzip();
    whole_feeds(path, &lines, &samples)?;
    for sample in &mut samples {
        sample.feed = sample.feed.or(args.feed_mm_per_min).map(|f| f / 60.0);
    }
    with_direction(path, &lines, &samples)?;
    let samples = cut_overshoot(&samples, args.overshoot_deg.map(rad_from_deg));
    let centre = plane.axes().map(|a| args.centre()[a.direction()]);
    Ok(Circles { plane, radius: args.radius_mm, centre, samples })
}

/// Refuses a feed with fewer readings in a direction than a circle needs: it is a slip.
fn whole_feeds(path: &Path, lines: &[u64], samples: &[Sample]) -> Result<()> {
    let mut runs: Vec<(f64, Travel, u64, usize)> = Vec::new();
    for (sample, line) in samples.iter().zip(lines) {
        let Some(feed) = sample.feed else { continue };
        match runs.iter_mut().find(|(f, travel, ..)| (*f, *travel) == (feed, sample.travel)) {
            Some((.., count)) => *count += 1,
            None => runs.push((feed, sample.travel, *line, 1)),
        }
    }
    let several = runs.iter().any(|run| run.0 != runs[0].0);
    match runs.iter().find(|(.., count)| several && *count < READINGS_NEEDED) {
        Some((feed, _, line, count)) => Err(failure!(
            EX_DATAERR,
            "{}:{line}: {} at {feed} mm/min in one direction; a circle needs {READINGS_NEEDED}: correct feed_mm_per_min, or leave them out",
            path.display(),
            counted(*count, "reading")
        )),
        None => Ok(()),
    }
}

/// Angle that a run may go against its direction, rad: more is no noise of the angles.
const AGAINST: f64 = core::f64::consts::FRAC_PI_2;

/// Refuses runs whose angle goes against the direction stated.
fn with_direction(path: &Path, lines: &[u64], samples: &[Sample]) -> Result<()> {
    for (first, angle) in run_starts(samples).into_iter().zip(travelled(samples)) {
        if angle < -AGAINST {
            let (direction, way) = match samples[first].travel {
                Travel::Forward => (1, "decreases"),
                Travel::Reverse => (-1, "increases"),
            };
            let (path, line, [by, limit]) =
                (path.display(), lines[first], [-angle, AGAINST].map(deg_from_rad));
            return Err(failure!(
                EX_DATAERR,
                "{path}:{line}: angle_deg {way} by {by:.0} deg over the run that begins here, against its direction {direction} (limit \
                 {limit:.0} deg); exchange 1 and -1 in column direction, or put the rows in the order they were taken"
            ));
        }
    }
    Ok(())
}

/// Adds an error to that of the model, in the sense of its axis.
fn add(model: &mut ModelFile, found: &Assembled, from: Provenance) {
    let axis = found.symbol.axis();
    let mirrors = model.spec.is_mirrored(axis) && matches!(found.symbol, ErrorSymbol::Motion { .. });
    let curve = if mirrors { mirrored_curve(&found.curve) } else { found.curve.clone() };
    let function = match model.spec.error(found.symbol) {
        None => ErrorFunction { std: Some(found.std), ..ErrorFunction::single(curve) },
        Some(old) => old.clone().with(curve, found.std),
    };
    let from = model.origin_of(found.symbol).map(|old| old.joined(&from)).unwrap_or(from);
    model.put(found.symbol, function, from);
    model.spec.axis_mut(axis);
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::curve::{Interpolation, Table};

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
        let carriage = mirrored_curve(&Curve::Table(relative.clone()));
        for x in [0.0, 50.0, 100.0, 250.0, 300.0] {
            assert_eq!(carriage.value(-x, Travel::Reverse), -relative.value(x, Travel::Forward));
            assert_eq!(carriage.value(-x, Travel::Forward), -relative.value(x, Travel::Reverse));
        }
    }
}
