//! The formulas of the effects: deviation of the tool against the workpiece, in machine axes and um, per unit of each
//! parameter.
//!
//! Assumptions: small errors, so that effects add; references at zero (angular and rotary errors vanish at the zero of
//! their axis), so that none of them carries a squareness or a location error. Everything is linear in the parameters;
//! what is not (time constants, lengths, pitches) belongs to the shape itself and is searched over a grid.
//! Source: the catalogue of the diagnosis; equations 1 for squareness, angular errors and locations.

use serde::{Deserialize, Serialize};

use super::frame::RotaryFrame;
use super::lever::{Lever, ram, sag};
use super::polynomial::{legendre, twist};
use crate::machine_state::{Axis, Light, MachineState, Signal};
use volcomp_model::geometry::{Mat3, Vec3, unit};
use volcomp_units::{RAD_PER_ARCSEC, UM_PER_MM};

/// Most parameters of one shape.
pub const WIDTH_MAX: usize = 40;
/// Movement below this is standstill, mm/s or rad/s.
pub const STILL: f64 = 1e-6;
/// Speed from which friction has its full size, mm/s.
const CREEP_MM_PER_S: f64 = 0.1;
/// um per arcsec and mm of lever.
const UM_PER_ARCSEC_MM: f64 = RAD_PER_ARCSEC * UM_PER_MM;
/// Reference temperature of lengths, ISO 1.
pub const REFERENCE_DEGC: f64 = 20.0;

