//! What a session holds, as far as it decides which effects it can show.

use std::collections::{BTreeMap, BTreeSet};

use super::super::constants::{FEW, HALF, MANY, MOVES, SEES};
use super::super::moment::{Axis, Light, Moment, SLOTS, Signal, Source};
use super::super::session::{Session, Spans, is_encoder};
use super::STILL;
use volcomp_effects::SPINDLE_S;
use volcomp_effects::data::Data;

/// Positions that differ by less are one.
const SAME_MM: f64 = 1e-3;
const SAME_RAD: f64 = 1e-5;

/// The facts of a session.
pub(super) fn data(s: &Session) -> Data {
    let of_axes = |fact: &dyn Fn(usize) -> bool| {
        let mut all = [false; SLOTS];
        s.axes.iter().for_each(|a| all[a.slot()] = fact(a.slot()));
        all
    };
    let spread = |of: &dyn Fn(&Moment) -> f64| {
        let values = s.moments.iter().map(of).filter(|v| v.is_finite());
        values.fold(None, |r: Option<[f64; 2]>, v| Some(r.map_or([v, v], |[l, h]| [l.min(v), h.max(v)])))
    };
    let changes = |least: f64, of: &dyn Fn(&Moment) -> f64| spread(of).is_some_and(|[l, h]| h - l > least);
    let position = |i: usize| spread(&|m| m.position[i]).filter(|[l, h]| h - l > STILL);
    let moved = of_axes(&|i| position(i).is_some());
    let any = |is: &dyn Fn(&Moment) -> bool| s.moments.iter().any(is);
    let targets =
        Axis::ALL.map(|a| if moved[a.slot()] { positions(s, a, &looks_along(a)) } else { Vec::new() });
    let (sources, spans) = (s.history.sources().into_iter(), s.spans());
    Data {
        machine: s.machine.clone(),
        axes: s.axes.clone(),
        range: core::array::from_fn(|i| if moved[i] { position(i) } else { None }),
        moves: of_axes(&|i| any(&|m| m.velocity[i].abs() > STILL)),
        accelerates: of_axes(&|i| changes(1e3 * STILL, &|m| m.acceleration[i])),
        reverses: of_axes(&|i| spread(&|m| m.direction[i]).is_some_and(|[l, h]| l < 0.0 && h > 0.0)),
        soonest_s: core::array::from_fn(|i| soonest(s, i, |m| m.since_s[i])),
        nearest: core::array::from_fn(|i| soonest(s, i, |m| m.since_mm[i].abs())),
        forces: core::array::from_fn(|i| changes(STILL, &|m| m.force_n[i])),
        sees: core::array::from_fn(|i| any(&|m| m.u[i].abs() > SEES)),
        positions: Axis::LINEAR
            .map(|a| if moved[a.slot()] { positions(s, a, &|_| true) } else { Vec::new() }),
        looked_at: Axis::LINEAR.map(|a| {
            let along = |b: Axis| positions(s, a, &|m| m.u[b.slot()].abs() > SEES);
            Axis::LINEAR.map(|b| match moved[a.slot()] {
                true if a == b => targets[a.slot()].clone(),
                true => along(b),
                false => Vec::new(),
            })
        }),
        tested: Axis::ALL.map(|a| {
            let looking = |along| if moved[a.slot()] { tested(s, &spans, a, along) } else { Vec::new() };
            Axis::LINEAR.map(looking)
        }),
        targets,
        tools: changes(MOVES[0], &|m| m.tool_length_mm),
        lengths: any(&|m| m.tool_length_mm.is_finite()),
        ranges: changes(MOVES[0], &|m| m.range_mm),
        lights: Light::ALL.into_iter().filter(|l| any(&|m| m.light == Some(*l))).collect(),
        angular: any(&|m| m.is_angular()),
        only_angles: !any(&|m| !m.is_angular()),
        ballbar_setups: {
            let of_ballbar = s.moments.iter().filter(|m| m.is_ballbar);
            of_ballbar.map(|m| m.setup).collect::<BTreeSet<_>>().into_iter().collect()
        },
        stations: any(&|m| m.station_mm.iter().all(|v| v.is_finite())),
        one_setup: s.setups.len() == 1,
        encoders_only: s.instruments.iter().all(|n| is_encoder(n)),
        clocks: clocks(s),
        sources: sources
            .filter_map(|o| Some((o.clone(), s.history.range(&o)?, s.history.first(&o)?)))
            .collect(),
        follow_spindle: follow_spindle(s),
        first: s.moments.first().cloned().unwrap_or_default(),
    }
}

