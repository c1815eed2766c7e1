//! `volcomp identify fivedof`: runs of a 5-DOF laser, and its calibration with the carriage at rest.

mod drift_check;
mod head_file;

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use self::drift_check::DriftCheck;
use self::head_file::HeadFile;
use super::case::{CaseArgs, CaseFile, print_json};
use super::straightness::axis_writer::{AxisWriter, Measured, Origin};
use crate::arg_parsers::linear_axis;
use crate::files::write_text;
use crate::input::{self, InputKind};
use crate::positioning_data::no_rows;
use crate::{EX_USAGE, Failure, table};
use volcomp_identify::Reading;
use volcomp_identify::fivedof::align::{Aligned, Level, align};
use volcomp_identify::fivedof::resting::{Calibration, RestingReading, calibrate};
use volcomp_identify::fivedof::{Channels, Detector, FiveDof, Head, Readings, lateral, to_machine};
use volcomp_identify::straightness::{Line, Rule};
use volcomp_model::{Component, ErrorSymbol};
use volcomp_units::axes::{AxisName, Travel};
use volcomp_units::{arcsec_from_rad, mm_from_um, rad_from_arcsec, um_from_mm};

/// What the help says beside the options.
const HELP: &str = "A head sends two parallel beams to the carriage. PSD1 sees its pitch and yaw, the quadrant detectors \
    QD2 (beam 1) and QD1 (beam 2) its sideways motion, PSD2 and PSD3 the drift of the beams' own \
    pointing. Columns name the machine directions across the beam: y and z for axis X, z and x for Y, x \
    and y for Z.\n\n\
    The instrument is a file; signs, gains and noise may be left out, or come from a log of the resting \
    carriage:\n\n\
    \x20 format = \"volcomp-fivedof/1\"\n\
    \x20 focal-mm = { psd1 = 230.1, psd2 = 231.3, psd3 = 206.5 }\n\
    \x20 beam-1-mm = [-35, 8]        # corner cubes, from the point given with --point-mm\n\
    \x20 beam-2-mm = [33, 8]\n\n\
    Columns of --data: position_mm, distance_mm (head to carriage), psd1_y_um psd1_z_um psd2_y_um .. \
    psd3_z_um qd1_y_um .. qd2_z_um, optional cycle, direction, level_arcsec (roll by a level; only at \
    both ends, else empty).\n\n\
    Columns of --resting: distance_mm and the channels, in order of time, at two or more distances; \
    optional push_y_um push_z_um where the carriage was displaced by known amounts (that gives the signs \
    of the quadrant detectors, too).\n\n\
    Example:\n  volcomp identify fivedof --resting rest.csv --calibration head.toml --axis x --write-calibration cal.toml\n  volcomp identify fivedof --data x.csv --calibration cal.toml --axis x --sense carriage --chain \"[w X' b Y Z t]\" --point-mm 0,250,-600 --out model.toml";

/// Straightness, roll, pitch and yaw of one axis from a 5-DOF laser with drift compensation.
#[derive(Debug, clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Args {
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

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(file) = args.case.file() {
        file.writes_no_model(args.out.is_wanted())?;
        return run_case(args, file);
    }
    let (Some(path), Some(axis)) = (&args.calibration, args.axis) else {
        return Err(Failure::new(
            EX_USAGE,
            "error: give --data or --resting with --calibration and --axis, or --input",
        ));
    };
    let mut file = HeadFile::read(path)?;
    if let Some(log) = &args.resting {
        let calibration = run_resting(args, axis, log, &mut file)?;
        if args.case.data(&args.data).is_none() {
            report_calibration(args, axis, &calibration);
        }
    }
    match args.case.data(&args.data) {
        Some(data) => run_data(args, axis, data, &file),
        None if args.resting.is_none() => {
            Err(Failure::new(EX_USAGE, "error: give --data, --resting or --input"))
        }
        None => Ok(()),
    }
}

// ---------------------------------------------------------------------------------------------- reference vectors

#[derive(serde::Deserialize)]
struct Case {
    focal: Focal,
    distance: f64,
    beam_1_yz: [f64; 2],
    beam_2_yz: [f64; 2],
    readings: CaseReadings,
}

#[derive(serde::Deserialize)]
struct Focal {
    f1: f64,
    f2: f64,
    f3: f64,
}

