//! Values that are possible but odd: units off by a thousand, columns that never change, jumps in time. What is certain is
//! refused by [`super::check`]; here it is a note, because some machine may be like that.

use std::collections::BTreeMap;

use super::super::constants::bounds::{
    DEGC, DEVIATION_UM, PAUSE_S, SCATTER_UM, SPEED_MM_PER_S, STEP_S, TOOL_MM, TRAVEL_MM, TWO_UNITS,
};
use super::super::constants::{FEW, SEES};
use super::super::moment::{Axis, Machine, MachineAxis};
use super::{Note, Raw, Session, SessionError, has_rotation, is_angular, is_encoder};
use volcomp_units::deg_from_rad;

/// RMS about the mean and RMS of the deviations of each setup with enough of them, um.
fn sizes(raw: &Raw) -> BTreeMap<i64, (f64, f64)> {
    let mut setups: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    let deviation = raw.column("deviation_um").unwrap_or(&[]);
    for (s, d) in raw.column("setup").unwrap_or(&[]).iter().zip(deviation).filter(|(_, d)| d.is_finite()) {
        setups.entry(*s as i64).or_default().push(*d);
    }
    let rms = |values: &[f64], centre: f64| {
        (values.iter().map(|v| (v - centre).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    setups
        .into_iter()
        .filter(|(_, d)| d.len() >= FEW)
        .map(|(s, d)| (s, (rms(&d, d.iter().sum::<f64>() / d.len() as f64), rms(&d, 0.0))))
        .collect()
}

/// Refuses setups whose deviations can only be in another unit.
pub(super) fn units_of_setups(raw: &Raw) -> Result<(), SessionError> {
    let sizes = sizes(raw);
    let largest = sizes.values().map(|s| s.1).fold(0.0, f64::max);
    let wrong = |what: String, remedy: &'static str| {
        let column = "deviation_um".to_owned();
        Err(SessionError::Unit { file: raw.file.clone(), column, what, remedy })
    };
    let shifted_only = raw.instruments.iter().all(|n| !is_encoder(n) && !has_rotation(n));
    for (setup, (scatter, size)) in &sizes {
        if *size > 0.0 && *size < DEVIATION_UM[0] && *size * TWO_UNITS < largest {
            let what = format!("has an RMS of {size:.5} µm in setup {setup}, of {largest:.2} µm in another");
            return wrong(what, "is that setup in mm? the column is in um: multiply by 1000");
        }
        if shifted_only && *scatter > SCATTER_UM {
            let what = format!(
                "scatters by {scatter:.0} µm RMS in setup {setup}, limit {:.0} for an instrument that is only shifted",
                SCATTER_UM
            );
            return wrong(what, "are these nm? the column is in µm");
        }
    }
    Ok(())
}

/// What looks odd.
pub(super) fn of(raw: &Raw) -> Vec<Note> {
    let mut odd = Vec::new();
    let file = &raw.file;
    let mut say = |what: String| odd.push(Note::new(format!("{file}: {what}")));
    let sizes = sizes(raw);
    let scatter = sizes.values().map(|s| s.0).fold(0.0, f64::max);
    let shifted_only = raw.instruments.iter().all(|n| !is_encoder(n) && !has_rotation(n));
    if shifted_only && scatter > DEVIATION_UM[2] {
        say(format!("deviation_um scatters by {scatter:.0} µm RMS: are these nm? the column is in µm"));
    }
    if scatter > 0.0 && scatter < DEVIATION_UM[1] && !is_angular(raw) {
        say(format!("deviation_um scatters by {scatter:.3} µm RMS only: are these mm? the column is in µm"));
    }
    if raw.instruments.iter().any(|n| n == UNNAMED) {
        say("no column instrument: all readings count as one class of noise".to_owned());
    }
    positions(raw, &mut say);
    times(raw, &mut say);
    let largest =
        |values: &[f64]| values.iter().filter(|v| v.is_finite()).fold(0.0f64, |m, v| m.max(v.abs()));
    let tool = largest(raw.column("tool_length_mm").unwrap_or(&[]));
    if tool > 0.0 && tool < TOOL_MM {
        say(format!("tool_length_mm reaches {tool:.3} mm only: are these m? the column is in mm"));
    }
    for (name, values) in raw.names.iter().zip(&raw.columns) {
        let warm = largest(values);
        if name.starts_with("temp_") && name.ends_with("_degc") && warm > 0.0 && warm < DEGC[0] {
            say(format!(
                "{name} stays within {warm:.3} degC of zero: is it in thousands? the column is in degC"
            ));
        }
    }
    odd
}

/// The word of rows whose file has no column `instrument`.
pub(super) const UNNAMED: &str = "instrument";

fn span(values: &[f64]) -> f64 {
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    high - low
}

fn positions(raw: &Raw, say: &mut dyn FnMut(String)) {
    let mut widest = 0.0f64;
    for axis in Axis::LINEAR {
        // an angle is given as displacement, but no position along it is seen
        let seen = raw.column(&format!("u_{axis}")).is_some_and(|u| u.iter().any(|v| v.abs() > SEES))
            && !is_angular(raw);
        match raw.column(&axis.column()) {
            None if seen => say(format!(
                "no column {}, though readings look along {axis}: nothing that goes with its position can be seen",
                axis.column()
            )),
            Some(values) if seen && span(values) == 0.0 => say(format!(
                "{} is {} in all rows: nothing that goes with it can be seen",
                axis.column(),
                values.first().copied().unwrap_or(0.0)
            )),
            Some(values) => widest = widest.max(span(values)),
            None => {}
        }
    }
    if widest > 0.0 && widest < TRAVEL_MM[0] {
        say(format!("positions stay within {widest:.3} mm: are these m? the columns are in mm"));
    }
}

fn times(raw: &Raw, say: &mut dyn FnMut(String)) {
    let (Some(t), Some(run)) = (raw.column("t_s"), raw.column("run")) else { return };
    if t.len() > 1 && span(t) == 0.0 {
        say("t_s is the same in all rows: neither drift nor anything that moves can be told".to_owned());
        return;
    }
    let follows = |i: &usize| run[*i] == run[i - 1] && t[*i] > t[i - 1];
    let mut steps: Vec<f64> = (1..t.len()).filter(follows).map(|i| t[i] - t[i - 1]).collect();
    let step = super::super::noise::median(&mut steps);
    if step > STEP_S {
        say(format!("readings of a run follow each other every {step:.0} s: are these ms? t_s is in s"));
    }
    for axis in Axis::LINEAR {
        let Some(x) = raw.column(&axis.column()) else { continue };
        let moved = |i: &usize| follows(i) && x[*i] != x[i - 1];
        let mut speeds: Vec<f64> =
            (1..t.len()).filter(moved).map(|i| (x[i] - x[i - 1]).abs() / (t[i] - t[i - 1])).collect();
        let speed = super::super::noise::median(&mut speeds);
        if speed > SPEED_MM_PER_S {
            say(format!(
                "{} and t_s give {speed:.0} mm/s between readings: check their units",
                axis.column()
            ));
        }
    }
    let pause = (1..t.len()).map(|i| t[i] - t[i - 1]).fold(0.0, f64::max);
    if pause > PAUSE_S[0] {
        say(format!("t_s pauses for {:.1} days: is all of it on one clock?", pause / 86_400.0));
    }
}

/// Share of the travel by which positions may lie outside it.
const OUTSIDE: f64 = 0.01;

impl Session {
    /// Range of the positions of an axis, mm or rad; none where it stands still.
    #[must_use]
    pub fn range(&self, axis: Axis) -> Option<[f64; 2]> {
        let positions = self.moments.iter().map(|m| m.position[axis.slot()]);
        let ends = (f64::INFINITY, f64::NEG_INFINITY);
        let (low, high) = positions.fold(ends, |(l, h), v| (l.min(v), h.max(v)));
        (low < high).then_some([low, high])
    }

    /// Axes whose positions leave the travel that the model states: probably it is the model of another machine.
    #[must_use]
    pub fn outside_travel(&self, machine: &Machine) -> Vec<Note> {
        let leaves = |a: &MachineAxis| {
            let (unit, scale) = if a.axis.is_linear() { ("mm", 1.0) } else { ("deg", deg_from_rad(1.0)) };
            let [low, high] = a.travel?.map(|v| scale * v);
            let [from, to] = self.range(a.axis)?.map(|v| scale * v);
            let allowed = OUTSIDE * (high - low);
            let name = a.axis.to_string().to_uppercase();
            let text = || {
                format!(
                    "{name} runs from {from:.1} to {to:.1} {unit}, the travel of the model is {low:.1} to {high:.1} {unit}: \
                     is it the model of this machine?"
                )
            };
            (from < low - allowed || to > high + allowed).then(|| Note::new(text()))
        };
        machine.axes.iter().filter_map(leaves).collect()
    }
}
