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
        text: &'static str,
    },
    /// The stream cannot be followed any more.
    #[error("{0}; the connection is closed")]
    Lost(&'static str),
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
                return Some(Err(WireError::Lost("a line has no end")));
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
            return Some(Err(WireError::Lost("neither a JSON line nor a binary message")));
        }
        let (kind, name) = (head[4], usize::from(head[5]));
        let count = usize::from(u16::from_le_bytes([head[6], head[7]]));
        let length = HEAD + name + 8 * count + 4;
        if length > MESSAGE_MAX {
            return Some(Err(WireError::Lost("a binary message is too long")));
        }
        if self.bytes.len() < length {
            return None;
        }
        let message: Vec<u8> = self.bytes.drain(..length).collect();
        let (content, sum) = message.split_at(length - 4);
        if crc32c::crc32c(content).to_le_bytes() != sum {
            return Some(Err(WireError::Lost("the check sum of a binary message is wrong")));
        }
        let wrong = |text| WireError::Binary { kind, text };
        let Ok(sensor) = core::str::from_utf8(&content[HEAD..HEAD + name]) else {
            return Some(Err(wrong("the name is not UTF-8")));
        };
        let numbers: Vec<f64> = content[HEAD + name..]
            .chunks_exact(8)
            .map(|b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]))
            .collect();
        let stamp_ns = i64::from_le_bytes(core::array::from_fn(|k| content[8 + k]));
        let quality = f64::from(f32::from_le_bytes(core::array::from_fn(|k| content[16 + k])));
        if !is_share(quality) {
            return Some(Err(wrong("the quality is not from 0 to 1")));
        }
        let body = binary_body(kind, &numbers).map_err(wrong);
        let sensor = sensor.to_owned();
        Some(body.map(|body| Said { sensor, reading: Reading { stamp_ns, quality, body } }))
    }
}

fn vector(v: &[f64]) -> Vec3 {
    Vec3::new(v[0], v[1], v[2])
}

fn binary_body(kind: u8, n: &[f64]) -> Result<Body, &'static str> {
    let seen = |absolute: bool, v: Vec3| if absolute { Seen::Absolute(v) } else { Seen::Deviation(v) };
    match kind {
        1 | 2 => {
            if n.len() != 6 && n.len() != 42 {
                return Err("6 or 42 numbers are needed");
            }
            finite(&n[..3])?;
            finite(&n[6..])?;
            let direction = if n[3..6].iter().all(|v| v.is_nan()) {
                None
            } else {
                finite(&n[3..6])?;
                let direction = vector(&n[3..6]);
                Some(seen(kind == 1, if kind == 1 { unit(direction)? } else { direction }))
            };
            let covariance = n.get(6..42).map(Matrix6::from_row_slice);
            if covariance.is_some_and(|c| asymmetry(&c).is_some()) {
                return Err("the covariance is not symmetric");
            }
            Ok(Body::Tool(ToolReading { tip: seen(kind == 1, vector(n)), direction, covariance }))
        }
        3 | 4 => {
            if n.is_empty() || !n.len().is_multiple_of(7) || n.len() > 7 * POINTS_MAX {
                return Err("7 numbers per point are needed, of 1 to 500 points");
            }
            finite(n)?;
            if n.chunks_exact(7).any(|p| p[6] < 0.0) {
                return Err("a standard deviation is below 0");
            }
            let point = |p: &[f64]| PointReading {
                offset: vector(p),
                position: seen(kind == 3, vector(&p[3..])),
                std: (p[6] > 0.0).then_some(p[6]),
            };
            Ok(Body::Points(n.chunks_exact(7).map(point).collect()))
        }
        5 => {
            let [x, y, z, value, std] = fixed(n)?;
            let direction = unit(Vec3::new(x, y, z))?;
            if std < 0.0 {
                return Err("a standard deviation is below 0");
            }
            Ok(Body::Deviation { direction, value, std: (std > 0.0).then_some(std) })
        }
        6 => Ok(Body::FiveDof(fixed(n)?)),
        7 => {
            let [distance, c @ ..] = fixed::<11>(n)?;
            Ok(Body::FiveDofRaw(Readings {
                distance,
                change: core::array::from_fn(|d| [c[2 * d], c[2 * d + 1]]),
            }))
        }
        8 => Ok(Body::Value { value: fixed::<1>(n)?[0], unit: None }),
        9 => {
            finite(n)?;
            if n.is_empty() || n.len() > VALUES_MAX {
                return Err("1 to 16 temperatures are taken");
            }
            Ok(Body::Temperatures(n.to_vec()))
        }
        10 => Ok(Body::Speed(fixed::<1>(n)?[0])),
        _ => Err("this kind is not known"),
    }
}