#[derive(serde::Deserialize)]
#[expect(non_snake_case, reason = "the keys of the reference vectors")]
struct CaseReadings {
    PSD1_y: f64,
    PSD1_z: f64,
    PSD2_y: f64,
    PSD2_z: f64,
    PSD3_y: f64,
    PSD3_z: f64,
    QD1_y: f64,
    QD1_z: f64,
    QD2_y: f64,
    QD2_z: f64,
}

fn run_case(args: &Args, file: CaseFile<'_>) -> Result<(), Failure> {
    let case: Case = file.read()?;
    let focal = [case.focal.f1, case.focal.f2, case.focal.f3];
    let head = Head::nominal(focal, [case.beam_1_yz, case.beam_2_yz]).map_err(|e| file.bad(e))?;
    let r = &case.readings;
    let change = [
        [r.PSD1_y, r.PSD1_z],
        [r.PSD2_y, r.PSD2_z],
        [r.PSD3_y, r.PSD3_z],
        [r.QD1_y, r.QD1_z],
        [r.QD2_y, r.QD2_z],
    ];
    let readings = Readings { distance: case.distance, change };
    let found = head.reduce(&readings);
    let without = head.without_drift_compensation().reduce(&readings);
    let object = |f: &FiveDof| -> Map<String, Value> {
        ["EY", "EZ", "EA", "EB", "EC"]
            .iter()
            .zip(f.motion)
            .map(|(k, v)| ((*k).to_owned(), json!(v)))
            .collect()
    };
    if args.case.json {
        let mut result = object(&found);
        result.insert("without_drift_compensation".into(), Value::Object(object(&without)));
        result.insert("pointing".into(), json!(found.pointing));
        result.insert("stretch".into(), json!(found.stretch));
        print_json(&Value::Object(result));
        return Ok(());
    }
    for (i, name) in ["EY", "EZ", "EA", "EB", "EC"].iter().enumerate() {
        let (a, b, unit) = if i < 2 {
            (um_from_mm(found.motion[i]), um_from_mm(without.motion[i]), "um")
        } else {
            (arcsec_from_rad(found.motion[i]), arcsec_from_rad(without.motion[i]), "arcsec")
        };
        say!("{name}{a:>12.3} {unit:<7} (without drift compensation {b:.3})");
    }
    Ok(())
}

// ---------------------------------------------------------------------------------------------------- people's data

/// Columns of the ten channels.
fn channel_columns<R: std::io::BufRead>(
    table: &table::Table<R>,
    axis: AxisName,
) -> Result<[[usize; 2]; 5], Failure> {
    let mut columns = [[0; 2]; 5];
    for (pair, detector) in columns.iter_mut().zip(Detector::ALL) {
        for (slot, letter) in pair.iter_mut().zip(lateral(axis)) {
            *slot = table.require(&format!("{}_{letter}_um", detector.name()))?;
        }
    }
    Ok(columns)
}

fn read_channels<R: std::io::BufRead>(
    table: &table::Table<R>,
    columns: &[[usize; 2]; 5],
) -> Result<Channels, Failure> {
    let mut channels = [[0.0; 2]; 5];
    for (pair, columns) in channels.iter_mut().zip(columns) {
        for (value, column) in pair.iter_mut().zip(columns) {
            *value = mm_from_um(table.number(*column)?);
        }
    }
    Ok(channels)
}

/// Refuses columns that nobody asked for.
fn only<R: std::io::BufRead>(table: &table::Table<R>, known: &[usize]) -> Result<(), Failure> {
    match (0..table.columns().len()).find(|i| !known.contains(i)) {
        Some(i) => Err(table.fail(i, "unknown column; --help names the columns")),
        None => Ok(()),
    }
}

fn run_resting(
    args: &Args,
    axis: AxisName,
    path: &Path,
    file: &mut HeadFile,
) -> Result<Calibration, Failure> {
    let mut table = table::open(path)?;
    let distance = table.require("distance_mm")?;
    let channels = channel_columns(&table, axis)?;
    let push = lateral(axis).map(|letter| table.find(&format!("push_{letter}_um")));
    let mut known: Vec<usize> = channels.as_flattened().to_vec();
    known.push(distance);
    known.extend(push.iter().flatten());
    known.extend(table.find("t_s"));
    only(&table, &known)?;
    let mut log = Vec::new();
    while table.advance()? {
        let mut pushed = [0.0; 2];
        for (value, column) in pushed.iter_mut().zip(push) {
            if let Some(column) = column {
                *value = mm_from_um(table.number(column)?);
            }
        }
        log.push(RestingReading {
            distance: table.number(distance)?,
            push: pushed,
            channels: read_channels(&table, &channels)?,
        });
    }
    if log.is_empty() {
        return Err(no_rows(table.file()));
    }
    let calibration = calibrate(&file.head, &log).map_err(|e| Failure::data(path, e))?;
    file.head = calibration.head;
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    file.calibrated_from = Some(match input::hash(path, InputKind::Table) {
        Some(hash) => format!("{name}, blake3 {hash}"),
        None => name,
    });
    if let Some(out) = &args.write_calibration {
        write_text(out, &file.text(Some(&calibration)))?;
        note!("calibration written: {}", out.display());
    }
    Ok(calibration)
}

