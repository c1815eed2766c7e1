//! `volcomp identify straightness`: runs of a 6D interferometer, or plain straightness readings.

pub(super) mod axis_writer;
mod sign_file;

use self::axis_writer::{AxisWriter, Measured, Origin};
use self::sign_file::{ChannelColumns, SetUp, SignFile, read_tilt_test};
use crate::identify::prelude::*;
use volcomp_identify::straightness::runs::means;
use volcomp_identify::straightness::signs::{Channel, SignTable, TiltFound};
use volcomp_identify::straightness::{Line, Rule, levers};

/// Straightness and angles of one axis from a 6D interferometer, about three reference lines.
#[derive(Debug, clap::Args)]
#[command(after_long_help = include_str!("help.txt"))]
pub(crate) struct Args {
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

#[derive(Deserialize)]
struct Case {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.case.front(&self.out.model)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        let case: Case = file.read()?;
        let mut lines = Line::of_all_rules(&case.x, &case.y).map_err(|e| file.bad(e))?;
        let mut json = json!({});
        for (rule, line) in &lines {
            json[rule.name()] = fields!(line; slope, intercept, straightness;
                "slope_std_per_unit": line.slope_std, "deviation": line.deviations(&case.x, &case.y));
        }
        // in the order of their names
        lines.sort_by_key(|(rule, _)| rule.name());
        Ok(printed(json, move || {
            say!("line                   slope         intercept      straightness");
            for (rule, line) in &lines {
                let name = rule.name();
                let [intercept, straightness] = [line.intercept, line.straightness].map(um_from_mm);
                let slope = arcsec_from_rad(line.slope);
                say_text!("{name:<14}{slope:>11.3} \"{intercept:>15.3} um{straightness:>15.3} um");
            }
        }))
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        let tilts = self.tilt_test.as_deref().map(read_tilt_test).transpose()?;
        let axis = self.axis.ok_or_else(|| usage!("--axis is missing; say which axis moved"))?;
        let mut signs = self.signs.as_deref().map(SignFile::read).transpose()?;
        if let Some(found) = &tilts {
            let file = signs.get_or_insert_with(SignFile::default);
            confirm(self, axis, file, found)?;
        }
        let Some(data) = self.case.data(&self.data) else {
            return match tilts {
                Some(_) => Ok(None),
                None => Err(usage!("give --data, --tilt-test or --input")),
            };
        };
        let run = read_run(data, axis, self, signs.as_ref())?;
        let errors = run.iter().map(|m| ErrorFigures::of(m, axis)).collect::<Result<_, _>>()?;
        let files = [data].into_iter().chain(&self.signs).chain(&self.tilt_test).cloned().collect();
        let instrument = signs.and_then(|s| s.instrument);
        let origin = Origin { method: "straightness", files, instrument };
        Ok(Some(Box::new(Outcome { args: self, axis, run, errors, origin })))
    }
}

/// A run, its figures and where it came from.
struct Outcome<'a> {
    args: &'a Args,
    axis: AxisName,
    run: Vec<Measured>,
    errors: Vec<ErrorFigures>,
    origin: Origin,
}

/// Range of an error; of a straightness the lines, too.
struct ErrorFigures {
    symbol: ErrorSymbol,
    range: f64,
    lines: Vec<(Rule, Line)>,
}

impl ErrorFigures {
    fn of(m: &Measured, axis: AxisName) -> Result<Self> {
        let (symbol, (x, y)) = (m.symbol(axis), means(&m.readings));
        let lines = if symbol.is_angle() || m.component.index() == axis.direction() {
            Vec::new()
        } else {
            Line::of_all_rules(&x, &y).map_err(|e| data!(symbol.to_string(), "{e}"))?
        };
        let [low, high] = hull(y);
        Ok(Self { symbol, range: high - low, lines })
    }
}

