//! What effects do at the rows of a session, and whether one set of effects says the same as another.
//!
//! A declared cause is a re-expression where its fitted contribution, evaluated by `volcomp predict` at the rows of the session,
//! is what true effects do there. Nothing is whitened but the offset of each setup; the marks of the tool's own report
//! (`re_expression_of`, `confounded_with`) take no part in it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use nalgebra::{DMatrix, DVector, Rotation3, Vector3};

use crate::campaign::files::Text;

/// Share of a column that others have to express (sum of squares).
pub const OVERLAP: f64 = 0.97;
/// Sets of at most so many causes are tried as an expression of one true effect.
const SINGULAR: f64 = 1e-9;

/// A table of numbers with a heading.
#[derive(Debug, Clone, PartialEq)]
struct Table {
    name: String,
    head: BTreeMap<String, usize>,
    rows: Vec<Vec<Option<f64>>>,
}

/// Time, s; file and row of a reading, none for an entry of the log; place among the entries.
type Instant = (f64, Option<(usize, usize)>, usize);

impl Table {
    fn read(file: &Text) -> Result<Self, String> {
        let mut reader = csv::Reader::from_reader(file.text.as_bytes());
        let why = |e: csv::Error| format!("{}: {e}", file.name);
        let head = reader.headers().map_err(why)?;
        let head = head.iter().enumerate().map(|(k, h)| (h.to_owned(), k)).collect();
        let rows = reader
            .records()
            .map(|r| Ok(r.map_err(why)?.iter().map(|f| f.parse().ok()).collect()))
            .collect::<Result<_, String>>()?;
        Ok(Self { name: file.name.clone(), head, rows })
    }

    fn get(&self, row: usize, column: &str) -> Option<f64> {
        self.rows.get(row)?.get(*self.head.get(column)?).copied().flatten()
    }
}

/// The rows of the session files of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows {
    tables: Vec<Table>,
    history: Table,
    /// Rotary axes that carry the workpiece, from the bed outwards.
    carrying: Vec<char>,
}

/// One value per row, in the order of the files and their rows.
pub type Column = Vec<f64>;

impl Rows {
    /// Reads the files of a case.
    ///
    /// # Errors
    /// A file that is no table.
    pub fn read(sessions: &[Text], history: &Text, model: &Text) -> Result<Self, String> {
        let chain = model.text.lines().find_map(|l| l.strip_prefix("chain = ")).unwrap_or_default();
        let workpiece_side = chain.split_once(" b ").map_or("", |(left, _)| left);
        let carrying = workpiece_side
            .chars()
            .filter(|c| matches!(c, 'A' | 'B' | 'C'))
            .map(|c| c.to_ascii_lowercase())
            .rev()
            .collect();
        Ok(Self {
            tables: sessions.iter().map(Table::read).collect::<Result<_, _>>()?,
            history: Table::read(history)?,
            carrying,
        })
    }

    fn each(&self) -> impl Iterator<Item = (usize, usize)> {
        self.tables.iter().enumerate().flat_map(|(f, t)| (0..t.rows.len()).map(move |r| (f, r)))
    }

    fn value(&self, (file, row): (usize, usize), column: &str) -> f64 {
        self.tables.get(file).and_then(|t| t.get(row, column)).unwrap_or_default()
    }

    fn u(&self, at: (usize, usize)) -> Vector3<f64> {
        Vector3::from(["u_x", "u_y", "u_z"].map(|c| self.value(at, c)))
    }

    /// A column from values by file name.
    #[must_use]
    pub fn column(&self, by_file: &BTreeMap<String, Vec<f64>>) -> Column {
        self.each()
            .map(|(f, r)| {
                let name = self.tables.get(f).map(|t| t.name.as_str()).unwrap_or_default();
                by_file.get(name).and_then(|v| v.get(r)).copied().unwrap_or_default()
            })
            .collect()
    }

