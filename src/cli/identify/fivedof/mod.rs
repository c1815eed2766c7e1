//! `volcomp identify fivedof`: runs of a 5-DOF laser, and its calibration with the carriage at rest.

mod drift_check;
mod head_file;
mod resting;

use self::drift_check::DriftCheck;
use self::head_file::HeadFile;
use super::straightness::axis_writer::{AxisWriter, Measured, Origin};
use crate::identify::prelude::*;
use crate::units::beyond_detectors;
use volcomp_identify::fivedof::align::{Aligned, Level, Stretch, align};
use volcomp_identify::fivedof::{Channels, Detector, FiveDof, Head, Readings, lateral, to_machine};

/// Straightness, roll, pitch and yaw of one axis from a 5-DOF laser with drift compensation.
#[derive(Debug, clap::Args)]
#[command(after_long_help = include_str!("help.txt"))]
pub(crate) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// Readings along the axis; - is stdin.
    #[arg(long, value_name = "FILE", requires = "calibration", requires = "axis", conflicts_with = "input")]
    data: Option<PathBuf>,
    /// Log of the resting carriage at two or more distances.
    #[arg(long, value_name = "FILE", requires = "calibration", requires = "axis")]
    resting: Option<PathBuf>,
    /// The instrument.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Write the instrument with the gains and signs of the resting log.
    #[arg(long, value_name = "FILE", requires = "resting")]
    write_calibration: Option<PathBuf>,
    /// The axis that moved.
    #[arg(long, value_name = "LETTER", value_parser = linear_axis)]
    axis: Option<AxisName>,
    /// What becomes of roll, whose slope only a level knows.
    #[arg(long, value_enum, default_value = "auto")]
    roll: RollArg,
    #[command(flatten)]
    out: AxisWriter,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum RollArg {
    /// With its slope where a level was read at both ends, else left out.
    Auto,
    /// About its end points.
    Detrended,
    /// Left out.
    Skip,
}

#[derive(Deserialize)]
struct Case {
    focal: Focal,
    distance: f64,
    beam_1_yz: [f64; 2],
    beam_2_yz: [f64; 2],
    /// `PSD1_y` and so on.
    readings: BTreeMap<String, f64>,
}

#[derive(Deserialize)]
struct Focal {
    f1: f64,
    f2: f64,
    f3: f64,
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.case.front(&self.out.model)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        let case: Case = file.read()?;
        let focal = [case.focal.f1, case.focal.f2, case.focal.f3];
        let head = Head::nominal(focal, [case.beam_1_yz, case.beam_2_yz]).map_err(|e| file.bad(e))?;
        let names = Detector::ALL.map(|d| ["y", "z"].map(|l| format!("{}_{l}", d.name().to_uppercase())));
        let mut change = Channels::default();
        for (value, name) in change.as_flattened_mut().iter_mut().zip(names.as_flattened()) {
            let missing = || file.bad(format_args!("missing field `{name}`"));
            *value = *case.readings.get(name).ok_or_else(missing)?;
        }
        let readings = Readings { distance: case.distance, change };
        let found = head.reduce(&readings);
        let without = head.without_drift_compensation().reduce(&readings);
        let names = ["EY", "EZ", "EA", "EB", "EC"];
        let object = |f: &FiveDof| -> Value {
            names.iter().zip(f.motion).map(|(k, v)| ((*k).to_owned(), json!(v))).collect()
        };
        let mut json = object(&found);
        json["without_drift_compensation"] = object(&without);
        json["pointing"] = json!(found.pointing);
        json["stretch"] = json!(found.stretch);
        Ok(printed(json, move || {
            for (i, component) in Component::ALL.into_iter().skip(1).enumerate() {
                let Units { value: unit, of_value, .. } = Units::of_component(component);
                let [a, b] = [found.motion[i], without.motion[i]].map(of_value);
                say_text!("{}{a:>12.3} {unit:<7} (without drift compensation {b:.3})", names[i]);
            }
        }))
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        let (Some(path), Some(axis)) = (&self.calibration, self.axis) else {
            return Err(usage!("give --data or --resting with --calibration and --axis, or --input"));
        };
        let mut file = HeadFile::read(path)?;
        let calibration =
            self.resting.as_deref().map(|log| resting::calibrated(self, axis, log, &mut file)).transpose()?;
        match (self.case.data(&self.data), calibration) {
            (Some(data), _) => Ok(Some(Box::new(Outcome::of(self, axis, data, file)?))),
            (None, Some(c)) => Ok(Some(printed(resting::json_of(&c), move || resting::print(axis, &c)))),
            (None, None) => Err(usage!("give --data, --resting or --input")),
        }
    }
}