fn finite(n: &[f64]) -> Result<(), &'static str> {
    if n.iter().all(|v| v.is_finite()) { Ok(()) } else { Err("a number is not finite") }
}

fn fixed<const N: usize>(n: &[f64]) -> Result<[f64; N], &'static str> {
    finite(n)?;
    <[f64; N]>::try_from(n).map_err(|_| "another number of numbers is needed")
}

fn is_share(quality: f64) -> bool {
    (0.0..=1.0).contains(&quality)
}

/// Row and column, from 1, of a number that differs from its mirror image by more than rounding.
fn asymmetry(c: &Matrix6<f64>) -> Option<(usize, usize)> {
    let pairs = (0..6).flat_map(|i| (0..i).map(move |j| (i, j)));
    let differs = |(i, j)| (c[(i, j)] - c[(j, i)]).abs() > SYMMETRY * (c[(i, i)] * c[(j, j)]).abs().sqrt();
    pairs.into_iter().find(|at| differs(*at)).map(|(i, j)| (i + 1, j + 1))
}

fn unit(v: Vec3) -> Result<Vec3, &'static str> {
    if (v.norm() - 1.0).abs() < 1e-3 { Ok(v.normalize()) } else { Err("the direction is not a unit vector") }
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
    tip_mm: Option<[f64; 3]>,
    tip_deviation_um: Option<[f64; 3]>,
    direction: Option<[f64; 3]>,
    direction_deviation_arcsec: Option<[f64; 3]>,
    /// Tip in um, direction in arcsec, row by row.
    covariance: Option<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Point {
    offset_mm: [f64; 3],
    position_mm: Option<[f64; 3]>,
    deviation_um: Option<[f64; 3]>,
    std_um: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Circle {
    /// Centre of the circle on the tool's axis of rotation, from the tip towards the spindle.
    height_mm: f64,
    centre_mm: [f64; 3],
    std_um: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Deviation {
    direction: [f64; 3],
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
    psd1_um: [f64; 2],
    psd2_um: [f64; 2],
    psd3_um: [f64; 2],
    qd1_um: [f64; 2],
    qd2_um: [f64; 2],
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
            Err(_) => Err(problem.to_string()),
        },
    }
}

fn reading_of(line: Line) -> Result<Said, String> {
    let stamp_ns = match (line.t_ns, line.t_s) {
        (Some(ns), None) => ns,
        (None, Some(s)) if s.is_finite() => (s * NS_PER_S) as i64,
        _ => return Err("write either t_s or t_ns, the time of the reading on the sensor's clock".to_owned()),
    };
    let sensor = line.sensor.clone();
    let quality = line.quality.unwrap_or(1.0);
    if !is_share(quality) {
        return Err(format!("quality is {quality}, 0 (unusable) to 1 (best) is taken"));
    }
    let mut bodies = bodies_of(line)?;
    match (bodies.pop(), bodies.is_empty()) {
        (Some(body), true) => Ok(Said { sensor, reading: Reading { stamp_ns, quality, body } }),
        _ => Err("write exactly one of pose, points, circles, deviation, probe, five_dof, five_dof_raw, value_um, \
                  value_arcsec, temperature_degc, speed_rpm"
            .to_owned()),
    }
}

