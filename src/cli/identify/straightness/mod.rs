//! `volcomp identify straightness`: runs of a 6D interferometer, or plain straightness readings.

pub(super) mod axis_writer;
mod sign_file;

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use self::axis_writer::{AxisWriter, Measured, Origin, means};
use self::sign_file::{ChannelColumns, SetUp, SignFile, read_tilt_test};
use super::case::{CaseArgs, CaseFile, print_json};
use crate::arg_parsers::{linear_axis, point};
use crate::files::write_text;
use crate::{EX_CONFIG, EX_DATAERR, Failure, table};
use volcomp_identify::Reading;
use volcomp_identify::straightness::signs::{Channel, SignTable, TiltFound};
use volcomp_identify::straightness::{Line, Rule, levers};
use volcomp_model::geometry::Vec3;
use volcomp_model::{Component, ErrorSymbol};
use volcomp_units::axes::{AxisName, Travel};
use volcomp_units::{arcsec_from_rad, mm_from_um, rad_from_arcsec, um_from_mm};

/// What the help says beside the options.
const HELP: &str = "The instrument reads distance, horizontal and vertical straightness, roll, pitch and yaw in its own \
    directions and signs. A sign table says what each channel is in the machine:\n\n\
    \x20 format = \"volcomp-6d/1\"\n\
    \x20 instrument = \"six-axis laser, no 123\"\n\
    \x20 [x]                       # set-up along X\n\
    \x20 distance = \"+x\"\n\
    \x20 horizontal = \"-y\"\n\
    \x20 vertical = \"+z\"\n\
    \x20 roll = \"-a\"\n\
    \x20 pitch = \"+b\"\n\
    \x20 yaw = \"-c\"\n\n\
    Angles of a right-handed instrument follow from its lengths; the table is checked for that. A tilt \
    test proves the signs: tilt the optics by known angles and give the readings with --tilt-test.\n\n\
    Columns of --data: position_mm, optional cycle and direction (1 towards plus, -1 towards minus), and \
    the channels distance_um horizontal_um vertical_um roll_arcsec pitch_arcsec yaw_arcsec (those that \
    the instrument has); or, already in machine directions and without a sign table, the errors \
    themselves: eyx_um, ebx_arcsec.\n\n\
    Columns of --tilt-test: applied_ea_arcsec applied_eb_arcsec applied_ec_arcsec, optional \
    applied_ex_um .. , and the channels.\n\n\
    Example:\n  volcomp identify straightness --data x.csv --axis x --signs sixd.toml --tilt-test tilt.csv --chain \"[w X' b Y Z t]\" --sense carriage --point-mm 0,250,-620 --out model.toml";

/// Straightness and angles of one axis from a 6D interferometer, about three reference lines.
#[derive(Debug, clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// Readings along the axis; - is stdin.
    #[arg(long, value_name = "FILE", conflicts_with = "input")]
    data: Option<PathBuf>,
    /// The axis that moved.
    #[arg(long, value_name = "LETTER", value_parser = linear_axis)]
    axis: Option<AxisName>,
    /// Sign table of the instrument.
    #[arg(long, value_name = "FILE")]
    signs: Option<PathBuf>,
    /// Readings while known tilts were applied in the same set-up.
    #[arg(long, value_name = "FILE", requires = "axis", conflicts_with = "input")]
    tilt_test: Option<PathBuf>,
    /// Write the sign table with what the tilt test found.
    #[arg(long, value_name = "FILE", requires = "tilt_test")]
    write_signs: Option<PathBuf>,
    /// Move all linear components to this point on the carriage (M at home) with the measured angles.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    base_point_mm: Option<Vec3>,
    #[command(flatten)]
    out: AxisWriter,
}

#[derive(serde::Deserialize)]
struct Case {
    x: Vec<f64>,
    y: Vec<f64>,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(file) = args.case.file() {
        file.writes_no_model(args.out.is_wanted())?;
        return run_case(args, file);
    }
    let tilts = args.tilt_test.as_deref().map(read_tilt_test).transpose()?;
    let Some(axis) = args.axis else {
        return Err(Failure::usage("--axis is missing; say which axis moved"));
    };
    let mut signs = args.signs.as_deref().map(SignFile::read).transpose()?;
    if let Some(found) = &tilts {
        let file = signs.get_or_insert_with(SignFile::default);
        confirm(args, axis, file, found)?;
    }
    let Some(data) = args.case.data(&args.data) else {
        return if tilts.is_some() {
            Ok(())
        } else {
            Err(Failure::usage("give --data, --tilt-test or --input"))
        };
    };
    let run = read_run(data, axis, args, signs.as_ref())?;
    report(args, axis, &run)?;
    if args.out.is_wanted() {
        let mut files = vec![data.clone()];
        files.extend([&args.signs, &args.tilt_test].into_iter().flatten().cloned());
        let instrument = signs.and_then(|s| s.instrument);
        let origin = Origin { method: "straightness", files: &files, instrument };
        args.out.write(axis, run, args.base_point_mm, &origin, !args.case.json)?;
    }
    Ok(())
}

