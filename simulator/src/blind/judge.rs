//! What the tool said, beside what is true.

use serde::{Deserialize, Serialize};

use super::cases::{Case, Kind};

/// A cause of report.json, as far as it is judged.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Cause {
    effect: String,
    subject: String,
    probability: f64,
    declared: bool,
    confounded_with: Vec<String>,
    #[serde(default)]
    re_expression_of: Vec<String>,
    tests: Option<serde_json::Value>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Unexplained {
    significant: bool,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Shrink {
    fraction: f64,
    ci90: [f64; 2],
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Fresh {
    fraction: f64,
}

/// report.json, as far as it is judged.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Report {
    verdict: String,
    causes: Vec<Cause>,
    unexplained: Unexplained,
    shrink: Shrink,
    fresh: Option<Fresh>,
}

/// A cause that the tool named.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Said {
    /// `effect:subject`.
    pub label: String,
    /// Its probability.
    pub probability: f64,
    /// The tool stands by it.
    pub declared: bool,
    /// It is true.
    pub right: bool,
    /// It is true of what the tool says it cannot tell apart.
    pub in_group: bool,
    /// What it said it cannot tell apart, and sums that say the same.
    pub group: Vec<String>,
    /// Figures of the tests, for training.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tests: Option<serde_json::Value>,
}

/// A case, judged.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// Its number.
    pub number: usize,
    /// What it asked.
    pub kind: Kind,
    /// The truth.
    pub labels: Vec<String>,
    /// Levels of the effects.
    pub levels: Vec<f64>,
    /// The plan can see them.
    pub visible: bool,
    /// The answer in one word.
    pub verdict: String,
    /// Everything that was named, most probable first.
    pub said: Vec<Said>,
    /// The tool says that something is not explained.
    pub unexplained: bool,
    /// Forecast of the shrink, its interval, and what another day showed.
    pub shrink: Option<[f64; 4]>,
    /// Why the tool refused the files, where it did: then nothing was said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// Judges a report.
#[must_use]
pub fn judge(case: &Case, report: &Report) -> Judged {
    let said: Vec<Said> = report
        .causes
        .iter()
        .map(|c| {
            let label =
                if c.subject.is_empty() { c.effect.clone() } else { format!("{}:{}", c.effect, c.subject) };
            let right = case.labels.contains(&label);
            let group: Vec<String> = c.confounded_with.iter().chain(&c.re_expression_of).cloned().collect();
            let in_group = right || case.labels.iter().any(|l| group.contains(l));
            Said {
                label,
                probability: c.probability,
                declared: c.declared,
                right,
                in_group,
                group,
                tests: c.tests.clone(),
            }
        })
        .collect();
    let claims = said.iter().any(|s| s.declared);
    let shrink = report
        .fresh
        .as_ref()
        .filter(|_| claims)
        .map(|f| [report.shrink.fraction, report.shrink.ci90[0], report.shrink.ci90[1], f.fraction]);
    Judged {
        number: case.number,
        kind: case.kind,
        labels: case.labels.clone(),
        levels: case.levels.clone(),
        visible: case.visible,
        verdict: report.verdict.clone(),
        said,
        unexplained: report.unexplained.significant || report.verdict == "unexplained",
        shrink,
        refused: None,
    }
}

/// A claim counts as confident from this probability of its own.
pub const CONFIDENT: f64 = 0.5;

impl Judged {
    /// A case whose files the tool refused, and why: nothing was said.
    #[must_use]
    pub fn refused(case: &Case, why: String) -> Self {
        Self {
            number: case.number,
            kind: case.kind,
            labels: case.labels.clone(),
            levels: case.levels.clone(),
            visible: case.visible,
            verdict: "refused".to_owned(),
            said: Vec::new(),
            unexplained: false,
            shrink: None,
            refused: Some(why),
        }
    }

    /// The causes that the tool stands by.
    pub fn declared(&self) -> impl Iterator<Item = &Said> {
        self.said.iter().filter(|s| s.declared)
    }

    /// Declared causes outside the truth, its group and exact re-expressions.
    pub fn false_attributions(&self) -> impl Iterator<Item = &Said> {
        self.declared().filter(|s| !s.in_group)
    }

    /// The most probable cause is true.
    #[must_use]
    pub fn top_right(&self) -> bool {
        self.said.first().is_some_and(|s| s.right && s.declared)
    }

    /// The most probable cause is true, or says that it cannot be told from the truth.
    #[must_use]
    pub fn top_in_group(&self) -> bool {
        self.said.first().is_some_and(|s| s.in_group && s.declared)
    }

    /// All of the truth is declared, and nothing else.
    #[must_use]
    pub fn exact(&self) -> bool {
        let right = self.declared().filter(|s| s.right).count();
        right == self.labels.len() && self.declared().count() == right
    }

    /// The same up to groups.
    #[must_use]
    pub fn exact_in_group(&self) -> bool {
        let found = |l: &String| self.declared().any(|s| s.label == *l || s.group.contains(l));
        self.labels.iter().all(found) && self.false_attributions().count() == 0
    }
}
