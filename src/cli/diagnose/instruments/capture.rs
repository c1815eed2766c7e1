//! Captures of a SINUMERIK Edge: following errors of the axes, from the JSON of the control or a table of its signals.

use super::{InstrumentArgs, Measurement, Rows, along};
use crate::prelude::*;
use volcomp_diagnose::session::Times;
use volcomp_formats::edge::{self, Header, Row, Sink};

/// Seconds per cycle of a table, which does not state it.
const CYCLE_S: f64 = 0.002;
/// An axis that moves further turns, whatever its name: no linear axis does, mm.
const TURNS: f64 = 20_000.0;

/// An axis with the columns of its commanded and its actual position.
#[derive(Debug, Clone, Copy)]
struct Channel {
    axis: AxisName,
    desired: usize,
    actual: usize,
}

/// A numbered axis of a capture.
#[derive(Debug, Default, Clone)]
struct Seen {
    name: String,
    desired: Option<usize>,
    actual: Option<usize>,
    range: Option<[f64; 2]>,
}

/// The axes of a capture by number, with what they do.
#[derive(Debug, Default)]
struct Survey {
    axes: BTreeMap<u32, Seen>,
    /// Kinds of signals that are not read, such as those of a second encoder.
    unused: BTreeSet<String>,
}

impl Survey {
    fn of<'a>(signals: impl Iterator<Item = (&'a str, &'a str)>) -> Self {
        let mut axes: BTreeMap<u32, Seen> = BTreeMap::new();
        let mut unused = BTreeSet::new();
        for (column, (signal, name)) in signals.enumerate() {
            let Some((kind, number)) = signal.split_once('|') else { continue };
            let Ok(number) = number.parse::<u32>() else { continue };
            let seen = axes.entry(number).or_default();
            if !name.is_empty() {
                name.clone_into(&mut seen.name);
            }
            match kind {
                "DES_POS" => seen.desired = Some(column),
                "ENC_POS" => seen.actual = Some(column),
                _ => {
                    unused.insert(kind.to_owned());
                }
            }
        }
        Self { axes, unused }
    }

    /// The signals that are not read, in words.
    fn unused_text(&self) -> Option<String> {
        let kinds = self.unused.iter().joined(", ");
        (!kinds.is_empty()).then(|| format!("signals not used: {kinds}; DES_POS and ENC_POS are read"))
    }

    fn widen(&mut self, value: impl Fn(usize) -> f64) {
        for seen in self.axes.values_mut() {
            let Some(v) = seen.desired.map(&value).filter(|v| v.is_finite()) else { continue };
            let range = seen.range.get_or_insert([v, v]);
            *range = [range[0].min(v), range[1].max(v)];
        }
    }

    /// The linear axes that names and behaviour give away, and what was assumed.
    fn guess(&self) -> (Vec<(AxisName, u32)>, Vec<String>) {
        let (mut axes, mut taken, mut left) = (Vec::new(), Vec::new(), Vec::new());
        for (number, seen) in &self.axes {
            // without names the order of the control is X, Y, Z
            let letter = seen.name.chars().next().or(match number {
                1 => Some('X'),
                2 => Some('Y'),
                3 => Some('Z'),
                _ => None,
            });
            let axis = letter.and_then(AxisName::from_letter).filter(|a| {
                a.kind() == AxisKind::Linear && volcomp_diagnose::machine_state::Axis::from_name(*a).is_some()
            });
            let name = if seen.name.is_empty() { String::new() } else { format!(" ({})", seen.name) };
            let span = seen.range.map_or(0.0, |[low, high]| high.abs().max(low.abs()).max(high - low));
            let why = match axis {
                _ if seen.desired.is_none() || seen.actual.is_none() => "no DES_POS or ENC_POS",
                None => "its name is not that of X, Y or Z",
                Some(_) if span > TURNS => "it turns",
                Some(a) if axes.iter().any(|(b, _)| *b == a) => "another axis has that letter",
                Some(a) => {
                    axes.push((a, *number));
                    taken.push(format!("{}={number}{name}", a.lower()));
                    continue;
                }
            };
            left.push(format!("{number}{name}: {why}"));
        }
        let mut notes = vec![format!(
            "axes {} assumed from their names; --axes states them, because a name need not say how an axis moves",
            taken.join(", ")
        )];
        if !left.is_empty() {
            notes.push(format!("axes left out: {}", left.join("; ")));
        }
        (axes, notes)
    }

    fn channels(&self, path: &Path, axes: &[(AxisName, u32)]) -> Result<Vec<Channel>> {
        let known = || {
            let all = self.axes.iter().map(|(n, s)| format!("{n} ({})", s.name)).joined(", ");
            all.replace(" ()", "")
        };
        let linear = axes.iter().filter(|(a, _)| a.kind() == AxisKind::Linear);
        let mut channels = Vec::new();
        for (axis, number) in linear {
            let seen = self.axes.get(number);
            match (seen.and_then(|s| s.desired), seen.and_then(|s| s.actual)) {
                (Some(desired), Some(actual)) => channels.push(Channel { axis: *axis, desired, actual }),
                (desired, _) => {
                    let lost = if desired.is_none() { "DES_POS" } else { "ENC_POS" };
                    let what =
                        format!("no signal {lost}|{number}; --axes names axes of the capture: {}", known());
                    return Err(Failure::data(path, what));
                }
            }
        }
        if channels.is_empty() {
            let (file, known) = (path.display(), known());
            return Err(usage!(
                "{file}: a capture needs at least one linear axis; name them with --axes, such as x=1,y=2,z=6; the capture has {known}"
            ));
        }
        Ok(channels)
    }
}