/// A formula with its non-linear parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "form", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
#[expect(missing_docs, reason = "each variant says what it is; its fields are the symbols of that formula")]
pub enum Shape {
    /// `d_along = angle x_over`.
    Squareness { along: Axis, over: Axis },
    /// `d_a = s x_a`.
    Scale { axis: Axis },
    /// `d_along = SUM c_k P_k((x_over - centre)/half)`, Legendre polynomials of degree low..high.
    Polynomial { along: Axis, over: Axis, low: usize, high: usize, centre_mm: f64, half_mm: f64 },
    /// `d = eps x lever` about one direction, `eps = SUM e_k p_k(x)` zero at the zero of the axis: see [`twist`].
    Angular {
        about: Axis,
        over: Axis,
        degree: usize,
        half_mm: f64,
        /// Middle of the data; powers of `x/half` where it does not stand.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        centre_mm: Option<f64>,
        lever: Lever,
    },
    /// A curve with values of its own in each direction of travel: `d_a = SUM p_k P_k(s) - dir/2 SUM r_k P_k(s)`.
    Reverse { axis: Axis, high: usize, reverse: usize, centre_mm: f64, half_mm: f64 },
    /// `d_a = alpha (T - T0) x_a`, and `k (T - T0)` where the reference is not at zero.
    Thermal { axis: Axis, signal: Signal, reference_degc: f64, with_offset: bool },
    /// `d = SUM k_i (s_i - s_0)` along the directions listed.
    Growth { signals: Vec<Signal>, along: Vec<Axis>, reference: f64 },
    /// `d_along = -w/2 dir (1 - exp(-s/length))`, times `1 + g x` where it has a slope.
    Backlash { axis: Axis, along: Vec<Axis>, length_mm: f64, slope: bool },
    /// `d_a = h dir (exp(-t/fall) - exp(-t/rise))` while the axis moves.
    Spike { axis: Axis, rise_s: f64, fall_s: f64, slope: bool },
    /// Friction that the servo lags behind by while the axis moves: `d_a = -h tanh(v/v0)`.
    Friction { axis: Axis },
    /// `SUM c_n cos(2 pi n x/pitch) - c_n + s_n sin(2 pi n x/pitch)`.
    Cyclic { axis: Axis, along: Axis, pitch_mm: f64, harmonics: usize },
    /// `d_a = -tau v_a + tau tie a_a` for every axis listed.
    Lag { axes: Vec<Axis>, tie_ms: f64 },
    /// `d_along = k a_axis`, and `k' a_axis x_axis` where it has a slope.
    Inertial { axis: Axis, along: Axis, slope: bool },
    /// `d = k a_axis (e_about x lever)` for each direction listed.
    InertialTilt { axis: Axis, about: Vec<Axis>, lever: Lever },
    /// Bending of a cantilever: `d_z = w s^2 (3 L - s)/(2 L^3)`, `s = x - start`, and its slope times the tool length.
    Sag {
        axis: Axis,
        start_mm: f64,
        length_mm: f64,
        tool: bool,
        /// What the slope turns under a head; the tool length alone where nothing is said.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lever: Option<Lever>,
    },
    /// A ram that moves out by s: weight at its end and own weight, `d_z = -(w1 s^3 + w2 s^4)` over powers of its reach, and
    /// the slope of that times the lever to the tool; with a moment at its end, too, `w3 s^2`.
    Ram {
        axis: Axis,
        start_mm: f64,
        reach_mm: f64,
        lever: Lever,
        #[serde(default, skip_serializing_if = "core::ops::Not::not")]
        moment: bool,
        /// The axis runs along a beam that stays where it is: the slope is the derivative of the drop.
        #[serde(default, skip_serializing_if = "core::ops::Not::not")]
        beam: bool,
    },
    /// `d = (b L, -a L)`.
    SpindleTilt,
    /// `d_z = c L`.
    ToolLength,
    /// Along the beam: `c (T - 20) (range + q)`; of all instruments that measure by light, or only of one kind, or (additions
    /// of before) only of those with (true) or without (false) a station.
    DeadPath {
        signal: Signal,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        light: Option<Light>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        station: Option<bool>,
    },
    /// Along the line from station to target: `c range`, or `c range (T - 20)`; with a wrong zero of the range, too.
    TrackerScale {
        signal: Option<Signal>,
        #[serde(default, skip_serializing_if = "core::ops::Not::not")]
        zero: bool,
    },
    /// Delay and drift of the clock of each file: `-v (d + r (t - start))`.
    ClockSkew { files: Vec<usize>, start_s: Vec<f64>, span_s: Vec<f64>, drift: bool },
    /// Two shifts and two tilts of a rotary axis; no deviation at zero.
    RotaryLocation {
        frame: RotaryFrame,
        /// What the axis carries is wrong with it, at its zero, too (equations 1.9); shifts then show only on an axis that
        /// another one turns.
        #[serde(default, skip_serializing_if = "core::ops::Not::not")]
        tied: bool,
    },
    /// Harmonics of the rotation: shifts `cos(n q) - 1`, `sin(n q)` along the directions listed, of the machine or of what the
    /// axis stands on (with `frame`).
    RotaryMotion {
        axis: Axis,
        along: Vec<Axis>,
        low: usize,
        high: usize,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        frame: Option<RotaryFrame>,
    },
    /// Angular error `SUM c_n (cos n q - 1) + s_n sin n q` about the axis itself, times the radius.
    RotaryEccentricity {
        frame: RotaryFrame,
        #[serde(default = "one", skip_serializing_if = "is_one")]
        harmonics: usize,
    },
    /// `-w/2 dir` about the axis itself, times the radius.
    RotaryBacklash { frame: RotaryFrame },
    /// `-tau omega` about the axis itself, times the radius.
    RotaryLag { frame: RotaryFrame },
    /// `s q` about the axis itself, times the radius.
    RotaryScale { frame: RotaryFrame },
    /// `d_along = c sign(F) |F|^power` of one axis.
    Load { axis: Axis, along: Axis, power: f64 },
    /// A worn place: `d_a = h (1 - |(x - centre)/width|^power / (2 order))^order` where that is above zero, or
    /// `h exp(-|(x - centre)/width|^power / 2)`, its limit, without an order.
    Wear {
        axis: Axis,
        centre_mm: f64,
        width_mm: f64,
        /// 2 is a bell, more has a flat bottom.
        #[serde(default = "bell", skip_serializing_if = "is_bell")]
        power: f64,
        /// A place with an end: the lower, the sharper it ends.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        order: Option<f64>,
    },
    /// A constant shift of everything after a time, until the end of the file.
    Step { file: usize, after_s: f64 },
}

