//! What docs/explanation/safety.md and docs/protocol.md promise, as checks of recorded cycles.

use simulator::control::CycleRecord;
use simulator::demo::figures;
use simulator::motion::{MotionSource, Trajectory};
use volcomp::model::axes::AxisArray;
use volcomp::protocol::{CorrectionState, MachineState};

use super::{Bench, CENTRE_MM, RADIUS_MM, Setup, ramping_out};

/// Rate limit of every axis in the shipped machine file, mm/s.
const RATE: f64 = 2.0;
/// The control's hold time, cycles of 1 ms.
pub(crate) const HOLD_CYCLES: usize = 100;
/// Rate and acceleration at which the control takes an offset back, mm/s and mm/s^2.
const BACK_RATE: f64 = 0.1;
const BACK_ACCELERATION: f64 = 1.0;
/// A tenth of the shipped rate limit: more than any blend of these offsets in half a second needs, mm per cycle.
const SMOOTH: f64 = RATE * 0.1 * 1e-3;
const AXES: usize = 3;
/// Cycles at the end of a run over which accuracy is judged.
const JUDGED: usize = 1000;

fn deltas(pair: &[CycleRecord]) -> [f64; AXES] {
    core::array::from_fn(|k| pair[1].applied[k] - pair[0].applied[k])
}

/// The offset moves smoothly, and every value is finite; the monitor of the bench checks the limits.
pub(crate) fn assert_smooth(records: &[CycleRecord]) {
    assert_bounded(records, SMOOTH);
}

/// The same in real time, where a loaded computer delays frames: what has built up meanwhile comes in one cycle.
pub(crate) fn assert_smooth_in_real_time(records: &[CycleRecord]) {
    assert_bounded(records, 3.0 * SMOOTH);
}

fn assert_bounded(records: &[CycleRecord], limit: f64) {
    for r in records {
        let axes = r.applied.iter().chain(&r.sample.axis).chain(&r.sample.tip_mm);
        assert!(axes.copied().all(f64::is_finite), "cycle {}: {r:?}", r.cycle);
    }
    for pair in records.windows(2) {
        assert_eq!(pair[1].cycle, pair[0].cycle + 1);
        let step = deltas(pair);
        assert!(
            step.iter().all(|v| v.abs() <= limit),
            "cycle {}: a step of {step:?} mm from {:?} to {:?}",
            pair[1].cycle,
            pair[0].applied,
            pair[1].applied
        );
    }
}

/// The motion is the programmed one, cycle by cycle; where the machine is not ready it stands still.
pub(crate) fn assert_motion(records: &[CycleRecord], mut planned: Trajectory) {
    planned.rewind();
    let mut at = planned.start();
    for r in records {
        if r.state.is_ready() {
            at = planned.next_cycle().map_or(at, |next| next.commanded);
        }
        assert_eq!(r.commanded, at, "cycle {}", r.cycle);
    }
}

/// `records`: the last cycle that was answered, then those without a daemon. Held, then taken back smoothly.
pub(crate) fn assert_held_then_taken_back(records: &[CycleRecord]) {
    let answer = records[0].correction.expect("answered").offset;
    let alone = &records[1..];
    assert!(alone.iter().all(|r| r.correction.is_none()));
    for r in alone.iter().take(HOLD_CYCLES) {
        assert_eq!(r.applied[..AXES], answer[..AXES], "cycle {}: held", r.cycle);
        assert!(!ramping_out(r), "cycle {}: within the hold time", r.cycle);
    }
    let back = alone.get(HOLD_CYCLES - 1..).unwrap_or_default();
    let mut before = [0.0; AXES];
    for pair in back.windows(2) {
        let (step, r) = (deltas(pair), &pair[1]);
        for k in 0..AXES {
            assert!(step[k].abs() <= BACK_RATE * 1e-3 + 1e-12, "cycle {}: {step:?}", r.cycle);
            // slowing down at the very end may happen within one cycle that is not full
            let change = (step[k] - before[k]).abs();
            assert!(change <= BACK_ACCELERATION * 1e-6 + 1e-12, "cycle {}: {change} mm", r.cycle);
            assert!(r.applied[k].abs() <= pair[0].applied[k].abs(), "cycle {}: towards zero", r.cycle);
        }
        assert_eq!(ramping_out(r), r.applied != [0.0; 8], "cycle {}", r.cycle);
        before = step;
    }
}

/// `records`: from the first cycle of a new daemon on. It starts from what the control holds and blends in.
pub(crate) fn assert_taken_over(records: &[CycleRecord]) {
    let first = &records[0];
    let answer = first.correction.expect("answered");
    assert_same(&answer.offset, &first.applied, "the first offset sent is the one held");
    assert_ne!(answer.state, CorrectionState::Active);
    assert!(records[1..].iter().all(|r| !ramping_out(r)), "the control follows again");
    let blending = records
        .iter()
        .take_while(|r| r.correction.is_none_or(|c| c.state != CorrectionState::Active))
        .count();
    assert!((500..700).contains(&blending), "{blending} cycles until active");
    let states: Vec<CorrectionState> = records.iter().filter_map(|r| r.correction.map(|c| c.state)).collect();
    assert!(states.contains(&CorrectionState::RampingIn));
    assert_smooth(records);
}

pub(crate) fn assert_same(a: &AxisArray, b: &AxisArray, why: &str) {
    let close = a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(close, "{why}: {a:?} and {b:?}");
}

/// The offset does not move at all in these cycles.
pub(crate) fn assert_frozen(records: &[CycleRecord]) {
    for r in records {
        assert_eq!(r.applied, records[0].applied, "cycle {}", r.cycle);
    }
}

/// Largest radial deviation over the last cycles of a run on the circle, um.
pub(crate) fn radial_um(bench: &Bench) -> f64 {
    let scored: Vec<CycleRecord> = bench.records.iter().filter(|r| r.scored).copied().collect();
    let last = &scored[scored.len() - JUDGED..];
    assert!(last.iter().all(|r| r.state.has(MachineState::MOVING)));
    let trace = figures::ballbar(bench.shop.machine(), CENTRE_MM, RADIUS_MM, last).unwrap();
    trace.readings.iter().map(|r| r.deviation_um.abs()).fold(0.0, f64::max)
}

/// The same circles without and with a daemon that nothing happens to: largest radial deviations, um.
pub(crate) fn undisturbed_um(turns: usize) -> [f64; 2] {
    let mut without = Bench::new(Setup::default(), turns);
    without.run_to_end();
    assert!(without.records.iter().all(|r| r.applied == [0.0; 8]));
    let mut with = Bench::new(Setup::default(), turns);
    let _daemon = with.connected_daemon();
    with.run_to_end();
    assert_smooth(&with.records);
    [radial_um(&without), radial_um(&with)]
}

/// As accurate at the end as without any disturbance.
pub(crate) fn assert_accurate(bench: &Bench, undisturbed_um: [f64; 2]) {
    let [without, with] = undisturbed_um;
    let now = radial_um(bench);
    assert!(with < 0.2 * without, "the reference itself: {with} um instead of {without} um");
    assert!(now <= with + 0.5, "{now} um at the end, undisturbed {with} um, without {without} um");
    let end = bench.records.iter().rfind(|r| r.scored).expect("a scored cycle");
    assert_eq!(end.correction.map(|c| c.state), Some(CorrectionState::Active));
}