/// Columns of the ten channels.
type ChannelColumns = [[Column; 2]; 5];

fn channel_columns(table: &mut Columns, axis: AxisName) -> Result<ChannelColumns> {
    let mut columns = Vec::with_capacity(5);
    for detector in Detector::ALL {
        let [a, b] = lateral(axis).map(|letter| format!("{}_{letter}_um", detector.name()));
        columns.push([table.column(&a)?, table.column(&b)?]);
    }
    Ok(core::array::from_fn(|i| columns[i]))
}

fn read_channels(row: &Columns, columns: &ChannelColumns) -> Result<Channels> {
    let mut channels = [[0.0; 2]; 5];
    for (value, column) in channels.as_flattened_mut().iter_mut().zip(columns.as_flattened()) {
        *value = row.within(*column, beyond_detectors)?;
    }
    Ok(channels)
}

/// A run as read.
struct Run {
    rows: Vec<Reading>,
    readings: Vec<Readings>,
    level: Level,
}

fn read_run(path: &Path, axis: AxisName) -> Result<Run> {
    let mut table = table::open(path)?;
    let (at, distance) = (table.run("position_mm")?, table.column("distance_mm")?);
    let channels = channel_columns(&mut table, axis)?;
    let level = table.find_column("level_arcsec");
    table.only_known()?;
    let mut levels: Vec<(f64, f64)> = Vec::new();
    let mut reference: Option<Channels> = None;
    let rows = table.some_rows(|row| {
        let now = read_channels(row, &channels)?;
        let zero = *reference.get_or_insert(now);
        let reading = row.reading(&at)?;
        let change = std::array::from_fn(|c| std::array::from_fn(|i| now[c][i] - zero[c][i]));
        let distance = row.value(distance)?;
        if let Some(column) = level.filter(|c| !row.word(*c).is_empty()) {
            levels.push((reading.position, row.deviation(column)?));
        }
        Ok((reading, Readings { distance, change }))
    })?;
    let (rows, readings): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
    let level = level_of(path, &rows, &levels)?;
    Ok(Run { rows, readings, level })
}

/// Change of the level from the lowest to the highest position.
fn level_of(path: &Path, rows: &[Reading], levels: &[(f64, f64)]) -> Result<Level> {
    if levels.is_empty() {
        return Ok(Level::None);
    }
    let [low, high] = hull(rows.iter().map(|r| r.position));
    let mean = |x: f64| {
        let there: Vec<f64> = levels.iter().filter(|(p, _)| *p == x).map(|(_, v)| *v).collect();
        (!there.is_empty()).then(|| there.iter().sum::<f64>() / there.len() as f64)
    };
    match (mean(low), mean(high)) {
        (Some(first), Some(last)) => Ok(Level::Read(last - first)),
        _ => Err(data!(
            path,
            "level_arcsec must be read at both ends, {low} and {high} mm; read it there or leave the column out"
        )),
    }
}

/// A run, the errors found in it and what they were checked against.
struct Outcome<'a> {
    args: &'a Args,
    axis: AxisName,
    measured: Vec<Measured>,
    aligned: Aligned,
    /// Largest pointing drift, rad.
    drift: f64,
    /// Between the corner cubes.
    stretch: Stretch,
    check: Option<DriftCheck>,
    origin: Origin,
}

