//! `volcomp predict`: the model's deviation and corrections at every point of a table, row by row.
//!
//! Bounded memory: one line in, one line out. The input line is copied as it stands, then the new columns follow.

mod circle;
mod readings;

use super::additions::Additions;
use super::files::{Rows, read_hashed_model};
use super::quantities::offset_as_is;
use super::table::{Table, nearest, other_unit};
use crate::prelude::*;
use volcomp_model::search::Volume;
use volcomp_model::{AxisCorrection, AxisMotion, DYNAMIC_MAX, Deviation, Pose};
use volcomp_units::RAD_PER_DEG;
use volcomp_units::axes::MAX_AXES;

/// Predict the error of the tool, and the corrections of the axes, at every point of a table; or a measured circle.
#[derive(Debug, clap::Parser)]
#[command(after_long_help = include_str!("predict/circle.txt"))]
pub(super) struct Args {
    /// The model file.
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// An addition found by `volcomp diagnose`; may be repeated.
    #[arg(long, value_name = "FILE")]
    add: Vec<PathBuf>,
    /// Points: x_mm, c_deg .. per axis; optional tool_x_mm tool_y_mm tool_z_mm or tool_length_mm, dir_x ..; - is stdin.
    #[arg(long, value_name = "CSV", required_unless_present = "circle", conflicts_with = "circle")]
    points: Option<PathBuf>,
    /// The result; - is stdout.
    #[arg(long, value_name = "CSV", required_unless_present = "circle", conflicts_with = "circle")]
    out: Option<PathBuf>,
    /// Exact rotations instead of first order.
    #[arg(long)]
    exact: bool,
    /// Reading of a sensor that the model's thermal displacements depend on, degC or rpm, steady for long; may be repeated.
    #[arg(long, value_name = "SENSOR=VALUE", value_parser = readings::reading)]
    reading: Vec<readings::Reading>,
    #[command(flatten)]
    circle: circle::CircleArgs,
}

/// Columns that session files have and that are kept without a word (`docs/reference/session-files.md` 1).
const KEPT: &str = "t_s instrument setup run repeat pair u_x u_y u_z deviation_um \
    moving range_mm spindle_rpm id point comment cycle";
/// Beginnings of further such columns.
const KEPT_STEMS: [&str; 9] =
    ["since_reversal_", "target_", "lever_", "station_", "force_", "temp_", "load_", "note_", "label"];

pub(super) fn run(args: &Args) -> Result<()> {
    if args.circle.is_wanted() {
        return circle::run(args);
    }
    let (Some(points), Some(out)) = (&args.points, &args.out) else {
        return Err(Failure::usage("give --points and --out, or --circle"));
    };
    let (spec, model, hash) = read_hashed_model(&args.model)?;
    let live = readings::live_values(&args.model, &model, &args.reading)?;
    let mut table = table::open_stream(points)?;
    let columns = Columns::find(&table, &model)?;
    columns.note_directions(&spec);
    let mut additions = Additions::read(&args.add, (&spec, &model, &hash), &table)?;
    columns.check_length(&table, &model, additions.as_ref())?;
    let mut rows = Rows::create(out)?;
    columns.header(&table, &mut rows.block);
    rows.flush()?;
    while table.advance()? {
        let mut pose = columns.pose(&table, &model)?;
        pose.live = live;
        let (mut deviation, mut correction) =
            if args.exact { model.correct_exact(&pose) } else { model.correct(&pose) };
        if let Some(additions) = &mut additions {
            deviation.position += additions.next(&table, &model)?;
            correction = model.opposing(&pose, &deviation);
        }
        rows.block.extend_from_slice(table.text());
        columns.row(&deviation, &correction, &mut rows.block);
        rows.row_end()?;
    }
    rows.finish()
}

/// What a column of the motion of an axis sets.
type SetMotion = fn(&mut AxisMotion, f64);

/// Columns of the motion of an axis: name, unit inside of one of the file's, and what each sets.
fn motion_columns(name: AxisName) -> [(String, f64, SetMotion); 4] {
    let (axis, length) = (name.lower(), position_unit(name));
    let unit = if name.kind() == AxisKind::Linear { 1.0 } else { RAD_PER_DEG };
    [
        (format!("v{axis}_{length}_per_s"), unit, |m, v| m.velocity = v),
        (format!("a{axis}_{length}_per_s2"), unit, |m, v| m.acceleration = v),
        (format!("since_reversal_{axis}_{length}"), unit, |m, v| m.since = v),
        (format!("since_reversal_{axis}_s"), 1.0, |m, v| m.since_s = v),
    ]
}