fn run_case(args: &Args, file: CaseFile<'_>) -> Result<(), Failure> {
    let case: Case = file.read()?;
    let mut result = Map::new();
    for rule in Rule::ALL {
        let line = Line::fit(&case.x, &case.y, rule).map_err(|e| file.bad(e))?;
        let mut object = json!({
            "slope": line.slope, "intercept": line.intercept, "straightness": line.straightness,
            "slope_std_per_unit": line.slope_std,
        });
        object["deviation"] = json!(line.deviations(&case.x, &case.y));
        result.insert(rule.name().to_owned(), object);
    }
    if args.case.json {
        print_json(&Value::Object(result));
    } else {
        say!("{:<14}{:>14}{:>18}{:>18}", "line", "slope", "intercept", "straightness");
        for (name, v) in &result {
            let number = |key: &str| v[key].as_f64().unwrap_or(f64::NAN);
            say!(
                "{name:<14}{:>11.3} \"{:>15.3} um{:>15.3} um",
                arcsec_from_rad(number("slope")),
                um_from_mm(number("intercept")),
                um_from_mm(number("straightness"))
            );
        }
    }
    Ok(())
}

/// Compares a tilt test with the table, or makes the table from it.
fn confirm(
    args: &Args,
    axis: AxisName,
    file: &mut SignFile,
    found: &[Option<TiltFound>; 6],
) -> Result<(), Failure> {
    let tilt_name = args
        .tilt_test
        .as_deref()
        .and_then(Path::file_name)
        .map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    for (channel, f) in Channel::ALL.into_iter().zip(found) {
        if let Some(f) = f {
            let (name, gain, std) = (channel.name(), f.gain, f.gain_std);
            note!("tilt test: {name} = \"{}\", gain {gain:.3} +- {std:.3} (k = 1)", f.assignment);
        }
    }
    let known = file.set_ups.iter().find(|s| s.axis == axis).map(|s| s.table);
    let mut table = known.unwrap_or(SignTable { channels: [None; 6] });
    for ((channel, slot), f) in Channel::ALL.into_iter().zip(&mut table.channels).zip(found) {
        let Some(f) = f else { continue };
        match slot {
            Some(a) if *a != f.assignment => {
                return Err(Failure::new(
                    EX_CONFIG,
                    format_args!(
                        "error: [{}] {} = \"{a}\" in the sign table, but the tilt test shows \"{}\" (gain {:.2} +- {:.2}); correct the table",
                        axis.lower(),
                        channel.name(),
                        f.assignment,
                        f.gain,
                        f.gain_std
                    ),
                ));
            }
            _ => *slot = Some(f.assignment),
        }
    }
    table.check(axis).map_err(|e| Failure::new(EX_CONFIG, format_args!("error: {tilt_name}: {e}")))?;
    file.put(SetUp { axis, table, tilt_test: Some(tilt_name) });
    if !table.is_right_handed() {
        note!(
            "note: the angles of this instrument are not those of a right-handed frame (as in table 2 of paper 004); the tilt test shows that it is so"
        );
    }
    if let Some(path) = &args.write_signs {
        write_text(path, &file.text())?;
        note!("sign table written: {}", path.display());
    }
    Ok(())
}

/// The sign table for a run; refused where its parity is impossible and nothing proves it.
fn table_for(args: &Args, axis: AxisName, signs: Option<&SignFile>) -> Result<SignTable, Failure> {
    let path = args.signs.as_deref().or(args.tilt_test.as_deref()).unwrap_or(Path::new("--signs"));
    let Some(file) = signs else {
        return Err(Failure::usage(
            "these are channels of an instrument with unknown signs: give a sign table with --signs (see --help)",
        ));
    };
    let set_up = file.set_up(axis, path)?;
    if file.is_confirmed() {
        return Ok(set_up.table);
    }
    if !set_up.table.is_right_handed() {
        let wrong: Vec<&str> = Channel::ALL[3..]
            .iter()
            .zip(set_up.table.parity())
            .filter(|(_, p)| *p == Some(false))
            .map(|(c, _)| c.name())
            .collect();
        return Err(Failure::new(
            EX_CONFIG,
            format_args!(
                "error: {}: [{}] is not a rotation of axes: {} would turn against a right-handed frame; correct the sign, or prove it with --tilt-test",
                path.display(),
                axis.lower(),
                wrong.join(", ")
            ),
        ));
    }
    note!(
        "warning: the signs of [{}] are right-handed, but no tilt test has confirmed them: a mirrored table looks the same; apply known tilts and give --tilt-test",
        axis.lower()
    );
    Ok(set_up.table)
}

