//! ISO 230-6: positioning along the four body diagonals.
//!
//! Each diagonal is evaluated like a linear axis (ISO 230-2); the machine's figures are the worst of the four.
//!
//! Source: ISO 230-6:2002, clause 3; names of the diagonals as in equations 5.3.

use super::positioning::{Positioning, PositioningError, PositioningReading};

/// A body diagonal by the signs with which X, Y and Z move along it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Diagonal {
    /// + + +
    Ppp,
    /// - + +
    Npp,
    /// + - +
    Pnp,
    /// + + -
    Ppn,
}

impl Diagonal {
    /// All four.
    pub const ALL: [Self; 4] = [Self::Ppp, Self::Npp, Self::Pnp, Self::Ppn];

    /// Its name in files and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ppp => "ppp",
            Self::Npp => "npp",
            Self::Pnp => "pnp",
            Self::Ppn => "ppn",
        }
    }

    /// The signs of X, Y, Z: `+X -Y +Z`.
    #[must_use]
    pub fn signs(self) -> String {
        let sign = |(c, axis): (char, char)| format!("{}{axis}", if c == 'p' { '+' } else { '-' });
        self.name().chars().zip(['X', 'Y', 'Z']).map(sign).collect::<Vec<_>>().join(" ")
    }

    /// The diagonal of a name; the opposite signs name the same diagonal (`nnn` is `ppp`).
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        match text.to_ascii_lowercase().as_str() {
            "ppp" | "nnn" => Some(Self::Ppp),
            "npp" | "pnn" => Some(Self::Npp),
            "pnp" | "npn" => Some(Self::Pnp),
            "ppn" | "nnp" => Some(Self::Ppn),
            _ => None,
        }
    }
}

/// Readings with each diagonal about its mean: the zero of the interferometer belongs to its set-up.
#[must_use]
pub fn about_means(readings: &[(Diagonal, PositioningReading)]) -> Vec<(Diagonal, PositioningReading)> {
    let about = |(d, r): &(Diagonal, PositioningReading)| {
        let own = || readings.iter().filter(|(other, _)| other == d).map(|(_, r)| r.deviation);
        let mean = own().sum::<f64>() / own().count().max(1) as f64;
        (*d, PositioningReading { deviation: r.deviation - mean, ..*r })
    };
    readings.iter().map(about).collect()
}

/// The result of a diagonal test.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagonalTest {
    /// The diagonals that were measured.
    pub diagonals: Vec<(Diagonal, Positioning)>,
}

/// Why a test cannot be evaluated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum DiagonalError {
    /// A diagonal is missing.
    #[error("diagonal {} has no readings; the test needs all four: ppp npp pnp ppn", missing.name())]
    Missing {
        /// The diagonal.
        missing: Diagonal,
    },
    /// One diagonal cannot be evaluated.
    #[error("diagonal {}: {error}", diagonal.name())]
    Positioning {
        /// The diagonal.
        diagonal: Diagonal,
        /// Why.
        error: PositioningError,
    },
}

impl DiagonalTest {
    /// Evaluates a test.
    ///
    /// # Errors
    /// A diagonal is missing or cannot be evaluated.
    pub fn evaluate(readings: &[(Diagonal, PositioningReading)]) -> Result<Self, DiagonalError> {
        let mut diagonals = Vec::with_capacity(4);
        for diagonal in Diagonal::ALL {
            let own: Vec<PositioningReading> =
                readings.iter().filter(|(d, _)| *d == diagonal).map(|(_, r)| *r).collect();
            if own.is_empty() {
                return Err(DiagonalError::Missing { missing: diagonal });
            }
            let result = Positioning::evaluate(&own)
                .map_err(|error| DiagonalError::Positioning { diagonal, error })?;
            diagonals.push((diagonal, result));
        }
        Ok(Self { diagonals })
    }

    /// The diagonal with the largest value of a figure, and the value.
    #[must_use]
    pub fn worst(&self, figure: impl Fn(&Positioning) -> Option<f64>) -> Option<(Diagonal, f64)> {
        self.diagonals
            .iter()
            .filter_map(|(d, p)| figure(p).map(|v| (*d, v)))
            .reduce(|a, b| if b.1 > a.1 { b } else { a })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_units::axes::Travel;

    #[test]
    fn the_worst_diagonal_is_named() {
        let mut all = Vec::new();
        for (k, diagonal) in Diagonal::ALL.into_iter().enumerate() {
            for _ in 0..2 {
                for i in 0..3 {
                    let deviation = f64::from(i) * [1.0, -4.0, 2.0, 0.5][k];
                    let target = f64::from(i) * 100.0;
                    all.push((diagonal, PositioningReading { travel: Travel::Forward, target, deviation }));
                }
            }
        }
        let test = DiagonalTest::evaluate(&all).unwrap();
        assert_eq!(test.worst(|p| p.forward.map(|f| f.e)), Some((Diagonal::Npp, 8.0)));
        assert_eq!(test.worst(|p| p.both.map(|b| b.b)), None);
        all.retain(|(d, _)| *d != Diagonal::Pnp);
        assert_eq!(
            DiagonalTest::evaluate(&all).unwrap_err(),
            DiagonalError::Missing { missing: Diagonal::Pnp }
        );
    }

    #[test]
    fn names_read_back_and_opposite_signs_are_the_same_line() {
        for d in Diagonal::ALL {
            assert_eq!(Diagonal::parse(d.name()), Some(d));
            let opposite: String = d.name().chars().map(|c| if c == 'p' { 'n' } else { 'p' }).collect();
            assert_eq!(Diagonal::parse(&opposite), Some(d));
        }
        assert_eq!(Diagonal::parse("pp"), None);
    }
}
