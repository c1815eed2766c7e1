//! Probation of a tool sensor after its initialisation.
//!
//! Whether a sensor sees what is applied for what it said shows only once that is applied: so it is on **probation** for
//! 200 readings and 5 s. Meanwhile its map remembers what it knew before, and what it knew while nothing spoke against
//! it. A sensor that contradicts the map in that time, or later with innovations that point one way, has what it taught
//! last taken back, and is looked at again after a rest of a minute, twice as long each time, up to an hour.

use crate::{InnovationBias, InnovationSample, Kind, Window};
use volcomp_model::units::MonoTime;

/// Readings of a probation.
const PROBATION_READINGS: u32 = 200;
/// Shortest probation, s: several times what a table needs to come into effect.
const PROBATION_S: f64 = 5.0;
/// Time in which what it taught comes into effect, so that it can be seen whether it was right, s.
const EFFECT_S: f64 = 2.0;
/// Rest after a probation that went wrong, s.
const REST_S: f64 = 60.0;
/// Longest rest, s.
const REST_MAX_S: f64 = 3600.0;
/// Time without a contradiction after which those before do not count any more, s.
const FORGIVEN_S: f64 = 1800.0;
/// Share of each row in the noise that means are compared with.
const REFERENCE_SHARE: f64 = 1e-4;

/// Probation of one sensor.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SensorProbation {
    persistence: InnovationBias,
    /// Since when it is used, and for how many readings.
    met: Option<(MonoTime, u32)>,
    /// Contradictions that count.
    contradictions: u32,
    rests_until: Option<MonoTime>,
    /// Variance of its noise over the stated one, as initialised, following slowly: lengths, angles.
    reference: [f64; 2],
}

impl Default for SensorProbation {
    fn default() -> Self {
        let persistence = InnovationBias::default();
        Self { persistence, met: None, contradictions: 0, rests_until: None, reference: [1.0; 2] }
    }
}

impl SensorProbation {
    /// It is initialised, with this noise.
    pub(super) fn met(&mut self, now: MonoTime, noise: [f64; 2]) {
        (self.persistence, self.met, self.rests_until) = (InnovationBias::default(), Some((now, 0)), None);
        self.reference = noise;
    }

    /// A reading was used; `noise` is what is known of its noise by now.
    pub(super) fn used(&mut self, now: MonoTime, rows: &[InnovationSample], noise: [f64; 2]) -> Window {
        if let Some((_, used)) = &mut self.met {
            *used = used.saturating_add(1);
        }
        for kind in rows.iter().map(|row| row.kind.index()) {
            self.reference[kind] += REFERENCE_SHARE * (noise[kind] - self.reference[kind]);
        }
        let relative = Kind::ALL.map(Kind::index).map(|k| self.reference[k] / noise[k]);
        let window = self.persistence.add(now, rows, relative);
        if self.met.is_some_and(|(since, _)| now.seconds_since(since) >= FORGIVEN_S) {
            self.contradictions = 0;
        }
        window
    }

    /// Its probation is over.
    pub(super) fn has_proven(&self, now: MonoTime) -> bool {
        self.met.is_some_and(|(since, used)| {
            used >= PROBATION_READINGS && now.seconds_since(since) >= PROBATION_S
        })
    }

    /// Time for which it was seen to be right, s; `None` before what it taught is in effect.
    pub(super) fn right_for_s(&self, now: MonoTime) -> Option<f64> {
        self.met.map(|(since, _)| now.seconds_since(since)).filter(|s| *s >= EFFECT_S)
    }

    /// It contradicts the map: by readings beyond the gate, or by innovations that point one way (`persists`).
    pub(super) fn contradicts(&mut self, now: MonoTime, persists: bool) {
        if persists || self.met.is_some() && !self.has_proven(now) {
            let rest_s = REST_S * f64::from(1_u32 << self.contradictions.min(10));
            self.rests_until = Some(now.plus_seconds(rest_s.min(REST_MAX_S)));
            self.contradictions = self.contradictions.saturating_add(1);
        }
        self.met = None;
    }

    /// Time until it is looked at again, s; `None` where it may be.
    pub(super) fn rests_s(&self, now: MonoTime) -> Option<f64> {
        self.rests_until.map(|until| until.seconds_since(now)).filter(|s| *s > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: f64) -> MonoTime {
        MonoTime::ZERO.plus_seconds(s)
    }

    #[test]
    fn who_fails_on_probation_rests_longer_each_time_until_one_goes_well() {
        let mut probation = SensorProbation::default();
        let mut now = 0.0;
        for rest in [60.0, 120.0, 240.0] {
            probation.met(at(now), [1.0; 2]);
            probation.contradicts(at(now + 1.0), false);
            assert!((probation.rests_s(at(now + 1.0)).unwrap() - rest).abs() < 1e-9);
            now += 1.0 + rest;
            assert_eq!(probation.rests_s(at(now)), None);
        }
        probation.met(at(now), [1.0; 2]);
        let row = InnovationSample { innovation: 0.1, uncertainty: 0.1, prior: 4.0, kind: Kind::Length };
        for _ in 0..600 {
            now += 0.01;
            probation.used(at(now), &[row], [1.0; 2]);
        }
        assert!(probation.has_proven(at(now)));
        probation.contradicts(at(now), false);
        assert_eq!(probation.rests_s(at(now)), None, "it has proven itself: it comes back when it agrees");
        probation.met(at(now), [1.0; 2]);
        probation.used(at(now + 1900.0), &[row], [1.0; 2]);
        probation.contradicts(at(now + 1900.0), true);
        assert!((probation.rests_s(at(now + 1900.0)).unwrap() - 60.0).abs() < 1e-9, "the count began anew");
    }
}
