//! Figures of an experiment, their limits, and what holds over many seeds.

use std::collections::BTreeMap;

/// Which machine and which instruments an experiment meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Truth {
    /// The machine is the same in survey and test; instruments have noise only.
    Kind,
    /// Heat, load, axis interaction and wear between survey and test; instruments with systematic errors.
    Hard,
}

impl Truth {
    /// Its name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Kind => "kind",
            Self::Hard => "hard",
        }
    }
}

/// What a figure must keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limit {
    /// The figure is at most this.
    AtMost(f64),
    /// The figure is at least this.
    AtLeast(f64),
}

impl Limit {
    /// True where the value keeps the limit; a value that is no number does not.
    #[must_use]
    pub fn holds(self, value: f64) -> bool {
        match self {
            Self::AtMost(limit) => value <= limit,
            Self::AtLeast(limit) => value >= limit,
        }
    }

    /// On which side of the limit the figure must be.
    #[must_use]
    pub const fn sense(self) -> &'static str {
        match self {
            Self::AtMost(_) => "at most",
            Self::AtLeast(_) => "at least",
        }
    }

    /// The limit itself.
    #[must_use]
    pub const fn value(self) -> f64 {
        match self {
            Self::AtMost(v) | Self::AtLeast(v) => v,
        }
    }
}

impl core::fmt::Display for Limit {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (sign, value) = match self {
            Self::AtMost(v) => ('\u{2264}', v),
            Self::AtLeast(v) => ('\u{2265}', v),
        };
        write!(f, "{sign} {value}")
    }
}

/// A row of an experiment's table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Name of the figure.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Value in the paper, where it has one.
    pub paper: Option<f64>,
    /// Limit with either truth; none for a figure that is reported only.
    pub limit: Option<Limit>,
    /// Decimals in tables.
    pub decimals: usize,
}

impl Row {
    /// A figure that is reported without a limit.
    #[must_use]
    pub const fn reported(
        name: &'static str,
        unit: &'static str,
        paper: Option<f64>,
        decimals: usize,
    ) -> Self {
        Self { name, unit, paper, limit: None, decimals }
    }

    /// A figure with a limit.
    #[must_use]
    pub const fn limited(
        name: &'static str,
        unit: &'static str,
        paper: Option<f64>,
        limit: Limit,
        decimals: usize,
    ) -> Self {
        Self { name, unit, paper, limit: Some(limit), decimals }
    }
}

/// Share of what is left after compensation or identification that one cause explains.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Share {
    /// The cause.
    pub cause: String,
    /// Drop of the mean square when the cause is switched off, relative to the whole; causes that compensate each other
    /// have negative shares.
    pub share: f64,
}

/// Figures of one run by name.
pub type Values = BTreeMap<&'static str, f64>;

/// Distribution of a figure over seeds.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// The value that 95 % of the seeds reach or exceed in the sense of the limit; the worst of all below 20 seeds.
    pub worst_5_percent: f64,
}

impl Spread {
    /// The distribution of some values; none where there are none.
    #[must_use]
    pub fn of(values: &[f64], limit: Option<Limit>) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (min, max) = (*sorted.first()?, *sorted.last()?);
        let n = sorted.len();
        let median = if n % 2 == 1 { sorted[n / 2] } else { (sorted[n / 2 - 1] + sorted[n / 2]) / 2.0 };
        // how many of the worst may be left out: one of 20, two of 40
        let beyond = n / 20;
        let worst_5_percent = match limit {
            Some(Limit::AtLeast(_)) => sorted[beyond],
            _ => sorted[n - 1 - beyond],
        };
        Some(Self { median, min, max, worst_5_percent })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_judge_the_worse_side() {
        let values: Vec<f64> = (1..=20).map(f64::from).collect();
        let most = Spread::of(&values, Some(Limit::AtMost(5.0))).unwrap();
        let least = Spread::of(&values, Some(Limit::AtLeast(5.0))).unwrap();
        assert_eq!((most.worst_5_percent, least.worst_5_percent), (19.0, 2.0));
        assert_eq!((most.median, most.min, most.max), (10.5, 1.0, 20.0));
        // with fewer than 20 seeds none may be left out
        assert_eq!(Spread::of(&values[..19], Some(Limit::AtMost(5.0))).unwrap().worst_5_percent, 19.0);
        assert!(Spread::of(&[], None).is_none());
    }

    #[test]
    fn a_value_that_is_no_number_keeps_no_limit() {
        assert!(!Limit::AtMost(1.0).holds(f64::NAN) && !Limit::AtLeast(1.0).holds(f64::NAN));
    }
}
