//! Families of curves as words of a command line.

use volcomp_identify::curve::Basis;

/// A value where one is chosen, `None` where the program chooses.
pub(crate) type Auto<T> = Option<T>;

type Word = (&'static str, &'static str, Auto<Basis>);

const AUTO: Word =
    ("auto", "Half-range or Chebyshev, or a fitted period or table where the data call for it", None);
const HALF_RANGE: Word = ("half-range", "Mean, linear part and sine half waves", Some(Basis::HalfRange));
const FOURIER: Word = ("fourier", "Harmonics of a period", Some(Basis::Fourier));
const CHEBYSHEV: Word = ("chebyshev", "Chebyshev polynomials", Some(Basis::Chebyshev));
const TABLE: Word = (
    "table",
    "The mean at every position, with a reverse curve where both directions are kept",
    Some(Basis::Table),
);

/// All of them.
pub(super) const ALL: &[Word] = &[AUTO, HALF_RANGE, FOURIER, CHEBYSHEV, TABLE];
/// Those that need no further options.
pub(crate) const BASES: &[Word] = &[AUTO, HALF_RANGE, CHEBYSHEV, TABLE];
