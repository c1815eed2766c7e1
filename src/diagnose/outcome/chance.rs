//! Causes that chance may have made though it came back: waves over a position where something shakes the machine and a time
//! and a way are the same; small curves on a display so coarse that its rounding is the same in every pass.

use super::super::Analysis;
use super::super::assess::Assessed;
use super::super::forecast::{Contributions, minus};
use super::super::library::STILL;
use super::super::moment::Moment;
use super::super::noise::beside_repeats;
use super::super::session::Session;
use super::super::stochastic;
use super::product::ACTS_SHARE;

/// Speeds within this factor are one feed.
const ONE_FEED: f64 = 1.5;
/// What shows in fewer programmes (`breadth`) nothing but the passes of one shows.
const ONE_PROGRAMME: f64 = 2.0;

/// Takes back what chance may have made.
pub(super) fn doubt(
    session: &Session,
    a: &Analysis,
    parts: &Contributions,
    owner: &[usize],
    assessed: &mut [Assessed],
) {
    doubt_waves(session, a, parts, assessed);
    for (place, x) in assessed.iter_mut().enumerate().filter(|(_, x)| x.declared) {
        let own = || (0..owner.len()).filter(|j| owner[*j] == place);
        let part = |i: &usize| own().map(|j| parts.in_sample[j][*i]).sum::<f64>();
        let does: Vec<(f64, f64)> =
            a.problem.rows.iter().map(|i| (part(i), scatter(session, a, *i))).collect();
        if x.gates.breadth < ONE_PROGRAMME && is_within_rounding(&does) {
            x.doubt(
                "shows in one programme and is smaller than the rounding there, which comes back with every pass: measure with a finer display"
                    .to_owned(),
            );
        }
    }
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
    let acts: Vec<&(f64, f64)> = does.iter().filter(|p| square(p) > ACTS_SHARE * mean).collect();
    let effect: f64 = acts.iter().map(|p| square(p)).sum();
    effect < acts.iter().map(|p| p.1 * p.1).sum()
}

/// Takes back the waves of a screw where something shakes the machine and every axis was seen at one feed only.
fn doubt_waves(session: &Session, a: &Analysis, parts: &Contributions, assessed: &mut [Assessed]) {
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
