//! Circular tests (ballbar, grid encoder): the table `angle_deg,deviation_um,direction`, optionally with the feed and the run.

use core::f64::consts::PI;

use super::{InstrumentArgs, Measurement, Rows, ways};
use crate::prelude::*;
use volcomp_diagnose::session::Times;
use volcomp_identify::ballbar::{Plane, Sample, within_overshoot};

/// Length of the most common ballbar, mm.
const RADIUS_MM: f64 = 150.0;

/// Sine of the angle to a turning point below which an axis goes neither way.
const TURNING: f64 = 1e-9;

pub(super) fn read(path: &Path, args: &InstrumentArgs) -> Result<Measurement> {
    let (lines, samples): (Vec<u64>, Vec<Sample>) = samples(path, args)?.into_iter().unzip();
    let plane = args.plane.unwrap_or(Plane::Xy);
    let radius = args.radius_mm.unwrap_or(RADIUS_MM);
    let centre = args.centre_mm.unwrap_or_else(Vec3::zeros);
    let axes = plane.axes().map(|a| a.direction());
    let fed = samples.iter().all(|s| s.feed.is_some());
    let names = "t_s setup run repeat moving x_mm y_mm z_mm u_x u_y u_z deviation_um";
    let mut names: Vec<String> = names.split(' ').map(str::to_owned).collect();
    let letters = axes.map(|k| ["x", "y", "z"][k]);
    if fed {
        for letter in letters {
            names.extend([format!("v{letter}_mm_per_s"), format!("a{letter}_mm_per_s2")]);
        }
    }
    // known from the angle, where differences of places are one reading late
    names.extend(letters.map(|axis| format!("dir_{axis}")));
    for axis in letters {
        names.push(format!("since_reversal_{axis}_mm"));
        names.extend(fed.then(|| format!("since_reversal_{axis}_s")));
    }
    let mut rows = Rows::new(path, names);
    let (mut run, mut runs_before) = (0.0, Vec::<(bool, u64)>::new());
    let (mut t, mut repeat) = (0.0, 1.0);
    let mut last: Option<&Sample> = None;
    let (mut turning, mut travelled) = (0, 0.0);
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
        travelled = if begins { 0.0 } else { travelled + step };
        if sine.abs().min(cosine.abs()) < TURNING {
            turning += 1;
            continue;
        }
        let mut place = centre;
        place[axes[0]] += radius * cosine;
        place[axes[1]] += radius * sine;
        let mut u = Vec3::zeros();
        (u[axes[0]], u[axes[1]]) = (cosine, sine);
        let mut values = vec![t, 1.0, run, repeat, 1.0, place.x, place.y, place.z];
        values.extend([u.x, u.y, u.z, um_from_mm(s.deviation)]);
        if let Some(feed) = s.feed.filter(|_| fed) {
            let v = if ccw { feed } else { -feed };
            let a = -feed * feed / radius;
            values.extend([-v * sine, a * cosine, v * cosine, a * sine]);
        }
        let way = if ccw { 1.0 } else { -1.0 };
        values.extend([way * -sine.signum(), way * cosine.signum()]);
        for turn in [0.0, 0.5 * PI] {
            // from the turning point of the axis; before the first of a run there is another motion
            let since = (way * (s.angle - turn)).rem_euclid(PI);
            let is_known = since <= travelled;
            let of = |value: f64| if is_known { value } else { f64::NAN };
            values.push(of(radius * (1.0 - since.cos())));
            values.extend(s.feed.filter(|_| fed).map(|feed| of(since * radius / feed)));
        }
        rows.push(lines[i], "ballbar", &values);
    }
    let times = if fed { Times::Nominal } else { Times::Ordinal };
    let mut found = Measurement::new(rows, times, "circular test (angle, deviation, direction)");
    let ways = ways(samples.iter().map(|s| s.travel));
    let stated = |given: bool, option: &str| {
        if given { String::new() } else { format!(" (assumed; {option} states it)") }
    };
    found.note(format!("{}, {}, {ways}", counted(samples.len(), "reading"), counted(run as usize, "run")));
    if turning > 0 {
        let readings = counted(turning, "reading");
        found.note(format!("{readings} where an axis turns round left out: it goes neither way there"));
    }
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
    let mut table = table::open(path)?;
    let (angle, deviation, direction) =
        (table.require("angle_deg")?, table.require("deviation_um")?, table.require("direction")?);
    let (feed, run) = (table.find("feed_mm_per_min"), table.find("run"));
    table.only(&["angle_deg", "deviation_um", "direction", "feed_mm_per_min", "run"])?;
    let all = table.rows(|table| {
        let feed_mm_per_min = feed.map(|c| table.number(c)).transpose()?.or(args.feed_mm_per_min);
        if let (Some(bad), Some(c)) = (feed_mm_per_min.filter(|f| *f <= 0.0), feed) {
            return Err(table.fail(c, format_args!("{bad} is no feed; it is above 0 mm/min")));
        }
        let sample = Sample {
            angle: rad_from_deg(table.number(angle)?),
            deviation: mm_from_um(table.number(deviation)?),
            travel: table.travel(direction)?,
            feed: feed_mm_per_min.map(|f| f / 60.0),
            run: run.map_or(Ok(0), |c| table.count(c))?,
        };
        Ok((table.line(), sample))
    })?;
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