/// Following errors of a capture: actual minus commanded position of each axis; a gap begins a new run.
struct Following {
    channels: Vec<Channel>,
    only: Option<AxisName>,
    rows: Rows,
    runs: BTreeSet<u32>,
}

impl Following {
    fn new(path: &Path, only: Option<AxisName>, channels: Vec<Channel>) -> Self {
        let names = ["t_s", "setup", "run", "repeat", "moving", "u_x", "u_y", "u_z", "deviation_um"];
        let positions = channels.iter().map(|c| format!("{}_mm", c.axis.lower()));
        let rows = Rows::new(path, names.map(str::to_owned).into_iter().chain(positions));
        Self { rows, channels, only, runs: BTreeSet::new() }
    }

    fn sample(&mut self, line: u64, t_s: f64, run: u32, value: impl Fn(usize) -> f64) {
        let places: Vec<f64> = self.channels.iter().map(|c| value(c.desired)).collect();
        if places.iter().any(|p| !p.is_finite()) {
            return;
        }
        self.runs.insert(run);
        for (channel, place) in self.channels.iter().zip(&places) {
            if self.only.is_some_and(|only| only != channel.axis) {
                continue;
            }
            let [x, y, z] = along(channel.axis.direction());
            let e = um_from_mm(value(channel.actual) - place);
            let mut values = vec![t_s, 1.0, f64::from(run), 1.0, 1.0, x, y, z, e];
            values.extend(&places);
            self.rows.push(line, "encoder", &values);
        }
    }

    fn finish(self, format: String, notes: Vec<String>, times: &str) -> Measurement {
        let all = self.channels.iter().map(|c| c.axis.lower().to_string()).joined(", ");
        let axes = self.only.map_or(all, |a| a.lower().to_string());
        let readings = counted(self.rows.raw.len(), "reading");
        let parts = counted(self.runs.len(), "uninterrupted part");
        let mut found = Measurement::new(self.rows, Times::Measured, format);
        found.notes = notes;
        found.note(format!(
            "following errors (encoder minus set point) of {axes}: {readings}, {times}, {parts}"
        ));
        found
    }
}

/// The axes to read: those of --axes, else by their names.
fn chosen(args: &InstrumentArgs, survey: &Survey) -> (Vec<(AxisName, u32)>, Vec<String>) {
    let (axes, mut notes) =
        if args.axes.is_empty() { survey.guess() } else { (args.axes.clone(), Vec::new()) };
    notes.extend(survey.unused_text());
    (axes, notes)
}