fn report_calibration(args: &Args, axis: AxisName, c: &Calibration) {
    if args.case.json {
        let pair = |e: &[volcomp_identify::fivedof::resting::Estimate; 2]| json!(e.map(|e| e.value));
        let std = |e: &[volcomp_identify::fivedof::resting::Estimate; 2]| json!(e.map(|e| e.std));
        let signs: Map<String, Value> =
            Detector::ALL.iter().zip(c.head.signs).map(|(d, s)| (d.name().to_owned(), json!(s))).collect();
        print_json(&json!({
            "signs": signs,
            "angle_gain": pair(&c.angle_gain), "angle_gain_std": std(&c.angle_gain),
            "gain_beam_1": pair(&c.gain[0]), "gain_beam_1_std": std(&c.gain[0]),
            "gain_beam_2": pair(&c.gain[1]), "gain_beam_2_std": std(&c.gain[1]),
            "path_beam_1_mm": pair(&c.path[0]), "path_beam_1_std_mm": std(&c.path[0]),
            "path_beam_2_mm": pair(&c.path[1]), "path_beam_2_std_mm": std(&c.path[1]),
            "drift_arcsec": c.drift.map(|d| d.map(arcsec_from_rad)),
            "linearity_chi2": c.linearity.0, "linearity_dof": c.linearity.1, "distances_mm": c.distances,
        }));
        return;
    }
    let letters = lateral(axis);
    say!("{:<18}{:>12}{:>22}{:>22}", "resting carriage", "drift rms", "gain of d theta", "path beyond d");
    for beam in 0..2 {
        for (i, letter) in letters.iter().enumerate() {
            let (g, p) = (c.gain[beam][i], c.path[beam][i]);
            say!(
                "beam {} {letter:<11}{:>7.2} arcsec{:>12.4} +- {:<7.4}{:>10.1} +- {:.1} mm",
                beam + 1,
                arcsec_from_rad(c.drift[beam][i]),
                g.value,
                g.std,
                p.value,
                p.std
            );
        }
    }
    for (i, letter) in letters.iter().enumerate() {
        let k = c.angle_gain[i];
        say!("psd1 {letter}: pointing enters with {:.4} +- {:.4} (nominal 1)", k.value, k.std);
    }
    let excluded = c
        .gain
        .as_flattened()
        .iter()
        .map(|g| (g.value - 0.5) / g.std.max(1e-12))
        .fold(f64::INFINITY, f64::min);
    say!("the halved gain (d theta/2, as printed in paper 002) lies {excluded:.0} standard deviations away");
    for (d, [a, b]) in Detector::ALL.iter().zip(c.head.signs) {
        say!("signs of {:<5}{a:>3}{b:>3}", d.name());
    }
    for (pushed, letter) in c.pushed.iter().zip(letters) {
        if !pushed {
            note!(
                "note: signs of the quadrant detectors in {letter} are those of the instrument file; pushes of known size in the log would prove them"
            );
        }
    }
    let (chi2, dof) = c.linearity;
    if dof > 0 {
        let verdict =
            if chi2 > dof as f64 + 3.0 * (2.0 * dof as f64).sqrt() { "NOT straight" } else { "straight" };
        say!(
            "over {} distances the gain is {verdict}: chi^2 {chi2:.1} with {dof} degrees of freedom",
            c.distances.len()
        );
    }
}

/// A run as read.
struct Run {
    rows: Vec<Reading>,
    readings: Vec<Readings>,
    level: Level,
}