/// Where the readings of a run stand in its table.
struct RunColumns {
    position: usize,
    cycle: Option<usize>,
    direction: Option<usize>,
    channels: ChannelColumns,
    /// Channels in machine directions; `None` where the columns are errors of the machine already.
    signs: Option<SignTable>,
    errors: Vec<(Component, usize)>,
}

impl RunColumns {
    fn find<R: std::io::BufRead>(
        table: &table::Table<R>,
        axis: AxisName,
        args: &Args,
        signs: Option<&SignFile>,
    ) -> Result<Self, Failure> {
        let position = table.require("position_mm")?;
        let (cycle, direction) = (table.find("cycle"), table.find("direction"));
        let channels = ChannelColumns::find(table);
        let errors = error_columns(table, axis);
        let mut known: Vec<usize> = [Some(position), cycle, direction].into_iter().flatten().collect();
        known.extend(channels.indices());
        known.extend(errors.iter().map(|(_, i)| *i));
        if let Some(i) = (0..table.columns().len()).find(|i| !known.contains(i)) {
            return Err(table.fail(
                i,
                "unknown column; columns are position_mm, cycle, direction, distance_um, horizontal_um, vertical_um, roll_arcsec, pitch_arcsec, yaw_arcsec, or errors such as eyx_um",
            ));
        }
        let is_raw = channels.indices().next().is_some();
        match (is_raw, errors.first()) {
            (true, Some((_, i))) => {
                let what = "channels of the instrument and errors of the machine in one file; keep one kind";
                return Err(table.fail(*i, what));
            }
            (false, None) => {
                let file = table.file();
                return Err(Failure::new(EX_DATAERR, format_args!("error: {file}: no column with readings")));
            }
            _ => {}
        }
        let signs = is_raw.then(|| table_for(args, axis, signs)).transpose()?;
        let has = channels.has();
        if let Some(t) = &signs
            && let Some(i) = (0..6).find(|i| has[*i] && t.channels[*i].is_none())
        {
            let (name, section) = (Channel::ALL[i].name(), axis.lower());
            return Err(Failure::new(
                EX_CONFIG,
                format_args!(
                    "error: the data have {name}, section [{section}] of the sign table does not assign it; add {name} = \"..\""
                ),
            ));
        }
        // a channel of the table that the data do not have says nothing
        let signs =
            signs.map(|t| SignTable { channels: std::array::from_fn(|i| t.channels[i].filter(|_| has[i])) });
        Ok(Self { position, cycle, direction, channels, signs, errors })
    }

    /// The current row: place and direction, and the motion in machine directions.
    fn read<R: std::io::BufRead>(
        &self,
        table: &table::Table<R>,
    ) -> Result<(Reading, [Option<f64>; 6]), Failure> {
        let motion = match &self.signs {
            Some(t) => t.apply(&self.channels.read(table)?),
            None => read_errors(table, &self.errors)?,
        };
        let reading = Reading {
            cycle: self.cycle.map_or(Ok(0), |c| table.count(c))?,
            travel: self.direction.map_or(Ok(Travel::Forward), |c| table.travel(c))?,
            position: table.number(self.position)?,
            value: 0.0,
        };
        Ok((reading, motion))
    }
}

/// Reads a run in machine directions, moved to the base point where wanted.
fn read_run(
    path: &Path,
    axis: AxisName,
    args: &Args,
    signs: Option<&SignFile>,
) -> Result<Vec<Measured>, Failure> {
    let mut table = table::open(path)?;
    let columns = RunColumns::find(&table, axis, args, signs)?;
    let mut rows: Vec<(Reading, [Option<f64>; 6])> = Vec::new();
    while table.advance()? {
        rows.push(columns.read(&table)?);
    }
    if rows.is_empty() {
        return Err(crate::positioning_data::no_rows(table.file()));
    }
    if let Some(base) = args.base_point_mm {
        move_to_base(args, axis, base, &mut rows)?;
    }
    let of = |component: Component| -> Option<Measured> {
        let readings: Option<Vec<Reading>> = rows
            .iter()
            .map(|(r, motion)| Some(Reading { value: motion[component.index()]?, ..*r }))
            .collect();
        readings.map(|readings| Measured { component, readings, std: None })
    };
    Ok(Component::ALL.into_iter().filter_map(of).collect())
}

/// Columns such as `eyx_um` of this axis.
fn error_columns<R: std::io::BufRead>(table: &table::Table<R>, axis: AxisName) -> Vec<(Component, usize)> {
    Component::ALL
        .into_iter()
        .filter_map(|component| {
            let symbol = ErrorSymbol::Motion { component, axis }.to_string().to_lowercase();
            let unit = if component.is_angle() { "arcsec" } else { "um" };
            Some((component, table.find(&format!("{symbol}_{unit}"))?))
        })
        .collect()
}

