//! Leadscrew error tables of ISG and Beckhoff controls, `achskw*.lis`.
//!
//! Lines `key value`, `#` starts a comment: `kw.ssfk.interval` (distance of the points; 0: each has its `setpoint`),
//! `kw.ssfk.kw_startpos`, `kw.ssfk.kw_nr_max`, `kw.ssfk.unit` (1: steps of 0.1 um or 0.0001 deg, 0: encoder increments),
//! `kw.ssfk.bilateral`, `kw.ssfk.table[i].pos` and `.neg`, `i` from 0. The values are actual - programmed, whole steps: the
//! vendor's example reads programmed 19866.7 um, measured 19856.5 um, value -102. Between points the control
//! interpolates linearly, beyond the ends it holds the end value.
//!
//! The file holds the positioning error of one axis. Source: the vendors' manuals (axis compensation).

use crate::prelude::*;

use super::axis_table::{Row, curve};
use super::sample::sample_positioning;

/// Most points of a table, the control's own default.
pub const POINTS_MAX: usize = 1500;
/// Steps per mm or deg with unit 1.
const STEPS: f64 = 1e4;
const LIMITS: Limits = Limits {
    format: "isg-lis",
    equidistant: false,
    points: POINTS_MAX,
    two_directions: true,
    decimals: 4, // of a step
};

/// True where the beginning of a file looks like this format.
#[must_use]
pub fn recognises(text: &str) -> bool {
    text.contains("kw.ssfk.")
}

#[derive(Default)]
struct Raw<'a> {
    /// `interval`, `kw_startpos`, `kw_nr_max`, `unit`, `bilateral`, ..
    keys: BTreeMap<&'a str, (Word<'a>, f64)>,
    /// By index: setpoint, pos, neg.
    points: BTreeMap<u32, [Option<(usize, f64)>; 3]>,
}

/// Reads the positioning error of an axis; `increment` is the size of an encoder increment in mm or deg, for files
/// that count in them.
///
/// # Errors
/// The first mistake, with its line and column.
pub fn parse(text: &str, kind: AxisKind, increment: Option<f64>) -> Result<ErrorFunction, FormatError> {
    let mut raw = Raw::default();
    for line in lines(text) {
        let body = Word { text: line.text.split('#').next().unwrap_or("").trim_end(), ..line };
        if !body.text.is_empty() {
            raw.line(body)?;
        }
    }
    raw.finish(kind, increment)
}

impl<'a> Raw<'a> {
    fn line(&mut self, line: Word<'a>) -> Result<(), FormatError> {
        let mut parts = words(line);
        let (Some(key), value) = (parts.next(), parts.next()) else { return Ok(()) };
        // the head and other compensations of the same list mean nothing here
        let Some(name) = key.text.strip_prefix("kw.ssfk.") else { return Ok(()) };
        let Some(value) = value else { return Err(key.unexpected("a key and a value")) };
        let number = value.number("a whole number of steps")?;
        let Some(entry) = name.strip_prefix("table[") else {
            if let Some((first, _)) = self.keys.insert(name, (value, number)) {
                return Err(key.fail(FormatErrorKind::Twice { what: name.to_owned(), first: first.line }));
            }
            return Ok(());
        };
        let (index, field) = entry
            .split_once("].")
            .ok_or_else(|| key.unexpected("kw.ssfk.table[i].pos, .neg or .setpoint"))?;
        let index = Word { text: index, column: key.column + 14, line: key.line }.whole(
            "an index of the table",
            0,
            999_999,
        )?;
        let slot = match field {
            "setpoint" => 0,
            "pos" => 1,
            "neg" => 2,
            _ => return Err(key.unexpected("kw.ssfk.table[i].pos, .neg or .setpoint")),
        };
        let point = self.points.entry(index).or_default();
        if let Some((first, _)) = point[slot].replace((line.line, number)) {
            return Err(key.fail(FormatErrorKind::Twice { what: format!("table[{index}].{field}"), first }));
        }
        Ok(())
    }

    fn key(&self, name: &str) -> Option<f64> {
        self.keys.get(name).map(|(_, v)| *v)
    }