const fn one() -> usize {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
const fn is_one(n: &usize) -> bool {
    *n == 1
}

/// Power of a worn place that is a bell.
pub const BELL: f64 = 2.0;

const fn bell() -> f64 {
    BELL
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_bell(power: &f64) -> bool {
    (power - BELL).abs() < 1e-12
}

fn put(out: &mut [Vec3], at: usize, v: Vec3) {
    out[at] = v;
}

impl Shape {
    /// Number of parameters.
    #[must_use]
    pub fn width(&self) -> usize {
        match self {
            Self::Squareness { .. }
            | Self::Scale { .. }
            | Self::Lag { .. }
            | Self::Friction { .. }
            | Self::ToolLength => 1,
            Self::Polynomial { low, high, .. } => high + 1 - low,
            Self::Reverse { high, reverse, .. } => high + reverse,
            Self::Angular { degree, .. } => *degree,
            Self::Thermal { with_offset, .. } => 1 + usize::from(*with_offset),
            Self::Growth { signals, along, .. } => signals.len() * along.len(),
            Self::Backlash { along, slope, .. } => along.len() * (1 + usize::from(*slope)),
            Self::Spike { slope, .. } | Self::Inertial { slope, .. } => 1 + usize::from(*slope),
            Self::Cyclic { harmonics, .. } => 2 * harmonics,
            Self::InertialTilt { about, .. } => about.len(),
            Self::Sag { tool, .. } => 1 + usize::from(*tool),
            Self::Ram { moment, .. } => 2 + usize::from(*moment),
            Self::RotaryEccentricity { harmonics, .. } => 2 * harmonics,
            Self::TrackerScale { zero, .. } => 1 + usize::from(*zero),
            Self::SpindleTilt | Self::DeadPath { .. } => 2,
            Self::RotaryBacklash { .. }
            | Self::RotaryLag { .. }
            | Self::RotaryScale { .. }
            | Self::Load { .. } => 1,
            Self::ClockSkew { files, drift, .. } => files.len() * (1 + usize::from(*drift)),
            Self::RotaryLocation { frame, tied: true } if frame.outer.is_empty() => 2,
            Self::RotaryLocation { .. } => 4,
            Self::RotaryMotion { along, low, high, .. } => 2 * along.len() * (high + 1 - low),
            Self::Wear { .. } => 1,
            Self::Step { .. } => 3,
        }
    }

    /// The deviation per unit of each parameter, um.
    pub fn evaluate(&self, m: &MachineState, out: &mut [Vec3]) {
        match self {
            Self::Squareness { along, over } => {
                put(out, 0, unit(along.direction()) * (UM_PER_ARCSEC_MM * m.position[over.slot()]));
            }
            Self::Scale { axis } => {
                put(out, 0, unit(axis.direction()) * (m.position[axis.slot()] * 1e-3));
            }
            Self::Polynomial { along, over, low, high, centre_mm, half_mm } => {
                let s = (m.position[over.slot()] - centre_mm) / half_mm;
                let mut values = [0.0; WIDTH_MAX + 8];
                legendre(s.clamp(-1.2, 1.2), &mut values[..=*high]);
                for (i, v) in values[*low..=*high].iter().enumerate() {
                    put(out, i, unit(along.direction()) * *v);
                }
            }
            Self::Reverse { axis, high, reverse, centre_mm, half_mm } => {
                let s = (m.position[axis.slot()] - centre_mm) / half_mm;
                let mut values = [0.0; WIDTH_MAX + 8];
                legendre(s.clamp(-1.2, 1.2), &mut values[..=*high.max(reverse)]);
                let along = unit(axis.direction());
                // means from the second degree (the first is the scale), reversals from the constant
                for (i, v) in values[2..=*high].iter().enumerate() {
                    put(out, i, along * *v);
                }
                let half_turn = -0.5 * m.direction[axis.slot()];
                for (i, v) in values[..=*reverse].iter().enumerate() {
                    put(out, high - 1 + i, along * (*v * half_turn));
                }
            }
            Self::Angular { about, over, degree, half_mm, centre_mm, lever } => {
                let arm = unit(about.direction()).cross(&lever.at(m)) * UM_PER_ARCSEC_MM;
                let mut values = [0.0; WIDTH_MAX];
                twist(m.position[over.slot()], *half_mm, *centre_mm, &mut values[..*degree]);
                for (i, v) in values[..*degree].iter().enumerate() {
                    put(out, i, arm * *v);
                }
            }
            Self::Cyclic { axis, along, pitch_mm, harmonics } => {
                let phase = core::f64::consts::TAU * m.position[axis.slot()] / pitch_mm;
                for n in 0..*harmonics {
                    let (s, c) = (phase * (n + 1) as f64).sin_cos();
                    put(out, 2 * n, unit(along.direction()) * (c - 1.0));
                    put(out, 2 * n + 1, unit(along.direction()) * s);
                }
            }
            Self::Sag { axis, start_mm, length_mm, tool, lever } => {
                let arm = lever.map_or_else(|| unit(2) * -m.tool_length_mm, |l| l.at(m));
                sag(*axis, *start_mm, *length_mm, tool.then_some(arm), m, out);
            }
            Self::Ram { axis, start_mm, reach_mm, lever, moment, beam } => {
                let slopes = if *beam { [3.0, 4.0, 2.0] } else { [1.5, 4.0 / 3.0, 2.0] };
                ram(*axis, *start_mm, *reach_mm, lever, slopes, m, &mut out[..2 + usize::from(*moment)]);
            }
            Self::Wear { axis, centre_mm, width_mm, power, order } => {
                let s = ((m.position[axis.slot()] - centre_mm) / width_mm).abs().powf(*power);
                let depth = order
                    .map_or_else(|| (-0.5 * s).exp(), |order| (1.0 - 0.5 * s / order).max(0.0).powf(order));
                put(out, 0, unit(axis.direction()) * depth);
            }
            Self::SpindleTilt => {
                let l = m.tool_length_mm * UM_PER_ARCSEC_MM;
                put(out, 0, m.head.turns(Vec3::new(0.0, l, 0.0)));
                put(out, 1, m.head.turns(Vec3::new(-l, 0.0, 0.0)));
            }
            Self::ToolLength => {
                put(out, 0, m.head.turns(Vec3::new(0.0, 0.0, -m.tool_length_mm * 1e-3)));
            }
            Self::Load { axis, along, power } => {
                let f = m.force_n[axis.direction()];
                put(out, 0, unit(along.direction()) * (f.signum() * f.abs().powf(*power)));
            }
            Self::Step { file, after_s } => {
                let on = f64::from(u8::from(m.file == *file && m.t_s >= *after_s));
                for i in 0..3 {
                    put(out, i, unit(i) * on);
                }
            }
            _ => self.evaluate_dynamic(m, out),
        }
    }

    /// Effects of motion, heat and instruments.
    fn evaluate_dynamic(&self, m: &MachineState, out: &mut [Vec3]) {
        match self {
            Self::Backlash { axis, along, length_mm, slope } => {
                backlash(*axis, along, *length_mm, *slope, m, out)
            }
            Self::Spike { axis, rise_s, fall_s, slope } => {
                let i = axis.slot();
                let moving = f64::from(u8::from(m.velocity[i].abs() > STILL));
                let since = m.since_s[i];
                let h = if since.is_finite() && m.direction[i] != 0.0 {
                    moving * m.direction[i] * ((-since / fall_s).exp() - (-since / rise_s).exp())
                } else {
                    0.0
                };
                put(out, 0, unit(axis.direction()) * h);
                if *slope {
                    put(out, 1, unit(axis.direction()) * (h * m.position[i] * 1e-3));
                }
            }
            Self::Friction { axis } => {
                let h = -(m.velocity[axis.slot()] / CREEP_MM_PER_S).tanh();
                put(out, 0, unit(axis.direction()) * h);
            }
            Self::Lag { axes, tie_ms } => {
                let mut d = Vec3::zeros();
                for a in axes {
                    d[a.direction()] += -m.velocity[a.slot()] + tie_ms * 1e-3 * m.acceleration[a.slot()];
                }
                put(out, 0, d);
            }
            Self::Inertial { axis, along, slope } => {
                let k = m.acceleration[axis.slot()] * 1e-3;
                put(out, 0, unit(along.direction()) * k);
                if *slope {
                    put(out, 1, unit(along.direction()) * (k * m.position[axis.slot()] * 1e-3));
                }
            }
            Self::InertialTilt { axis, about, lever } => {
                let r = lever.at(m);
                for (i, b) in about.iter().enumerate() {
                    let d = unit(b.direction()).cross(&r);
                    put(out, i, d * (UM_PER_ARCSEC_MM * m.acceleration[axis.slot()] * 1e-3));
                }
            }
            Self::ClockSkew { files, start_s, span_s, drift } => {
                let v = Vec3::new(m.velocity[0], m.velocity[1], m.velocity[2]);
                let each = 1 + usize::from(*drift);
                for (i, file) in files.iter().enumerate() {
                    let on = f64::from(u8::from(m.file == *file));
                    put(out, each * i, -v * on);
                    if *drift {
                        put(out, each * i + 1, -v * (on * (m.t_s - start_s[i]) / span_s[i]));
                    }
                }
            }
            _ => {}
        }
    }

    /// True where all that the effect needs is known: no part of its deviation is NaN.
    #[must_use]
    pub fn is_known_at(&self, m: &MachineState, at: &dyn Fn(&Signal) -> Option<usize>) -> bool {
        let mut out = [Vec3::zeros(); WIDTH_MAX];
        let out = &mut out[..self.width()];
        self.evaluate_with(m, at, out);
        out.iter().flatten().all(|v| v.is_finite())
    }

    /// Effects that read lagged signals; `at` gives the place of a signal in [`MachineState::signals`].
    pub fn evaluate_with(&self, m: &MachineState, at: &dyn Fn(&Signal) -> Option<usize>, out: &mut [Vec3]) {
        let value = |s: &Signal| at(s).and_then(|i| m.signals.get(i)).copied().unwrap_or(f64::NAN);
        match self {
            Self::Thermal { axis, signal, reference_degc, with_offset } => {
                let dt = value(signal) - reference_degc;
                put(out, 0, unit(axis.direction()) * (dt * m.position[axis.slot()] * 1e-3));
                if *with_offset {
                    put(out, 1, unit(axis.direction()) * dt);
                }
            }
            Self::Growth { signals, along, reference } => {
                for (i, s) in signals.iter().enumerate() {
                    let v = value(s) - reference;
                    for (j, a) in along.iter().enumerate() {
                        put(out, i * along.len() + j, unit(a.direction()) * v);
                    }
                }
            }
            Self::DeadPath { signal, light, station } => {
                let dt = value(signal) - REFERENCE_DEGC;
                let own = line_of_sight(m);
                let counts = m.light.is_some_and(|own| light.is_none_or(|wanted| own == wanted))
                    && station.is_none_or(|wanted| own.is_some() == wanted);
                let line = if counts { own.unwrap_or(m.u) } else { Vec3::zeros() };
                put(out, 0, line * (dt * m.range_mm * 1e-3));
                put(out, 1, line * dt);
            }
            Self::TrackerScale { signal, zero } => {
                // a laser on a tripod has a station, too
                let r =
                    line_of_sight(m).filter(|_| m.light != Some(Light::Laser)).unwrap_or_else(Vec3::zeros);
                let dt = signal.as_ref().map_or(1.0, |s| value(s) - REFERENCE_DEGC);
                put(out, 0, r * (m.range_mm * 1e-3 * dt));
                if *zero {
                    put(out, 1, r);
                }
            }
            Self::RotaryLocation { .. }
            | Self::RotaryMotion { .. }
            | Self::RotaryEccentricity { .. }
            | Self::RotaryBacklash { .. }
            | Self::RotaryLag { .. }
            | Self::RotaryScale { .. } => self.evaluate_rotary(m, out),
            _ => self.evaluate(m, out),
        }
    }

    fn evaluate_rotary(&self, m: &MachineState, out: &mut [Vec3]) {
        match self {
            Self::RotaryLocation { frame, tied } => {
                let (outer, own, p) = frame.state(m);
                let a = frame.axis.direction();
                let (b, c) = ((a + 1) % 3, (a + 2) % 3);
                let tilts = out.len() - 2;
                // what is right at the zero of the axis is wrong by the same in the turned frame
                let at_zero = if *tied { Mat3::zeros() } else { own };
                for (i, k) in [b, c].into_iter().enumerate() {
                    let l = unit(k);
                    if tilts > 0 {
                        put(out, i, outer * (l - at_zero * l) * frame.sign());
                    }
                    let d = l.cross(&(own * p)) - at_zero * l.cross(&p);
                    put(out, tilts + i, outer * d * (frame.sign() * UM_PER_ARCSEC_MM));
                }
            }
            Self::RotaryMotion { axis, along, low, high, frame } => {
                let q = m.position[axis.slot()];
                let turned = frame.as_ref().map_or_else(Mat3::identity, |f| f.product(&f.outer, m));
                let orders = high + 1 - low;
                for (j, a) in along.iter().enumerate() {
                    for n in 0..orders {
                        let (s, c) = ((low + n) as f64 * q).sin_cos();
                        let way = turned * unit(a.direction());
                        put(out, 2 * (j * orders + n), way * (c - 1.0));
                        put(out, 2 * (j * orders + n) + 1, way * s);
                    }
                }
            }
            Self::RotaryEccentricity { frame, .. }
            | Self::RotaryBacklash { frame }
            | Self::RotaryLag { frame }
            | Self::RotaryScale { frame } => {
                let (outer, own, p) = frame.state(m);
                let axis = unit(frame.axis.direction());
                // a table turns against its coordinate, so the sign cancels in the angle of tool against workpiece
                let um_per_rad = outer * axis.cross(&(own * p)) * UM_PER_MM;
                let arm = um_per_rad * RAD_PER_ARCSEC;
                let slot = frame.axis.slot();
                let harmonics = match self {
                    Self::RotaryEccentricity { harmonics, .. } => harmonics,
                    Self::RotaryLag { .. } => {
                        put(out, 0, um_per_rad * (-1e-3 * m.velocity[slot]));
                        return;
                    }
                    Self::RotaryScale { .. } => {
                        put(out, 0, um_per_rad * (1e-6 * m.position[slot]));
                        return;
                    }
                    _ => {
                        put(out, 0, arm * (-0.5 * m.direction[slot]));
                        return;
                    }
                };
                for n in 0..*harmonics {
                    let (s, c) = ((n + 1) as f64 * m.position[frame.axis.slot()]).sin_cos();
                    put(out, 2 * n, arm * (c - 1.0));
                    put(out, 2 * n + 1, arm * s);
                }
            }
            _ => {}
        }
    }

    /// True for curves that bend to anything smooth.
    #[must_use]
    pub const fn is_free_curve(&self) -> bool {
        matches!(
            self,
            Self::Polynomial { .. }
                | Self::Reverse { .. }
                | Self::Angular { .. }
                | Self::Wear { .. }
                | Self::Cyclic { .. }
                | Self::Sag { .. }
                | Self::Ram { .. }
                | Self::RotaryMotion { .. }
        )
    }

    /// The direction of the deviation, where it is a single one.
    #[must_use]
    pub fn acts_along(&self) -> Option<Axis> {
        match self {
            Self::Squareness { along, .. }
            | Self::Polynomial { along, .. }
            | Self::Cyclic { along, .. }
            | Self::Inertial { along, .. }
            | Self::Load { along, .. } => Some(*along),
            Self::Scale { axis }
            | Self::Reverse { axis, .. }
            | Self::Friction { axis }
            | Self::Spike { axis, .. }
            | Self::Wear { axis, .. } => Some(*axis),
            Self::Backlash { along, .. } | Self::Growth { along, .. } if along.len() == 1 => Some(along[0]),
            Self::Lag { axes, .. } if axes.len() == 1 => Some(axes[0]),
            Self::Sag { tool: false, .. } | Self::ToolLength => Some(Axis::Z),
            _ => None,
        }
    }

    /// True for a straightness that brings its own slope; it comes in only in the place of one without.
    #[must_use]
    pub const fn has_slope(&self) -> bool {
        matches!(self, Self::Polynomial { low: 1, .. })
    }

    /// The same curve with (true) or without the slope of its own; other effects as they are.
    #[must_use]
    pub fn with_line(&self, line: bool) -> Self {
        let mut shape = self.clone();
        if let Self::Polynomial { low, .. } = &mut shape {
            *low = if line { 1 } else { 2 };
        }
        shape
    }

    /// True for what a curve with a slope of its own may stand for: neither a line, which every such curve could say, nor a
    /// curve that is counted from a line.
    #[must_use]
    pub const fn allows_lines(&self) -> bool {
        let is_line = matches!(self, Self::Squareness { .. } | Self::Scale { .. });
        let is_counted = matches!(self, Self::Polynomial { .. } | Self::Reverse { .. } | Self::Cyclic { .. });
        !is_line && !is_counted
    }

    /// True for a straight line in the direction and over the axis of a curve; a squareness is one in both directions.
    #[must_use]
    pub fn may_be_the_slope_of(&self, curve: &Self) -> bool {
        let Self::Polynomial { along, over, .. } = curve else { return false };
        match self {
            Self::Squareness { along: a, over: b } => [(a, b), (b, a)].contains(&(along, over)),
            Self::Scale { axis } => axis == along && axis == over,
            _ => false,
        }
    }

    /// The axis of whose position it is a function, where there is one.
    #[must_use]
    pub fn over(&self) -> Option<Axis> {
        match self {
            Self::Squareness { over, .. } | Self::Polynomial { over, .. } | Self::Angular { over, .. } => {
                Some(*over)
            }
            Self::Scale { axis }
            | Self::Reverse { axis, .. }
            | Self::Thermal { axis, .. }
            | Self::Cyclic { axis, .. }
            | Self::Sag { axis, .. }
            | Self::Ram { axis, .. }
            | Self::RotaryMotion { axis, .. }
            | Self::Wear { axis, .. } => Some(*axis),
            Self::RotaryLocation { frame, .. }
            | Self::RotaryEccentricity { frame, .. }
            | Self::RotaryScale { frame } => Some(frame.axis),
            _ => None,
        }
    }

    /// The lagged signals that it reads.
    #[must_use]
    pub fn signals(&self) -> Vec<&Signal> {
        match self {
            Self::Thermal { signal, .. } | Self::DeadPath { signal, .. } => vec![signal],
            Self::Growth { signals, .. } => signals.iter().collect(),
            Self::TrackerScale { signal: Some(signal), .. } => vec![signal],
            _ => Vec::new(),
        }
    }
}

/// The unit vector from station to target, where an instrument has a station.
#[must_use]
pub fn line_of_sight(m: &MachineState) -> Option<Vec3> {
    let line = m.reflector_mm - m.station_mm;
    let length = line.norm();
    (length > 0.0 && length.is_finite()).then(|| line / length)
}

fn backlash(axis: Axis, along: &[Axis], length: f64, slope: bool, m: &MachineState, out: &mut [Vec3]) {
    let i = axis.slot();
    let since = m.since_mm[i];
    let share = if length > 0.0 && since.is_finite() { 1.0 - (-since.abs() / length).exp() } else { 1.0 };
    let v = -0.5 * m.direction[i] * share;
    let each = 1 + usize::from(slope);
    for (j, a) in along.iter().enumerate() {
        put(out, each * j, unit(a.direction()) * v);
        if slope {
            put(out, each * j + 1, unit(a.direction()) * (v * m.position[i] * 1e-3));
        }
    }
}
