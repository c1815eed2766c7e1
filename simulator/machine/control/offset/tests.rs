use proptest::prelude::*;
use volcomp_units::axes::MAX_AXES;

use super::*;

const DT: f64 = 0.001;

fn axes() -> MachineAxes {
    MachineAxes::three_axis([0.0, 850.0], [0.0, 500.0], [0.0, 500.0]).unwrap()
}

fn stage(config: &OffsetConfig) -> OffsetStage {
    OffsetStage::new(config, &axes(), DT)
}

fn mid() -> AxisArray {
    let mut q = [0.0; MAX_AXES];
    q[..3].fill(250.0);
    q
}

fn answer(sequence: u32, x: f64) -> Correction {
    let mut c = Correction { sequence, ..Correction::default() };
    c.offset[0] = x;
    c
}

/// Runs to a steady offset by a smooth request; returns the next cycle.
fn settle(s: &mut OffsetStage, x: f64, cycles: u64) -> u64 {
    for n in 0..cycles {
        let share = (n as f64 / (cycles as f64 / 2.0)).min(1.0);
        s.advance(n, &mid(), true);
        let value = x * share * share * (3.0 - 2.0 * share);
        assert_eq!(s.receive(&answer(n as u32, value), n, n as u32), Verdict::Good);
    }
    cycles
}

#[test]
fn a_correction_acts_after_the_delay_exactly() {
    for delay in [1, 3] {
        let mut s = stage(&OffsetConfig { delay_cycles: delay, ..OffsetConfig::default() });
        for n in 0..20_u64 {
            let a = s.advance(n, &mid(), true);
            // a request of 0.1 um per cycle, known exactly
            let expected = if n >= u64::from(delay) { (n - u64::from(delay)) as f64 * 1e-4 } else { 0.0 };
            assert_eq!(a.offset[0], expected, "cycle {n}");
            s.receive(&answer(n as u32, n as f64 * 1e-4), n, n as u32);
        }
    }
}

#[test]
fn missing_corrections_hold_and_then_ramp_smoothly_to_zero() {
    let mut s = stage(&OffsetConfig::default());
    let from = settle(&mut s, 0.02, 2000);
    let ramp = OffsetConfig::default().ramp_linear;
    let (mut last, mut last_rate) = (0.02, 0.0);
    let mut held = 0;
    let mut reached = None;
    for n in from..from + 2000 {
        let a = s.advance(n, &mid(), true);
        let rate = (a.offset[0] - last) / DT;
        assert!(rate.abs() <= ramp.rate * (1.0 + 1e-9), "{rate}");
        assert!((rate - last_rate).abs() <= ramp.acceleration * DT * (1.0 + 1e-6) + 1e-12);
        if !a.ramping_out && a.offset[0] == 0.02 {
            held += 1;
        }
        if a.offset[0] == 0.0 && reached.is_none() {
            reached = Some(n - from);
            assert!(!a.ramping_out);
        } else if reached.is_none() && held < n - from {
            assert!(a.ramping_out || a.offset[0] == 0.02);
        }
        assert!(a.offset[0] > -1e-12, "no overshoot");
        (last, last_rate) = (a.offset[0], rate);
    }
    assert!((98..=101).contains(&held), "held {held} cycles");
    // 20 um with 0.1 mm/s and 1 mm/s^2: 0.3 s (trapezoid) after 0.1 s of holding
    let reached = reached.expect("zero is reached");
    assert!((390..460).contains(&reached), "{reached}");
}

#[test]
fn a_daemon_that_comes_back_goes_on_from_the_present_offset() {
    let mut s = stage(&OffsetConfig::default());
    let mut n = settle(&mut s, 0.02, 2000);
    let mut present = 0.0;
    for _ in 0..200 {
        present = s.advance(n, &mid(), true).offset[0];
        n += 1;
    }
    assert!(present < 0.02 && present > 0.0, "{present}");
    s.link_opened();
    // the daemon starts from the read-back it was told
    let start = present;
    let (mut last, mut last_rate) = (present, -0.1);
    for k in 0..500_u64 {
        s.receive(&answer(n as u32, start), n - 1, n as u32);
        let a = s.advance(n, &mid(), true);
        let rate = (a.offset[0] - last) / DT;
        assert!(!a.ramping_out, "cycle {k}");
        assert!((rate - last_rate).abs() <= 1000.0 * DT + 1e-9);
        (last, last_rate) = (a.offset[0], rate);
        n += 1;
    }
    assert_eq!(last, start);
}

