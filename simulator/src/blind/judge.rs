//! What the tool said, beside what is true.
//!
//! The words, as in `docs/development/blind-tests.md`: a cause is *declared* where report.json says so (`declared`) and nowhere else. It is
//! *right* where its label is true, a *set answer* where it lists a true label in `confounded_with`, a *re-expression* where the judge
//! computes one ([`super::columns`]). A declared cause that is none of these is *misattributed*. A case without a nameable cause is
//! *honest* where nothing is misattributed and the report says that something is unexplained (or re-expresses it), *silent* where
//! neither is.

use std::collections::BTreeSet;

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
    /// It is true, or of what the tool says it cannot tell apart one is true.
    pub in_group: bool,
    /// The judge finds that it says again what is true.
    pub re_expression: bool,
    /// What it said it cannot tell apart.
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

impl Report {
    /// Labels of the causes that are declared.
    pub fn declared(&self) -> impl Iterator<Item = String> {
        self.causes.iter().filter(|c| c.declared).map(Cause::label)
    }
}

impl Cause {
    fn label(&self) -> String {
        super::cases::label(&self.effect, &self.subject)
    }
}

/// Judges a report; which declared causes are re-expressions was computed before.
#[must_use]
pub fn judge(case: &Case, report: &Report, re_expressions: &BTreeSet<String>) -> Judged {
    let said: Vec<Said> = report
        .causes
        .iter()
        .map(|c| {
            let label = c.label();
            let right = case.labels.contains(&label);
            Said {
                right,
                in_group: right || case.labels.iter().any(|l| c.confounded_with.contains(l)),
                re_expression: re_expressions.contains(&label),
                label,
                probability: c.probability,
                declared: c.declared,
                group: c.confounded_with.clone(),
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

    /// Declared causes that are neither right, nor a set answer, nor a re-expression.
    pub fn misattributed(&self) -> impl Iterator<Item = &Said> {
        self.declared().filter(|s| !s.in_group && !s.re_expression)
    }

    /// Nothing is misattributed, and the report says that something is unexplained or re-expresses it.
    #[must_use]
    pub fn honest(&self) -> bool {
        let told = self.unexplained || self.declared().any(|s| s.in_group || s.re_expression);
        self.refused.is_none() && told && self.misattributed().next().is_none()
    }

    /// Nothing is declared, and nothing is said to be unexplained.
    #[must_use]
    pub fn silent(&self) -> bool {
        self.refused.is_none() && !self.unexplained && self.declared().next().is_none()
    }

    /// The case did not end as its kind wants it.
    #[must_use]
    pub fn failed(&self) -> bool {
        if self.refused.is_some() {
            return true;
        }
        let misattributed = self.misattributed().next().is_some();
        match self.kind {
            _ if !self.visible && !matches!(self.kind, Kind::Pair | Kind::Several) => {
                self.declared().next().is_some()
            }
            Kind::Single | Kind::LeftOut => !self.top_right() || misattributed,
            Kind::Pair | Kind::Several => !self.exact(),
            Kind::Null => self.declared().next().is_some(),
            Kind::Outside | Kind::Removed => !self.honest(),
        }
    }

    /// The most probable cause is true.
    #[must_use]
    pub fn top_right(&self) -> bool {
        self.said.first().is_some_and(|s| s.right && s.declared)
    }

    /// The most probable cause is right, a set answer or a re-expression.
    #[must_use]
    pub fn top_in_group(&self) -> bool {
        self.said.first().is_some_and(|s| (s.in_group || s.re_expression) && s.declared)
    }

    /// All of the truth is declared, and nothing else.
    #[must_use]
    pub fn exact(&self) -> bool {
        let right = self.declared().filter(|s| s.right).count();
        right == self.labels.len() && self.declared().count() == right
    }

    /// All of the truth is declared or in a set answer, and nothing is misattributed.
    #[must_use]
    pub fn exact_in_group(&self) -> bool {
        let found = |l: &String| self.declared().any(|s| s.label == *l || s.group.contains(l));
        self.labels.iter().all(found) && self.misattributed().next().is_none()
    }

    /// True labels that are declared.
    pub fn found(&self) -> impl Iterator<Item = (&String, f64)> {
        let levels = self.levels.iter().copied().chain(std::iter::repeat(0.0));
        self.labels.iter().zip(levels).filter(|(l, _)| self.declared().any(|s| s.label == **l))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blind::{Generator, Mode};
    use crate::twin::Dice;

    fn case(kind: Kind, labels: &[&str]) -> Case {
        Case {
            number: 3,
            kind,
            labels: labels.iter().map(|l| (*l).to_owned()).collect(),
            levels: vec![2.0; labels.len()],
            visible: true,
            days: [1, 2],
            truth: Generator::Twin.machine(Mode::Plain, &mut Dice::new(1, "machines")),
        }
    }

    fn report(causes: &[(&str, bool, &[&str])], unexplained: bool) -> Report {
        let causes = causes
            .iter()
            .map(|(label, declared, group)| {
                let (effect, subject) = label.split_once(':').unwrap_or((label, ""));
                serde_json::json!({"effect": effect, "subject": subject, "probability": 0.9, "declared": declared,
                    "confounded_with": group})
            })
            .collect::<Vec<_>>();
        serde_json::from_value(serde_json::json!({"verdict": "explained", "causes": causes,
            "unexplained": {"significant": unexplained}, "shrink": {"fraction": 0.5, "ci90": [0.4, 0.6]}}))
        .unwrap()
    }

    #[test]
    fn what_is_not_declared_does_not_count_and_a_set_answer_is_no_misattribution() {
        let none = BTreeSet::new();
        let single = case(Kind::Single, &["backlash:x"]);
        assert!(!judge(&single, &report(&[("backlash:x", true, &[])], false), &none).failed());
        assert!(judge(&single, &report(&[("backlash:x", false, &[])], false), &none).failed());
        let group = judge(&single, &report(&[("latency", true, &["backlash:x"])], false), &none);
        assert!(group.top_in_group() && !group.top_right() && group.misattributed().next().is_none());
        let null = case(Kind::Null, &[]);
        assert!(!judge(&null, &report(&[("backlash:x", false, &[])], true), &none).failed());
        assert!(judge(&null, &report(&[("backlash:x", true, &[])], true), &none).failed());
    }

    #[test]
    fn only_the_judge_says_what_is_a_re_expression() {
        let outside = case(Kind::Outside, &["outside-oil"]);
        let said = report(&[("sag:z", true, &[])], true);
        assert!(judge(&outside, &said, &BTreeSet::new()).failed());
        let expressed = judge(&outside, &said, &BTreeSet::from(["sag:z".to_owned()]));
        assert!(expressed.honest() && !expressed.failed());
        let nothing = judge(&outside, &report(&[], false), &BTreeSet::new());
        assert!(nothing.silent() && !nothing.honest());
        assert!(judge(&outside, &report(&[], true), &BTreeSet::new()).honest());
    }
}
