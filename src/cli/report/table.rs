//! A table that a terminal and a page show alike: the same heads and rows, columns as wide as what stands in them.

use std::fmt::Display;

use super::page::Page;
use crate::acceptance::NOT_STATED;
use crate::prelude::*;

/// Blanks between two columns.
const GAP: usize = 2;

/// A table under construction.
#[derive(Debug, Clone)]
pub struct Table {
    heads: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// The heads of its columns, of which the first names the rows. A head that begins with `>` stands over numbers, which go to
    /// the right; where all are empty there is no line of heads.
    pub fn new<H: Display>(heads: impl IntoIterator<Item = H>) -> Self {
        Self { heads: heads.into_iter().map(|h| h.to_string()).collect(), rows: Vec::new() }
    }

    /// Adds a row.
    pub fn row<C: Display>(&mut self, cells: impl IntoIterator<Item = C>) {
        self.rows.push(cells.into_iter().map(|c| c.to_string()).collect());
    }

    /// Adds rows.
    #[must_use]
    pub fn rows<R: IntoIterator<Item: Display>>(mut self, rows: impl IntoIterator<Item = R>) -> Self {
        rows.into_iter().for_each(|row| self.row(row));
        self
    }

    fn is_number(&self, column: usize) -> bool {
        self.heads.get(column).is_some_and(|h| h.starts_with('>'))
    }

    fn head(&self, column: usize) -> &str {
        self.heads[column].trim_start_matches('>')
    }

    /// True where it has no row.
    pub(crate) const fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The words of its rows.
    pub(crate) fn cells(&self) -> &[Vec<String>] {
        &self.rows
    }

    /// The columns in which a cell stands that does not count as silent, and whether any of them has a head.
    fn shown(&self, is_silent: impl Fn(&str) -> bool) -> (Vec<usize>, bool) {
        let speaks = |k: &usize| self.rows.iter().any(|r| r.get(*k).is_some_and(|c| !is_silent(c)));
        let columns: Vec<usize> = (0..self.heads.len()).filter(speaks).collect();
        let has_heads = columns.iter().any(|k| !self.head(*k).is_empty());
        (columns, has_heads)
    }

    /// Lines for a terminal, without columns in which nothing is stated.
    pub(crate) fn lines(&self) -> Vec<String> {
        let (columns, has_heads) = self.shown(|cell| ["", "-", NOT_STATED].contains(&cell));
        let heads: Vec<String> = (0..self.heads.len()).map(|k| self.head(k).to_owned()).collect();
        let rows = has_heads.then_some(&heads).into_iter().chain(&self.rows);
        let all: Vec<Vec<String>> = rows.map(|row| row.iter().map(|cell| micro(cell)).collect()).collect();
        let width = |k: usize| all.iter().map(|r| r[k].chars().count()).max().unwrap_or(0);
        let widths: Vec<(usize, usize)> = columns.into_iter().map(|k| (k, width(k))).collect();
        let line = |row: &Vec<String>| {
            let cells = widths.iter().map(|(k, width)| match self.is_number(*k) {
                true => format!("{:>width$}", row[*k]),
                false => format!("{:<width$}", row[*k]),
            });
            cells.joined(&" ".repeat(GAP)).trim_end().to_owned()
        };
        all.iter().map(line).collect()
    }

    /// Prints it.
    pub(crate) fn print(&self) {
        self.lines().iter().for_each(|line| say!("{line}"));
    }

    /// Puts it on a page; what is not stated is pale. A table without rows takes no room.
    pub(crate) fn put(&self, page: &mut Page) {
        if self.is_empty() {
            return;
        }
        let (columns, has_heads) = self.shown(str::is_empty);
        let heads: Vec<Cell> = columns.iter().map(|k| self.head_cell(*k)).collect();
        page.table(if has_heads { &heads } else { &[] }, &self.page_rows(&columns));
    }

    /// Puts it on a page, where its rows become blocks if the page is narrow.
    pub fn put_stacked(&self, page: &mut Page) {
        let (columns, _) = self.shown(str::is_empty);
        let heads: Vec<String> = columns.iter().map(|k| micro(self.head(*k))).collect();
        page.stacked_table(&heads.iter().map(String::as_str).collect::<Vec<_>>(), &self.page_rows(&columns));
    }

    fn head_cell(&self, column: usize) -> Cell {
        let words = micro(self.head(column));
        if self.is_number(column) { Cell::number(words) } else { Cell::head(words) }
    }

    fn page_rows(&self, columns: &[usize]) -> Vec<Vec<Cell>> {
        let cell = |k: usize, words: &str| {
            let is_number = self.is_number(k);
            let cell = match (k, is_number) {
                (_, true) => Cell::number(micro(words)),
                (0, false) => Cell::head(micro(words)),
                _ => Cell::text(micro(words)),
            };
            if words == NOT_STATED || words == "-" && !is_number { cell.faint() } else { cell }
        };
        self.rows.iter().map(|row| columns.iter().map(|k| cell(*k, &row[*k])).collect()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_what_stands_in_them() {
        let mut table = Table::new(["", ">before / um", "where"]);
        table.row(["a long name", "1.25", "here"]);
        table.row(["b", "-", ""]);
        let lines = table.lines();
        assert_eq!(
            lines,
            ["             before / µm  where", "a long name         1.25  here", "b                      -"]
        );
        let mut page = Page::new("t");
        table.put(&mut page);
        let text = page.finish();
        assert!(
            text.contains("<th class=\"n\">before / µm</th>") && text.contains("<td class=\"n\">1.25</td>"),
            "{text}"
        );
        assert_eq!(Table::new(["", ">"]).rows([["a", "1"]]).lines(), ["a  1"]);
    }
}
