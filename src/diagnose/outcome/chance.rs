//! Causes that chance may have made though it came back: waves over a position where something shakes the machine and a time
//! and a way are the same; small curves on a display so coarse that its rounding is the same in every pass.

use super::super::Analysis;
use super::super::constants::LITTLE;
use super::super::decision::{Evidence, Reason};
use super::super::forecast::{Contributions, minus};
use super::super::library::STILL;
use super::super::moment::Moment;
use super::super::noise::beside_repeats;
use super::super::session::Session;
use super::super::stochastic;

/// Speeds within this factor are one feed.
const ONE_FEED: f64 = 1.5;
/// What shows in fewer programs (`breadth`) nothing but the passes of one shows.
const ONE_PROGRAM: f64 = 2.0;

/// The pattern, if any, by which chance may have made each effect.
pub(super) fn patterns(
    session: &Session,
    a: &Analysis,
    parts: &Contributions,
    owner: &[usize],
    evidence: &[Evidence],
) -> Vec<Option<Reason>> {
    let shaken = is_shaken_at_one_feed(session, a, parts, evidence);
    let of = |(place, x): (usize, &Evidence)| {
        if shaken && is_wave(x) {
            return Some(Reason::ShakenAtOneFeed);
        }
        let own = || (0..owner.len()).filter(|j| owner[*j] == place);
        let part = |i: &usize| own().map(|j| parts.in_sample[j][*i]).sum::<f64>();
        let does = || a.problem.rows.iter().map(|i| (part(i), scatter(session, a, *i))).collect::<Vec<_>>();
        (x.figures.breadth < ONE_PROGRAM && is_within_rounding(&does())).then_some(Reason::WithinRounding)
    };
    evidence.iter().enumerate().map(of).collect()
}

/// Scatter by rounding, um, of the display behind a reading; 0 where it is fine.
fn scatter(session: &Session, a: &Analysis, reading: usize) -> f64 {
    let class = session.readings[reading].instrument;
    stochastic::rounding(a.lattice_um[class], &a.noise[class]).unwrap_or(0.0)
}

/// True where an effect does less than rounding scatters wherever it acts: pairs of what it does and of that scatter, um.
fn is_within_rounding(does: &[(f64, f64)]) -> bool {
    let square = |p: &(f64, f64)| p.0 * p.0;
    let mean = does.iter().map(square).sum::<f64>() / does.len().max(1) as f64;
    let acts: Vec<&(f64, f64)> = does.iter().filter(|p| square(p) > LITTLE * mean).collect();
    let effect: f64 = acts.iter().map(|p| square(p)).sum();
    effect < acts.iter().map(|p| p.1 * p.1).sum()
}

/// True where something shakes the machine, every axis was seen at one feed only, and a wave of a screw was chosen.
fn is_shaken_at_one_feed(
    session: &Session,
    a: &Analysis,
    parts: &Contributions,
    evidence: &[Evidence],
) -> bool {
    let speed = |m: &Moment| m.velocity[..3].iter().map(|v| v * v).sum::<f64>().sqrt();
    if !evidence.iter().any(is_wave) || !is_one_feed(session.moments.iter().map(speed)) {
        return false;
    }
    let found = minus(&a.gap, &parts.in_sample, |_| true);
    let beside = a.filter.column(&beside_repeats(session, &a.used, &found));
    let left = super::left_whitened(a, &a.selection.chosen);
    stochastic::shaking(session, &a.problem.rows, &left, &beside).is_some()
}

fn is_wave(x: &Evidence) -> bool {
    x.label.effect == "cyclic"
}

/// True where all speeds (mm/s) are alike, and nothing stands still.
fn is_one_feed(speeds: impl Iterator<Item = f64>) -> bool {
    let [low, high] = speeds.fold([f64::INFINITY, 0.0], |[l, h]: [f64; 2], v| [l.min(v), h.max(v)]);
    low > STILL && (low..ONE_FEED * low).contains(&high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_feed_has_neither_rest_nor_a_second_speed() {
        assert!(is_one_feed([40.0, 41.0, 39.5].into_iter()));
        assert!(!is_one_feed([40.0, 0.0].into_iter()));
        assert!(!is_one_feed([18.0, 75.0].into_iter()));
        assert!(!is_one_feed([].into_iter()));
    }

    #[test]
    fn what_is_smaller_than_the_rounding_where_it_acts_is_within_it() {
        let does = |size: f64, scatter: f64| -> Vec<(f64, f64)> {
            // acts in a quarter of the readings
            (0..80).map(|i| (if i < 20 { size * (0.7 * i as f64).sin() } else { 0.0 }, scatter)).collect()
        };
        assert!(is_within_rounding(&does(1.5, 1.4)));
        assert!(!is_within_rounding(&does(3.0, 1.4)));
        assert!(!is_within_rounding(&does(1.5, 0.0)), "a fine display rounds nothing");
    }
}
