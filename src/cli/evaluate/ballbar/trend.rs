//! Circular errors and causes over several ballbar tests, and what changed by more than its uncertainty.

use super::Test;
use super::report::named;
use crate::identify::ballbar::report::{COVERAGE, decimals_of, unit_of, with_limits};
use crate::prelude::*;
use volcomp_identify::ballbar::{Effect, Feature};

/// One quantity over the tests.
pub(super) struct Course {
    /// In words, with its unit.
    pub(super) name: String,
    /// Value and standard uncertainty (none for circular errors), by test.
    pub(super) values: Vec<Option<(f64, Option<f64>)>>,
}

/// The quantities over the tests.
pub(super) struct Trend {
    /// Days, or names of files.
    pub(super) labels: Vec<String>,
    /// Abscissa: days since the first test, or numbers of the tests.
    pub(super) at: Vec<f64>,
    /// What the abscissa counts.
    pub(super) axis: String,
    pub(super) courses: Vec<Course>,
}

impl Trend {
    /// The trend of tests in their order.
    pub(super) fn of(tests: &[Test]) -> Self {
        let first = tests.first().and_then(|t| t.day);
        let axis = match (first, tests.first()) {
            (Some(_), Some(test)) => format!("days since {}", test.label),
            _ => "test".to_owned(),
        };
        let place =
            |k: usize, t: &Test| t.day.zip(first).map_or((k + 1) as f64, |(day, first)| (day - first) as f64);
        let at = tests.iter().enumerate().map(|(k, t)| place(k, t)).collect();
        let mut courses = vec![Course {
            name: "circular error G(b), µm".to_owned(),
            values: tests.iter().map(|t| t.slowest().result.g_both.map(|g| (um_from_mm(g), None))).collect(),
        }];
        // every effect that is significant in a test, in the order of the newest
        let all = tests.iter().rev().flat_map(|t| &t.plan.analysis.estimates);
        let effects = once(all.filter(|e| e.significant), |a, b| a.effect == b.effect);
        courses.extend(effects.into_iter().flat_map(|e| courses_of(tests, e.effect)));
        // one direction alone has no G(b)
        courses.retain(|c| c.values.iter().any(Option::is_some));
        Self { labels: tests.iter().map(|t| t.label.clone()).collect(), at, axis, courses }
    }

    /// The trend as JSON.
    pub(super) fn json(&self) -> Value {
        let course = |c: &Course| {
            json!({
                "quantity": c.name,
                "values": c.values.iter().map(|v| v.map(|(v, _)| v)).collect::<Vec<_>>(),
                "std": c.values.iter().map(|v| v.and_then(|(_, s)| s)).collect::<Vec<_>>(),
                "change": c.change().map(|(v, _)| v),
                "change_u95": c.change().and_then(|(_, u)| u),
                "significant": c.significant(),
            })
        };
        json!({ "tests": self.labels, "quantities": self.courses.iter().map(course).collect::<Value>() })
    }
}

/// Items that are not the same as one before them.
fn once<T>(items: impl Iterator<Item = T>, same: impl Fn(&T, &T) -> bool) -> Vec<T> {
    items.fold(Vec::new(), |mut known, item| {
        if !known.iter().any(|k| same(k, &item)) {
            known.push(item);
        }
        known
    })
}

/// The values of an effect over the tests, one course for each end of travel.
fn courses_of(tests: &[Test], effect: Effect) -> Vec<Course> {
    let of = |t: &Test| -> Vec<Feature> {
        t.plan.analysis.estimate(effect).map(|e| t.plan.analysis.features(e)).unwrap_or_default()
    };
    let all: Vec<Vec<Feature>> = tests.iter().map(of).collect();
    let names = once(all.iter().rev().flatten(), |a, b| a.name == b.name);
    let plane = tests.first().map(|t| t.plan.circles.plane);
    let course = |n: &&Feature| {
        let end = n.end().map_or_else(String::new, |end| format!(" ({end})"));
        let name = plane.map_or_else(|| n.name.clone(), |p| named(effect, p).0);
        let find = |fs: &Vec<Feature>| fs.iter().find(|f| f.name == n.name).map(|f| (f.value, Some(f.std)));
        Course { name: format!("{name}{end}, {}", unit_of(n)), values: all.iter().map(find).collect() }
    };
    names.iter().map(course).collect()
}

impl Course {
    /// Last value minus first one with its expanded uncertainty (k = 2).
    pub(super) fn change(&self) -> Option<(f64, Option<f64>)> {
        let ((first, u), (last, v)) = (self.values.first().copied()??, self.values.last().copied()??);
        Some((last - first, u.zip(v).map(|(u, v)| COVERAGE * u.hypot(v))))
    }

    /// Whether the change exceeds its expanded uncertainty; `None` where that is not known.
    pub(super) fn significant(&self) -> Option<bool> {
        let (change, u) = self.change()?;
        Some(change.abs() > u?)
    }

    /// Decimals of its values: two significant figures of the largest uncertainty.
    pub(super) fn decimals(&self) -> usize {
        let stds = self.values.iter().flatten().filter_map(|(_, s)| *s);
        stds.reduce(f64::max).map_or(2, |s| decimals_of(COVERAGE * s))
    }

    /// The change in words.
    pub(super) fn change_words(&self) -> String {
        match self.change() {
            None => "-".to_owned(),
            Some((v, None)) => plain(v, 2),
            Some((v, Some(u))) => with_limits(v, u / COVERAGE),
        }
    }

    /// Whether it changed, in words.
    pub(super) fn verdict(&self) -> &'static str {
        match self.significant() {
            Some(true) => "changed",
            Some(false) => "within U",
            None => "U not stated",
        }
    }
}

impl Trend {
    /// The courses: value of each test, change and verdict.
    pub(super) fn table(&self) -> Table {
        let heads = self.labels.iter().map(|label| format!(">{label}"));
        let heads =
            [String::new()].into_iter().chain(heads).chain([">change, U (k = 2)".into(), String::new()]);
        let rows = self.courses.iter().map(|c| {
            let value =
                |v: &Option<(f64, _)>| v.map_or_else(|| "-".to_owned(), |(v, _)| plain(v, c.decimals()));
            let change = [c.change_words(), c.verdict().to_owned()];
            [c.name.clone()].into_iter().chain(c.values.iter().map(value)).chain(change).collect::<Vec<_>>()
        });
        Table::new(heads).rows(rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_counts_beyond_its_expanded_uncertainty() {
        let course = |last: f64| Course {
            name: String::new(),
            values: vec![Some((1.0, Some(0.3))), None, Some((last, Some(0.4)))],
        };
        assert_eq!(course(1.9).significant(), Some(false));
        assert_eq!(course(2.1).significant(), Some(true));
        assert_eq!(course(2.1).change_words(), "1.1 ± 1.0");
        let unknown = Course { name: String::new(), values: vec![Some((1.0, None)), Some((9.0, None))] };
        assert_eq!((unknown.significant(), unknown.verdict()), (None, "U not stated"));
    }
}
