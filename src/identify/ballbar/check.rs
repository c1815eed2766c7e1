//! Circles and requests that cannot be analysed are refused.

use crate::prelude::*;

use super::{BallbarError, Circles, Pitch, Request};

/// Fewest readings.
const READINGS_NEEDED: usize = 120;
/// Least part of the circle, rad.
const ARC_NEEDED: f64 = TAU / 4.0;

pub(super) fn check(circles: &Circles, request: &Request) -> Result<(), BallbarError> {
    let (plane, samples) = (circles.plane, &circles.samples);
    let finite = |s: &super::Sample| {
        s.angle.is_finite() && s.deviation.is_finite() && s.feed.is_none_or(f64::is_finite)
    };
    if let Some(i) = samples.iter().position(|s| !finite(s)) {
        return Err(BallbarError::NotFinite { plane, row: i + 1 });
    }
    if samples.len() < READINGS_NEEDED {
        return Err(BallbarError::TooFewReadings { plane, found: samples.len(), needed: READINGS_NEEDED });
    }
    let deviation = samples.iter().fold(0.0f64, |m, s| m.max(s.deviation.abs()));
    if !(circles.radius.is_finite() && circles.radius > 10.0 * deviation) {
        return Err(BallbarError::Radius { radius: circles.radius, deviation });
    }
    let positive = |what, value: f64| {
        if value.is_finite() && value > 0.0 { Ok(()) } else { Err(BallbarError::NotPositive { what, value }) }
    };
    for feed in samples.iter().filter_map(|s| s.feed) {
        positive("the feed", feed)?;
    }
    for p in request.pitch {
        match p {
            Pitch::None => {}
            Pitch::Given(v) => positive("a pitch", v)?,
            Pitch::Search([low, high]) => {
                positive("the shortest pitch", low)?;
                positive("the search for a pitch, longest less shortest,", high - low)?;
            }
        }
    }
    if let Some(t) = request.spike_time {
        positive("the time to the peak of a spike", t)?;
    }
    let known = samples.iter().filter(|s| s.feed.is_some()).count();
    if known != 0 && known != samples.len() {
        return Err(BallbarError::FeedMissing { plane });
    }
    let covered = TAU - largest_gap(samples.iter().map(|s| s.angle));
    if covered < ARC_NEEDED {
        let (covered_deg, limit_deg) = (covered.to_degrees(), ARC_NEEDED.to_degrees());
        return Err(BallbarError::ArcTooShort { plane, covered_deg, limit_deg });
    }
    Ok(())
}
