//! Two runs of error motions of an axis: straightnesses about their end-point lines, positioning and angular errors about zero.

use crate::evaluate::Compared;
use crate::prelude::*;
use crate::report_page::{Plot, Style};
use volcomp_evaluate::Placed;
use volcomp_evaluate::reduction::about_end_points;
use volcomp_formats::axis_table::positioning_symbol;
use volcomp_model::ErrorSymbol;

/// Name of a comparison of angular errors.
pub(super) const ANGULAR: &str = "angular";

/// What a column holds: errors of different quantities have no range in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Straightness,
    Positioning,
    Angle,
}

/// One error motion over its positions: column, and position, direction, value of each reading.
struct Motion {
    column: String,
    quantity: Quantity,
    rows: Vec<(f64, Travel, f64)>,
}

impl Quantity {
    /// Of a column such as `exx_um` or `eax_arcsec`; `None` of a column with something else.
    fn of(column: &str) -> Option<Self> {
        if !column.starts_with('e') {
            return None;
        }
        if column.ends_with("_arcsec") {
            return Some(Self::Angle);
        }
        let symbol = ErrorSymbol::parse(column.strip_suffix("_um")?);
        let is_positioning = symbol.is_some_and(|s| s == positioning_symbol(s.axis()));
        Some(if is_positioning { Self::Positioning } else { Self::Straightness })
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Straightness => "straightness",
            Self::Positioning => "positioning",
            Self::Angle => "angular errors",
        }
    }
}

/// Two runs of error motions of one quantity, with a plot of each; `columns` names them where it is not empty.
pub(super) fn compare(files: [&Path; 2], columns: &[String]) -> Result<(Compared, Vec<Plot>)> {
    let [before, after] = [read(files[0], columns)?, read(files[1], columns)?];
    let names = |m: &[Motion]| m.iter().map(|m| m.column.clone()).collect::<Vec<_>>();
    let [old, new] = [names(&before), names(&after)];
    if old != new {
        return Err(data!(files[1], "columns are {}, those before are {}", new.join(", "), old.join(", ")));
    }
    // a file without any was refused
    let quantity = before[0].quantity;
    if let Some(other) = before.iter().find(|m| m.quantity != quantity) {
        return Err(data!(
            files[0],
            "{} ({}) and {} ({}) have no range in common; name the columns of one of them: --columns {}",
            before[0].column,
            quantity.name(),
            other.column,
            other.quantity.name(),
            before.iter().filter(|m| m.quantity == quantity).map(|m| &m.column).joined(",")
        ));
    }
    let placed = |motions: &[Motion]| -> Vec<Placed> {
        let of = |(k, m): (usize, &Motion)| {
            let one = |(q, t, v): &(f64, Travel, f64)| Placed::at_target(k as u32, *q, *t, *v);
            m.rows.iter().map(one).collect::<Vec<_>>()
        };
        motions.iter().enumerate().flat_map(of).collect()
    };
    let unit = if quantity == Quantity::Angle { "arcsec" } else { "µm" };
    let chart = |(b, a): (&Motion, &Motion)| {
        let points = |m: &Motion| m.rows.iter().map(|(q, _, v)| (*q, *v)).collect();
        let name = b.column.split('_').next().unwrap_or_default().to_uppercase();
        let plot = Plot::new(name, "position, mm", format!("deviation, {unit}"));
        plot.with(Style::Dots, "before", points(b)).with(Style::Dots, "after", points(a))
    };
    let charts = before.iter().zip(&after).map(chart).collect();
    let about_zero = ["", ", about zero"];
    let (test, standard, about) = match quantity {
        Quantity::Straightness => (
            "straightness",
            "Error motions of an axis about their end-point lines, ISO 230-1:2012",
            [", about the end-point line"; 2],
        ),
        Quantity::Positioning => ("positioning", "Positioning error of an axis, ISO 230-1:2012", about_zero),
        Quantity::Angle => (ANGULAR, "Angular error motions of an axis, ISO 230-1:2012", about_zero),
    };
    let compared = Compared {
        test,
        standard,
        unit,
        about,
        is_repeated: true,
        readings: [placed(&before), placed(&after)],
        ..Compared::default()
    };
    Ok((compared, charts))
}

fn read(path: &Path, wanted: &[String]) -> Result<Vec<Motion>> {
    let mut table = table::open(path)?;
    let (position, direction) = (table.require("position_mm")?, table.find("direction"));
    for column in wanted {
        table.require(column)?;
    }
    let is_wanted = |column: &str| wanted.is_empty() || wanted.iter().any(|w| w == column);
    let all = table.columns().iter().enumerate().filter(|(_, c)| is_wanted(c));
    let (columns, mut motions): (Vec<usize>, Vec<Motion>) = all
        .filter_map(|(i, name)| {
            let quantity = Quantity::of(name)?;
            Some((i, Motion { column: name.clone(), quantity, rows: Vec::new() }))
        })
        .unzip();
    if columns.is_empty() {
        return Err(data!(
            path,
            "no column with error motions such as eyx_um; --help names the kinds of files"
        ));
    }
    while table.advance()? {
        let q = table.number(position)?;
        let travel = direction.map_or(Ok(Travel::Forward), |c| table.travel(c))?;
        for (motion, column) in motions.iter_mut().zip(&columns) {
            motion.rows.push((q, travel, table.number(*column)?));
        }
    }
    for motion in motions.iter_mut().filter(|m| m.quantity == Quantity::Straightness) {
        about_end_points(&mut motion.rows);
    }
    Ok(motions)
}