fn bodies_of(line: Line) -> Result<Vec<Body>, String> {
    let um = |v: [f64; 3]| Vec3::from(v) / 1e3;
    let mut bodies = Vec::new();
    if let Some(pose) = line.pose {
        bodies.push(Body::Tool(tool(&pose)?));
    }
    if let Some(points) = line.points {
        counted("points", points.len(), POINTS_MAX)?;
        let points: Result<Vec<_>, String> = points
            .iter()
            .map(|p| {
                let position = one_of(p.position_mm.map(Vec3::from), p.deviation_um.map(um))
                    .ok_or("a point has either position_mm or deviation_um")?;
                let std = std_of(p.std_um)?;
                Ok(PointReading { offset: Vec3::from(p.offset_mm), position, std })
            })
            .collect();
        bodies.push(Body::Points(points?));
    }
    if let Some(circles) = line.circles {
        counted("circles", circles.len(), POINTS_MAX)?;
        let centre = |c: &Circle| {
            Ok(PointReading {
                offset: Vec3::new(0.0, 0.0, c.height_mm),
                position: Seen::Absolute(Vec3::from(c.centre_mm)),
                std: std_of(c.std_um)?,
            })
        };
        bodies.push(Body::Points(circles.iter().map(centre).collect::<Result<_, String>>()?));
    }
    for d in line.deviation.iter().chain(&line.probe) {
        let direction = unit(Vec3::from(d.direction))?;
        let std = std_of(d.std_um)?;
        bodies.push(Body::Deviation { direction, value: mm_from_um(d.value_um), std });
    }
    if let Some(f) = line.five_dof {
        let [a, b, c] = [f.ea_arcsec, f.eb_arcsec, f.ec_arcsec].map(rad_from_arcsec);
        bodies.push(Body::FiveDof([mm_from_um(f.ey_um), mm_from_um(f.ez_um), a, b, c]));
    }
    if let Some(r) = line.five_dof_raw {
        let change = [r.psd1_um, r.psd2_um, r.psd3_um, r.qd1_um, r.qd2_um].map(|d| d.map(mm_from_um));
        bodies.push(Body::FiveDofRaw(Readings { distance: r.distance_mm, change }));
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
    match um {
        Some(um) if um < 0.0 => Err(format!("std_um is {um}, 0 (not stated) or more is taken")),
        um => Ok(um.filter(|um| *um > 0.0).map(mm_from_um)),
    }
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
    let deviation = pose.tip_deviation_um.map(|v| Vec3::from(v) / 1e3);
    let tip = one_of(pose.tip_mm.map(Vec3::from), deviation)
        .ok_or("a pose has either tip_mm or tip_deviation_um")?;
    let turned = pose.direction_deviation_arcsec.map(|v| Vec3::from(v.map(rad_from_arcsec)));
    let absolute = pose.direction.map(|v| unit(Vec3::from(v))).transpose()?;
    let direction = match (absolute, turned) {
        (None, None) => None,
        (a, d) => Some(one_of(a, d).ok_or("a pose has either direction or direction_deviation_arcsec")?),
    };
    let covariance = match &pose.covariance {
        None => None,
        Some(list) if list.len() == 36 => {
            let unit = |k: usize| if k < 3 { mm_from_um(1.0) } else { rad_from_arcsec(1.0) };
            let covariance = Matrix6::from_fn(|i, j| list[6 * i + j] * unit(i) * unit(j));
            if let Some((row, column)) = asymmetry(&covariance) {
                let [a, b] = [(row, column), (column, row)].map(|(i, j)| list[6 * (i - 1) + j - 1]);
                return Err(format!(
                    "covariance is not symmetric: row {row}, column {column} is {a}, and row {column}, column {row} is {b}"
                ));
            }
            Some(covariance)
        }
        Some(list) => return Err(format!("covariance has {} numbers, 36 are needed", list.len())),
    };
    Ok(ToolReading { tip, direction, covariance })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The next reading.
    fn next(stream: &mut Stream) -> Option<Result<Said, WireError>> {
        stream.next().map(|heard| {
            heard.map(|heard| match heard {
                Heard::Reading(said) => said,
                Heard::Sync(number) => panic!("sync {number}"),
            })
        })
    }

    #[test]
    fn a_sync_is_told_from_readings_and_nothing_else_stands_beside_it() {
        let heard = |line: &str| {
            let mut stream = Stream::default();
            stream.push(format!("{line}\n").as_bytes());
            stream.next().unwrap()
        };
        assert_eq!(heard("{\"sync\": 7}"), Ok(Heard::Sync(7)));
        assert!(heard("{\"sync\": -7}").is_err() && heard("{\"sync\": 7, \"sensor\": \"a\"}").is_err());
    }

    fn one(text: &str) -> Result<Said, WireError> {
        let mut stream = Stream::default();
        stream.push(text.as_bytes());
        stream.push(b"\n");
        next(&mut stream).expect("a message")
    }

    fn binary(kind: u8, name: &str, numbers: &[f64]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.push(kind);
        bytes.push(u8::try_from(name.len()).unwrap());
        bytes.extend(u16::try_from(numbers.len()).unwrap().to_le_bytes());
        bytes.extend(12_345_678_901_i64.to_le_bytes());
        bytes.extend(0.5_f32.to_le_bytes());
        bytes.extend(name.as_bytes());
        numbers.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        let sum = crc32c::crc32c(&bytes);
        bytes.extend(sum.to_le_bytes());
        bytes
    }

    #[test]
    fn json_arrives_in_mm_and_rad() {
        let said = one(
            r#"{"sensor": "t", "t_s": 1.5, "pose": {"tip_deviation_um": [1, 2, 3], "direction": [0, 0, 1]}}"#,
        )
        .unwrap();
        assert_eq!(
            (said.sensor.as_str(), said.reading.stamp_ns, said.reading.quality),
            ("t", 1_500_000_000, 1.0)
        );
        let Body::Tool(tool) = said.reading.body else { panic!("a pose") };
        assert_eq!(tool.tip, Seen::Deviation(Vec3::new(0.001, 0.002, 0.003)));
        assert_eq!(tool.direction, Some(Seen::Absolute(Vec3::z())));
        let said =
            one(r#"{"sensor": "p", "t_ns": 7, "probe": {"direction": [0, 1, 0], "value_um": -4}}"#).unwrap();
        assert_eq!(said.reading.body, Body::Deviation { direction: Vec3::y(), value: -0.004, std: None });
        let circles = r#"{"sensor": "t", "t_ns": 7, "circles": [{"height_mm": 20, "centre_mm": [1, 2, 3]}]}"#;
        let Body::Points(points) = one(circles).unwrap().reading.body else { panic!("points") };
        assert_eq!(points[0].offset, Vec3::new(0.0, 0.0, 20.0));
        let said = one(r#"{"sensor": "a", "t_ns": 7, "temperature_degc": [20.5, 21]}"#).unwrap();
        assert_eq!(said.reading.body, Body::Temperatures(vec![20.5, 21.0]));
        let said = one(r#"{"sensor": "s", "t_ns": 7, "speed_rpm": -3000}"#).unwrap();
        assert_eq!(said.reading.body, Body::Speed(-3000.0));
    }

    #[test]
    fn mistakes_are_told_and_cost_one_line() {
        for (text, words) in [
            (r#"{"sensor": "t", "pose": {"tip_mm": [1, 2, 3]}}"#, "t_s or t_ns"),
            (r#"{"sensor": "t", "t_s": 1}"#, "exactly one of"),
            (r#"{"sensor": "t", "t_s": 1, "value_um": 1, "value_arcsec": 1}"#, "exactly one of"),
            (r#"{"sensor": "t", "t_s": 1, "value_mm": 1}"#, "unknown field"),
            (r#"{"sensor": "t", "t_s": 1, "pose": {}}"#, "either tip_mm"),
            (
                r#"{"sensor": "t", "t_s": 1, "deviation": {"direction": [1, 1, 0], "value_um": 1}}"#,
                "unit vector",
            ),
            (r#"{"sensor": "t", "t_s": 1, "pose": {"tip_mm": [1, 2, 3], "covariance": [1]}}"#, "36"),
            (
                r#"{"sensor": "t", "t_s": 1, "value_um": 1, "quality": 1.5}"#,
                "quality is 1.5, 0 (unusable) to 1",
            ),
            (r#"{"sensor": "t", "t_s": 1, "value_um": 1, "quality": -0.1}"#, "quality is -0.1"),
            (
                r#"{"sensor": "t", "t_s": 1, "probe": {"direction": [0, 1, 0], "value_um": 1, "std_um": -2}}"#,
                "std_um is -2",
            ),
            (
                r#"{"sensor": "t", "t_s": 1, "points": [{"offset_mm": [0, 0, 0], "deviation_um": [1, 2, 3], "std_um": -1}]}"#,
                "std_um is -1",
            ),
            (
                r#"{"sensor": "t", "t_s": 1, "circles": [{"height_mm": 1, "centre_mm": [1, 2, 3], "std_um": -1}]}"#,
                "std_um is -1",
            ),
            (
                r#"{"sensor": "t", "t_s": 1, "pose": {"tip_mm": [1, 2, 3], "covariance": [4,0,0,0,0,0, 3,4,0,0,0,0, 0,0,4,0,0,0, 0,0,0,1,0,0, 0,0,0,0,1,0, 0,0,0,0,0,1]}}"#,
                "covariance is not symmetric: row 2, column 1 is 3, and row 1, column 2 is 0",
            ),
            (r#"{"sensor": "t", "t_s": 1, "points": []}"#, "points has 0 entries"),
            (r#"{"sensor": "t", "t_s": 1, "circles": []}"#, "circles has 0 entries"),
            (r#"{"sensor": "t", "t_s": 1, "temperature_degc": []}"#, "1 to 16 are taken"),
            ("nonsense", "line 1"),
        ] {
            let error = one(text).unwrap_err();
            assert!(error.to_string().contains(words) && !error.is_fatal(), "{text}: {error}");
        }
        let mut stream = Stream::default();
        stream.push(b"nonsense\n\n# a comment\n{\"sensor\": \"v\", \"t_ns\": 1, \"value_um\": 2}\n{\"sen");
        assert!(next(&mut stream).unwrap().is_err());
        assert_eq!(
            next(&mut stream).unwrap().unwrap().reading.body,
            Body::Value { value: 0.002, unit: Some(Kind::Length) }
        );
        assert!(next(&mut stream).is_none());
    }

    #[test]
    fn both_forms_share_a_connection_and_arrive_piece_by_piece() {
        let mut all = binary(8, "v", &[0.002]);
        all.extend(b"{\"sensor\": \"v\", \"t_ns\": 1, \"value_um\": 2}\n");
        let mut raw = vec![500.0];
        raw.extend((0..10).map(f64::from));
        all.extend(binary(7, "laser-x", &raw));
        let mut stream = Stream::default();
        let mut found = Vec::new();
        for byte in all {
            stream.push(&[byte]);
            while let Some(said) = next(&mut stream) {
                found.push(said.unwrap());
            }
        }
        assert_eq!(found.len(), 3);
        assert_eq!(found[0].reading.body, Body::Value { value: 0.002, unit: None });
        assert_eq!(found[1].reading.body, Body::Value { value: 0.002, unit: Some(Kind::Length) });
        assert_eq!((found[0].reading.stamp_ns, found[0].reading.quality), (12_345_678_901, 0.5));
        let Body::FiveDofRaw(readings) = &found[2].reading.body else { panic!("raw") };
        assert_eq!((readings.distance, readings.change[4]), (500.0, [8.0, 9.0]));
    }

    #[test]
    fn every_binary_kind_is_read_and_wrong_ones_are_refused() {
        let one = |bytes: &[u8]| {
            let mut stream = Stream::default();
            stream.push(bytes);
            next(&mut stream).expect("a message")
        };
        let mut pose = vec![1.0, 2.0, 3.0, 0.0, 0.0, 1.0];
        assert!(
            matches!(one(&binary(1, "t", &pose)).unwrap().reading.body, Body::Tool(t) if t.covariance.is_none())
        );
        let refused = |kind: u8, numbers: &[f64], words: &str| {
            let error = one(&binary(kind, "t", numbers)).unwrap_err();
            assert!(!error.is_fatal() && error.to_string().contains(words), "{error}");
        };
        for direction in [[0.0, 0.0, 0.98], [0.0, 0.1, 1.0], [0.0; 3]] {
            pose[3..].copy_from_slice(&direction);
            refused(1, &pose, "unit vector");
        }
        pose[4] = f64::NAN;
        refused(1, &pose, "not finite");
        pose[3..].fill(f64::NAN);
        assert!(
            matches!(one(&binary(2, "t", &pose)).unwrap().reading.body, Body::Tool(t) if t.direction.is_none())
        );
        pose.extend([f64::INFINITY; 36]);
        refused(1, &pose, "not finite");
        refused(9, &[], "1 to 16");
        refused(5, &[0.0, 0.0, 1.0, 0.1, -0.1], "below 0");
        refused(3, &[0.0, 0.0, 0.0, 1.0, 2.0, 3.0, -0.1], "below 0");
        pose[6..].fill(1e-6);
        pose[7] = 2e-6;
        refused(1, &pose, "not symmetric");
        for quality in [-0.1_f32, 1.5, f32::NAN] {
            let mut bytes = binary(8, "t", &[1.0]);
            bytes[16..20].copy_from_slice(&quality.to_le_bytes());
            let end = bytes.len() - 4;
            let sum = crc32c::crc32c(&bytes[..end]);
            bytes[end..].copy_from_slice(&sum.to_le_bytes());
            assert!(one(&bytes).unwrap_err().to_string().contains("from 0 to 1"), "{quality}");
        }
        pose[6..].fill(1e-6);
        assert!(
            matches!(one(&binary(1, "t", &pose)).unwrap().reading.body, Body::Tool(t) if t.covariance.is_some())
        );
        assert!(
            matches!(one(&binary(4, "t", &[0.0; 14])).unwrap().reading.body, Body::Points(p) if p.len() == 2)
        );
        assert!(matches!(one(&binary(6, "t", &[0.0; 5])).unwrap().reading.body, Body::FiveDof(_)));
        assert_eq!(
            one(&binary(9, "t", &[20.5, 21.0])).unwrap().reading.body,
            Body::Temperatures(vec![20.5, 21.0])
        );
        assert_eq!(one(&binary(10, "t", &[3000.0])).unwrap().reading.body, Body::Speed(3000.0));
        for (kind, count) in [(1, 5), (3, 8), (5, 5), (6, 4), (7, 10), (8, 2), (9, 17), (10, 2), (77, 1)] {
            let error = one(&binary(kind, "t", &vec![0.0; count])).unwrap_err();
            assert!(!error.is_fatal(), "{error}");
        }
        assert!(one(&binary(8, "t", &[f64::NAN])).is_err());
        let mut broken = binary(8, "t", &[1.0]);
        broken[22] ^= 1;
        assert!(one(&broken).unwrap_err().is_fatal());
        assert!(one(b"VXXX0000000000000000000000").unwrap_err().is_fatal());
        let mut endless = vec![b'{'; MESSAGE_MAX + 1];
        assert!(one(&endless).unwrap_err().is_fatal());
        endless.push(b'\n');
        assert!(one(&endless).unwrap_err().is_fatal(), "not even where its end has come as well");
    }
}
