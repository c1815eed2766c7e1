//! What sensors send, as bytes: JSON lines and binary messages, on one connection as they come.
//!
//! Byte by byte in `docs/how-to/sensors.md`. Nothing a sensor sends can stop the daemon: what is no message costs itself, and
//! is answered with a sentence; only a binary message whose check sum is wrong ends the connection, for nobody knows
//! where the next one begins.

use nalgebra::Matrix6;
use serde::Deserialize;

use volcomp_estimate::fivedof::Readings;
use volcomp_estimate::live::{Body, PointReading, Reading, Seen, ToolReading};
use volcomp_estimate::{Kind, VALUES_MAX};
use volcomp_model::geometry::Vec3;
use volcomp_units::{NS_PER_S, mm_from_um, rad_from_arcsec};

/// Longest JSON line and longest binary message, bytes.
pub(super) const MESSAGE_MAX: usize = 64 * 1024;
/// Most points in one message.
const POINTS_MAX: usize = 500;
/// Largest difference of a covariance from its mirror image, as a share of the two standard deviations: rounding.
const SYMMETRY: f64 = 1e-6;
/// Largest difference of the length of a unit vector from 1.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Longest piece of a line that an answer quotes, bytes.
const QUOTE_MAX: usize = 20;
/// Begin of a binary message.
const MAGIC: [u8; 4] = *b"VCS1";
/// Bytes before the name.
const HEAD: usize = 20;

/// What is wrong with a message.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum WireError {
    /// No JSON, or keys that do not belong there.
    #[error("line {line}: {text}")]
    Line {
        /// Number of the line on this connection.
        line: u64,
        /// What is wrong.
        text: String,
    },
    /// A binary message that says nothing.
    #[error("binary message of kind {kind}: {text}")]
    Binary {
        /// Its kind.
        kind: u8,
        /// What is wrong.
        text: String,
    },
    /// The stream cannot be followed any more.
    #[error("{0}; the connection is closed")]
    Lost(String),
}

impl WireError {
    /// True where the connection must end.
    pub(super) const fn is_fatal(&self) -> bool {
        matches!(self, Self::Lost(_))
    }
}

/// What a sensor says.
#[expect(
    clippy::large_enum_variant,
    reason = "one at a time, on the stack; a box would allocate for every reading"
)]
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Heard {
    /// A reading.
    Reading(Said),
    /// It asks to be told when all that it said before is with the estimator; the number comes back.
    Sync(u64),
}

/// A reading and whose it is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Said {
    /// Name of the sensor.
    pub(super) sensor: String,
    pub(super) reading: Reading,
}

/// Bytes to messages.
#[derive(Debug, Default)]
pub(super) struct Stream {
    bytes: Vec<u8>,
    lines: u64,
}

impl Stream {
    /// More bytes have come.
    pub(super) fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next message, or what is wrong with it; `None` until there are more bytes.
    pub(super) fn next(&mut self) -> Option<Result<Heard, WireError>> {
        loop {
            let first = *self.bytes.first()?;
            if first == MAGIC[0] {
                return self.binary().map(|said| said.map(Heard::Reading));
            }
            let end = self.bytes.iter().position(|b| *b == b'\n');
            // the same wherever the line was cut on its way
            if end.unwrap_or(self.bytes.len()) > MESSAGE_MAX {
                return Some(Err(WireError::Lost(format!("a line is longer than {MESSAGE_MAX} bytes"))));
            }
            let end = end?;
            let line: Vec<u8> = self.bytes.drain(..=end).collect();
            self.lines += 1;
            let text = line.trim_ascii();
            if text.is_empty() || text.starts_with(b"#") {
                continue;
            }
            let number = self.lines;
            return Some(parse_line(text).map_err(|text| WireError::Line { line: number, text }));
        }
    }

