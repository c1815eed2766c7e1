//! Families of curves that need no further options.

use volcomp_identify::curve::Basis;

/// Family of curves of `identify`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum SimpleBasis {
    /// Half-range or Chebyshev, or a fitted period or table where the data call for it.
    Auto,
    /// Mean, linear part and sine half waves.
    HalfRange,
    /// Chebyshev polynomials.
    Chebyshev,
    /// The mean at every position, with a reverse curve where both directions were measured.
    Table,
}

impl SimpleBasis {
    /// The basis; `None` where the fit chooses.
    pub(crate) const fn basis(self) -> Option<Basis> {
        match self {
            Self::Auto => None,
            Self::HalfRange => Some(Basis::HalfRange),
            Self::Chebyshev => Some(Basis::Chebyshev),
            Self::Table => Some(Basis::Table),
        }
    }
}