    /// The rows and the entries of the log in the order of time, as points for `volcomp predict`.
    #[must_use]
    pub fn points(&self) -> Points {
        const LEFT_OUT: [&str; 9] =
            ["instrument", "setup", "run", "repeat", "pair", "deviation_um", "moving", "u_x", "u_y"];
        let mut columns: BTreeSet<&str> =
            self.tables.iter().flat_map(|t| t.head.keys()).map(String::as_str).collect();
        columns.retain(|c| !LEFT_OUT.contains(c) && *c != "u_z" && *c != "t_s" && !c.starts_with("station_"));
        columns.extend(self.history.head.keys().map(String::as_str).filter(|c| *c != "t_s"));
        let mut order: Vec<Instant> = (0..self.history.rows.len())
            .map(|r| (self.history.get(r, "t_s").unwrap_or_default(), None, r))
            .collect();
        order.extend(self.each().map(|at| (self.value(at, "t_s"), Some(at), 0)));
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut text = String::from("t_s");
        columns.iter().for_each(|c| text.extend([",", c]));
        text.push('\n');
        let mut log = 0;
        let mut rows = Vec::with_capacity(order.len());
        for (t, at, entry) in order {
            if at.is_none() {
                log = entry;
            }
            // writing to a String cannot fail
            let _ = write!(text, "{t}");
            for c in &columns {
                let own = at.and_then(|(f, r)| self.tables.get(f).and_then(|t| t.get(r, c)));
                let value =
                    own.or_else(|| self.history.get(log, c)).filter(|v| v.is_finite()).unwrap_or_default();
                // before it has moved, an axis counts as moving forward
                let value = if c.starts_with("dir_") && value == 0.0 { 1.0 } else { value };
                let _ = write!(text, ",{value}");
            }
            text.push('\n');
            rows.push(at);
        }
        Points { text, rows }
    }

    /// What `volcomp predict` says at [`Rows::points`], along u.
    ///
    /// # Errors
    /// A prediction that does not belong to the points.
    pub fn predicted(&self, points: &Points, prediction: &Text) -> Result<Column, String> {
        let table = Table::read(prediction)?;
        if table.rows.len() != points.rows.len() {
            return Err(format!(
                "{}: {} rows for {} points",
                prediction.name,
                table.rows.len(),
                points.rows.len()
            ));
        }
        let mut by_row: BTreeMap<(usize, usize), f64> = BTreeMap::new();
        for (n, at) in points.rows.iter().enumerate() {
            let Some(at) = *at else { continue };
            let in_w =
                Vector3::from(["dx_um", "dy_um", "dz_um"].map(|c| table.get(n, c).unwrap_or_default()));
            by_row.insert(at, (self.turn(at) * in_w).dot(&self.u(at)));
        }
        Ok(self.each().map(|at| by_row.get(&at).copied().unwrap_or_default()).collect())
    }

    /// Nominal rotation of the workpiece in M: tables turn against their coordinates.
    fn turn(&self, at: (usize, usize)) -> Rotation3<f64> {
        self.carrying.iter().fold(Rotation3::identity(), |all, letter| {
            let axis = match letter {
                'a' => Vector3::x_axis(),
                'b' => Vector3::y_axis(),
                _ => Vector3::z_axis(),
            };
            let angle = self.value(at, &format!("{letter}_deg")).to_radians();
            all * Rotation3::from_axis_angle(&axis, -angle)
        })
    }

    /// Columns of an effect of an instrument, which no prediction of the machine has: linear in its parameters.
    #[must_use]
    pub fn of_instrument(&self, effect: &str) -> Vec<Column> {
        let all = |f: &dyn Fn((usize, usize)) -> f64| self.each().map(f).collect::<Column>();
        let speed = |at| {
            Vector3::from(["vx_mm_per_s", "vy_mm_per_s", "vz_mm_per_s"].map(|c| self.value(at, c)))
                .dot(&self.u(at))
        };
        let path = |at: (usize, usize)| {
            let station = ["station_x_mm", "station_y_mm", "station_z_mm"];
            let known = self.tables.get(at.0).is_some_and(|t| t.get(at.1, station[0]).is_some());
            if known {
                let tip = ["x_mm", "y_mm", "z_mm"].map(|c| self.value(at, c));
                let tip = Vector3::from(tip) - Vector3::z() * self.value(at, "tool_length_mm");
                (tip - Vector3::from(station.map(|c| self.value(at, c)))).dot(&self.u(at))
            } else {
                self.value(at, "range_mm")
            }
        };
        match effect {
            "clock-skew" => (0..self.tables.len())
                .flat_map(|file| {
                    [0, 1].map(|power| {
                        all(&|at| {
                            let own = f64::from(u8::from(at.0 == file));
                            own * speed(at) * self.value(at, "t_s").powi(power)
                        })
                    })
                })
                .collect(),
            "tracker-scale" => vec![all(&path)],
            "dead-path" => {
                let mut columns = vec![all(&path)];
                for name in self.history.head.keys().filter(|n| n.starts_with("temp_")) {
                    columns.push(all(&|at| path(at) * self.logged(name, self.value(at, "t_s"))));
                }
                columns
            }
            _ => Vec::new(),
        }
    }

