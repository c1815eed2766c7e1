//! What is measured: some 7,700 readings in about nine hours.

use nalgebra::Vector3;

use super::course::{ALL, Circle, Course};
use super::machine::{NOSE_MM, TABLE_MM, TOOL_MM, TRAVEL_MM, on_table, reach};

/// The campaign begins so long after the log, s.
const BEGIN_S: f64 = 7700.0;
/// Speed of moves between readings, mm/s or deg/s.
const QUICK: f64 = 110.0;
/// Where the axes stand that do not move, mm.
const MIDDLE_MM: [f64; 3] = [45.0, 20.0, 205.0];
/// Where the tracker stands, mm.
const STATION_MM: [f64; 3] = [1250.0, -1700.0, 520.0];
/// Repetitions of each program.
const REPEATS: i64 = 2;

/// The whole campaign of a day.
#[must_use]
pub fn all(day: u64) -> Course {
    let mut c = Course::new(BEGIN_S, day);
    lines(&mut c, 1);
    flights(&mut c, 4);
    grid(&mut c, 7);
    loads(&mut c, 8);
    probe(&mut c, 9);
    table(&mut c, 10);
    // the axes run to and fro until they are warm
    c.work(1.0);
    c.wait(5200.0);
    lines(&mut c, 12);
    c.work(0.6);
    moves(&mut c, 15);
    circles(&mut c, 18);
    c.work(0.0);
    still(&mut c, 24);
    c
}

fn at(axis: usize, q: f64, elsewhere: [f64; 3]) -> [f64; 3] {
    let mut p = elsewhere;
    p[axis] = q;
    p
}

/// Where the laser's head stands: beyond the end of the axis, in line with the tip of the tool.
fn head(axis: usize) -> [f64; 3] {
    let [x, y, z] = at(axis, TRAVEL_MM[axis][0] - 240.0, MIDDLE_MM);
    [x + NOSE_MM[0], y + NOSE_MM[1], z + NOSE_MM[2] - TOOL_MM]
}

/// Laser at rest: the whole axis in unequal steps and a fine stretch, both ways.
fn lines(c: &mut Course, setup: i64) {
    for axis in 0..3 {
        c.mount("laser", setup + axis as i64);
        c.station(head(axis));
        let [low, high] = TRAVEL_MM[axis];
        let (low, high) = (low + 9.0, high - 9.0);
        // the golden section leaves no two steps alike
        let coarse: Vec<f64> = (0..38)
            .map(|k| {
                let shift = (k as f64 * 0.618_034).fract() - 0.5;
                let inner = if k == 0 || k == 37 { 0.0 } else { 0.7 * shift };
                low + (high - low) * (k as f64 + inner) / 37.0
            })
            .collect();
        let start = low + 0.41 * (high - low);
        let fine: Vec<f64> =
            (0..30).map(|k| start + 0.93 * k as f64 + 0.35 * (k as f64 * 0.618_034).fract()).collect();
        for targets in [coarse, fine] {
            let n = targets.len();
            let first = c.pairs(2 * n);
            for repeat in 1..=REPEATS {
                for up in [true, false] {
                    c.run(repeat);
                    let begin = if up { targets[0] - 6.0 } else { targets[n - 1] + 6.0 };
                    c.go(at(axis, begin, MIDDLE_MM), [0.0; 2], QUICK);
                    for i in 0..n {
                        let k = if up { i } else { n - 1 - i };
                        c.go(at(axis, targets[k], MIDDLE_MM), [0.0; 2], 40.0);
                        c.dwell(1.4, 3.2);
                        c.read(&[ALL[axis]], first + (k + if up { 0 } else { n }) as i64);
                    }
                }
                c.dwell(20.0, 60.0);
            }
        }
    }
}

/// Laser in flight: each axis over its travel at two feeds, both ways.
fn flights(c: &mut Course, setup: i64) {
    for axis in 0..3 {
        c.mount("laser-flight", setup + axis as i64);
        c.station(head(axis));
        let [low, high] = TRAVEL_MM[axis];
        let ends = [low + 14.0, high - 14.0];
        for speed in [22.0, 95.0] {
            let n = 11;
            let first = c.pairs(2 * n);
            let seconds = (ends[1] - ends[0]) / speed;
            let times: Vec<f64> = (0..n)
                .map(|k| seconds * (0.1 + 0.8 * (k as f64 + 0.25 * (k as f64 * 2.1).cos()) / (n - 1) as f64))
                .collect();
            for repeat in 1..=REPEATS {
                for (way, [from, to]) in [[ends[0], ends[1]], [ends[1], ends[0]]].into_iter().enumerate() {
                    c.go(at(axis, from, MIDDLE_MM), [0.0; 2], QUICK);
                    c.dwell(1.0, 2.0);
                    c.run(repeat);
                    c.glide(axis, to, [speed, 0.4], &times, &[ALL[axis]], first + (way * n) as i64);
                }
            }
        }
    }
}