impl Found for Outcome<'_> {
    fn json(&self) -> Value {
        let mut json = json!({});
        for ErrorFigures { symbol, range, lines } in &self.errors {
            let units = Units::of(*symbol);
            let own = &mut json[key(*symbol)];
            if lines.is_empty() {
                *own = json!({ format!("range_{}", units.value): (units.of_value)(*range) });
            }
            for (rule, line) in lines {
                own[rule.name()] = json!({
                    "straightness_um": um_from_mm(line.straightness),
                    "slope_arcsec": arcsec_from_rad(line.slope),
                });
            }
        }
        json
    }

    fn print(&self) {
        say!("error         range   least squares     end point  minimum zone   slope removed");
        for ErrorFigures { symbol, range, lines } in &self.errors {
            let Units { value: unit, of_value, .. } = Units::of(*symbol);
            let range = of_value(*range);
            let mut row = format!("{symbol:<7}{range:>9.2} {unit}");
            for (rule, line) in lines {
                let width = if *rule == Rule::LeastSquares { 13 } else { 11 };
                row.push_str(&format!("{:>width$.2} um", um_from_mm(line.straightness)));
            }
            if let Some((_, line)) = lines.iter().find(|(rule, _)| *rule == self.args.out.rule) {
                row.push_str(&format!("{:>9.2} arcsec", arcsec_from_rad(line.slope)));
            }
            say_text!("{row}");
        }
    }

    fn write(&self, end: &mut String) -> Result<()> {
        *end = self.args.out.write(self.axis, &self.run, self.args.base_point_mm, &self.origin)?;
        Ok(())
    }
}

fn mistake(what: impl core::fmt::Display) -> Failure {
    failure!(EX_CONFIG, "{what}")
}

/// Compares a tilt test with the table, or makes the table from it.
fn confirm(args: &Args, axis: AxisName, file: &mut SignFile, found: &[Option<TiltFound>; 6]) -> Result<()> {
    let tilt_name = args.tilt_test.as_deref().map_or_else(String::new, file_name);
    for (channel, f) in Channel::ALL.into_iter().zip(found) {
        if let Some(f) = f {
            let (name, gain, std) = (channel.name(), f.gain, f.gain_std);
            note!("tilt test: {name} = \"{}\", gain {gain:.3} +- {std:.3} (k = 1)", f.assignment);
        }
    }
    let known = file.set_ups.iter().find(|s| s.axis == axis).map(|s| s.table);
    let mut table = known.unwrap_or(SignTable { channels: [None; 6] });
    table.confirm(found).map_err(|(channel, a, TiltFound { assignment, gain, gain_std })| {
        let (name, section) = (channel.name(), axis.lower());
        mistake(format_args!(
            "[{section}] {name} = \"{a}\" in the sign table, but the tilt test shows \"{assignment}\" (gain {gain:.2} +- {gain_std:.2}); correct the table"
        ))
    })?;
    table.check(axis).map_err(|e| mistake!(tilt_name, "{e}"))?;
    file.put(SetUp { axis, table, tilt_test: Some(tilt_name) });
    if !table.is_right_handed() {
        note!(
            "note: the angles of this instrument are not those of a right-handed frame (as in table 2 of paper 004); the tilt test shows that it is so"
        );
    }
    if let Some(path) = &args.write_signs {
        continue_text(args.signs.as_deref(), path, &file.text())?;
        note!("sign table written: {}", path.display());
    }
    Ok(())
}

/// The sign table for a run; refused where its parity is impossible and nothing proves it.
fn table_for(args: &Args, axis: AxisName, signs: Option<&SignFile>) -> Result<SignTable> {
    let path = args.signs.as_deref().or(args.tilt_test.as_deref()).unwrap_or(Path::new("--signs"));
    let Some(file) = signs else {
        return Err(usage!(
            "these are channels of an instrument with unknown signs: give a sign table with --signs (see --help)"
        ));
    };
    let set_up = file.set_up(axis, path)?;
    if file.is_confirmed() {
        return Ok(set_up.table);
    }
    if !set_up.table.is_right_handed() {
        let wrong = set_up.table.left_handed().map(Channel::name).joined(", ");
        return Err(mistake!(
            path,
            "[{}] is not a rotation of axes: {wrong} would turn against a right-handed frame; correct the sign, or prove it with --tilt-test",
            axis.lower()
        ));
    }
    note!(
        "warning: the signs of [{}] are right-handed, but no tilt test has confirmed them: a mirrored table looks the same; apply known tilts and give --tilt-test",
        axis.lower()
    );
    Ok(set_up.table)
}

/// Place and direction, and the motion in machine directions.
type Row = (Reading, [Option<f64>; 6]);

