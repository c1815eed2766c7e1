//! `evaluate ballbar`: the report of a ballbar test with its causes by rank, and the trend over several tests.

mod report;
mod trend;

use super::circular::{assessed, keys};
use super::{Output, page};
use crate::evaluate::picture::circular::{self as drawing, Shown};
use crate::identify::ballbar::report::{Circle, as_json, circles, print};
use crate::identify::ballbar::{Plan, SetUp};
use crate::prelude::*;
use volcomp_evaluate::CircularUncertainties;
use volcomp_formats::columns::day;
use volcomp_identify::ballbar::Plane;

/// Ballbar report: polar plot of both directions, causes by rank with values, uncertainty and remedy, trend over several tests
///
/// Circular errors are those of ISO 230-4; causes are fitted all at once to all readings of a test (docs/how-to/identify/ballbar.md).
/// Several tests of one plane give a trend; the newest of them is reported in full.
///
/// Example: volcomp evaluate ballbar --data 2026-01-12=january.csv --data 2026-03-12=march.csv --radius-mm 150 --html xy.html
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// CSV with angle_deg,deviation_um,direction and optional feed_mm_per_min, run, as for volcomp identify ballbar; may be
    /// repeated for a trend, then all with their day, such as 2026-03-12=xy.csv, or in the order of the tests.
    #[arg(long, value_name = "[DAY=]CSV", required_unless_present = "file", value_parser = dated)]
    data: Vec<(Option<Day>, PathBuf)>,
    /// Plane of the circles: xy, yz or zx.
    #[arg(long, value_name = "PLANE", default_value = "xy", value_parser = plane)]
    plane: Plane,
    #[command(flatten)]
    setup: SetUp,
    #[command(flatten)]
    output: Output,
}

fn plane(text: &str) -> Result<Plane, String> {
    Plane::parse(text).ok_or_else(|| format!("invalid plane '{text}'; expected one of xy, yz, zx"))
}

/// A day as written, and its number since 1970.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Day {
    text: String,
    number: i64,
}

fn dated(text: &str) -> Result<(Option<Day>, PathBuf), String> {
    let Some((before, file)) = text.split_once('=') else { return Ok((None, PathBuf::from(text))) };
    match day(before) {
        Some(number) if !file.is_empty() => {
            Ok((Some(Day { text: before.to_owned(), number }), PathBuf::from(file)))
        }
        // a file whose name has the sign
        _ if !before.starts_with(|c: char| c.is_ascii_digit()) => Ok((None, PathBuf::from(text))),
        _ => Err(format!("invalid day and file '{text}'; write for example 2026-03-12=xy.csv")),
    }
}

/// A test of the trend.
struct Test {
    /// Day, or name of the file.
    label: String,
    /// Day since 1970, where stated.
    day: Option<i64>,
    plan: Plan,
    /// Circular errors of each feed (mm/min), slowest first.
    circles: Vec<Circle>,
}

impl Test {
    fn read(args: &Args, (day, path): &(Option<Day>, PathBuf)) -> Result<Self> {
        let plan = Plan::read(&args.setup, args.plane, path, None)?;
        let label = day.as_ref().map_or_else(|| file_name(path), |d| d.text.clone());
        let circles = circles(&plan).map_err(|e| data!(path, "{e}"))?;
        Ok(Self { label, day: day.as_ref().map(|d| d.number), plan, circles })
    }

    /// The circle of the slowest feed.
    fn slowest(&self) -> &Circle {
        &self.circles[0]
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut acceptance = Acceptance::load(&args.output.head, "iso230-4", &keys())?;
    let single = args.output.file.iter().map(|path| (None, path.clone()));
    let data: Vec<_> = args.data.iter().cloned().chain(single).collect();
    let dated = data.iter().filter(|(day, _)| day.is_some()).count();
    if dated > 0 && dated < data.len() {
        return Err(usage!(
            "some tests have a day and some have none; give it for all, such as 2026-03-12=xy.csv"
        ));
    }
    args.setup.check(&[args.plane])?;
    let mut tests = data.iter().map(|of| Test::read(args, of)).collect::<Result<Vec<_>, _>>()?;
    tests.sort_by_key(|t| t.day);
    let Some(newest) = tests.last() else { return Ok(()) };
    let circle = newest.slowest();
    acceptance.fill(Stated {
        feed_mm_per_min: circle.feed,
        date: newest.day.map(|_| newest.label.clone()),
        ..Stated::default()
    });
    let judged = Judged {
        figures: assessed(&acceptance, &circle.result, CircularUncertainties::default()),
        acceptance,
    };
    let title = args.output.title("Ballbar test");
    args.output.deliver(
        &judged,
        || {
            let shown = shown(newest, circle);
            drawing::whole(title, &[("", shown)], drawing::scale([&shown]))
        },
        || report::page(title, &judged, &tests, args.setup.centre_mm.is_some()),
        || (json_of(&tests), None),
        || {
            print(&newest.plan);
            for (i, circle) in newest.circles.iter().enumerate() {
                let others = (i > 0).then(|| unjudged(circle));
                say!("circular errors{}", circle.at_feed());
                page::figures("um", others.as_deref().unwrap_or(&judged.figures), None).print();
            }
            if tests.len() > 1 {
                let trend = trend::Trend::of(&tests);
                say!("trend over {}", trend.labels.join(", "));
                trend.table().print();
            }
        },
    )
}

/// The figures of a circle that is held against no tolerance.
fn unjudged(circle: &Circle) -> Vec<Assessed> {
    assessed(&Acceptance::default(), &circle.result, CircularUncertainties::default())
}

/// The polar plot of a circle.
fn shown<'a>(test: &'a Test, circle: &'a Circle) -> Shown<'a> {
    Shown {
        result: &circle.result,
        readings: &circle.readings,
        plane: test.plan.circles.plane.axes().map(|a| a.lower().to_ascii_uppercase()),
        radius_mm: Some(test.plan.circles.radius),
    }
}

fn json_of(tests: &[Test]) -> Map<String, Value> {
    let each = tests.iter().map(|t| {
        let mut one = as_json(&t.plan, None);
        one["test"] = json!(t.label);
        one
    });
    let mut out = Map::from_iter([("tests".to_owned(), each.collect())]);
    if tests.len() > 1 {
        out.insert("trend".to_owned(), trend::Trend::of(tests).json());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_day_may_stand_before_the_file() {
        let (day, file) = dated("1970-02-01=a=b.csv").unwrap();
        assert_eq!((day.unwrap().number, file), (31, PathBuf::from("a=b.csv")));
        assert_eq!(dated("x=b.csv").unwrap(), (None, PathBuf::from("x=b.csv")));
        assert!(dated("2026-13-01=b.csv").is_err() && dated("2026-03-12=").is_err());
    }
}