/// A tracker over a grid of unequal steps, two tools in one mounting.
fn grid(c: &mut Course, setup: i64) {
    // no two places of X alike: what is even about the middle must not hide
    const X_MM: [f64; 5] = [-270.0, -160.0, -35.0, 120.0, 345.0];
    const Y_MM: [f64; 4] = [-215.0, -60.0, 95.0, 270.0];
    const Z_MM: [f64; 3] = [15.0, 190.0, 430.0];
    const POINTS: usize = X_MM.len() * Y_MM.len() * Z_MM.len();
    c.mount("tracker", setup);
    c.station(STATION_MM);
    let first = c.pairs(2 * POINTS);
    for repeat in 1..=REPEATS {
        for (t, tool) in [75.0, 205.0].into_iter().enumerate() {
            c.tool(tool);
            c.dwell(40.0, 80.0);
            // every pass comes from the same corner
            c.go([-285.0, -228.0, 2.0], [0.0; 2], QUICK);
            c.run(repeat);
            for m in 0..POINTS {
                // Z to and fro inside, then X, then Y
                let (layer, row, column) = (m / 15, (m / 3) % 5, m % 3);
                let row = if layer % 2 == 1 { 4 - row } else { row };
                let column = if (m / 3) % 2 == 1 { 2 - column } else { column };
                let p = [X_MM[row], Y_MM[layer], Z_MM[column]];
                c.go(p, [0.0; 2], QUICK);
                c.dwell(1.2, 2.6);
                c.read(&ALL, first + (POINTS * t + m) as i64);
            }
        }
    }
    c.tool(TOOL_MM);
}

/// Forces in steps along each axis.
fn loads(c: &mut Course, setup: i64) {
    const STEPS: [f64; 13] =
        [0.0, 250.0, 700.0, 1250.0, 500.0, 150.0, -300.0, -950.0, -1300.0, -600.0, 900.0, -200.0, 0.0];
    c.mount("load", setup);
    c.go([60.0, -30.0, 160.0], [0.0; 2], QUICK);
    let first = c.pairs(39);
    for repeat in 1..=REPEATS {
        for axis in 0..3 {
            c.run(repeat);
            for (k, step) in STEPS.into_iter().enumerate() {
                let mut force = [0.0; 3];
                force[axis] = step;
                c.force(force);
                c.dwell(4.0, 11.0);
                c.read(&ALL, first + (13 * axis + k) as i64);
            }
            c.force([0.0; 3]);
        }
        c.wait(500.0);
    }
}

/// One point while the spindle runs, rests and runs faster, twice.
fn probe(c: &mut Course, setup: i64) {
    c.mount("probe", setup);
    c.go([20.0, 35.0, 90.0], [0.0; 2], QUICK);
    let n = 54;
    let first = c.pairs(n);
    for repeat in 1..=REPEATS {
        c.run(repeat);
        for k in 0..n {
            c.spin(match k {
                0..5 => 0.0,
                5..19 => 5500.0,
                19..31 => 0.0,
                31..44 => 8500.0,
                _ => 0.0,
            });
            c.dwell(48.0, 75.0);
            c.read(&ALL, first + k as i64);
        }
        c.spin(0.0);
        c.wait(7000.0);
    }
}

/// R-test: the tool stays at a ball while table and swivel turn; two balls.
fn table(c: &mut Course, setup: i64) {
    let balls = [
        ([88.0, 12.0, 115.0], &[-72.0, -38.0, 0.0, 21.0][..]),
        ([-30.0, 132.0, 98.0], &[-55.0, -12.0, 28.0][..]),
    ];
    let n = 12;
    for (ball, (from_axis, tilts)) in balls.into_iter().enumerate() {
        c.mount("rtest", setup + ball as i64);
        let home = Vector3::from(TABLE_MM) + Vector3::from(from_axis);
        c.target(Some(home.into()));
        let first = c.pairs(2 * n * tilts.len());
        for repeat in 1..=REPEATS {
            for up in [true, false] {
                for i in 0..tilts.len() {
                    c.run(repeat);
                    let tilt = if up { i } else { tilts.len() - 1 - i };
                    let follow = |c: &mut Course, a: f64, deg: f64| {
                        let turn = [a.to_radians(), deg.to_radians()];
                        c.go(reach(on_table(turn, home), TOOL_MM), turn, 45.0);
                    };
                    // from beyond the end, so that swivel and table come from one side
                    let beyond = if up { -5.0 } else { 5.0 };
                    let edge = if up { -180.0 } else { 180.0 };
                    follow(c, tilts[tilt] + beyond, edge + beyond);
                    for j in 0..n {
                        let k = if up { j } else { n - 1 - j };
                        let deg = -174.0 + 31.0 * k as f64 + 5.0 * (k as f64 * 2.3).sin();
                        follow(c, tilts[tilt], deg);
                        c.dwell(1.5, 4.0);
                        let pair = (tilt * n + k) + if up { 0 } else { n * tilts.len() };
                        c.read(&ALL, first + pair as i64);
                    }
                }
            }
        }
        c.target(None);
        c.go(MIDDLE_MM, [0.0; 2], 45.0);
    }
}

