//! Families of curves that need no further options.

use volcomp_identify::curve::Basis;

/// A value where one is chosen, `None` where the program chooses.
pub(crate) type Auto<T> = Option<T>;

/// Families of curves of `identify`.
pub(crate) const BASES: &[(&str, &str, Auto<Basis>)] = &[
    ("auto", "Half-range or Chebyshev, or a fitted period or table where the data call for it", None),
    ("half-range", "Mean, linear part and sine half waves", Some(Basis::HalfRange)),
    ("chebyshev", "Chebyshev polynomials", Some(Basis::Chebyshev)),
    (
        "table",
        "The mean at every position, with a reverse curve where both directions are kept",
        Some(Basis::Table),
    ),
];
