//! Lags: of the servo of one axis, of all of them, of the clock of the instrument.

use crate::extend::{fastest, steepest};
use crate::prelude::*;
use volcomp_units::rad_from_deg;

/// Most files with a clock of their own.
const CLOCKS_MAX: usize = 12;
/// mm/s and mm/s^2 per unit of what stands in ms.
const PER_MS: f64 = 1e-3;

const AT_REST: &str = "no readings while the axis moves";
const ALL_AT_REST: &str = "no readings while an axis moves";

/// Variants of `servo-mismatch`.
pub(super) fn servo_mismatch(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    if data.moved(axis)?.is_none() {
        return Ok(Vec::new());
    }
    if !data.moves[axis.slot()] {
        return Err(AT_REST.into());
    }
    let linear = || Lag::of(vec![axis]).into();
    let rotary = data.frame(axis).filter(|_| !axis.is_linear());
    Ok(vec![rotary.map_or_else(linear, |frame| RotaryLag { frame }.into())])
}

/// Variants of `latency`.
pub(super) fn latency(data: &Data, _: &Subject) -> Variants {
    let moving: Vec<Axis> = Axis::ALL.into_iter().filter(|a| data.moves[a.slot()]).collect();
    let axes: Vec<Axis> = moving.iter().copied().filter(|a| a.is_linear()).collect();
    match moving[..] {
        [] => Err(ALL_AT_REST.into()),
        _ if !axes.is_empty() => Ok(vec![Lag::of(axes).into()]),
        // alone in motion, a rotary axis that lags is confounded with a delay of all axes
        [axis] => Ok(data.frame(axis).map(|frame| RotaryLag { frame }.into()).into_iter().collect()),
        _ => Ok(Vec::new()),
    }
}

/// Variants of `clock-skew`.
pub(super) fn clock_skew(data: &Data, _: &Subject) -> Variants {
    if !data.moves.contains(&true) {
        return Err(ALL_AT_REST.into());
    }
    let clocks = &data.clocks;
    if clocks.is_empty() || clocks.len() > CLOCKS_MAX {
        return Ok(Vec::new());
    }
    let shape = |drift| ClockSkew {
        files: clocks.iter().map(|c| c.0).collect(),
        start_s: clocks.iter().map(|c| c.1).collect(),
        span_s: clocks.iter().map(|c| c.2).collect(),
        drift,
    };
    Ok([false, true].map(|drift| shape(drift).into()).into())
}

/// `d_a = -tau v_a + tau tie a_a` for every axis listed; behind a position loop `d_a = -tau w_a`, where `w_a` is the commanded
/// velocity behind the loop (`tau w' + u = v`, `inner u' + u = w`): `tau = 1 / Kv`, `inner` the lag of the velocity loop. Behind a
/// dead time, too, `lag` is the sum of both and `w` what the position is behind by, over it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Lag {
    pub axes: Vec<Axis>,
    pub tie_ms: f64,
    /// `w` of each axis; empty where the lag is a series in velocity and acceleration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lagged: Vec<Signal>,
}

impl Lag {
    /// The term of the velocity alone.
    #[must_use]
    pub const fn of(axes: Vec<Axis>) -> Self {
        Self { axes, tie_ms: 0.0, lagged: Vec::new() }
    }

    /// A delay: half its square stands with the acceleration.
    #[must_use]
    pub const fn delay(axes: Vec<Axis>, lag_ms: f64) -> Self {
        Self { axes, tie_ms: 0.5 * lag_ms, lagged: Vec::new() }
    }

    /// The same response of other axes.
    #[must_use]
    pub fn over(&self, axes: Vec<Axis>) -> Self {
        let of = |signal: &Signal| -> Vec<Signal> {
            axes.iter().map(|a| Signal { source: Source::Velocity(*a), ..signal.clone() }).collect()
        };
        Self { lagged: self.lagged.first().map(of).unwrap_or_default(), axes, tie_ms: self.tie_ms }
    }

    /// A position loop around a velocity loop, behind a dead time; together they lag by `lag_ms`.
    #[must_use]
    pub fn response(axes: Vec<Axis>, lag_ms: f64, [dead_ms, inner_ms]: [f64; 2]) -> Self {
        let loop_ms = lag_ms - dead_ms;
        let behind = |a: &Axis| Signal {
            inner_s: inner_ms * PER_MS,
            dead_time_s: dead_ms * PER_MS,
            ..Signal::of(Source::Velocity(*a), loop_ms * PER_MS)
        };
        // second coefficient of the series of 1 - exp(-dead s) / (1 + loop s (1 + inner s))
        let second = dead_ms * (0.5 * dead_ms + loop_ms) + loop_ms * (loop_ms - inner_ms);
        Self { lagged: axes.iter().map(behind).collect(), axes, tie_ms: second / lag_ms }
    }
}

impl Form for Lag {
    fn parameters(&self) -> Vec<String> {
        plain(&["lag_ms"])
    }