impl<'a> Outcome<'a> {
    fn of(args: &'a Args, axis: AxisName, path: &Path, file: HeadFile) -> Result<Self> {
        let (run, head) = (read_run(path, axis)?, &file.head);
        if file.calibrated_from.is_none() {
            note!(
                "warning: signs and gains of the drift compensation are nominal; a log of the resting carriage at two distances (--resting) proves them"
            );
        }
        let reduced: Vec<FiveDof> = run.readings.iter().map(|r| head.reduce(r)).collect();
        let positions: Vec<f64> = run.rows.iter().map(|r| r.position).collect();
        let level = if args.roll == RollArg::Detrended { Level::None } else { run.level };
        let aligned = align(head, &positions, &reduced, level).map_err(|e| Failure::data(path, e))?;
        let with_roll = match (args.roll, run.level) {
            (RollArg::Skip, _) => false,
            (RollArg::Auto, Level::None) => {
                note!(
                    "note: roll is left out: beams that are not parallel look like roll that grows, and only a level read at both ends tells (level_arcsec); --roll detrended keeps its shape"
                );
                false
            }
            _ => true,
        };
        let files = [path.to_owned()].iter().chain(&args.calibration).chain(&args.resting).cloned().collect();
        Ok(Self {
            args,
            axis,
            measured: measured(axis, &run, &aligned, head, with_roll),
            aligned,
            drift: reduced.iter().flat_map(|r| r.pointing).flatten().fold(0.0f64, |m, v| m.max(v.abs())),
            stretch: Stretch::of(&positions, &reduced, head, &run.readings),
            check: DriftCheck::of(axis, &run, head),
            origin: Origin { method: "fivedof", files, instrument: file.instrument },
        })
    }
}

impl Found for Outcome<'_> {
    fn json(&self) -> Value {
        let mut json = json!({
            "pointing_max_arcsec": arcsec_from_rad(self.drift),
            "stretch_rms_um": um_from_mm(self.stretch.rms),
            "stretch_expected_um": um_from_mm(self.stretch.expected),
            "rigid": self.stretch.is_rigid,
            "drift_check": self.check,
        });
        for m in &self.measured {
            let symbol = m.symbol(self.axis);
            let Units { value: unit, of_value, .. } = Units::of(symbol);
            json[column(symbol)] = m.readings.iter().map(|r| of_value(r.value)).collect();
            json[format!("{}_std_{unit}", key(symbol))] = json!(m.std.map(of_value));
            json["position_mm"] = m.readings.iter().map(|r| r.position).collect();
        }
        json
    }

    fn print(&self) {
        say!("{:<8}{:>14}{:>20}", "error", "range", "std of a reading");
        for m in &self.measured {
            let symbol = m.symbol(self.axis);
            let Units { value: unit, of_value, .. } = Units::of(symbol);
            let [low, high] = hull(m.readings.iter().map(|r| of_value(r.value)));
            let (range, std) = (high - low, or_dash(m.std.map(of_value), 3));
            say_text!("{symbol:<8}{range:>10.2} {unit:<7}{std:>12} {unit}");
        }
        say!();
        say!("largest pointing drift removed: {:.2} arcsec", arcsec_from_rad(self.drift));
        let slope = arcsec_from_rad(self.aligned.roll_slope * 1e3);
        say!("beams not parallel: {slope:.2} arcsec of roll per metre removed");
        let (rms, expected) = (um_from_mm(self.stretch.rms), um_from_mm(self.stretch.expected));
        let verdict = match (expected > 0.0, self.stretch.is_rigid) {
            (false, _) => "the noise of the channels is not known",
            (true, true) => "within the noise",
            (true, false) => "MORE than the noise: the carriage bends, or the drift correction is wrong",
        };
        say_text!(
            "corner cubes against each other: {rms:.3} um rms, the noise explains {expected:.3} um: {verdict}"
        );
        self.check.iter().for_each(DriftCheck::print);
    }

    fn write(&self, end: &mut String) -> Result<()> {
        *end = self.args.out.write(self.axis, &self.measured, None, &self.origin)?;
        Ok(())
    }
}

/// The aligned errors in machine directions, one list of readings per error.
fn measured(axis: AxisName, run: &Run, aligned: &Aligned, head: &Head, with_roll: bool) -> Vec<Measured> {
    let covariance = head.covariance(run.readings.iter().map(|r| r.distance).fold(0.0, f64::max));
    let std = to_machine(axis, std::array::from_fn(|i| covariance[(i, i)].sqrt()));
    let (along, roll) = (axis.direction(), axis.direction() + 3);
    let of = |component: Component| {
        let i = component.index();
        let rows = run.rows.iter().zip(&aligned.motion);
        let readings = rows.map(|(r, m)| Reading { value: to_machine(axis, *m)[i], ..*r }).collect();
        Measured { component, readings, std: Some(std[i]).filter(|s| *s > 0.0) }
    };
    let is_measured = |c: &Component| c.index() != along && (with_roll || c.index() != roll);
    Component::ALL.into_iter().filter(is_measured).map(of).collect()
}