fn read_run(path: &Path, axis: AxisName) -> Result<Run, Failure> {
    let mut table = table::open(path)?;
    let (position, distance) = (table.require("position_mm")?, table.require("distance_mm")?);
    let channels = channel_columns(&table, axis)?;
    let [cycle, direction, level] = ["cycle", "direction", "level_arcsec"].map(|name| table.find(name));
    let mut known: Vec<usize> = channels.as_flattened().to_vec();
    known.extend([position, distance]);
    known.extend([cycle, direction, level].into_iter().flatten());
    only(&table, &known)?;
    let mut run = Run { rows: Vec::new(), readings: Vec::new(), level: Level::None };
    let mut levels: Vec<(f64, f64)> = Vec::new();
    let mut reference: Option<Channels> = None;
    while table.advance()? {
        let now = read_channels(&table, &channels)?;
        let zero = *reference.get_or_insert(now);
        let at = table.number(position)?;
        run.rows.push(Reading {
            cycle: cycle.map_or(Ok(0), |c| table.count(c))?,
            travel: direction.map_or(Ok(Travel::Forward), |c| table.travel(c))?,
            position: at,
            value: 0.0,
        });
        let change = std::array::from_fn(|c| std::array::from_fn(|i| now[c][i] - zero[c][i]));
        run.readings.push(Readings { distance: table.number(distance)?, change });
        if let Some(column) = level
            && !table.word(column).is_empty()
        {
            levels.push((at, rad_from_arcsec(table.number(column)?)));
        }
    }
    if run.rows.is_empty() {
        return Err(no_rows(table.file()));
    }
    run.level = level_of(path, &run.rows, &levels)?;
    Ok(run)
}

/// Change of the level from the lowest to the highest position.
fn level_of(path: &Path, rows: &[Reading], levels: &[(f64, f64)]) -> Result<Level, Failure> {
    if levels.is_empty() {
        return Ok(Level::None);
    }
    let low = rows.iter().map(|r| r.position).fold(f64::INFINITY, f64::min);
    let high = rows.iter().map(|r| r.position).fold(f64::NEG_INFINITY, f64::max);
    let mean = |x: f64| {
        let there: Vec<f64> = levels.iter().filter(|(p, _)| *p == x).map(|(_, v)| *v).collect();
        (!there.is_empty()).then(|| there.iter().sum::<f64>() / there.len() as f64)
    };
    match (mean(low), mean(high)) {
        (Some(first), Some(last)) => Ok(Level::Read(last - first)),
        _ => Err(Failure::data(
            path,
            format_args!(
                "level_arcsec must be read at both ends, {low} and {high} mm; read it there or leave the column out"
            ),
        )),
    }
}

fn run_data(args: &Args, axis: AxisName, path: &Path, file: &HeadFile) -> Result<(), Failure> {
    let run = read_run(path, axis)?;
    if file.calibrated_from.is_none() {
        note!(
            "warning: signs and gains of the drift compensation are nominal; a log of the resting carriage at two distances (--resting) proves them"
        );
    }
    let reduced: Vec<FiveDof> = run.readings.iter().map(|r| file.head.reduce(r)).collect();
    let positions: Vec<f64> = run.rows.iter().map(|r| r.position).collect();
    let aligned = align(&file.head, &positions, &reduced, run.level).map_err(|e| Failure::data(path, e))?;
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
    let aligned = if args.roll == RollArg::Detrended {
        align(&file.head, &positions, &reduced, Level::None).map_err(|e| Failure::data(path, e))?
    } else {
        aligned
    };
    let far = run.readings.iter().map(|r| r.distance).fold(0.0, f64::max);
    let measured = measured(axis, &run, &aligned, &file.head, far, with_roll);
    let rigid = rigidity(&positions, &reduced, &file.head, &run.readings);
    let check = DriftCheck::of(axis, &run, &file.head);
    report(args, axis, &measured, &reduced, &aligned, (rigid, check.as_ref()));
    if args.out.is_wanted() {
        let files: Vec<PathBuf> = [Some(path.to_owned()), args.calibration.clone(), args.resting.clone()]
            .into_iter()
            .flatten()
            .collect();
        let origin = Origin { method: "fivedof", files: &files, instrument: file.instrument.clone() };
        args.out.write(axis, measured, None, &origin, !args.case.json)?;
    }
    Ok(())
}

/// The aligned errors in machine directions, one list of readings per error.
fn measured(
    axis: AxisName,
    run: &Run,
    aligned: &Aligned,
    head: &Head,
    far: f64,
    with_roll: bool,
) -> Vec<Measured> {
    let covariance = head.covariance(far);
    let std = to_machine(axis, std::array::from_fn(|i| covariance[(i, i)].sqrt()));
    Component::ALL
        .into_iter()
        .filter(|c| c.index() != axis.direction() && (with_roll || c.index() != axis.direction() + 3))
        .map(|component| Measured {
            component,
            readings: run
                .rows
                .iter()
                .zip(&aligned.motion)
                .map(|(r, m)| Reading { value: to_machine(axis, *m)[component.index()], ..*r })
                .collect(),
            std: Some(std[component.index()]).filter(|s| *s > 0.0),
        })
        .collect()
}

