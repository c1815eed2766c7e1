//! Figures against their tolerances by ISO 14253-1, as cells of a table, text and JSON.

use super::Acceptance;
use crate::prelude::*;
use volcomp_evaluate::{Conformity, Uncertain};

/// A figure with what is known about it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Assessed {
    /// Key in JSON, such as `a_um`.
    pub(crate) key: String,
    /// In words.
    pub(crate) name: &'static str,
    /// The figure, where the data have it.
    pub(crate) value: Option<f64>,
    /// Expanded uncertainty (k = 2), where stated.
    pub(crate) expanded: Option<f64>,
    /// Expanded uncertainty (k = 2) with that of few runs, for a comparison; none where it is not known.
    pub(crate) compared: Option<f64>,
    /// Tolerance, where stated.
    pub(crate) limit: Option<f64>,
}

/// What stands where nothing is stated.
pub(crate) const NOT_STATED: &str = "not stated";

impl Assessed {
    /// The figure with the uncertainty of a comparison.
    pub(crate) fn uncertain(&self) -> Option<Uncertain> {
        Some(Uncertain { value: self.value?, std: self.compared.map(|u| u / 2.0) })
    }

    /// The verdict, where there are a figure and a tolerance.
    pub(crate) fn verdict(&self) -> Option<Conformity> {
        let (value, limit) = self.value.zip(self.limit)?;
        Some(if super::head_file::is_lower(&super::toml_key(&self.key)) {
            Conformity::below(-value, self.expanded, -limit)
        } else {
            Conformity::below(value.abs(), self.expanded, limit)
        })
    }

    /// Heads of the columns of [`Self::words`].
    pub(crate) fn heads(unit: &str) -> [String; 3] {
        [format!(">U (k = 2) / {unit}"), format!(">tolerance / {unit}"), "verdict".to_owned()]
    }

    /// Uncertainty, tolerance, verdict.
    pub(crate) fn words(&self) -> [String; 3] {
        let or = |words: Option<String>| words.unwrap_or_else(|| NOT_STATED.to_owned());
        let verdict = self.verdict().map_or("-", Conformity::words);
        let expanded = self.expanded.map(|u| format!("{u:.2}"));
        [or(expanded), or(self.limit.map(|l| l.to_string())), verdict.to_owned()]
    }
}

/// The figures of a test with what they are judged by.
pub(crate) struct Judged {
    /// Head, tolerances and stated uncertainties.
    pub(crate) acceptance: Acceptance,
    /// The figures; none of a test without tolerances.
    pub(crate) figures: Vec<Assessed>,
}

impl Judged {
    fn verdicts(&self) -> impl Iterator<Item = (&Assessed, Conformity)> {
        self.figures.iter().filter_map(|a| Some((a, a.verdict()?)))
    }

    /// True where a figure has a tolerance.
    pub(crate) fn has_verdicts(&self) -> bool {
        self.verdicts().next().is_some()
    }

    /// Adds `conformity` to a report: limit, expanded uncertainty and verdict of each figure with a tolerance.
    pub(crate) fn put(&self, out: &mut Map<String, Value>) {
        let of = |(a, verdict): (&Assessed, Conformity)| {
            let (limit, expanded, verdict) = (a.limit, a.expanded, verdict.key());
            (
                a.key.clone(),
                json!({ "limit": limit, "expanded_uncertainty_k2": expanded, "verdict": verdict }),
            )
        };
        let judged: Map<String, Value> = self.verdicts().map(of).collect();
        if !judged.is_empty() {
            out.insert("conformity".to_owned(), Value::Object(judged));
        }
    }
}

/// The result in a sentence; `None` where no tolerance is stated.
pub(crate) fn summary(all: &[Assessed]) -> Option<String> {
    let of = |wanted: Conformity| -> Vec<&str> {
        all.iter().filter(|a| a.verdict() == Some(wanted)).map(|a| a.name).collect()
    };
    let judged = all.iter().filter(|a| a.verdict().is_some()).count();
    if judged == 0 {
        return None;
    }
    let mut parts = Vec::new();
    for (verdict, words) in [
        (Conformity::NonConformity, "Non-conformity"),
        (Conformity::Neither, "Neither conformity nor non-conformity proved"),
        (Conformity::UncertaintyNotStated, "Not decided, because the uncertainty is not stated"),
        (Conformity::Conformity, "Conformity"),
    ] {
        let names = of(verdict);
        if names.len() == judged && judged > 1 {
            let all = if judged == 2 { "both".to_owned() } else { format!("all {judged}") };
            parts.push(format!("{words} with {all} stated tolerances"));
        } else if !names.is_empty() {
            parts.push(format!("{words}: {}", names.join(", ")));
        }
    }
    Some(parts.join(". ") + ".")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(key: &str, value: f64, expanded: Option<f64>, limit: Option<f64>) -> Assessed {
        let (key, compared) = (key.to_owned(), expanded);
        Assessed { key, name: "accuracy A", value: Some(value), expanded, compared, limit }
    }

    #[test]
    fn lower_limits_count_from_below_and_signs_do_not_matter_elsewhere() {
        let verdict = |key, value, limit| figure(key, value, Some(0.5), Some(limit)).verdict().unwrap();
        assert_eq!(verdict("fmin_um", -3.0, -4.0), Conformity::Conformity);
        assert_eq!(verdict("fmin_um", -5.0, -4.0), Conformity::NonConformity);
        assert_eq!(verdict("b_mean_um", -5.0, 4.0), Conformity::NonConformity);
        assert_eq!(figure("a_um", 1.0, Some(0.5), None).verdict(), None);
    }

    #[test]
    fn the_summary_names_the_worst_first() {
        let all = [
            figure("a_um", 1.0, Some(0.5), Some(8.0)),
            figure("e_um", 9.0, Some(0.5), Some(8.0)),
            figure("m_um", 9.0, Some(0.5), None),
        ];
        assert_eq!(summary(&all).unwrap(), "Non-conformity: accuracy A. Conformity: accuracy A.");
        let both = [all[0].clone(), all[0].clone()];
        assert_eq!(summary(&both).unwrap(), "Conformity with both stated tolerances.");
        assert_eq!(summary(&all[2..]), None);
    }
}
