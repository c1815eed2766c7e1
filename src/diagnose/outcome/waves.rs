//! Waves over a position that a vibration may have made: at one feed a time and a way are the same.

use super::super::Analysis;
use super::super::assess::Assessed;
use super::super::forecast::{Contributions, minus};
use super::super::library::STILL;
use super::super::moment::Moment;
use super::super::noise::beside_repeats;
use super::super::session::Session;
use super::super::stochastic;

/// Speeds within this factor are one feed.
const ONE_FEED: f64 = 1.5;

/// Takes back the waves of a screw where something shakes the machine and every axis was seen at one feed only.
pub(super) fn doubt(session: &Session, a: &Analysis, parts: &Contributions, assessed: &mut [Assessed]) {
    let speed = |m: &Moment| m.velocity[..3].iter().map(|v| v * v).sum::<f64>().sqrt();
    if !assessed.iter().any(is_wave) || !is_one_feed(session.moments.iter().map(speed)) {
        return;
    }
    let found = minus(&a.gap, &parts.in_sample, |_| true);
    let beside = a.filter.column(&beside_repeats(session, &a.used, &found));
    let left = super::left_whitened(a, &a.selection.chosen);
    if stochastic::shaking(session, &a.problem.rows, &left, &beside).is_some() {
        for x in assessed.iter_mut().filter(|x| is_wave(x)) {
            x.doubt(
                "something shakes the machine, which at one feed looks alike: measure at another feed"
                    .to_owned(),
            );
        }
    }
}

fn is_wave(x: &Assessed) -> bool {
    x.declared && x.label.effect == "cyclic"
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
}
