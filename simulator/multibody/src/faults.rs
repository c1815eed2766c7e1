//! Faults of bodies: ground guideways, screws, mountings, beams, heat. What drives and joints do is in `dynamics`.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::dynamics::{CLOCKS, Drives};
use crate::heat::{Heat, State};
use crate::machine::{Bodies, TRAVEL_MM, deviation};
use crate::program::Sample;
use crate::random::Stream;
use crate::solid::Beam;

/// An effect of the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Its name (`docs/reference/session-files.md`, 4.1); outside of libraries with `outside-` first.
    pub name: &'static str,
    /// Its subjects.
    pub subjects: &'static [&'static str],
    /// How it arises.
    pub physics: &'static str,
}

const AXES: &[&str] = &["x", "y", "z"];
const NONE: &[&str] = &[""];

const fn entry(name: &'static str, subjects: &'static [&'static str], physics: &'static str) -> Entry {
    Entry { name, subjects, physics }
}

/// All effects.
pub const CATALOGUE: &[Entry] = &[
    entry(
        "squareness",
        &["xy", "yz", "zx"],
        "a guideway is mounted at an angle; exact rotation of its frame",
    ),
    entry("scale", AXES, "the scale is stretched by its mounting"),
    entry(
        "positioning",
        AXES,
        "lead errors of a ground screw add up along it; the nut averages over its length",
    ),
    entry(
        "cyclic",
        AXES,
        "a tilted bearing face pushes the screw once per turn, a Cardan coupling turns it unevenly twice",
    ),
    entry("wear", AXES, "visits around a favourite place wear the screw; the nut averages over its length"),
    entry(
        "straightness",
        &["eyx", "ezx", "exy", "ezy", "exz", "eyz"],
        "a ground guideway; the mean of four shoes follows it",
    ),
    entry(
        "angular",
        &["eax", "ebx", "ecx", "eay", "eby", "eaz", "ebz"],
        "two guideways ground apart from each other; the shoes turn the carriage",
    ),
    entry("sag", &["z"], "the ram and its head bend as they come out: beam elements on two elastic bearings"),
    entry(
        "thermal-expansion",
        AXES,
        "a screw warms along its length: conduction from bearing and nut, convection",
    ),
    entry("spindle-growth", NONE, "bearing heat flows along the spindle and into the headstock"),
    entry(
        "ambient-drift",
        NONE,
        "the column takes the hall's temperature from its faces inwards, bends and rises",
    ),
    entry("backlash", AXES, "clearance between screw and slide; friction holds the slide"),
    entry("lateral-play", AXES, "clearance across a guideway; the drive pushes to one side"),
    entry("reversal-spike", AXES, "friction that the drive does not know turns; its integral needs its time"),
    entry("servo-mismatch", AXES, "velocity feed-forward is incomplete; the position loop lags"),
    entry("latency", NONE, "all drives act on set points of some time ago"),
    entry("clock-skew", NONE, "instruments have clocks of their own"),
    entry("inertial", AXES, "what an axis carries stands on a spring"),
    entry("inertial-cross", AXES, "what an axis carries tilts about a pivot, its centre of mass beside it"),
    entry("load", AXES, "the spindle's bearing is a spring under forces on the tool"),
    entry("spindle-tilt", NONE, "the spindle is mounted at an angle"),
    entry("tool-length", NONE, "the presetter's scale is wrong"),
    entry("dead-path", NONE, "light through air of another temperature than stated"),
    entry("tracker-scale", NONE, "the tracker's lengths have a wrong scale"),
    entry("rotary-location", &["b"], "the table's axis stands elsewhere and leans"),
    entry("rotary-motion", &["b"], "the table runs on a ring of two and three waves"),
    entry("rotary-eccentricity", &["b"], "the graduated disc sits off its centre"),
    entry("vibration", NONE, "a pump shakes the machine"),
    entry("outliers", NONE, "single readings are far off"),
    entry("quantisation", NONE, "the display has few digits"),
    entry("range-noise", NONE, "noise grows with the range of the tracker"),
    entry(
        "outside-warm-bed",
        NONE,
        "the bed bends with a temperature difference that nobody measures, as the square of X",
    ),
    entry(
        "outside-carried-weight",
        NONE,
        "the bed gives way under table and ram together: product of X and Z",
    ),
    entry("outside-oil", NONE, "oil lifts the headstock with its speed and saturates"),
    entry("outside-coolant", NONE, "coolant under a thermostat warms the table's screw"),
    entry("outside-foundation", NONE, "the foundation yields to the table's weight within ten minutes"),
    entry("outside-whirl", NONE, "a screw whirls near one speed and shakes the ram once per turn"),
];

/// Families: two effects with one in common are hard to tell apart by any program, and are not drawn together.
pub fn families(name: &str, subject: &str) -> Vec<String> {
    let axis_of = |symbol: &str| symbol.chars().last().map(String::from).unwrap_or_default();
    match name {
        "scale" | "positioning" | "wear" | "thermal-expansion" => vec![format!("position-{subject}")],
        "straightness" | "angular" => vec![format!("guide-{}", axis_of(subject))],
        "sag" => vec!["guide-z".to_owned()],
        "latency" | "clock-skew" => ["x", "y", "z"].map(|a| format!("lag-{a}")).into(),
        "servo-mismatch" => vec![format!("lag-{subject}")],
        "backlash" | "lateral-play" | "reversal-spike" => vec![format!("reversal-{subject}")],
        "inertial" | "inertial-cross" => vec![format!("inertia-{subject}")],
        "spindle-growth" | "ambient-drift" => vec!["head".to_owned()],
        "dead-path" | "tracker-scale" => vec!["light".to_owned()],
        "spindle-tilt" | "tool-length" => vec!["tool".to_owned()],
        "vibration" | "outliers" | "quantisation" | "range-noise" => vec!["reading".to_owned()],
        _ if name.starts_with("rotary") => vec!["table".to_owned()],
        _ => vec![format!("{name}-{subject}")],
    }
}

fn axis(subject: &str) -> usize {
    match subject.chars().last() {
        Some('y') => 1,
        Some('z') => 2,
        _ => 0,
    }
}

fn component(symbol: &str) -> usize {
    match symbol.chars().nth(1) {
        Some('y' | 'b') => 1,
        Some('z' | 'c') => 2,
        _ => 0,
    }
}

/// A curve over the travel on a grid of 1 mm.
#[derive(Debug, Clone, PartialEq)]
struct Curve(Vec<f64>);

impl Curve {
    const MARGIN: f64 = 80.0;

    fn at(&self, q: f64) -> f64 {
        let place = (q + Self::MARGIN).clamp(0.0, (self.0.len() - 1) as f64);
        let (k, f) = (place as usize, place.fract());
        let get = |k: usize| self.0.get(k.min(self.0.len() - 1)).copied().unwrap_or_default();
        get(k) * (1.0 - f) + get(k + 1) * f
    }

    fn mean_over(&self, nut_mm: usize) -> Self {
        let n = self.0.len();
        Self(
            (0..n)
                .map(|k| {
                    let part = &self.0[k.saturating_sub(nut_mm / 2)..(k + nut_mm / 2 + 1).min(n)];
                    part.iter().sum::<f64>() / part.len() as f64
                })
                .collect(),
        )
    }

    /// Unit RMS, without mean (and slope).
    fn normalised(mut self, slope: bool) -> Self {
        let n = self.0.len() as f64;
        let mean = self.0.iter().sum::<f64>() / n;
        let centre = 0.5 * (n - 1.0);
        let (mut sxy, mut sxx) = (0.0, 0.0);
        for (k, v) in self.0.iter().enumerate() {
            let x = k as f64 - centre;
            sxy += x * (v - mean);
            sxx += x * x;
        }
        let slope = if slope { sxy / sxx } else { 0.0 };
        for (k, v) in self.0.iter_mut().enumerate() {
            *v -= mean + slope * (k as f64 - centre);
        }
        let rms = (self.0.iter().map(|v| v * v).sum::<f64>() / n).sqrt().max(1e-12);
        self.0.iter_mut().for_each(|v| *v /= rms);
        self
    }

    /// Grinding: white errors of the wheel, smoothed by a length and added up.
    fn ground(axis: usize, length_mm: usize, add_up: bool, chance: &mut Stream) -> Self {
        let n = (TRAVEL_MM[axis][1] + 2.0 * Self::MARGIN) as usize + 1;
        let noise = Self((0..n).map(|_| chance.normal()).collect());
        let mut smooth = noise.mean_over(length_mm).mean_over(length_mm);
        if add_up {
            let mut sum = 0.0;
            for v in &mut smooth.0 {
                sum += *v;
                *v = sum;
            }
        }
        smooth.normalised(true)
    }
}

/// A fault with its constants.
#[derive(Debug, Clone)]
pub struct Fault {
    /// `name:subject`.
    pub label: String,
    name: &'static str,
    subject: String,
    /// Typical size, um; signed.
    pub size_um: f64,
    curve: Option<Curve>,
    more: Vec<f64>,
    sag: Vec<[f64; 2]>,
}

impl Fault {
    /// Draws the constants of a fault.
    pub fn new(entry: &'static Entry, subject: &str, size_um: f64, seed: u64) -> Option<Self> {
        let label =
            if subject.is_empty() { entry.name.to_owned() } else { format!("{}:{subject}", entry.name) };
        let mut chance = Stream::new(seed, &label);
        let axis = axis(subject);
        let curve = match entry.name {
            "positioning" => Some(
                Curve::ground(axis, chance.uniform(30.0, 90.0) as usize, true, &mut chance).mean_over(40),
            ),
            "straightness" => Some(
                Curve::ground(axis, chance.uniform(60.0, 120.0) as usize, true, &mut chance).mean_over(90),
            ),
            "angular" => Some(
                Curve::ground(axis, chance.uniform(50.0, 110.0) as usize, true, &mut chance).mean_over(90),
            ),
            "wear" => {
                let travel = TRAVEL_MM[axis][1];
                let (place, width) = (chance.uniform(0.25, 0.75) * travel, chance.uniform(14.0, 32.0));
                let mut depth = vec![0.0; (travel + 2.0 * Curve::MARGIN) as usize + 1];
                for _ in 0..60_000 {
                    let at = place + width * chance.normal() + Curve::MARGIN;
                    if let Some(d) = depth.get_mut(at.max(0.0) as usize) {
                        *d += 1.0;
                    }
                }
                let worn = Curve(depth).mean_over(36);
                let peak = worn.0.iter().copied().fold(0.0, f64::max);
                Some(Curve(worn.0.iter().map(|v| 2.5 * v / peak).collect()))
            }
            _ => None,
        };
        let more = (0..12).map(|_| chance.uniform(0.0, 1.0)).collect();
        let sag = if entry.name == "sag" { ram(&mut chance)? } else { Vec::new() };
        Some(Self { label, name: entry.name, subject: subject.to_owned(), size_um, curve, more, sag })
    }

    fn share(&self, k: usize, low: f64, high: f64) -> f64 {
        low + (high - low) * self.more.get(k).copied().unwrap_or_default()
    }

    fn direction(&self, k: usize) -> Vector3<f64> {
        let v = Vector3::from_fn(|i, _| self.share(k + i, -1.0, 1.0));
        if v.norm() < 0.1 { Vector3::x() } else { v.normalize() }
    }

    /// True where it is a matter of drives and joints.
    pub fn is_dynamic(&self) -> bool {
        matches!(
            self.name,
            "backlash"
                | "lateral-play"
                | "reversal-spike"
                | "servo-mismatch"
                | "latency"
                | "clock-skew"
                | "inertial"
                | "inertial-cross"
                | "load"
        )
    }

    /// True where it is a matter of chance in single readings.
    pub fn is_random(&self) -> bool {
        matches!(self.name, "vibration" | "outliers" | "quantisation" | "range-noise")
    }

    /// Puts it into the drives.
    pub fn on_drives(&self, d: &mut Drives) {
        let s = self.size_um;
        let at = axis(&self.subject);
        match self.name {
            "latency" => d.latency_s += 1e-5 * s.abs(),
            "clock-skew" => {
                for (k, c) in CLOCKS.iter().enumerate() {
                    let _ = c;
                    d.clocks_s[k] += 1e-5 * s * self.share(k, -1.0, 1.0);
                }
            }
            _ => {}
        }
        let a = &mut d.axes[at];
        match self.name {
            "backlash" => a.gap_mm = 2e-3 * s.abs(),
            "lateral-play" => a.side_mm = 2e-3 * s,
            "reversal-spike" => a.friction_n = 90.0 * s.abs(),
            "servo-mismatch" => a.lag = 8e-4 * s,
            // 50 kg at 0.5 m/s^2 are 25 N
            "inertial" => a.carry_um_per_n = s.abs() / 25.0,
            "inertial-cross" => a.tilt_urad_per_nm = 1.2 * s.abs(),
            "load" => a.load_um_per_n = s.abs() / 1000.0,
            _ => {}
        }
    }

    /// What it does to bodies and light at a reading, um in directions of M; nothing where it is of drives or chance.
    pub fn at(&self, s: &Sample, tool_mm: f64, heat: &State) -> Vector3<f64> {
        let q = s.command.q;
        let mm = 1e-3 * self.size_um;
        let at = axis(&self.subject);
        let travel = TRAVEL_MM[at][1];
        let mut b = Bodies::default();
        let curve = || self.curve.as_ref().map_or(0.0, |c| c.at(q[at]));
        // a carriage on the workpiece side moves against the coordinate
        let sense = if at == 0 { -1.0 } else { 1.0 };
        match self.name {
            "squareness" => {
                let angle = mm / 150.0;
                match self.subject.as_str() {
                    "xy" => b.mount[0].z = angle,
                    "yz" => b.mount[1].x = angle,
                    _ => b.mount[1].y = angle,
                }
            }
            "scale" => b.carriage[at].shift[at] = sense * 3.5 * mm * q[at] / travel,
            "positioning" | "wear" => b.carriage[at].shift[at] = sense * mm * curve(),
            "cyclic" => {
                let lead = [5.0, 8.0, 10.0, 12.0, 16.0, 20.0][(self.share(0, 0.0, 5.999)) as usize];
                let turn = TAU * (q[at] / lead + self.share(1, 0.0, 1.0));
                // tan(out) = tan(in) / cos(bend); twice per turn
                let bend = self.share(2, 0.02, 0.1);
                let uneven = (turn.sin() / bend.cos()).atan2(turn.cos()) - turn;
                let uneven = uneven - TAU * (uneven / TAU).round();
                b.carriage[at].shift[at] =
                    sense * mm * (1.4 * turn.sin() + 0.5 * uneven * 4.0 / (bend * bend));
            }
            "straightness" => b.carriage[at].shift[component(&self.subject)] = sense * mm * curve(),
            "angular" => b.carriage[at].turn[component(&self.subject)] = sense * mm / 200.0 * curve(),
            "sag" => {
                let place = (q[2] / 10.0).clamp(0.0, (self.sag.len().max(2) - 2) as f64);
                let (k, f) = (place as usize, place.fract());
                if let (Some(a), Some(c)) = (self.sag.get(k), self.sag.get(k + 1)) {
                    let size = self.size_um.abs() * 1e-3;
                    b.carriage[2].shift.y = -size * (a[0] + f * (c[0] - a[0]));
                    b.carriage[2].turn.x = -size * (a[1] + f * (c[1] - a[1]));
                }
            }
            "thermal-expansion" => {
                let growth = Heat::growth_um(heat, at, q[at] / 600.0);
                b.carriage[at].shift[at] = sense * mm * growth / 6.0;
            }
            "spindle-growth" => {
                b.spindle.shift.z = -mm * heat.nose_um / 10.0;
                b.spindle.shift.y = mm * self.share(0, 0.2, 0.6) * heat.head_um / 3.0;
            }
            "ambient-drift" => {
                b.carriage[1].shift.z = mm * heat.column_um[0] / 1.5;
                b.carriage[1].shift.y = mm * self.share(0, 0.1, 0.3) * heat.column_um[1] / 3.0;
            }
            "spindle-tilt" => {
                let way = self.share(0, 0.0, TAU);
                b.spindle.turn = Vector3::new(way.cos(), way.sin(), 0.0) * (mm / 25.0);
            }
            "tool-length" => b.tool_mm = mm * tool_mm / 25.0,
            "rotary-location" => {
                b.axis.shift = Vector3::new(self.share(0, -1.0, 1.0), 0.0, self.share(1, -1.0, 1.0)) * mm;
                b.axis.turn =
                    Vector3::new(self.share(2, -1.0, 1.0), 0.0, self.share(3, -1.0, 1.0)) * (mm / 200.0);
            }
            "rotary-motion" => {
                let wave = |n: f64, k: usize| {
                    let phase = self.share(k, 0.0, TAU);
                    (n * q[3] + phase).cos() - phase.cos()
                };
                b.table.shift =
                    Vector3::new(0.5 * wave(2.0, 0), wave(2.0, 1) + 0.4 * wave(3.0, 2), 0.5 * wave(3.0, 3))
                        * mm;
                b.table.turn = Vector3::new(wave(2.0, 4), 0.0, wave(3.0, 5)) * (mm / 500.0);
            }
            "rotary-eccentricity" => {
                // angle seen by a head over a disc whose centre is off
                let (e, phase) = (mm / 150.0, self.share(0, 0.0, TAU));
                b.table.turn.y = -((q[3] + phase).sin() - phase.sin()) * e;
            }
            "outside-warm-bed" => {
                let x = (q[0] - 300.0) / 300.0;
                b.carriage[0].shift.y = 2.0 * mm * heat.bed_k * x * x;
                b.carriage[0].turn.z = 4.0 * mm * heat.bed_k * x / 300.0;
            }
            "outside-carried-weight" => {
                b.carriage[0].shift.y = mm * (q[0] - 280.0) * (q[2] - 190.0) / 1.2e4;
                b.carriage[0].shift.z = 0.6 * mm * (q[0] - 280.0) * (q[1] - 200.0) / 1.2e4;
            }
            "outside-oil" => {
                let speed = s.command.v[..3].iter().map(|v| v * v).sum::<f64>().sqrt();
                b.carriage[1].shift.z = 2.5 * mm * (1.0 - (-speed / 30.0).exp());
                b.carriage[1].shift.x = 1.2 * mm * (1.0 - (-speed / 30.0).exp());
            }
            "outside-coolant" => {
                b.carriage[0].shift.x = mm * heat.coolant_k * q[0] / 300.0;
                b.carriage[0].shift.y = 0.5 * mm * heat.coolant_k;
            }
            "outside-foundation" => {
                b.carriage[1].shift.z = mm * heat.settled_mm / 60.0;
                b.carriage[1].shift.x = 0.4 * mm * heat.settled_mm / 60.0;
            }
            "outside-whirl" => {
                let speed = s.command.v[..3].iter().map(|v| v.abs()).fold(0.0, f64::max);
                let near = ((speed - self.share(0, 70.0, 120.0)) / 18.0).powi(2);
                let turn = TAU * q[2] / 20.0 + TAU * q[0] / 16.0;
                b.carriage[2].shift = Vector3::new(turn.sin(), turn.cos(), 0.0) * (6.0 * mm / (1.0 + near));
            }
            "tracker-scale" => {
                return s.station.map_or_else(Vector3::zeros, |station| {
                    let tip = Vector3::new(q[0], q[1], q[2] - tool_mm);
                    (tip - station) * (self.size_um / 300.0)
                });
            }
            "dead-path" => {
                // one in a million per kelvin
                let warm = self.size_um * heat.air_k;
                return match (s.station, s.range_mm) {
                    (Some(station), Some(_)) => {
                        (Vector3::new(q[0], q[1], q[2] - tool_mm) - station) * (1e-3 * warm)
                    }
                    (None, Some(range)) => s.u * (1e-3 * warm * range),
                    _ => Vector3::zeros(),
                };
            }
            _ => return Vector3::zeros(),
        }
        1e3 * deviation(q, tool_mm, &b)
    }

    /// Amplitude, direction, frequency for a vibration.
    pub fn shake(&self) -> Option<(Vector3<f64>, f64)> {
        (self.name == "vibration")
            .then(|| (self.direction(0) * (2.5 * self.size_um), self.share(4, 14.0, 90.0)))
    }

    /// Share and size of outliers, um.
    pub fn outliers(&self) -> Option<(f64, f64)> {
        let share = self.share(0, 0.008, 0.02);
        (self.name == "outliers").then(|| (share, self.size_um.abs() / share.sqrt()))
    }

    /// Last digit of the display, um.
    pub fn digit(&self) -> Option<f64> {
        (self.name == "quantisation").then(|| 3.46 * self.size_um.abs())
    }

    /// Noise across the beam at 2 m, um.
    pub fn range_noise(&self) -> Option<f64> {
        (self.name == "range-noise").then(|| self.size_um.abs())
    }
}

/// Deflection and slope of the ram's nose over Z in steps of 10 mm, against Z = 0, for a typical deflection of 1.
fn ram(chance: &mut Stream) -> Option<Vec<[f64; 2]>> {
    let (length, nose, front) = (1.1, chance.uniform(250.0, 500.0), chance.uniform(0.12, 0.2));
    let mut all = Vec::new();
    for k in 0..=41 {
        let z = 0.01 * f64::from(k);
        // the ram comes out towards -z; the bearings stay
        let overhang = front + (0.4 - z).max(0.0);
        let mut beam = Beam::new(length, 44, 9e6);
        beam.support(length - overhang, 4e8);
        beam.support(length - overhang - 0.35, 4e8);
        beam.weight(1300.0);
        beam.force(length, nose);
        let bent = beam.solve()?;
        all.push([1e3 * bent.at(length), -bent.slope(length)]);
    }
    let zero = *all.first()?;
    for a in &mut all {
        *a = [a[0] - zero[0], a[1] - zero[1]];
    }
    let span = all.last()?[0].abs().max(1e-9);
    Some(all.iter().map(|a| [3.0 * a[0] / span, 3.0 * a[1] / span]).collect())
}