/// Which column of the input means what, and which axes are corrected.
#[derive(Debug, Default)]
struct Columns {
    /// Column, index in the chain, unit in mm or rad.
    axes: Vec<(usize, usize, f64)>,
    /// Column, index in the chain.
    directions: Vec<(usize, usize)>,
    /// Column, index in the chain, what of the motion, unit in mm or rad; only where the model has dynamic terms.
    motion: Vec<(usize, usize, SetMotion, f64)>,
    /// Column, component.
    tool: Vec<(usize, usize)>,
    tool_length: Option<usize>,
    /// Axes with a correction column: linear X Y Z U V W, then rotary A B C.
    corrected: Vec<(AxisName, usize)>,
    /// The axes in chain order.
    names: Vec<AxisName>,
}

impl Columns {
    fn find(table: &Table, model: &Model) -> Result<Self> {
        let mut found = Self { names: model.axes().map(|a| a.name).collect(), ..Self::default() };
        found.corrected =
            model.axes().enumerate().filter(|(_, a)| !a.spindle).map(|(k, a)| (a.name, k)).collect();
        found.corrected.sort_by_key(|(name, _)| *name);
        let known = found.known();
        let outputs = found.output_names();
        for (i, column) in table.columns().iter().enumerate() {
            if outputs.contains(column) {
                return Err(table.fail(i, "predict writes this column itself; rename or remove it"));
            }
            if !(found.take(i, column) || found.take_motion(i, column, model)) {
                found.check_kept(column, &known).map_err(|what| table.fail(i, what))?;
            }
        }
        if let Some(length) = found.tool_length
            && !found.tool.is_empty()
        {
            return Err(table.fail(length, "tool_x_mm .. and tool_length_mm both place the tip; keep one"));
        }
        if found.axes.is_empty() {
            let known = known.join(", ");
            return Err(data!(table.file(), "no column with an axis of the chain; columns are {known}"));
        }
        Ok(found)
    }

    /// Says which axes have errors that depend on the direction of travel, and no column for it.
    fn note_directions(&self, spec: &ModelSpec) {
        let directed = Volume::of(spec).directed().to_vec();
        for k in directed.into_iter().filter(|k| self.directions.iter().all(|(_, known)| known != k)) {
            let name = self.names[k];
            note!(
                "note: no column dir_{}: errors of axis {name} that depend on its direction are those of travel towards plus",
                name.lower()
            );
        }
    }

    /// Refuses tool lengths that neither the model nor an addition can use; of the readings of a session they are noted, as
    /// `volcomp diagnose` does.
    fn check_length(&self, table: &Table, model: &Model, additions: Option<&Additions>) -> Result<()> {
        let used = model.tool_tip_for_length(0.0).is_some() || additions.is_some_and(|a| a.takes_length);
        let Some(column) = self.tool_length.filter(|_| !used) else { return Ok(()) };
        if table.find("deviation_um").is_none() {
            return Err(table.fail(
                column,
                "the model has no gauge point; add gauge-point-mm to its [frame] or remove the column",
            ));
        }
        note!(
            "note: {}: tool_length_mm: the model has no gauge point; without gauge-point-mm in its [frame] the lengths are not used",
            table.file()
        );
        Ok(())
    }

    /// Uses a column; false where it means nothing here.
    fn take(&mut self, i: usize, column: &str) -> bool {
        match column {
            "tool_x_mm" => self.tool.push((i, 0)),
            "tool_y_mm" => self.tool.push((i, 1)),
            "tool_z_mm" => self.tool.push((i, 2)),
            "tool_length_mm" => self.tool_length = Some(i),
            _ => {
                let is = |n: &AxisName| column == axis_column(*n) || column == format!("dir_{}", n.lower());
                let Some(k) = self.names.iter().position(is) else { return false };
                match (column.starts_with("dir_"), self.names[k].kind()) {
                    (true, _) => self.directions.push((i, k)),
                    (false, AxisKind::Linear) => self.axes.push((i, k, 1.0)),
                    (false, AxisKind::Rotary) => self.axes.push((i, k, RAD_PER_DEG)),
                }
            }
        }
        true
    }

    /// Uses a column of motion, where the model has dynamic terms.
    fn take_motion(&mut self, i: usize, column: &str, model: &Model) -> bool {
        if model.dynamics().is_empty() {
            return false;
        }
        for (k, name) in self.names.iter().enumerate() {
            if let Some((_, unit, set)) = motion_columns(*name).into_iter().find(|(n, ..)| n == column) {
                self.motion.push((i, k, set, unit));
                return true;
            }
        }
        false
    }

