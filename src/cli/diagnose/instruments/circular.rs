//! Circular tests (ballbar, grid encoder): the table `angle_deg,deviation_um,direction`, optionally with the feed and the run.

use core::f64::consts::PI;

use super::{InstrumentArgs, Measurement, Rows, ways};
use crate::identify::ballbar::lines_and_samples;
use crate::prelude::*;
use volcomp_diagnose::session::Times;
use volcomp_identify::ballbar::{Plane, Sample, within_overshoot};

/// Length of the most common ballbar, mm.
const RADIUS_MM: f64 = 150.0;

pub(super) fn read(path: &Path, args: &InstrumentArgs) -> Result<Measurement> {
    let (lines, samples): (Vec<u64>, Vec<Sample>) = samples(path, args)?.into_iter().unzip();
    let plane = args.plane.unwrap_or(Plane::Xy);
    let radius = args.radius_mm.unwrap_or(RADIUS_MM);
    let centre = args.centre_mm.unwrap_or_else(Vec3::zeros);
    let axes = plane.axes().map(|a| a.direction());
    let fed = samples.iter().all(|s| s.feed.is_some());
    let names = "t_s setup run repeat moving x_mm y_mm z_mm u_x u_y u_z deviation_um";
    let mut rows = Rows::new(path, names.split(' '));
    let (mut run, mut runs_before) = (0.0, Vec::<(bool, u64)>::new());
    let (mut t, mut repeat) = (0.0, 1.0);
    let mut last: Option<&Sample> = None;
    for (i, s) in samples.iter().enumerate() {
        let ccw = s.travel == Travel::Forward;
        let begins = last.is_none_or(|l| l.travel != s.travel || l.run != s.run || l.feed != s.feed);
        if begins {
            run += 1.0;
            // the same direction and feed again is the same program again
            let program = (ccw, s.feed.map_or(0, f64::to_bits));
            repeat = 1.0 + runs_before.iter().filter(|p| **p == program).count() as f64;
            runs_before.push(program);
        }
        let step = last.map_or(0.0, |l| turned(l.angle, s.angle).abs());
        t += s.feed.filter(|_| !begins).map_or(1.0, |feed| radius * step / feed);
        last = Some(s);
        let (sine, cosine) = s.angle.sin_cos();
        let mut place = centre;
        place[axes[0]] += radius * cosine;
        place[axes[1]] += radius * sine;
        let mut u = Vec3::zeros();
        (u[axes[0]], u[axes[1]]) = (cosine, sine);
        let mut values = vec![t, 1.0, run, repeat, 1.0, place.x, place.y, place.z];
        values.extend([u.x, u.y, u.z, um_from_mm(s.deviation)]);
        rows.push(lines[i], "ballbar", &values);
    }
    let times = if fed { Times::Nominal } else { Times::Ordinal };
    let mut found = Measurement::new(rows, times, "circular test (angle, deviation, direction)");
    let ways = ways(samples.iter().map(|s| s.travel));
    let stated = |given: bool, option: &str| {
        if given { String::new() } else { format!(" (assumed; {option} states it)") }
    };
    found.note(format!("{}, {}, {ways}", counted(samples.len(), "reading"), counted(run as usize, "run")));
    found.note(format!("plane {plane}{}", stated(args.plane.is_some(), "--plane")));
    found.note(format!("radius {radius} mm{}", stated(args.radius_mm.is_some(), "--radius-mm")));
    let ([x, y, z], stated): ([f64; 3], _) = (centre.into(), stated(args.centre_mm.is_some(), "--centre-mm"));
    found.note(format!("centre at {x}, {y}, {z} mm{stated}"));
    found.note(if fed {
        "velocities and times from angle and feed"
    } else {
        "no feed: velocities are not known, so that neither lag nor servo mismatch is identifiable; --feed-mm-per-min or a \
         column feed_mm_per_min states it"
    });
    Ok(found)
}

/// The readings without overshoot, each with its line.
fn samples(path: &Path, args: &InstrumentArgs) -> Result<Vec<(u64, Sample)>> {
    let mut all = lines_and_samples(path, |row, column| match row.value(column)? {
        bad if bad <= 0.0 => Err(row.fail(column, format_args!("{bad} is no feed; it is above 0 mm/min"))),
        feed => Ok(feed),
    })?;
    for (_, sample) in &mut all {
        sample.feed = sample.feed.or(args.feed_mm_per_min).map(|f| f / 60.0);
    }
    let kept = within_overshoot(&all.iter().map(|(_, s)| *s).collect::<Vec<_>>(), None);
    if kept.is_empty() {
        return Err(data!(path, "no data rows below the header"));
    }
    Ok(kept.into_iter().map(|i| all[i]).collect())
}

/// From one angle to another the short way, rad.
fn turned(from: f64, to: f64) -> f64 {
    (to - from + PI).rem_euclid(2.0 * PI) - PI
}