    fn binary(&mut self) -> Option<Result<Said, WireError>> {
        let head = self.bytes.get(..HEAD)?;
        if head[..4] != MAGIC {
            let begin = head[..4].escape_ascii();
            let text = format!("\"{begin}\" begins neither a JSON line nor a binary message (VCS1)");
            return Some(Err(WireError::Lost(text)));
        }
        let (kind, name) = (head[4], usize::from(head[5]));
        let count = usize::from(u16::from_le_bytes([head[6], head[7]]));
        let length = HEAD + name + 8 * count + 4;
        if length > MESSAGE_MAX {
            let text = format!("a binary message has {length} bytes, {MESSAGE_MAX} at most are taken");
            return Some(Err(WireError::Lost(text)));
        }
        if self.bytes.len() < length {
            return None;
        }
        let message: Vec<u8> = self.bytes.drain(..length).collect();
        let (content, sum) = message.split_at(length - 4);
        if crc32c::crc32c(content).to_le_bytes() != sum {
            return Some(Err(WireError::Lost("the check sum of a binary message is wrong".to_owned())));
        }
        let wrong = |text| WireError::Binary { kind, text };
        let Ok(sensor) = core::str::from_utf8(&content[HEAD..HEAD + name]) else {
            let name = content[HEAD..HEAD + name].escape_ascii();
            return Some(Err(wrong(format!("the name \"{name}\" is not UTF-8"))));
        };
        let numbers: Vec<f64> = content[HEAD + name..]
            .chunks_exact(8)
            .map(|b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]))
            .collect();
        let stamp_ns = i64::from_le_bytes(core::array::from_fn(|k| content[8 + k]));
        let quality = f64::from(f32::from_le_bytes(core::array::from_fn(|k| content[16 + k])));
        let body = share(quality).and_then(|_| binary_body(kind, &numbers)).map_err(wrong);
        let sensor = sensor.to_owned();
        Some(body.map(|body| Said { sensor, reading: Reading { stamp_ns, quality, body } }))
    }
}

fn vector(v: &[f64]) -> Vec3 {
    Vec3::new(v[0], v[1], v[2])
}

fn binary_body(kind: u8, n: &[f64]) -> Result<Body, String> {
    let seen = |absolute: bool, v: Vec3| if absolute { Seen::Absolute(v) } else { Seen::Deviation(v) };
    match kind {
        1 | 2 => {
            if n.len() != 6 && n.len() != 42 {
                return Err(format!("it has {} numbers, 6 or 42 are needed", n.len()));
            }
            let direction = if n[3..6].iter().all(|v| v.is_nan()) {
                finite(n, |k| !(3..6).contains(&k))?;
                None
            } else {
                finite(n, |_| true)?;
                let direction = vector(&n[3..6]);
                Some(seen(kind == 1, if kind == 1 { unit("the direction", direction)? } else { direction }))
            };
            let covariance = n.get(6..42).map(Matrix6::from_row_slice);
            if let Some(covariance) = &covariance {
                symmetric(covariance, |i, j| covariance[(i, j)])?;
            }
            Ok(Body::Tool(ToolReading { tip: seen(kind == 1, vector(n)), direction, covariance }))
        }
        3 | 4 => {
            if n.is_empty() || !n.len().is_multiple_of(7) || n.len() > 7 * POINTS_MAX {
                return Err(format!(
                    "it has {} numbers, 7 for each of 1 to {POINTS_MAX} points are needed",
                    n.len()
                ));
            }
            finite(n, |_| true)?;
            let point = |p: &[f64]| {
                Ok(PointReading {
                    offset: vector(p),
                    position: seen(kind == 3, vector(&p[3..])),
                    std: stated("the standard deviation", p[6])?,
                })
            };
            Ok(Body::Points(n.chunks_exact(7).map(point).collect::<Result<_, String>>()?))
        }
        5 => {
            let [x, y, z, value, std] = fixed(n)?;
            let direction = unit("the direction", Vec3::new(x, y, z))?;
            Ok(Body::Deviation { direction, value, std: stated("the standard deviation", std)? })
        }
        6 => Ok(Body::FiveDof(fixed(n)?)),
        7 => {
            let [distance, c @ ..] = fixed::<11>(n)?;
            Ok(Body::FiveDofRaw(Readings {
                distance: ahead("the distance", distance)?,
                change: core::array::from_fn(|d| [c[2 * d], c[2 * d + 1]]),
            }))
        }
        8 => Ok(Body::Value { value: fixed::<1>(n)?[0], unit: None }),
        9 => {
            finite(n, |_| true)?;
            counted("it", n.len(), VALUES_MAX)?;
            Ok(Body::Temperatures(n.to_vec()))
        }
        10 => Ok(Body::Speed(fixed::<1>(n)?[0])),
        _ => Err("this kind is not known, 1 to 10 are".to_owned()),
    }
}

