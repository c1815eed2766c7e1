//! Columns of instrument tables by name; their numbers become mm and rad by the unit at the end of the name.

use std::io::BufRead;
use std::path::Path;

use crate::positioning_data::no_rows;
use crate::table::{self, Table, nearest};
use crate::{Failure, Result};
use volcomp_identify::Reading;
use volcomp_model::geometry::Vec3;
use volcomp_units::axes::Travel;
use volcomp_units::{mm_from_um, rad_from_arcsec, rad_from_deg};

/// A column and what brings its numbers into mm or rad.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column {
    pub(crate) index: usize,
    to_inner: fn(f64) -> f64,
}

/// Columns of a run along one axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RunColumns {
    position: Column,
    cycle: Option<Column>,
    direction: Option<Column>,
}

/// A table that knows which of its columns were asked for.
pub(crate) struct Columns {
    pub(crate) table: Table<Box<dyn BufRead>>,
    known: Vec<String>,
}

/// The name that is most like this one, or else `columns`.
pub(crate) fn hint(name: &str, names: &[String], columns: impl core::fmt::Display) -> String {
    match nearest(name, names.iter().map(String::as_str)) {
        Some(near) => format!("is {near} meant?"),
        None => format!("columns are {columns}"),
    }
}

/// Opens a table.
pub(crate) fn open(path: &Path) -> Result<Columns> {
    table::open(path).map(Columns::new)
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
    pub(crate) const fn new(table: Table<Box<dyn BufRead>>) -> Self {
        Self { table, known: Vec::new() }
    }

    /// The column of a name, where the table has it.
    pub(crate) fn find(&mut self, name: &str) -> Option<Column> {
        self.known.push(name.to_owned());
        self.table.find(name).map(|index| Column::new(name, index))
    }

    /// The column of a name.
    pub(crate) fn require(&mut self, name: &str) -> Result<Column> {
        self.known.push(name.to_owned());
        self.table.require(name).map(|index| Column::new(name, index))
    }

    /// Three columns, such as those of a point.
    pub(crate) fn three(&mut self, names: [&str; 3]) -> Result<[Column; 3]> {
        Ok([self.require(names[0])?, self.require(names[1])?, self.require(names[2])?])
    }

    /// The position, optional `cycle` and `direction`.
    pub(crate) fn run(&mut self, position: &str) -> Result<RunColumns> {
        let position = self.require(position)?;
        Ok(RunColumns { position, cycle: self.find("cycle"), direction: self.find("direction") })
    }

    /// The columns that were asked for.
    pub(crate) fn known(&self) -> &[String] {
        &self.known
    }

    /// Refuses columns that were not asked for; `hint` says which were, from the name of the first.
    pub(crate) fn only(&self, hint: impl FnOnce(&str) -> String) -> Result<()> {
        match self.table.columns().iter().position(|c| !self.known.contains(c)) {
            Some(i) => {
                let hint = hint(&self.table.columns()[i]);
                Err(self.table.fail(i, format_args!("unknown column; {hint}")))
            }
            None => Ok(()),
        }
    }

    /// A number of the current row as written.
    pub(crate) fn number(&self, column: Column) -> Result<f64> {
        self.table.number(column.index)
    }

    /// A number of the current row, mm or rad.
    pub(crate) fn value(&self, column: Column) -> Result<f64> {
        self.table.number(column.index).map(column.to_inner)
    }

    /// A number of the current row, or that of a table without the column.
    pub(crate) fn value_or(&self, column: Option<Column>, default: f64) -> Result<f64> {
        column.map_or(Ok(default), |c| self.value(c))
    }

    /// Three numbers of the current row.
    pub(crate) fn point(&self, [x, y, z]: [Column; 3]) -> Result<Vec3> {
        Ok(Vec3::new(self.value(x)?, self.value(y)?, self.value(z)?))
    }

    /// A word of the current row.
    pub(crate) fn word(&self, column: Column) -> String {
        self.table.word(column.index)
    }

    /// A whole number from 0 up; 0 without the column.
    pub(crate) fn count(&self, column: Option<Column>) -> Result<u32> {
        column.map_or(Ok(0), |c| self.table.count(c.index))
    }

    /// A direction; forward without the column.
    pub(crate) fn travel(&self, column: Option<Column>) -> Result<Travel> {
        column.map_or(Ok(Travel::Forward), |c| self.table.travel(c.index))
    }

    /// Where and when the current row was read; its value is left at 0.
    pub(crate) fn reading(&self, run: &RunColumns) -> Result<Reading> {
        Ok(Reading {
            cycle: self.count(run.cycle)?,
            travel: self.travel(run.direction)?,
            position: self.value(run.position)?,
            value: 0.0,
        })
    }

    /// A message about a field of the current row.
    pub(crate) fn fail(&self, column: Column, what: impl core::fmt::Display) -> Failure {
        self.table.fail(column.index, what)
    }

    /// Bad data in the file.
    pub(crate) fn file_error(&self, what: impl core::fmt::Display) -> Failure {
        Failure::data(Path::new(self.table.file()), what)
    }

    /// What `read` makes of every row.
    pub(crate) fn rows<T>(&mut self, mut read: impl FnMut(&Self) -> Result<T>) -> Result<Vec<T>> {
        let mut rows = Vec::new();
        while self.table.advance()? {
            rows.push(read(self)?);
        }
        Ok(rows)
    }

    /// The same, and there must be one.
    pub(crate) fn some_rows<T>(&mut self, read: impl FnMut(&Self) -> Result<T>) -> Result<Vec<T>> {
        let rows = self.rows(read)?;
        if rows.is_empty() { Err(no_rows(self.table.file())) } else { Ok(rows) }
    }
}