    fn evaluate(&self, m: &MachineState, read: &Read<'_>, out: &mut [Vec3]) {
        if !self.lagged.is_empty() {
            out[0] = self.axes.iter().zip(&self.lagged).map(|(a, w)| unit(a.direction()) * -read(w)).sum();
            return;
        }
        // without the second term no acceleration need be known
        let tied =
            |a: &Axis| if self.tie_ms > 0.0 { self.tie_ms * 1e-3 * m.acceleration[a.slot()] } else { 0.0 };
        let mut d = Vec3::zeros();
        for a in &self.axes {
            d[a.direction()] += -m.velocity[a.slot()] + tied(a);
        }
        out[0] = d;
    }

    fn columns(&self) -> Vec<String> {
        let velocities = self.axes.iter().map(|a| a.velocity_column());
        let tied = self.tie_ms > 0.0 && self.lagged.is_empty();
        let accelerations = self.axes.iter().filter(|_| tied).map(|a| a.acceleration_column());
        velocities.chain(accelerations).collect()
    }

    fn drawing(&self) -> Drawing {
        match self.axes[..] {
            [axis] => Over::Velocity(axis).into(),
            _ => Over::VelocityAlongU.into(),
        }
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        // against the velocity, and with the acceleration where the servo has a second time constant
        let mut all = Vec::new();
        for axis in self.axes.iter().copied() {
            let mut add = |law, most, unit| {
                all.push(Term { axis, symbol: shift(axis, axis), law, most, at: 0, slope: false, unit });
            };
            add(Law::Velocity, fastest(entry, axis)?, -mm_from_um(1.0));
            if self.tie_ms > 0.0 {
                add(Law::Acceleration, steepest(entry, axis)?, mm_from_um(self.tie_ms * PER_MS));
            }
        }
        terms(model, entry, all)
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        match self.lagged.first() {
            None if self.tie_ms > 0.0 => named(&[("filter_ms", self.tie_ms)]),
            None => Vec::new(),
            Some(w) => {
                let of = |name, time_s: f64, value| (time_s > 0.0).then_some((name, value));
                let all = [
                    of("velocity_gain_per_s", w.tau_s, 1.0 / w.tau_s),
                    of("velocity_loop_ms", w.inner_s, w.inner_s / PER_MS),
                    of("dead_time_ms", w.dead_time_s, w.dead_time_s / PER_MS),
                ];
                named(&all.into_iter().flatten().collect::<Vec<_>>())
            }
        }
    }

    fn is_valid(&self) -> bool {
        self.lagged
            .iter()
            .all(|w| w.looks_back() && [w.tau_s, w.inner_s, w.dead_time_s].iter().all(|t| *t >= 0.0))
    }

    fn traits(&self) -> Traits {
        Traits {
            acts_along: (self.axes.len() == 1).then(|| self.axes[0]),
            is_of_drive: true,
            ..Traits::default()
        }
    }

    fn signals(&self) -> Vec<&Signal> {
        self.lagged.iter().collect()
    }
}

/// `-tau omega` about the axis itself, times the radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RotaryLag {
    pub frame: RotaryFrame,
}

impl Form for RotaryLag {
    fn parameters(&self) -> Vec<String> {
        plain(&["lag_ms"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        out[0] = self.frame.um_per_rad(m) * (-1e-3 * m.velocity[self.frame.axis.slot()]);
    }

    fn columns(&self) -> Vec<String> {
        vec![self.frame.axis.column(), self.frame.axis.velocity_column()]
    }

    fn drawing(&self) -> Drawing {
        Over::Velocity(self.frame.axis).into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let axis = self.frame.axis;
        let (symbol, most) = (turn(axis, axis), rad_from_deg(fastest(entry, axis)?));
        let law = Law::Velocity;
        terms(model, entry, [Term { axis, symbol, law, most, at: 0, slope: false, unit: -PER_MS }])
    }

    fn traits(&self) -> Traits {
        Traits { is_of_drive: true, ..Traits::default() }
    }
}

/// Delay and drift of the clock of each file: `-v (d + r (t - start))`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ClockSkew {
    pub files: Vec<usize>,
    pub start_s: Vec<f64>,
    pub span_s: Vec<f64>,
    pub drift: bool,
}

impl Form for ClockSkew {
    fn parameters(&self) -> Vec<String> {
        let of = |f: &usize| [format!("delay_{}_ms", f + 1), format!("delay_gain_{}_ms", f + 1)];
        self.files.iter().flat_map(|f| of(f).into_iter().take(1 + usize::from(self.drift))).collect()
    }

    fn width(&self) -> usize {
        self.files.len() * (1 + usize::from(self.drift))
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let v = Vec3::new(m.velocity[0], m.velocity[1], m.velocity[2]);
        let each = 1 + usize::from(self.drift);
        for (i, file) in self.files.iter().enumerate() {
            let on = f64::from(u8::from(m.file == *file));
            out[each * i] = -v * on;
            if self.drift {
                out[each * i + 1] = -v * (on * (m.t_s - self.start_s[i]) / self.span_s[i]);
            }
        }
    }

    fn drawing(&self) -> Drawing {
        Over::VelocityAlongU.into()
    }

    fn traits(&self) -> Traits {
        Traits { is_of_drive: true, ..Traits::default() }
    }
}