/// A capture as a table of its signals.
pub(super) fn table(path: &Path, args: &InstrumentArgs) -> Result<Measurement> {
    let mut survey = {
        let table = table::open(path)?;
        Survey::of(table.columns().iter().map(|c| (c.as_str(), "")))
    };
    if args.axes.is_empty() {
        let mut table = table::open(path)?;
        while table.advance()? {
            survey.widen(|c| table.number_or_empty(c).unwrap_or(f64::NAN));
        }
    }
    let (axes, mut notes) = chosen(args, &survey);
    let mut following = Following::new(path, args.only, survey.channels(path, &axes)?);
    let mut table = table::open(path)?;
    let cycle = table.require("CYCLE")?;
    let columns: Vec<usize> = following.channels.iter().flat_map(|c| [c.desired, c.actual]).collect();
    let mut values = vec![f64::NAN; table.columns().len()];
    let (mut before, mut run) = (f64::NAN, 1);
    let mut origin = None;
    while table.advance()? {
        let count = table.number(cycle)?;
        if count - before > 1.5 {
            run += 1;
        }
        before = count;
        for c in &columns {
            values[*c] = table.number(*c)?;
        }
        let t_s = (count - *origin.get_or_insert(count)) * CYCLE_S;
        following.sample(table.line(), t_s, run, |c| values[c]);
    }
    notes.push(format!("interpolation cycle of {} ms assumed: the table does not state it", CYCLE_S * 1e3));
    Ok(following.finish("capture of a SINUMERIK Edge as a table".to_owned(), notes, "clock of the control"))
}

impl Sink for Survey {
    fn header(&mut self, header: &Header) -> bool {
        *self = Self::of(header.signals.iter().map(|s| (s.name.as_str(), s.axis.as_str())));
        true
    }

    fn row(&mut self, row: Row<'_>) -> bool {
        self.widen(|c| row.values.get(c).copied().unwrap_or(f64::NAN));
        true
    }
}

impl Sink for Following {
    fn header(&mut self, _: &Header) -> bool {
        true
    }

    fn row(&mut self, row: Row<'_>) -> bool {
        let line = self.rows.raw.lines.last().map_or(1, |l| l + 1);
        let at = |c: usize| row.values.get(c).copied().unwrap_or(f64::NAN);
        self.sample(line, row.t_s, row.segment + 1, at);
        true
    }
}

/// A capture as the control writes it; its lines are counted as rows of data.
pub(super) fn json(path: &Path, args: &InstrumentArgs) -> Result<Measurement> {
    let read = |sink: &mut dyn Sink| {
        let source = input::open(path, InputKind::Capture)?;
        edge::read(source.buffered(), sink).map_err(|e| read_failure(path, &e))
    };
    let mut survey = Survey::default();
    let summary = read(&mut survey)?;
    let (axes, notes) = chosen(args, &survey);
    let mut following = Following::new(path, args.only, survey.channels(path, &axes)?);
    read(&mut following)?;
    let machine = summary.header.machine().map_or_else(String::new, |m| format!(" ({m})"));
    let clock = format!("a row every {} ms", summary.header.cycle_ms);
    Ok(following.finish(format!("capture of a SINUMERIK Edge{machine}"), notes, &clock))
}

#[cfg(test)]
mod tests {
    use super::Survey;

    #[test]
    fn signals_that_are_not_read_are_named() {
        let of = |names: &[&'static str]| Survey::of(names.iter().map(|n| (*n, ""))).unused_text();
        assert_eq!(of(&["CYCLE", "DES_POS|1", "ENC_POS|1"]), None);
        let text = of(&["CYCLE", "DES_POS|1", "ENC_POS|1", "ENC1_POS|1", "ENC2_POS|1", "ENC2_POS|2"]);
        assert_eq!(
            text.as_deref(),
            Some("signals not used: ENC1_POS, ENC2_POS; DES_POS and ENC_POS are read")
        );
    }
}