/// RMS of the stretch between the corner cubes about a straight line, and what the noise explains.
fn rigidity(positions: &[f64], reduced: &[FiveDof], head: &Head, readings: &[Readings]) -> (f64, f64) {
    let stretch: Vec<f64> = reduced.iter().map(|r| r.stretch).collect();
    let Ok(line) = Line::fit(positions, &stretch, Rule::LeastSquares) else { return (0.0, 0.0) };
    let dof = (positions.len() as f64 - 2.0).max(1.0);
    let rms = (line.deviations(positions, &stretch).iter().map(|v| v * v).sum::<f64>() / dof).sqrt();
    let n = readings.len() as f64;
    let expected = (readings.iter().map(|r| head.stretch_std(r.distance).powi(2)).sum::<f64>() / n).sqrt();
    (rms, expected)
}

fn report(
    args: &Args,
    axis: AxisName,
    measured: &[Measured],
    reduced: &[FiveDof],
    aligned: &Aligned,
    ((rms, expected), check): ((f64, f64), Option<&DriftCheck>),
) {
    let drift = reduced.iter().flat_map(|r| r.pointing).flatten().fold(0.0f64, |m, v| m.max(v.abs()));
    let is_rigid = expected == 0.0 || rms <= expected * (1.0 + 3.0 / (2.0 * reduced.len() as f64).sqrt());
    if args.out.takes_stdout() {
        return;
    }
    let show =
        |symbol: ErrorSymbol, v: f64| if symbol.is_angle() { arcsec_from_rad(v) } else { um_from_mm(v) };
    if args.case.json {
        let mut object = Map::new();
        for m in measured {
            let symbol = ErrorSymbol::Motion { component: m.component, axis };
            let unit = if symbol.is_angle() { "arcsec" } else { "um" };
            let key = symbol.to_string().to_lowercase();
            let values: Vec<f64> = m.readings.iter().map(|r| show(symbol, r.value)).collect();
            object.insert(format!("{key}_{unit}"), json!(values));
            object.insert(format!("{key}_std_{unit}"), json!(m.std.map(|s| show(symbol, s))));
        }
        if let Some(m) = measured.first() {
            object.insert(
                "position_mm".into(),
                json!(m.readings.iter().map(|r| r.position).collect::<Vec<_>>()),
            );
        }
        object.insert("pointing_max_arcsec".into(), json!(arcsec_from_rad(drift)));
        object.insert("stretch_rms_um".into(), json!(um_from_mm(rms)));
        object.insert("stretch_expected_um".into(), json!(um_from_mm(expected)));
        object.insert("rigid".into(), json!(is_rigid));
        object.insert("drift_check".into(), json!(check.map(DriftCheck::json)));
        print_json(&Value::Object(object));
        return;
    }
    say!("{:<8}{:>14}{:>20}", "error", "range", "std of a reading");
    for m in measured {
        let symbol = ErrorSymbol::Motion { component: m.component, axis };
        let unit = if symbol.is_angle() { "arcsec" } else { "um" };
        let values = || m.readings.iter().map(|r| show(symbol, r.value));
        let range = values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min);
        let std = m.std.map_or_else(|| "-".to_owned(), |s| format!("{:.3}", show(symbol, s)));
        say!("{symbol:<8}{range:>10.2} {unit:<7}{std:>12} {unit}", symbol = symbol.to_string());
    }
    say!();
    say!("largest pointing drift removed: {:.2} arcsec", arcsec_from_rad(drift));
    say!(
        "beams not parallel: {:.2} arcsec of roll per metre removed",
        arcsec_from_rad(aligned.roll_slope * 1e3)
    );
    let verdict = match (expected > 0.0, is_rigid) {
        (false, _) => "the noise of the channels is not known",
        (true, true) => "within the noise",
        (true, false) => "MORE than the noise: the carriage bends, or the drift correction is wrong",
    };
    say!(
        "corner cubes against each other: {:.3} um rms, the noise explains {:.3} um: {verdict}",
        um_from_mm(rms),
        um_from_mm(expected)
    );
    if let Some(check) = check {
        check.print();
    }
}