#[test]
fn an_orderly_close_keeps_the_offset() {
    let mut s = stage(&OffsetConfig::default());
    let n = settle(&mut s, 0.02, 2000);
    s.link_closed_in_order();
    for k in n..n + 2000 {
        assert_eq!(
            s.advance(k, &mid(), true),
            Applied { offset: answer(0, 0.02).offset, ..Applied::default() }
        );
    }
}

#[test]
fn nothing_moves_while_the_machine_is_off() {
    let mut s = stage(&OffsetConfig::default());
    let n = settle(&mut s, 0.02, 2000);
    for k in n..n + 500 {
        s.receive(&answer(k as u32, 0.5), k, k as u32);
        assert_eq!(s.advance(k, &mid(), false).offset[0], 0.02);
    }
}

#[test]
fn bad_corrections_count_as_missing() {
    let mut s = stage(&OffsetConfig::default());
    s.advance(500, &mid(), true);
    assert_eq!(s.receive(&answer(500, f64::NAN), 500, 500), Verdict::NotFinite);
    assert_eq!(s.receive(&answer(501, 0.0), 500, 500), Verdict::WrongAge);
    assert_eq!(s.receive(&answer(399, 0.0), 500, 500), Verdict::WrongAge);
    assert_eq!(s.receive(&answer(450, 0.0), 500, 500), Verdict::Good);
    assert_eq!(s.receive(&answer(449, 0.0), 500, 500), Verdict::OutOfOrder);
    assert_eq!(s.receive(&answer(450, 0.0), 500, 500), Verdict::Good);
    // an axis that is not used may carry anything
    let mut unused = answer(460, 0.0);
    unused.offset[7] = f64::NAN;
    assert_eq!(s.receive(&unused, 500, 500), Verdict::Good);
}

#[test]
fn sequence_numbers_wrap() {
    let mut s = stage(&OffsetConfig::default());
    for n in 0..10_u64 {
        let sequence = (u32::MAX - 4).wrapping_add(n as u32);
        s.advance(n, &mid(), true);
        assert_eq!(s.receive(&answer(sequence, 0.0), n, sequence), Verdict::Good);
    }
}

#[test]
fn the_travel_holds_for_the_sum() {
    let config = OffsetConfig { overtravel: [0.0, 0.0], ..OffsetConfig::default() };
    let mut s = stage(&config);
    let n = settle(&mut s, -0.02, 2000);
    let mut q = mid();
    q[0] = 0.005;
    let a = s.advance(n, &q, true);
    assert!((a.offset[0] + 0.005).abs() < 1e-12 && a.limited);
}

proptest! {
    /// Whatever is asked for, size, rate and acceleration hold.
    #[test]
    fn the_offset_is_never_stepped(
        requests in prop::collection::vec(prop_oneof![
            (-2.0..2.0_f64).prop_map(Some), Just(None), Just(Some(f64::INFINITY)), (-0.001..0.001_f64).prop_map(Some),
        ], 10..400),
        hold in 0.0..0.02_f64,
    ) {
        let limits = OffsetLimits { size: 0.5, rate: 1.0, acceleration: 20.0 };
        let config = OffsetConfig { linear: limits, hold_s: hold, ..OffsetConfig::default() };
        let mut s = stage(&config);
        let (mut last, mut last_rate) = (0.0, 0.0_f64);
        for (n, request) in requests.iter().enumerate() {
            let n = n as u64;
            let a = s.advance(n, &mid(), true);
            let rate = (a.offset[0] - last) / DT;
            prop_assert!(a.offset[0].abs() <= limits.size + 0.05);
            prop_assert!(rate.abs() <= limits.rate * (1.0 + 1e-9));
            prop_assert!((rate - last_rate).abs() <= limits.acceleration * DT * (1.0 + 1e-6) + 1e-9);
            (last, last_rate) = (a.offset[0], rate);
            if let Some(x) = request {
                s.receive(&answer(n as u32, *x), n, n as u32);
            }
        }
    }
}