    fn finish(self, kind: AxisKind, increment: Option<f64>) -> Result<ErrorFunction, FormatError> {
        if self.points.is_empty() {
            let remedy = "is this a list with a leadscrew compensation?";
            return Err(FormatError::missing(1, "kw.ssfk.table[0].pos", remedy));
        }
        if let Some((word, announced)) = self.keys.get("kw_nr_max")
            && *announced != self.points.len() as f64
        {
            return Err(word.count("points of the table", *announced as usize, self.points.len()));
        }
        if let Some((word, _)) = self.keys.get("modulo").filter(|(_, v)| *v != 0.0) {
            let why = "a table of a modulo axis closes on itself; the model's tables end";
            return Err(word.fail(FormatErrorKind::NotRead { name: "kw.ssfk.modulo".to_owned(), why }));
        }
        // a step in mm or deg
        let step = match (self.keys.get("unit"), increment) {
            (Some((_, 1.0)), _) => 1.0 / STEPS,
            (_, Some(increment)) => increment,
            (found, None) => {
                let what = "how long an encoder increment is (kw.ssfk.unit is not 1)";
                let kind =
                    FormatErrorKind::NotStated { what, remedy: "give --increment-um, for example 0.1" };
                return Err(
                    found.map_or_else(|| FormatError::at(1, 1, kind.clone()), |(w, _)| w.fail(kind.clone()))
                );
            }
        };
        let inner = |v: f64| kind.position_in(v * step);
        let interval = self.key("interval").unwrap_or(0.0);
        let start = self.key("kw_startpos").unwrap_or(0.0);
        let two_way = self.key("bilateral").unwrap_or(0.0) != 0.0;
        let mut rows = Vec::new();
        for (n, (index, [setpoint, pos, neg])) in self.points.iter().enumerate() {
            let line = pos.or(*neg).or(*setpoint).map_or(1, |(line, _)| line);
            let absent = |what, remedy| FormatError::missing(line, what, remedy);
            if *index as usize != n {
                return Err(absent(
                    "an index of the table before this one",
                    "number the points from 0 without a gap",
                ));
            }
            let position = match setpoint {
                _ if interval != 0.0 => start + interval * f64::from(*index),
                Some((_, at)) => *at,
                None => {
                    return Err(absent(
                        "the setpoint of this point",
                        "interval is 0: every point needs its position",
                    ));
                }
            };
            let (_, forward) = pos.ok_or_else(|| absent("the value .pos of this point", "add it"))?;
            let reverse = match neg {
                Some((_, v)) if two_way => *v,
                None if two_way => {
                    return Err(absent("the value .neg of this point", "bilateral is 1: add it"));
                }
                _ => forward,
            };
            rows.push(Row {
                line,
                position: inner(position),
                forward: inner(forward),
                reverse: inner(reverse),
            });
        }
        curve(&rows, kind)
    }
}