/// Where the readings of a run stand in its table.
struct Readings {
    run: RunColumns,
    channels: ChannelColumns,
    /// Channels in machine directions; `None` where the columns are errors of the machine already.
    signs: Option<SignTable>,
    errors: [Option<Column>; 6],
}

impl Readings {
    fn find(table: &mut Columns, axis: AxisName, args: &Args, signs: Option<&SignFile>) -> Result<Self> {
        let run = table.run("position_mm")?;
        let channels = ChannelColumns::find(table);
        // columns such as `eyx_um` of this axis
        let errors = Component::ALL
            .map(|component| table.find_column(&column(ErrorSymbol::Motion { component, axis })));
        table.only_asked(|_| {
            "columns are position_mm, cycle, direction, distance_um, horizontal_um, vertical_um, roll_arcsec, pitch_arcsec, yaw_arcsec, or errors such as eyx_um".to_owned()
        })?;
        let has = channels.has();
        let is_raw = has.contains(&true);
        match (is_raw, errors.iter().flatten().next()) {
            (true, Some(column)) => {
                let what = "channels of the instrument and errors of the machine in one file; keep one kind";
                return Err(table.fail(*column, what));
            }
            (false, None) => return Err(table.file_error("no column with readings")),
            _ => {}
        }
        let signs = is_raw.then(|| table_for(args, axis, signs)).transpose()?;
        if let Some(t) = &signs
            && let Some(i) = (0..6).find(|i| has[*i] && t.channels[*i].is_none())
        {
            let (name, section) = (Channel::ALL[i].name(), axis.lower());
            return Err(mistake(format_args!(
                "the data have {name}, section [{section}] of the sign table does not assign it; add {name} = \"..\""
            )));
        }
        // a channel of the table that the data do not have says nothing
        let signs =
            signs.map(|t| SignTable { channels: std::array::from_fn(|i| t.channels[i].filter(|_| has[i])) });
        Ok(Self { run, channels, signs, errors })
    }

    /// The current row: place and direction, and the motion in machine directions.
    fn read(&self, row: &Columns) -> Result<Row> {
        let mut motion = [None; 6];
        match &self.signs {
            Some(t) => motion = t.apply(&self.channels.read(row)?),
            None => {
                for (value, column) in motion.iter_mut().zip(self.errors) {
                    *value = column.map(|c| row.deviation(c)).transpose()?;
                }
            }
        }
        Ok((row.reading(&self.run)?, motion))
    }
}

/// Reads a run in machine directions, moved to the base point where wanted.
fn read_run(path: &Path, axis: AxisName, args: &Args, signs: Option<&SignFile>) -> Result<Vec<Measured>> {
    let mut table = table::open(path)?;
    let columns = Readings::find(&mut table, axis, args, signs)?;
    let mut rows = table.some_rows(|row| columns.read(row))?;
    if let Some(base) = args.base_point_mm {
        move_to_base(args, axis, base, &mut rows)?;
    }
    let of = |component: Component| -> Option<Measured> {
        let one = |(r, motion): &Row| Some(Reading { value: motion[component.index()]?, ..*r });
        let readings: Option<Vec<Reading>> = rows.iter().map(one).collect();
        readings.map(|readings| Measured { component, readings, std: None })
    };
    Ok(Component::ALL.into_iter().filter_map(of).collect())
}

/// Moves the linear components to the base point, lever by lever (equations 1.5).
fn move_to_base(args: &Args, axis: AxisName, base: Vec3, rows: &mut [Row]) -> Result<()> {
    let points = args.out.points(axis);
    for (_, motion) in rows {
        let mut full = [0.0; 6];
        for (i, (slot, value)) in full.iter_mut().zip(*motion).enumerate() {
            if i < 3 && value.is_some() && points[i].is_none() {
                return Err(usage!(
                    "--base-point-mm needs to know where the optics was: give --point-mm, or --abbe-mm and --bryan-mm"
                ));
            }
            if i >= 3 && value.is_none() {
                let symbol = ErrorSymbol::Motion { component: Component::ALL[i], axis };
                return Err(usage!("--base-point-mm needs all three angles, {symbol} was not measured"));
            }
            *slot = value.unwrap_or(0.0);
        }
        if args.out.on_bed() {
            return Err(usage!(
                "--base-point-mm moves points that ride on the carriage; points with --body bed are stored as they are, without loss"
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
