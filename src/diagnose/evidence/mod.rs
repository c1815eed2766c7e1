//! Exact model comparison for sessions of one or few programs: sets of effects against each other and against "none".
//!
//! Gap `r = SUM_e X_e b_e + delta + drift + noise`, one dense covariance for the last three ([`covariance`]), effect sizes
//! integrated over a ladder of scales, sets of effects searched and averaged by marginal likelihood ([`sets`]), all of it
//! over a ladder of the scales of discrepancy and drift ([`scales`]). Source: Kennedy and O'Hagan 2001, Brynjarsdottir and
//! O'Hagan 2014; `docs/diagnosis.md` (evidence).

pub mod constants;
mod covariance;
mod gram;
mod grouping;
mod posterior;
mod scales;
mod sets;

use super::library::Library;
use super::session::Session;

pub use covariance::{Component, Covariance, Structure};
pub use posterior::{Comparison, Contender, Shares};

/// Programs of a session (axes that move, feed, tool) up to which all of it is compared exactly; with more of them the
/// agreement between programs decides.
#[must_use]
pub fn applies(session: &Session) -> bool {
    grouping::programs(session) <= constants::PROGRAMS_MAX
}

/// Compares all sets of effects that the library offers. `gap` in um, a value per reading of the session; `used` marks the
/// readings that take part; `white_um` is the white noise of each instrument class, of which only the ratios count.
#[must_use]
pub fn compare(
    session: &Session,
    library: &Library,
    gap: &[f64],
    used: &[bool],
    white_um: &[f64],
) -> Option<Comparison> {
    let structure = Structure::new(session, grouping::groups(session, used), white_um);
    posterior::compare(session, library, gap, &structure)
}