/// Temperatures whose changes are mostly those of the lagged speed of the spindle.
fn follow_spindle(s: &Session) -> Vec<Source> {
    let step = s.moments.len().div_ceil(MANY).max(1);
    // over a step a trend is a constant, which goes with nothing
    let changes = |source: &Source, tau_s| -> Option<Vec<f64>> {
        let values = s.history.lagged(&Signal::of(source.clone(), tau_s), &s.moments)?;
        let seen: Vec<(usize, f64)> = s.moments.iter().map(|m| m.file).zip(values).step_by(step).collect();
        let within = seen.windows(2).filter(|w| w[0].0 == w[1].0);
        Some(within.map(|w| w[1].1 - w[0].1).collect())
    };
    let speeds: Vec<Vec<f64>> =
        SPINDLE_S.into_iter().filter_map(|tau_s| changes(&Source::Spindle, tau_s)).collect();
    let follows =
        |own: &Vec<f64>| own.len() >= FEW && speeds.iter().any(|speed| determination(own, speed) > HALF);
    let mut temperatures = s.history.sources();
    temperatures.retain(|source| {
        let is_asked = !speeds.is_empty() && matches!(source, Source::Temperature(_));
        is_asked && changes(source, 0.0).as_ref().is_some_and(follows)
    });
    temperatures
}

/// Share of the variance of some values that goes with others.
fn determination(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (of_a, of_b) = (mean(a), mean(b));
    let moment =
        |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(x, y)| f(x - of_a, y - of_b)).sum::<f64>();
    let (both, own, other) = (moment(&|x, y| x * y), moment(&|x, _| x * x), moment(&|_, y| y * y));
    if own > 0.0 && other > 0.0 { both * both / (own * other) } else { 0.0 }
}

/// How soon after a reversal of an axis a reading was taken in motion, 0 without any.
fn soonest(s: &Session, slot: usize, since: impl Fn(&Moment) -> f64) -> f64 {
    let moving = s.moments.iter().filter(|m| m.velocity[slot].abs() > STILL);
    moving.map(since).filter(|v| v.is_finite()).reduce(f64::min).unwrap_or(0.0)
}

/// The positions of an axis at some readings, mm, in order, each once.
fn positions(s: &Session, axis: Axis, of: &dyn Fn(&Moment) -> bool) -> Vec<f64> {
    let same = if axis.is_linear() { SAME_MM } else { SAME_RAD };
    let place = |m: &Moment| (m.position[axis.slot()] / same).round() as i64;
    let mut seen: Vec<i64> = s.moments.iter().filter(|m| of(m)).map(place).collect();
    seen.sort_unstable();
    seen.dedup();
    seen.into_iter().map(|place| place as f64 * same).collect()
}

/// The targets of the tests of an axis, in order; of a linear one of those that look along a direction. Where nothing tests its
/// positioning, all readings do.
fn tested(s: &Session, spans: &[Spans], axis: Axis, along: Axis) -> Vec<f64> {
    let moves = |setup: usize, slot: usize| spans[setup][slot][1] - spans[setup][slot][0] > STILL;
    let alone = |m: &Moment| (0..SLOTS).all(|slot| moves(m.setup, slot) == (slot == axis.slot()));
    let is_test = |m: &Moment| m.velocity[axis.slot()].abs() <= STILL && alone(m);
    let looks = |m: &Moment| !axis.is_linear() || m.u[along.slot()].abs() > SEES;
    let has_test = s.moments.iter().any(|m| looks(m) && is_test(m));
    let any_does = !has_test && (axis == along || !axis.is_linear());
    let of = |m: &Moment| looks(m) && (any_does || is_test(m));
    let targets = positions(s, axis, &of);
    let readings = s.moments.iter().filter(|m| of(m)).count();
    if readings >= 2 * targets.len() { targets } else { Vec::new() }
}

/// Readings that see a displacement of an axis along itself; of a rotary axis all may.
fn looks_along(axis: Axis) -> impl Fn(&Moment) -> bool {
    move |m| !axis.is_linear() || m.u[axis.slot()].abs() > SEES
}

/// Start and duration of what each file measured in motion on a clock that is not the control's, s.
fn clocks(s: &Session) -> Vec<(usize, f64, f64)> {
    let mut spans: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for (m, r) in s.moments.iter().zip(&s.readings) {
        // the control's own encoders are on the control's own clock
        let own = is_encoder(&s.instruments[r.instrument]);
        if !own && (0..3).any(|i| m.velocity[i].abs() > STILL) {
            spans.entry(m.file).or_insert((m.t_s, m.t_s)).1 = m.t_s;
        }
    }
    spans.into_iter().map(|(file, (start, end))| (file, start, (end - start).max(STILL))).collect()
}

#[cfg(test)]
mod tests {
    use super::determination;

    #[test]
    fn what_goes_with_other_values_is_told_from_what_does_not() {
        let a = [1.0, -2.0, 3.0, 0.5, -1.5];
        let scaled: Vec<f64> = a.iter().map(|v| 4.0 - 0.3 * v).collect();
        assert!((determination(&a, &scaled) - 1.0).abs() < 1e-12);
        assert!(determination(&a, &[1.0, 1.0, 0.0, -1.0, -1.0]) < 0.3);
        // values that do not change go with nothing
        assert_eq!(determination(&a, &[2.0; 5]), 0.0);
    }
}
