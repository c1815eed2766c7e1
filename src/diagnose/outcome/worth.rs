//! A cause must be worth something on readings that its fit has not seen: where these fit better without it, it is shown,
//! but not declared.

use super::super::Analysis;
use super::super::assess::Assessed;
use super::super::forecast::{Contributions, minus};
use super::super::offsets::{rms, without_offsets};
use super::super::session::Session;

/// Takes back what makes the forecast worse, the worst first; `owner` is the effect of each column.
pub(super) fn keep(
    session: &Session,
    a: &Analysis,
    parts: &Contributions,
    owner: &[usize],
    assessed: &mut [Assessed],
) {
    loop {
        let left = |without: Option<usize>| {
            let take = |j: usize| assessed[owner[j]].declared && Some(owner[j]) != without;
            rms(&without_offsets(session, &minus(&a.gap, &parts.held_out, take), &a.used))
        };
        let places = (0..assessed.len()).filter(|p| assessed[*p].declared);
        let Some((place, without_um)) =
            places.map(|p| (p, left(Some(p)))).min_by(|(_, a), (_, b)| a.total_cmp(b))
        else {
            return;
        };
        let with_um = left(None);
        // each may help beside the others while all of them together do not
        let nothing_um = rms(&without_offsets(session, &a.gap, &a.used));
        if without_um > with_um && with_um < nothing_um {
            return;
        }
        assessed[place].doubt(format!(
            "makes readings that were left out worse: {with_um:.2} um with it, {without_um:.2} um without it"
        ));
    }
}