fn read_errors<R: std::io::BufRead>(
    table: &table::Table<R>,
    columns: &[(Component, usize)],
) -> Result<[Option<f64>; 6], Failure> {
    let mut motion = [None; 6];
    for (component, column) in columns {
        let read = table.number(*column)?;
        motion[component.index()] =
            Some(if component.is_angle() { rad_from_arcsec(read) } else { mm_from_um(read) });
    }
    Ok(motion)
}

/// Moves the linear components to the base point, lever by lever (equations 1.5).
fn move_to_base(
    args: &Args,
    axis: AxisName,
    base: Vec3,
    rows: &mut [(Reading, [Option<f64>; 6])],
) -> Result<(), Failure> {
    let points = args.out.points(axis);
    for (_, motion) in rows {
        let mut full = [0.0; 6];
        for (i, (slot, value)) in full.iter_mut().zip(*motion).enumerate() {
            if i < 3 && value.is_some() && points[i].is_none() {
                return Err(Failure::usage(
                    "--base-point-mm needs to know where the optics was: give --point-mm, or --abbe-mm and --bryan-mm",
                ));
            }
            if i >= 3 && value.is_none() {
                return Err(Failure::usage(format_args!(
                    "--base-point-mm needs all three angles, {} was not measured",
                    ErrorSymbol::Motion { component: Component::ALL[i], axis }
                )));
            }
            *slot = value.unwrap_or(0.0);
        }
        if args.out.on_bed() {
            return Err(Failure::usage(
                "--base-point-mm moves points that ride on the carriage; points with --body bed are stored as they are, without loss",
            ));
        }
        let from = points.map(Option::unwrap_or_default);
        let moved = levers::moved(&full, &from, &[base; 3]);
        for i in 0..3 {
            motion[i] = motion[i].map(|_| moved[i]);
        }
    }
    Ok(())
}

/// Straightness about the three lines, range of the rest.
fn report(args: &Args, axis: AxisName, run: &[Measured]) -> Result<(), Failure> {
    let mut object = Map::new();
    let speaks = !args.case.json && !args.out.takes_stdout();
    if speaks {
        say!(
            "{:<7}{:>12}{:>16}{:>14}{:>14}{:>16}",
            "error",
            "range",
            "least squares",
            "end point",
            "minimum zone",
            "slope removed"
        );
    }
    for m in run {
        let symbol = ErrorSymbol::Motion { component: m.component, axis };
        let (x, y) = means(&m.readings);
        let key = symbol.to_string().to_lowercase();
        let figures = if symbol.is_angle() || m.component.index() == axis.direction() {
            range_report(symbol, &y, speaks)
        } else {
            lines_report(args, symbol, &x, &y, speaks)?
        };
        object.insert(key, figures);
    }
    if args.case.json && !args.out.takes_stdout() {
        print_json(&Value::Object(object));
    }
    Ok(())
}

fn range(values: &[f64]) -> f64 {
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    high - low
}

/// Range of an angle or of the positioning.
fn range_report(symbol: ErrorSymbol, y: &[f64], speaks: bool) -> Value {
    let (range, unit) =
        if symbol.is_angle() { (arcsec_from_rad(range(y)), "arcsec") } else { (um_from_mm(range(y)), "um") };
    if speaks {
        say!("{symbol:<7}{range:>9.2} {unit}", symbol = symbol.to_string());
    }
    json!({ format!("range_{unit}"): range })
}

/// A straightness about the three lines.
fn lines_report(
    args: &Args,
    symbol: ErrorSymbol,
    x: &[f64],
    y: &[f64],
    speaks: bool,
) -> Result<Value, Failure> {
    let mut own = Map::new();
    let mut columns = String::new();
    for rule in Rule::ALL {
        let line = Line::fit(x, y, rule)
            .map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {symbol}: {e}")))?;
        let (um, slope) = (um_from_mm(line.straightness), arcsec_from_rad(line.slope));
        let width = if rule == Rule::LeastSquares { 13 } else { 11 };
        columns.push_str(&format!("{um:>width$.2} um"));
        own.insert(rule.name().to_owned(), json!({ "straightness_um": um, "slope_arcsec": slope }));
    }
    if speaks {
        let slope = own[args.out.rule().name()]["slope_arcsec"].as_f64().unwrap_or(f64::NAN);
        let range = um_from_mm(range(y));
        say!("{symbol:<7}{range:>9.2} um{columns}{slope:>9.2} arcsec", symbol = symbol.to_string());
    }
    Ok(Value::Object(own))
}
