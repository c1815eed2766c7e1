//! Columns of instrument tables by name; their numbers become mm and rad by the unit at the end of the name.

use std::collections::HashMap;

use crate::prelude::*;
pub(crate) use crate::table::Table as Columns;
use crate::table::{nearest, other_unit};
use crate::units::beyond_machines;

/// A column and what brings its numbers into mm or rad.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column {
    pub(crate) index: usize,
    to_inner: fn(f64) -> f64,
}

/// A name with its place, such as that of a point, mm.
pub(crate) type Named = (String, Vec3);

/// Columns of a run along one axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RunColumns {
    position: Column,
    cycle: Option<Column>,
    direction: Option<Column>,
}

impl From<Column> for usize {
    fn from(column: Column) -> Self {
        column.index
    }
}

/// The name that is most like this one, or else `columns`.
pub(crate) fn hint(name: &str, names: &[String], columns: impl core::fmt::Display) -> String {
    let of_other_unit = names.iter().find_map(|known| other_unit(name, known));
    let near = || nearest(name, names.iter().map(String::as_str)).map(|near| format!("is {near} meant?"));
    of_other_unit.or_else(near).unwrap_or_else(|| format!("columns are {columns}"))
}

/// The points of a table by their names in `column`, of which there must be one; `wrong` says why a name cannot be.
pub(crate) fn named_points(path: &Path, column: &str, wrong: fn(&str) -> String) -> Result<Vec<Named>> {
    let mut table = table::open(path)?;
    let (name, at) = (table.column(column)?, table.three(["x_mm", "y_mm", "z_mm"])?);
    table.only_known()?;
    let mut points: Vec<Named> = Vec::new();
    table.rows(|row| {
        let word = row.word(name);
        if word.is_empty() || points.iter().any(|(n, _)| *n == word) {
            return Err(row.fail(name, wrong(&word)));
        }
        points.push((word, row.point(at)?));
        Ok(())
    })?;
    if points.is_empty() { Err(data!(path, "no {column}s below the header")) } else { Ok(points) }
}

impl Column {
    fn new(name: &str, index: usize) -> Self {
        let to_inner = match name.rsplit_once('_').map(|(_, unit)| unit) {
            Some("um") => mm_from_um,
            Some("arcsec") => rad_from_arcsec,
            Some("deg") => rad_from_deg,
            _ => |v| v,
        };
        Self { index, to_inner }
    }
}

impl Columns {
    /// The column of a name, where the table has it.
    pub(crate) fn find_column(&mut self, name: &str) -> Option<Column> {
        self.known.push(name.to_owned());
        self.find(name).map(|index| Column::new(name, index))
    }

    /// The column of a name.
    pub(crate) fn column(&mut self, name: &str) -> Result<Column> {
        self.known.push(name.to_owned());
        self.require(name).map(|index| Column::new(name, index))
    }

    /// Three columns, such as those of a point.
    pub(crate) fn three(&mut self, names: [&str; 3]) -> Result<[Column; 3]> {
        Ok([self.column(names[0])?, self.column(names[1])?, self.column(names[2])?])
    }

    /// The position, optional `cycle` and `direction`.
    pub(crate) fn run(&mut self, position: &str) -> Result<RunColumns> {
        let position = self.column(position)?;
        Ok(RunColumns {
            position,
            cycle: self.find_column("cycle"),
            direction: self.find_column("direction"),
        })
    }

    /// Refuses columns that were not asked for; `hint` says which were, from the name of the first.
    pub(crate) fn only_asked(&self, hint: impl FnOnce(&str) -> String) -> Result<()> {
        match self.columns().iter().position(|c| !self.known.contains(c)) {
            Some(i) => {
                let hint = hint(&self.columns()[i]);
                Err(self.fail(i, format_args!("unknown column; {hint}")))
            }
            None => Ok(()),
        }
    }

    /// Refuses columns that were not asked for, and names the nearest of those that were, or else all.
    pub(crate) fn only_known(&self) -> Result<()> {
        self.only_asked(|column| hint(column, &self.known, self.known.join(", ")))
    }

    /// Three deviations of the current row.
    pub(crate) fn deviations(&self, [x, y, z]: [Column; 3]) -> Result<Vec3> {
        Ok(Vec3::new(self.deviation(x)?, self.deviation(y)?, self.deviation(z)?))
    }

    /// A number of the current row, mm or rad.
    pub(crate) fn value(&self, column: Column) -> Result<f64> {
        self.number(column).map(column.to_inner)
    }