    fn logged(&self, column: &str, t_s: f64) -> f64 {
        let rows = &self.history.rows;
        let time = |r: usize| self.history.get(r, "t_s").unwrap_or_default();
        let (mut low, mut high) = (0, rows.len().saturating_sub(1));
        while low < high {
            let middle = (low + high).div_ceil(2);
            if time(middle) <= t_s { low = middle } else { high = middle - 1 }
        }
        self.history.get(low, column).unwrap_or_default()
    }

    /// A column without the offset (along each u) of each setup.
    fn without_offsets(&self, column: &Column) -> DVector<f64> {
        use nalgebra::Matrix3;
        let mut setups: BTreeMap<(usize, i64), (Matrix3<f64>, Vector3<f64>)> = BTreeMap::new();
        let key = |at: (usize, usize)| (at.0, self.value(at, "setup") as i64);
        for (at, v) in self.each().zip(column) {
            let u = self.u(at);
            let (normal, right) =
                setups.entry(key(at)).or_insert_with(|| (Matrix3::identity() * 1e-9, Vector3::zeros()));
            *normal += u * u.transpose();
            *right += u * *v;
        }
        let offsets: BTreeMap<_, Vector3<f64>> = setups
            .into_iter()
            .map(|(k, (normal, right))| (k, normal.try_inverse().map_or_else(Vector3::zeros, |i| i * right)))
            .collect();
        let values = self
            .each()
            .zip(column)
            .map(|(at, v)| v - offsets.get(&key(at)).map_or(0.0, |offset| offset.dot(&self.u(at))));
        DVector::from_vec(values.collect())
    }

    /// Share of a column's sum of squares that a combination of others expresses.
    #[must_use]
    pub fn expressed(&self, target: &Column, by: &[&Column]) -> f64 {
        let target = self.without_offsets(target);
        let total = target.norm_squared();
        if total <= 0.0 || by.is_empty() {
            return 0.0;
        }
        let columns: Vec<DVector<f64>> = by
            .iter()
            .map(|c| self.without_offsets(c))
            .filter(|c| c.norm() > 0.0)
            .map(|c| c.normalize())
            .collect();
        if columns.is_empty() {
            return 0.0;
        }
        let matrix = DMatrix::from_columns(&columns);
        let normal = matrix.transpose() * &matrix;
        let right = matrix.transpose() * &target;
        match normal.svd(true, true).solve(&right, SINGULAR) {
            Ok(size) => 1.0 - (target - matrix * size).norm_squared() / total,
            Err(_) => 0.0,
        }
    }

    /// Which declared causes say again what is true: the cause is a combination of true effects, or a true effect is a combination
    /// of declared causes in which this one is needed, beside its own name, too: a hinge that tilts under acceleration yields
    /// under a force, and takes two formulas.
    ///
    /// Both by label; a cause may have several columns, linear in its parameters.
    #[must_use]
    pub fn re_expressions(
        &self,
        truth: &BTreeMap<String, Column>,
        declared: &BTreeMap<String, Vec<Column>>,
    ) -> BTreeSet<String> {
        let mut found = BTreeSet::new();
        let true_columns: Vec<&Column> = truth.values().collect();
        for (label, columns) in declared.iter().filter(|(l, _)| !truth.contains_key(*l)) {
            let is_truth = |c: &Column| self.expressed(c, &true_columns) >= OVERLAP;
            if columns.len() == 1 && columns.iter().all(is_truth) {
                found.insert(label.clone());
            }
            for effect in truth.values() {
                let all: Vec<&Column> = declared.values().flatten().collect();
                let others: Vec<&Column> =
                    declared.iter().filter(|(l, _)| *l != label).flat_map(|(_, c)| c).collect();
                if self.expressed(effect, &all) >= OVERLAP && self.expressed(effect, &others) < OVERLAP {
                    found.insert(label.clone());
                }
            }
        }
        found
    }
}