/// Starts and stops of each axis at two speeds, at two places of the others.
fn moves(c: &mut Course, setup: i64) {
    for (axis, [low, high]) in TRAVEL_MM.into_iter().enumerate() {
        c.mount("dynamic", setup + axis as i64);
        let elsewhere = [MIDDLE_MM, [-180.0, 190.0, 370.0]];
        for ([speed, ramp], place) in [([65.0, 0.26], elsewhere[0]), ([170.0, 0.36], elsewhere[1])] {
            let ends = [low + 70.0, low + 70.0 + (high - low) * 0.55];
            let seconds = (ends[1] - ends[0]) / speed + ramp;
            // ramps, the way between them, and the stop
            let ramps = [0.15, 0.3, 0.5, 0.7, 0.9].map(|s| s * ramp);
            let mut times: Vec<f64> = ramps.to_vec();
            times.extend([0.35, 0.6].map(|s| s * seconds));
            times.extend(ramps.iter().rev().map(|s| seconds - s));
            times.extend([0.03, 0.09, 0.2].map(|s| seconds + s));
            let n = times.len();
            let first = c.pairs(2 * n);
            for repeat in 1..=REPEATS {
                for (way, [from, to]) in [[ends[0], ends[1]], [ends[1], ends[0]]].into_iter().enumerate() {
                    c.go(at(axis, from, place), [0.0; 2], QUICK);
                    c.dwell(1.0, 2.5);
                    c.run(repeat);
                    c.glide(axis, to, [speed, ramp], &times, &ALL, first + (way * n) as i64);
                }
            }
        }
    }
}

/// Circles in three planes at two places, two feeds each, both senses.
fn circles(c: &mut Course, setup: i64) {
    for (n, plane) in [[0, 1], [1, 2], [2, 0]].into_iter().enumerate() {
        let places = [
            ([40.0, 30.0, 215.0], 150.0, [14.0, 85.0], 56),
            ([225.0, -110.0, 330.0], 80.0, [24.0, 60.0], 36),
        ];
        for (m, (centre, radius, feeds, count)) in places.into_iter().enumerate() {
            c.mount("ballbar", setup + 2 * n as i64 + m as i64);
            for feed in feeds {
                let first = c.pairs(2 * count);
                for repeat in 1..=REPEATS {
                    for (way, sense) in [1.0, -1.0].into_iter().enumerate() {
                        c.run(repeat);
                        let circle = Circle { plane, centre, radius, feed: sense * feed, count };
                        c.circle(&circle, first + (way * count) as i64);
                        c.dwell(2.0, 6.0);
                    }
                }
            }
        }
    }
}

/// A fast capture at rest.
fn still(c: &mut Course, setup: i64) {
    c.mount("capture", setup);
    c.go(MIDDLE_MM, [0.0; 2], QUICK);
    let n = 72;
    let first = c.pairs(n);
    for repeat in 1..=REPEATS {
        c.dwell(3.0, 8.0);
        c.run(repeat);
        c.capture(190.0, n, first);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn the_campaign_has_its_size_and_every_point_is_repeated() {
        let course = all(3);
        assert!((7000..=8000).contains(&course.rows.len()), "{}", course.rows.len());
        assert!(course.rows.windows(2).all(|w| w[1].t_s >= w[0].t_s));
        let mut pairs: BTreeMap<i64, Vec<&super::super::Row>> = BTreeMap::new();
        for r in &course.rows {
            pairs.entry(r.place[3]).or_default().push(r);
        }
        for rows in pairs.values() {
            let first = rows[0];
            assert!(rows.iter().any(|r| r.place[2] != first.place[2]));
            for r in rows {
                let apart: f64 = (0..3).map(|k| (r.position[k] - first.position[k]).abs()).sum();
                assert!(apart < 1e-6 && r.tool_mm == first.tool_mm, "{r:?} {first:?}");
                assert_eq!(r.direction, first.direction, "{r:?} {first:?}");
            }
        }
        for r in &course.rows {
            for (q, [low, high]) in r.position.into_iter().zip(TRAVEL_MM) {
                assert!(q >= low && q <= high, "{r:?}");
            }
        }
    }
}