/// Writes the positioning error of an axis, in steps of 0.1 um or 0.0001 deg.
///
/// # Errors
/// What the format cannot hold.
pub fn write(
    spec: &ModelSpec,
    axis: AxisName,
    sampling: &Sampling,
) -> Result<(String, AxisTable), ExportError> {
    let mut table = sample_positioning(spec, axis, sampling, &LIMITS)?;
    let unit = |v: f64| axis.kind().position_out(v);
    let steps = |v: f64| (unit(v) * STEPS).round() as i64;
    let at: Vec<i64> = table.positions.iter().map(|q| LIMITS.printed(axis, *q) as i64).collect();
    let column = &table.columns[0];
    let two_way = column.reverse.is_some();
    let mut out = format!(
        "kopf.log_achs_name {axis}\nkw.ssfk.interval 0\nkw.ssfk.kw_startpos {}\nkw.ssfk.kw_nr_max {}\nkw.ssfk.unit 1\nkw.ssfk.bilateral {}\n",
        at[0],
        at.len(),
        u8::from(two_way),
    );
    for (i, q) in at.iter().enumerate() {
        out.push_str(&format!("kw.ssfk.table[{i}].setpoint {q}\n"));
    }
    let values = [("pos", Some(&column.forward)), ("neg", column.reverse.as_ref())];
    for (name, values) in values.into_iter().filter_map(|(n, v)| v.map(|v| (n, v))) {
        for (i, v) in values.iter().enumerate() {
            out.push_str(&format!("kw.ssfk.table[{i}].{name} {}\n", steps(*v)));
        }
    }
    // half a step is lost in each value
    table.largest_error +=
        if axis.kind() == AxisKind::Rotary { rad_from_deg(0.5 / STEPS) * 1000.0 } else { 0.5 / STEPS };
    Ok((out, table))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use volcomp_model::{Chain, ErrorSymbol};
    use volcomp_units::axes::Travel;

    const GOOD: &str = "kopf.log_achs_nr 2 # axis\nkw.ssfk.interval 20000\nkw.ssfk.kw_startpos -909000\nkw.ssfk.kw_nr_max 3\nkw.ssfk.unit 1\nkw.ssfk.bilateral 1\nkw.ssfk.table[0].pos 0\nkw.ssfk.table[1].pos 24\nkw.ssfk.table[2].pos -102\nkw.ssfk.table[0].neg 0\nkw.ssfk.table[1].neg 67\nkw.ssfk.table[2].neg 80\n";

    fn read(text: &str) -> Result<ErrorFunction, FormatError> {
        parse(text, AxisKind::Linear, None)
    }

    #[test]
    fn steps_and_signs_of_the_vendors_example() {
        let found = read(GOOD).unwrap();
        assert!(recognises(GOOD));
        assert!((found.value(-86.9, Travel::Forward) + 0.0102).abs() < 1e-12);
        assert!((found.value(-88.9, Travel::Reverse) - 0.0067).abs() < 1e-12);
        let uneven = GOOD.replace("interval 20000", "interval 0").replace("unit 1\n", "unit 1\nkw.ssfk.table[0].setpoint -200000\nkw.ssfk.table[1].setpoint -199306\nkw.ssfk.table[2].setpoint -198667\n");
        assert!((read(&uneven).unwrap().value(-19.8667, Travel::Forward) + 0.0102).abs() < 1e-12);
        let counts = GOOD.replace("unit 1", "unit 0");
        assert!(read(&counts).unwrap_err().to_string().starts_with("5:14: the file does not say how long"));
        assert!(parse(&counts, AxisKind::Linear, Some(1e-3)).unwrap().range().unwrap()[0] == -909.0);
    }

    #[test]
    fn mistakes_name_their_place() {
        let fails = |from: &str, to: &str| read(&GOOD.replace(from, to)).unwrap_err().to_string();
        assert!(fails("pos 24", "pos 2,4").starts_with("8:22: '2,4' is not a finite number"));
        assert!(fails("[1].pos", "[2].pos").contains("table[2].pos was given before, on line 8"));
        assert!(
            fails("kw_nr_max 3", "kw_nr_max 4")
                .starts_with("4:19: points of the table: 4 announced, 3 found")
        );
        assert!(fails("[1].neg", "[x].neg").starts_with("11:15: 'x' is not a finite number"));
        assert!(fails("table[1].neg", "table[1].up").contains("expected kw.ssfk.table[i].pos"));
        assert!(fails("interval 20000", "interval 0").contains("the setpoint of this point is missing"));
        assert!(fails("kw.ssfk.table[1].neg 67\n", "").contains("the value .neg of this point is missing"));
        assert!(fails("unit 1", "unit 1\nkw.ssfk.modulo 1").contains("kw.ssfk.modulo is not read"));
        assert!(read("").unwrap_err().to_string().contains("kw.ssfk.table[0].pos is missing"));
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(values in prop::collection::vec((-900i32..900, -900i32..900), 2..40)) {
            let n = values.len();
            let mut text = format!("kw.ssfk.interval 0\nkw.ssfk.unit 1\nkw.ssfk.kw_nr_max {n}\nkw.ssfk.bilateral 1\n");
            for (i, (p, m)) in values.iter().enumerate() {
                text += &format!("kw.ssfk.table[{i}].setpoint {}\nkw.ssfk.table[{i}].pos {p}\nkw.ssfk.table[{i}].neg {m}\n", i * i * 777 + i);
            }
            let first = read(&text).unwrap();
            let mut spec = ModelSpec::new("m", Chain::parse("[w b Y t]").unwrap());
            spec.errors = vec![(ErrorSymbol::parse("eyy").unwrap(), first.clone())];
            let (text, table) = write(&spec, AxisName::Y, &Sampling::default()).unwrap();
            prop_assert!(table.largest_error < 0.06e-3);
            prop_assert_eq!(read(&text).unwrap(), first);
        }

        #[test]
        fn damaged_files_never_panic(at in 0..GOOD.len(), with in "[a-z0-9.\\[\\]# \n-]{0,6}", cut in 0usize..9) {
            let end = (at + cut).min(GOOD.len());
            let _ = read(&format!("{}{with}{}", &GOOD[..at], &GOOD[end..]));
        }
    }
}