    /// The signals of the dynamic terms at a row; of what has no column, those of an axis at rest after long travel.
    fn signals(&self, table: &Table, model: &Model, pose: &Pose) -> Result<[f64; DYNAMIC_MAX]> {
        let mut motions = pose.travel.map(AxisMotion::after);
        for (column, k) in &self.directions {
            if table.travel_if_known(*column)?.is_none() {
                motions[*k].direction = 0.0;
            }
        }
        for (column, k, set, unit) in &self.motion {
            if let Some(value) = table.number_if_known(*column)? {
                set(&mut motions[*k], value * unit);
            }
        }
        let mut out = [0.0; DYNAMIC_MAX];
        for (signal, d) in out.iter_mut().zip(model.dynamics()) {
            *signal = motions.get(d.axis).map_or(0.0, |m| d.term.law.signal(m));
        }
        Ok(out)
    }

    /// Columns that are understood.
    fn known(&self) -> Vec<String> {
        let axes = self.names.iter().map(|n| axis_column(*n));
        let directions = self.names.iter().map(|n| format!("dir_{}", n.lower()));
        let tool = ["tool_x_mm", "tool_y_mm", "tool_z_mm", "tool_length_mm"].map(str::to_owned);
        axes.chain(directions).chain(tool).collect()
    }

    /// Lets other columns pass, but not one that looks like a slip or an axis that the chain does not have.
    fn check_kept(&self, column: &str, known: &[String]) -> Result<(), String> {
        if KEPT.split(' ').any(|kept| kept == column)
            || KEPT_STEMS.iter().any(|s| column.starts_with(s))
            || column.ends_with("_mm_per_s")
            || column.ends_with("_mm_per_s2")
        {
            return Ok(());
        }
        let plain: String = column.chars().filter(char::is_ascii_alphanumeric).collect();
        let stem = plain.strip_prefix("dir").unwrap_or(&plain);
        let rest = stem.get(1..).unwrap_or("");
        let axis = stem.chars().next().and_then(AxisName::from_letter);
        if let Some(axis) = axis
            && ["", "mm", "deg", "rad", "um", "m", "in", "inch"].contains(&rest.to_ascii_lowercase().as_str())
        {
            return Err(if self.names.contains(&axis) {
                let (column, letter) = (axis_column(axis), axis.lower());
                format!("unknown column; axis {axis} is given as {column}, its direction as dir_{letter}")
            } else {
                format!("axis {axis} is not in the chain of the model; columns are {}", known.join(", "))
            });
        }
        if let Some(hint) = known.iter().find_map(|known| other_unit(column, known)) {
            return Err(format!("unknown column; {hint}"));
        }
        match nearest(column, known.iter().map(String::as_str)) {
            Some(near) => Err(format!("unknown column; is {near} meant?")),
            None if column.starts_with("tool") || column.starts_with("dir_") => {
                Err(format!("unknown column; columns are {}", known.join(", ")))
            }
            None => {
                note!("note: column {column} is copied, not used");
                Ok(())
            }
        }
    }

    fn output_names(&self) -> Vec<String> {
        let mut names: Vec<String> =
            ["dx_um", "dy_um", "dz_um", "da_arcsec", "db_arcsec", "dc_arcsec"].map(str::to_owned).into();
        names.extend(self.corrected.iter().map(|(n, _)| format!("c{}_{}", n.lower(), offset_unit(*n))));
        names.push("flags".to_owned());
        if self.lacks_a_direction() {
            names.extend(["rx_um", "ry_um", "rz_um"].map(str::to_owned));
        }
        names
    }

    fn header(&self, table: &Table, block: &mut Vec<u8>) {
        block.extend_from_slice(table.text());
        for name in self.output_names() {
            block.push(b',');
            block.extend_from_slice(name.as_bytes());
        }
        block.push(b'\n');
    }

    #[inline]
    fn pose(&self, table: &Table, model: &Model) -> Result<Pose> {
        let mut pose = Pose::at([0.0; MAX_AXES]);
        for &(column, k, unit) in &self.axes {
            pose.position[k] = table.number(column)? * unit;
        }
        for &(column, k) in &self.directions {
            pose.travel[k] = table.travel_if_known(column)?.unwrap_or(Travel::Forward);
        }
        if !self.tool.is_empty() {
            let mut tip: Vec3 = model.tool_tip();
            for &(column, component) in &self.tool {
                if let Some(value) = table.number_if_known(column)? {
                    tip[component] = value;
                }
            }
            pose.tool_tip = Some(tip);
        } else if let Some(column) = self.tool_length {
            pose.tool_tip = table.number_if_known(column)?.and_then(|mm| model.tool_tip_for_length(mm));
        }
        if !model.dynamics().is_empty() {
            pose.dynamic = Some(self.signals(table, model, &pose)?);
        }
        Ok(pose)
    }