/// Whether the numbers at the places that are looked at are finite.
fn finite(n: &[f64], looked_at: impl Fn(usize) -> bool) -> Result<(), String> {
    match n.iter().enumerate().find(|(k, v)| looked_at(*k) && !v.is_finite()) {
        Some((k, v)) => Err(format!("number {} is {v}, which is not finite", k + 1)),
        None => Ok(()),
    }
}

fn fixed<const N: usize>(n: &[f64]) -> Result<[f64; N], String> {
    finite(n, |_| true)?;
    numbers("it", n)
}

/// As many numbers as are needed.
fn numbers<const N: usize>(what: &str, n: &[f64]) -> Result<[f64; N], String> {
    <[f64; N]>::try_from(n).map_err(|_| match n.len() {
        1 => format!("{what} has 1 number, {N} are needed"),
        count => format!("{what} has {count} numbers, {N} {} needed", if N == 1 { "is" } else { "are" }),
    })
}

fn share(quality: f64) -> Result<f64, String> {
    if (0.0..=1.0).contains(&quality) {
        return Ok(quality);
    }
    Err(format!("quality is {quality}, 0 (unusable) to 1 (best) is taken"))
}

/// A stated standard deviation; 0 states none.
fn stated(what: &str, std: f64) -> Result<Option<f64>, String> {
    if std < 0.0 {
        return Err(format!("{what} is {std}, 0 (not stated) or more is taken"));
    }
    Ok((std > 0.0).then_some(std))
}

/// The distance from a laser head to its carriage, mm.
fn ahead(what: &str, distance: f64) -> Result<f64, String> {
    if distance > 0.0 {
        return Ok(distance);
    }
    Err(format!("{what} is {distance} mm; from the head to the carriage it is above 0"))
}

/// Whether no number of a covariance differs from its mirror image by more than rounding; `said`: a number as it was sent.
fn symmetric(c: &Matrix6<f64>, said: impl Fn(usize, usize) -> f64) -> Result<(), String> {
    let pairs = (0..6).flat_map(|i| (0..i).map(move |j| (i, j)));
    let differs = |(i, j)| (c[(i, j)] - c[(j, i)]).abs() > SYMMETRY * (c[(i, i)] * c[(j, j)]).abs().sqrt();
    let Some((i, j)) = pairs.into_iter().find(|at| differs(*at)) else { return Ok(()) };
    let (row, column, a, b) = (i + 1, j + 1, said(i, j), said(j, i));
    Err(format!(
        "covariance is not symmetric: row {row}, column {column} is {a}, and row {column}, column {row} is {b}"
    ))
}

