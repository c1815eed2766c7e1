//! ISO 14253-1: conformity of a measured figure with a tolerance, given its measurement uncertainty.
//!
//! The guard band is the expanded uncertainty `U` (k = 2): conformity is proved below `limit - U`, non-conformity above
//! `limit + U`. ISO 14253-1:2017 allows a narrower guard band of 1.65 u for a one-sided limit; `U` is on the safe side for
//! whoever has to prove.
//!
//! Source: ISO 14253-1:2017, clause 5; `docs/how-to/reports.md`.

/// What a measurement says about a tolerance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Conformity {
    /// Within the tolerance by more than the uncertainty.
    Conformity,
    /// Beyond the tolerance by more than the uncertainty.
    NonConformity,
    /// The tolerance lies within the uncertainty of the figure: neither can be proved.
    Neither,
    /// The uncertainty of the figure is not stated: nothing can be proved.
    UncertaintyNotStated,
}

impl Conformity {
    /// Conformity of a value with an upper limit; `expanded` is its expanded uncertainty, k = 2. All have one unit.
    #[must_use]
    pub fn below(value: f64, expanded: Option<f64>, limit: f64) -> Self {
        match expanded {
            None => Self::UncertaintyNotStated,
            Some(u) if value + u <= limit => Self::Conformity,
            Some(u) if value - u > limit => Self::NonConformity,
            Some(_) => Self::Neither,
        }
    }

    /// Name in JSON.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::Conformity => "conformity",
            Self::NonConformity => "non-conformity",
            Self::Neither => "neither",
            Self::UncertaintyNotStated => "uncertainty-not-stated",
        }
    }

    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Conformity => "conformity",
            Self::NonConformity => "non-conformity",
            Self::Neither => "neither: tolerance within U",
            Self::UncertaintyNotStated => "not decided: U not stated",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Conformity::{Conformity, Neither, NonConformity, UncertaintyNotStated};

    #[test]
    fn a_guard_band_lies_on_both_sides_of_the_limit() {
        for (value, verdict) in
            [(6.9, Conformity), (7.0, Conformity), (7.1, Neither), (9.0, Neither), (9.1, NonConformity)]
        {
            assert_eq!(super::Conformity::below(value, Some(1.0), 8.0), verdict, "{value}");
        }
        assert_eq!(super::Conformity::below(1.0, None, 8.0), UncertaintyNotStated);
    }
}
