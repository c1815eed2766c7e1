//! What another day changes in the shrink of a gap, beside its own white noise: drift takes another course, what temperatures
//! cause is as large as the day is warm, and a ballbar is set to another length.

use super::constants::NINETY;
use super::library::Shape;
use super::moment::Source;
use super::noise::ClassNoise;
use super::offsets::without_offsets;
use super::session::Session;
use volcomp_model::geometry::Vec3;

/// Size on other days of what varies between days, as multiples of that of this one.
pub(super) const DAY_FACTORS: [f64; 2] = [0.3, 1.5];

/// What has another size on another day: what a temperature drives (0), and the length of a ballbar (1).
pub(super) fn varies_between_days(shape: &Shape) -> Option<usize> {
    let is_warmth = shape.signals().iter().any(|s| matches!(s.source, Source::Temperature(_)));
    matches!(shape, Shape::BallbarLength(_)).then_some(1).or(is_warmth.then_some(0))
}

/// What is known of this day.
pub(super) struct Day<'a> {
    pub(super) session: &'a Session,
    pub(super) used: &'a [bool],
    pub(super) noise: &'a [ClassNoise],
    /// What all causes do together, um per row.
    pub(super) causes: Vec<f64>,
    /// What those of them do that vary between days.
    pub(super) changing: Vec<f64>,
}

impl Day<'_> {
    /// How far the shrink may be below and above what is forecast, with mean squares `before` and `after`, um^2.
    pub(super) fn spread(&self, before: f64, after: f64) -> [f64; 2] {
        if !(before > 0.0 && after > 0.0) {
            return [0.0; 2];
        }
        let root = (after / before).sqrt();
        let (own, cross) = self.drift();
        // drift is in both; a chance agreement of drift and effect is in the gap before only
        let both = own * (1.0 / after - 1.0 / before).powi(2);
        let drift = NINETY * 0.5 * root * (both + cross / (before * before)).sqrt();
        let changing = mean_square(&without_offsets(self.session, &self.changing, self.used));
        let with = |factor: f64| {
            let other = (before + (factor * factor - 1.0) * changing).max(after);
            (root - (after / other).sqrt()).abs()
        };
        DAY_FACTORS.map(|f| drift.hypot(with(f)))
    }

    /// Variance of the mean square of another day's drift, and of twice its mean product with the causes, um^4; what the
    /// drift of this day did to the fit the bootstrap of its blocks shows.
    fn drift(&self) -> (f64, f64) {
        let causes = without_offsets(self.session, &self.causes, self.used);
        let mut setups: Vec<Vec<usize>> = vec![Vec::new(); self.session.setups.len()];
        for (i, r) in self.session.readings.iter().enumerate().filter(|(i, _)| self.used[*i]) {
            setups[r.setup].push(i);
        }
        let n: usize = setups.iter().map(Vec::len).sum();
        let (mut own, mut cross) = (0.0, 0.0);
        for rows in setups.iter().filter(|r| !r.is_empty()) {
            let class = self.noise[self.session.readings[rows[0]].instrument];
            if class.drift_um <= 0.0 {
                continue;
            }
            let t = |i: usize| self.session.moments[i].t_s;
            let times = (t(rows[rows.len() - 1]) - t(rows[0])).max(0.0) / class.drift_s.max(1e-9);
            // what is slower than the setup goes with its offset
            let variance = class.drift_um.powi(2) * (times / 3.0).min(1.0);
            let pieces = 1.0 + 0.5 * times;
            own += 2.0 / pieces * (rows.len() as f64 * variance).powi(2);
            // a sum over all pairs with the correlation of the drift, in one pass
            let (mut before, mut last, mut sum) = (Vec3::zeros(), t(rows[0]), 0.0);
            for i in rows {
                before *= (-(t(*i) - last).max(0.0) / class.drift_s.max(1e-9)).exp();
                last = t(*i);
                let part = self.session.moments[*i].u * causes[*i];
                sum += part.dot(&part) + 2.0 * part.dot(&before);
                before += part;
            }
            cross += 4.0 * variance * sum.max(0.0);
        }
        let n = (n.max(1) as f64).powi(2);
        (own / n, cross / n)
    }
}

fn mean_square(values: &[f64]) -> f64 {
    super::offsets::rms(values).powi(2)
}
