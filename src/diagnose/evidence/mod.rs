//! Exact model comparison for sessions of one or few programs: sets of effects against each other and against "none".
//!
//! Gap `r = SUM_e X_e b_e + delta + drift + noise`, one dense covariance for the last three ([`covariance`]), effect sizes
//! integrated over a ladder of scales, sets of effects searched and averaged by marginal likelihood ([`sets`]), all of it
//! over a ladder of the scales of discrepancy and drift ([`scales`]). Source: Kennedy and O'Hagan 2001, Brynjarsdottir and
//! O'Hagan 2014; `docs/explanation/diagnosis.md` (evidence).

mod comparison;
mod covariance;
mod gram;
mod grouping;
mod posterior;
mod scales;
mod sets;
mod tails;
#[cfg(test)]
mod tests;

use super::constants::PROGRAMS_MAX;
use super::library::{Library, STILL};
use super::moment::SLOTS;
use super::search::count_programs;
use super::session::{Session, is_encoder};

pub use comparison::{Comparison, Contender, Shares};
pub use covariance::{Component, Covariance, Structure};
pub(crate) use grouping::white_within;
pub(crate) use posterior::mean_of_members;

/// True for sessions of one or few programs. A capture of the control's encoders along a free path is no program: nothing in it
/// comes back, and its formulas hold to a share that the servo's own search knows.
#[must_use]
pub fn applies(session: &Session) -> bool {
    let encoders = session.instruments.iter().all(|n| is_encoder(n));
    let moving = (0..SLOTS).filter(|k| session.moments.iter().any(|m| m.velocity[*k].abs() > STILL));
    if encoders && moving.count() > 1 {
        return false;
    }
    count_programs(session) <= PROGRAMS_MAX
}

/// Compares all sets of effects that the library offers. `gap` in um, a value per reading of the session; `used` marks the
/// readings that take part; `white_um` is the white noise of each instrument class, of which only the ratios count. Nothing
/// where too many setups leave no readings that can be averaged, or too few readings are left.
#[must_use]
pub fn compare(
    session: &Session,
    library: &Library,
    gap: &[f64],
    used: &[bool],
    white_um: &[f64],
) -> Option<Comparison> {
    let groups = grouping::groups(session, used)?;
    posterior::compare(session, library, gap, Structure::new(session, groups, white_um))
}