    #[inline]
    fn row(&self, deviation: &Deviation, correction: &AxisCorrection, block: &mut Vec<u8>) {
        for v in deviation.position.iter() {
            push_number(block, um_from_mm(*v));
        }
        for v in deviation.rotation.iter() {
            push_number(block, arcsec_from_rad(*v));
        }
        for (name, k) in &self.corrected {
            push_number(block, offset_as_is(*name, correction.offset[*k]));
        }
        block.push(b',');
        if !deviation.flags.is_clear() || correction.singular != 0 {
            self.flags(deviation, correction, block);
        }
        if self.lacks_a_direction() {
            for v in correction.residual.iter() {
                push_number(block, um_from_mm(*v));
            }
        }
    }

    /// True where X, Y or Z is missing, so that a part of the deviation cannot be corrected.
    fn lacks_a_direction(&self) -> bool {
        [AxisName::X, AxisName::Y, AxisName::Z].iter().any(|a| !self.names.contains(a))
    }

    /// Words such as `x:out-of-travel`, separated by blanks.
    #[cold]
    fn flags(&self, deviation: &Deviation, correction: &AxisCorrection, block: &mut Vec<u8>) {
        let mut separator = "";
        for (k, name) in self.names.iter().enumerate() {
            for (bits, word) in [
                (deviation.flags.out_of_travel, "out-of-travel"),
                (deviation.flags.out_of_range, "out-of-range"),
                (correction.singular, "near-pole"),
            ] {
                if bits & (1 << k) != 0 {
                    block.extend_from_slice(format!("{separator}{}:{word}", name.lower()).as_bytes());
                    separator = " ";
                }
            }
        }
    }
}

fn axis_column(name: AxisName) -> String {
    format!("{}_{}", name.lower(), position_unit(name))
}

/// Decimals of the output: 1e-9 um, 1e-9 arcsec.
const DECIMALS: usize = 9;
/// Above this a number does not fit the fixed-point form.
const FIXED_LIMIT: f64 = 9e9;

/// Appends `,` and the number with up to nine decimals, without trailing zeros.
pub(super) fn push_number(block: &mut Vec<u8>, value: f64) {
    block.push(b',');
    if value.is_nan() || value.abs() >= FIXED_LIMIT {
        block.extend_from_slice(value.to_string().as_bytes());
        return;
    }
    // rounds half away from zero; a call of round() costs more than the whole conversion
    let fixed = (value.abs() * 1e9 + 0.5) as u64;
    if value < 0.0 && fixed > 0 {
        block.push(b'-');
    }
    let (mut whole, mut fraction) = (fixed / 1_000_000_000, (fixed % 1_000_000_000) as u32);
    let mut digits = [b'0'; 12];
    let mut start = digits.len();
    loop {
        start -= 1;
        digits[start] = b'0' + (whole % 10) as u8;
        whole /= 10;
        if whole == 0 {
            break;
        }
    }
    block.extend_from_slice(&digits[start..]);
    if fraction == 0 {
        return;
    }
    let mut decimals = [b'0'; DECIMALS];
    for d in decimals.iter_mut().rev() {
        *d = b'0' + (fraction % 10) as u8;
        fraction /= 10;
    }
    let used = decimals.iter().rposition(|d| *d != b'0').map_or(0, |i| i + 1);
    block.push(b'.');
    block.extend_from_slice(&decimals[..used]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn text(value: f64) -> String {
        let mut block = Vec::new();
        push_number(&mut block, value);
        String::from_utf8(block).unwrap()
    }

    #[test]
    fn numbers_are_short_and_exact_to_a_billionth() {
        for (value, expected) in [
            (0.0, ",0"),
            (-0.0, ",0"),
            (1e-10, ",0"),
            (-1e-9, ",-0.000000001"),
            (12.5, ",12.5"),
            (-3000.000001, ",-3000.000001"),
            (100.0, ",100"),
            (8.9e9, ",8900000000"),
            (1e12, ",1000000000000"),
        ] {
            assert_eq!(text(value), expected);
        }
    }

    proptest! {
        #[test]
        fn numbers_read_back(value in -1e5..1e5f64) {
            let back: f64 = text(value)[1..].parse().unwrap();
            prop_assert!((back - value).abs() <= 0.6e-9);
        }
    }
}