fn unit(what: &str, v: Vec3) -> Result<Vec3, String> {
    let length = v.norm();
    if (length - 1.0).abs() < UNIT_TOLERANCE {
        return Ok(v.normalize());
    }
    let [x, y, z] = [v.x, v.y, v.z];
    Err(format!(
        "{what} [{x}, {y}, {z}] has the length {length:.4}; a unit vector is needed, within {UNIT_TOLERANCE}"
    ))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    sensor: String,
    t_s: Option<f64>,
    t_ns: Option<i64>,
    quality: Option<f64>,
    pose: Option<Pose>,
    points: Option<Vec<Point>>,
    circles: Option<Vec<Circle>>,
    deviation: Option<Deviation>,
    probe: Option<Deviation>,
    five_dof: Option<FiveDof>,
    five_dof_raw: Option<Raw>,
    value_um: Option<f64>,
    value_arcsec: Option<f64>,
    temperature_degc: Option<Vec<f64>>,
    speed_rpm: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pose {
    tip_mm: Option<Vec<f64>>,
    tip_deviation_um: Option<Vec<f64>>,
    direction: Option<Vec<f64>>,
    direction_deviation_arcsec: Option<Vec<f64>>,
    /// Tip in um, direction in arcsec, row by row.
    covariance: Option<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Point {
    offset_mm: Vec<f64>,
    position_mm: Option<Vec<f64>>,
    deviation_um: Option<Vec<f64>>,
    std_um: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Circle {
    /// Centre of the circle on the tool's axis of rotation, from the tip towards the spindle.
    height_mm: f64,
    centre_mm: Vec<f64>,
    std_um: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Deviation {
    direction: Vec<f64>,
    value_um: f64,
    std_um: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FiveDof {
    ey_um: f64,
    ez_um: f64,
    ea_arcsec: f64,
    eb_arcsec: f64,
    ec_arcsec: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    distance_mm: f64,
    psd1_um: Vec<f64>,
    psd2_um: Vec<f64>,
    psd3_um: Vec<f64>,
    qd1_um: Vec<f64>,
    qd2_um: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sync {
    sync: u64,
}

fn parse_line(text: &[u8]) -> Result<Heard, String> {
    match serde_json::from_slice(text) {
        Ok(line) => reading_of(line).map(Heard::Reading),
        Err(problem) => match serde_json::from_slice(text) {
            Ok(Sync { sync }) => Ok(Heard::Sync(sync)),
            Err(_) => Err(in_words(&problem, text)),
        },
    }
}

/// What is wrong with a line, where, and what stands there; the number of the line is that of the connection.
fn in_words(problem: &serde_json::Error, line: &[u8]) -> String {
    let (full, column) = (problem.to_string(), problem.column());
    let place = format!(" at line {} column {column}", problem.line());
    let what = full.strip_suffix(&place).unwrap_or(&full);
    let is_word = |b: &u8| b.is_ascii_alphanumeric() || b"+-._".contains(b);
    let at = column.saturating_sub(1).min(line.len());
    let begin = line[..at].iter().rposition(|b| !is_word(b)).map_or(0, |k| k + 1);
    let word = line[begin..].iter().take_while(|b| is_word(b)).take(QUOTE_MAX).count();
    let found = String::from_utf8_lossy(&line[begin..begin + word]);
    let is_about_a_word = what.starts_with("expected") || what.contains("number");
    if !problem.is_syntax() || !is_about_a_word || found.is_empty() {
        return format!("column {column}: {what}");
    }
    let remedy = if ["nan", "inf"].iter().any(|name| found.to_ascii_lowercase().contains(name)) {
        "; JSON has finite numbers only"
    } else {
        ""
    };
    format!("column {column}: {what}, found `{found}`{remedy}")
}

fn reading_of(line: Line) -> Result<Said, String> {
    let stamp_ns = match (line.t_ns, line.t_s) {
        (Some(ns), None) => ns,
        (None, Some(s)) if s.is_finite() => (s * NS_PER_S) as i64,
        _ => return Err("write either t_s or t_ns, the time of the reading on the sensor's clock".to_owned()),
    };
    let sensor = line.sensor.clone();
    let quality = share(line.quality.unwrap_or(1.0))?;
    let mut bodies = bodies_of(line)?;
    match (bodies.pop(), bodies.is_empty()) {
        (Some(body), true) => Ok(Said { sensor, reading: Reading { stamp_ns, quality, body } }),
        _ => Err("write exactly one of pose, points, circles, deviation, probe, five_dof, five_dof_raw, value_um, \
                  value_arcsec, temperature_degc, speed_rpm"
            .to_owned()),
    }
}

fn bodies_of(line: Line) -> Result<Vec<Body>, String> {
    let mut bodies = Vec::new();
    if let Some(pose) = line.pose {
        bodies.push(Body::Tool(tool(&pose)?));
    }
    if let Some(points) = line.points {
        counted("points", points.len(), POINTS_MAX)?;
        let points: Result<Vec<_>, String> = points
            .iter()
            .map(|p| {
                let absolute = given("position_mm", p.position_mm.as_deref())?;
                let deviation = given("deviation_um", p.deviation_um.as_deref())?.map(|v| v / 1e3);
                let position =
                    one_of(absolute, deviation).ok_or("a point has either position_mm or deviation_um")?;
                let std = std_of(p.std_um)?;
                Ok(PointReading { offset: three("offset_mm", &p.offset_mm)?, position, std })
            })
            .collect();
        bodies.push(Body::Points(points?));
    }
    if let Some(circles) = line.circles {
        counted("circles", circles.len(), POINTS_MAX)?;
        let centre = |c: &Circle| {
            Ok(PointReading {
                offset: Vec3::new(0.0, 0.0, c.height_mm),
                position: Seen::Absolute(three("centre_mm", &c.centre_mm)?),
                std: std_of(c.std_um)?,
            })
        };
        bodies.push(Body::Points(circles.iter().map(centre).collect::<Result<_, String>>()?));
    }
    for d in line.deviation.iter().chain(&line.probe) {
        let direction = unit("direction", three("direction", &d.direction)?)?;
        let std = std_of(d.std_um)?;
        bodies.push(Body::Deviation { direction, value: mm_from_um(d.value_um), std });
    }
    if let Some(f) = line.five_dof {
        let [a, b, c] = [f.ea_arcsec, f.eb_arcsec, f.ec_arcsec].map(rad_from_arcsec);
        bodies.push(Body::FiveDof([mm_from_um(f.ey_um), mm_from_um(f.ez_um), a, b, c]));
    }
    if let Some(r) = line.five_dof_raw {
        let pair = |what, um: &[f64]| Ok::<_, String>(numbers::<2>(what, um)?.map(mm_from_um));
        let change = [
            pair("psd1_um", &r.psd1_um)?,
            pair("psd2_um", &r.psd2_um)?,
            pair("psd3_um", &r.psd3_um)?,
            pair("qd1_um", &r.qd1_um)?,
            pair("qd2_um", &r.qd2_um)?,
        ];
        let distance = ahead("distance_mm", r.distance_mm)?;
        bodies.push(Body::FiveDofRaw(Readings { distance, change }));
    }
    let value = |value: f64, unit: Kind| Body::Value { value, unit: Some(unit) };
    bodies.extend(line.value_um.map(|v| value(mm_from_um(v), Kind::Length)));
    bodies.extend(line.value_arcsec.map(|v| value(rad_from_arcsec(v), Kind::Angle)));
    if let Some(list) = line.temperature_degc {
        counted("temperature_degc", list.len(), VALUES_MAX)?;
        bodies.push(Body::Temperatures(list));
    }
    bodies.extend(line.speed_rpm.map(Body::Speed));
    Ok(bodies)
}

/// A stated noise, mm; 0 states none.
fn std_of(um: Option<f64>) -> Result<Option<f64>, String> {
    Ok(stated("std_um", um.unwrap_or(0.0))?.map(mm_from_um))
}

fn three(what: &str, list: &[f64]) -> Result<Vec3, String> {
    numbers::<3>(what, list).map(Vec3::from)
}

/// Three numbers, where they are there.
fn given(what: &str, list: Option<&[f64]>) -> Result<Option<Vec3>, String> {
    list.map(|list| three(what, list)).transpose()
}

/// A list must say something, and no more than is taken.
fn counted(key: &str, found: usize, most: usize) -> Result<(), String> {
    if (1..=most).contains(&found) {
        Ok(())
    } else {
        Err(format!("{key} has {found} entries, 1 to {most} are taken"))
    }
}

fn one_of(absolute: Option<Vec3>, deviation: Option<Vec3>) -> Option<Seen> {
    match (absolute, deviation) {
        (Some(v), None) => Some(Seen::Absolute(v)),
        (None, Some(v)) => Some(Seen::Deviation(v)),
        _ => None,
    }
}

fn tool(pose: &Pose) -> Result<ToolReading, String> {
    let deviation = given("tip_deviation_um", pose.tip_deviation_um.as_deref())?.map(|v| v / 1e3);
    let tip = one_of(given("tip_mm", pose.tip_mm.as_deref())?, deviation)
        .ok_or("a pose has either tip_mm or tip_deviation_um")?;
    let turned = given("direction_deviation_arcsec", pose.direction_deviation_arcsec.as_deref())?;
    let turned = turned.map(|v| v.map(rad_from_arcsec));
    let absolute = given("direction", pose.direction.as_deref())?;
    let absolute = absolute.map(|v| unit("direction", v)).transpose()?;
    let direction = match (absolute, turned) {
        (None, None) => None,
        (a, d) => Some(one_of(a, d).ok_or("a pose has either direction or direction_deviation_arcsec")?),
    };
    let covariance = match &pose.covariance {
        None => None,
        Some(list) if list.len() == 36 => {
            let unit = |k: usize| if k < 3 { mm_from_um(1.0) } else { rad_from_arcsec(1.0) };
            let covariance = Matrix6::from_fn(|i, j| list[6 * i + j] * unit(i) * unit(j));
            symmetric(&covariance, |i, j| list[6 * i + j])?;
            Some(covariance)
        }
        Some(list) => return Err(format!("covariance has {} numbers, 36 are needed", list.len())),
    };
    Ok(ToolReading { tip, direction, covariance })
}

#[cfg(test)]
mod tests;