    /// A deviation or angular error of the current row, mm or rad; one larger than any machine's is refused.
    pub(crate) fn deviation(&self, column: Column) -> Result<f64> {
        let is_angle = self.columns()[column.index].ends_with("_arcsec");
        self.within(column, |v| beyond_machines(v, is_angle))
    }

    /// A number of the current row, mm or rad; one with which something is wrong, in the unit of the column, is refused.
    pub(crate) fn within(&self, column: Column, wrong: impl Fn(f64) -> Option<String>) -> Result<f64> {
        match wrong(self.number(column)?) {
            Some(what) => Err(self.fail(column, what)),
            None => self.value(column),
        }
    }

    /// A number of the current row, or that of a table without the column.
    pub(crate) fn value_or(&self, column: Option<Column>, default: f64) -> Result<f64> {
        column.map_or(Ok(default), |c| self.value(c))
    }

    /// Three numbers of the current row.
    pub(crate) fn point(&self, [x, y, z]: [Column; 3]) -> Result<Vec3> {
        Ok(Vec3::new(self.value(x)?, self.value(y)?, self.value(z)?))
    }

    /// A whole number from 0 up; 0 without the column.
    pub(crate) fn count_of(&self, column: Option<Column>) -> Result<u32> {
        column.map_or(Ok(0), |c| self.count(c.index))
    }

    /// A direction; forward without the column.
    pub(crate) fn travel_of(&self, column: Option<Column>) -> Result<Travel> {
        column.map_or(Ok(Travel::Forward), |c| self.travel(c.index))
    }

    /// Where and when the current row was read; its value is left at 0.
    pub(crate) fn reading(&self, run: &RunColumns) -> Result<Reading> {
        Ok(Reading {
            cycle: self.count_of(run.cycle)?,
            travel: self.travel_of(run.direction)?,
            position: self.value(run.position)?,
            value: 0.0,
        })
    }

    /// Bad data in the file.
    pub(crate) fn file_error(&self, what: impl core::fmt::Display) -> Failure {
        Failure::data(self.file(), what)
    }
}

/// Positions closer than this (mm) are the same stop.
const SAME_POSITION: f64 = 1e-6;

/// What was read at the stops of an axis, found again by where and when it was, in any order and from several files.
pub(crate) struct Stops<T> {
    pub(crate) all: Vec<(Reading, Vec<T>)>,
    places: HashMap<(i64, u32, bool), usize>,
}

impl<T> Default for Stops<T> {
    fn default() -> Self {
        Self { all: Vec::new(), places: HashMap::new() }
    }
}

impl<T> Stops<T> {
    /// What was read at this stop, which is made where it is missing.
    pub(crate) fn at(&mut self, at: Reading) -> &mut Vec<T> {
        let cell = (at.position / SAME_POSITION).round() as i64;
        let key = |cell| (cell, at.cycle, at.travel == Travel::Forward);
        // a position near the edge of its cell may have met its like in the next one
        let same = |i: &usize| (self.all[*i].0.position - at.position).abs() < SAME_POSITION;
        let near = [cell, cell.saturating_sub(1), cell.saturating_add(1)];
        let known = near.into_iter().filter_map(|c| self.places.get(&key(c)).copied()).find(same);
        let index = known.unwrap_or_else(|| {
            self.all.push((at, Vec::new()));
            self.places.insert(key(cell), self.all.len() - 1);
            self.all.len() - 1
        });
        &mut self.all[index].1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_meet_again_in_any_order() {
        let mut stops = Stops::default();
        let mut at = |position, cycle, travel| {
            let seen = stops.at(Reading { position, cycle, travel, value: 0.0 });
            seen.push(position);
            let first = seen[0];
            stops
                .all
                .iter()
                .position(|(r, _)| r.position == first && (r.cycle, r.travel) == (cycle, travel))
                .unwrap()
        };
        assert_eq!(at(10.0, 1, Travel::Forward), 0);
        assert_eq!((at(10.0, 2, Travel::Forward), at(10.0, 1, Travel::Reverse)), (1, 2));
        assert_eq!(at(10.000_000_9, 1, Travel::Forward), 0);
        assert_eq!((at(10.000_002, 1, Travel::Forward), at(-10.0, 1, Travel::Forward)), (3, 4));
        assert_eq!(at(10.0 - 0.9e-6, 2, Travel::Forward), 1);
    }
}