/// Points for `volcomp predict`.
#[derive(Debug, Clone, PartialEq)]
pub struct Points {
    /// The table.
    pub text: String,
    /// The row of a session behind each point; `None` for an entry of the log.
    rows: Vec<Option<(usize, usize)>>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Rows {
        let mut text = String::from("t_s,setup,x_mm,y_mm,u_x,u_y,u_z,vx_mm_per_s\n");
        for k in 0..60 {
            let (x, y) = (f64::from(k % 20) * 20.0, f64::from(k / 20) * 50.0);
            let _ = writeln!(text, "{k},{},{x},{y},1,0,0,{}", k / 30, 3.0 * (f64::from(k) * 0.7).sin());
        }
        let file = |name: &str, text: &str| Text { name: name.to_owned(), text: text.to_owned() };
        Rows::read(
            &[file("laser.csv", &text)],
            &file("history.csv", "t_s,temp_air_degc\n0,20\n30,21\n"),
            &file("model.toml", "chain = \"[w C' A' b X Y Z t]\"\n"),
        )
        .unwrap()
    }

    fn of(rows: &Rows, f: impl Fn(f64, f64) -> f64) -> Column {
        rows.each().map(|at| f(rows.value(at, "x_mm"), rows.value(at, "y_mm"))).collect()
    }

    #[test]
    fn the_same_thing_by_another_name_is_a_re_expression_and_something_alike_is_not() {
        let rows = rows();
        let truth = BTreeMap::from([("scale:x".to_owned(), of(&rows, |x, _| 0.02 * x))]);
        // an offset of the setup does not matter, a curve does
        let same = of(&rows, |x, _| 0.019 * x + 40.0);
        let alike = of(&rows, |x, _| 0.02 * x + 1.2 * (x / 40.0).sin());
        let said = |c: &Column| BTreeMap::from([("sag:x".to_owned(), vec![c.clone()])]);
        assert_eq!(rows.re_expressions(&truth, &said(&same)).len(), 1);
        assert!(rows.expressed(&alike, &[&truth["scale:x"]]) > 0.8);
        assert!(rows.re_expressions(&truth, &said(&alike)).is_empty());
        assert!(rows.re_expressions(&BTreeMap::new(), &said(&same)).is_empty());
    }

    #[test]
    fn a_sum_of_causes_is_a_re_expression_and_a_cause_beside_it_is_none() {
        let rows = rows();
        let truth = BTreeMap::from([("latency".to_owned(), of(&rows, |x, y| 0.01 * x + 0.03 * y))]);
        let causes = |third: Column| {
            BTreeMap::from([
                ("servo-mismatch:x".to_owned(), vec![of(&rows, |x, _| 0.01 * x)]),
                ("servo-mismatch:y".to_owned(), vec![of(&rows, |_, y| 0.029 * y)]),
                ("wear:x".to_owned(), vec![third]),
            ])
        };
        let found =
            rows.re_expressions(&truth, &causes(of(&rows, |x, _| (-(x - 100.0).powi(2) / 900.0).exp())));
        assert_eq!(found.into_iter().collect::<Vec<_>>(), ["servo-mismatch:x", "servo-mismatch:y"]);
    }

    #[test]
    fn what_a_true_effect_does_beyond_its_formula_is_a_re_expression_and_what_it_does_not_is_none() {
        let rows = rows();
        let truth = BTreeMap::from([("inertial-cross:x".to_owned(), of(&rows, |x, y| 0.01 * x + 0.03 * y))]);
        let said = |second: Column| {
            BTreeMap::from([
                ("inertial-cross:x".to_owned(), vec![of(&rows, |x, _| 0.01 * x)]),
                ("load:y".to_owned(), vec![second]),
            ])
        };
        let found = rows.re_expressions(&truth, &said(of(&rows, |_, y| 0.03 * y)));
        assert_eq!(found.into_iter().collect::<Vec<_>>(), ["load:y"]);
        let bump = of(&rows, |x, _| (-(x - 100.0).powi(2) / 900.0).exp());
        assert!(rows.re_expressions(&truth, &said(bump)).is_empty());
    }

    #[test]
    fn points_come_in_the_order_of_time_with_the_log_between_them() {
        let rows = rows();
        let points = rows.points();
        assert_eq!(points.text.lines().count(), 63);
        assert_eq!(points.text.lines().next().unwrap(), "t_s,temp_air_degc,vx_mm_per_s,x_mm,y_mm");
        assert_eq!(points.rows.iter().filter(|r| r.is_none()).count(), 2);
        assert_eq!(rows.carrying, ['a', 'c']);
    }
}
