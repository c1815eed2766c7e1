//! Ordinary ramps, which no limit of size, rate or acceleration holds back, and those that one does.

use super::*;

/// Limits of rate and acceleration, mm/s and mm/s^2, that are used in machine files.
const USUAL: [(f64, f64); 4] = [(0.1, 1.0), (0.2, 5.0), (0.8, 20.0), (2.0, 40.0)];

fn world(ramp_s: f64, rate: f64, acceleration: f64, size: f64) -> World {
    let limits = AxisLimits { rate, acceleration, ..LIMITS };
    let mut world = World::new(&EngineConfig { ramp_s, limits: vec![limits; 3], ..config() });
    world.use_model(constant_model(size));
    world.engine.on_command(world.now, Command::Enable);
    while world.cycle().state != State::Active {}
    world
}

/// Ramps out; the number of answers that say that X is limited.
fn ramp_out(world: &mut World) -> u32 {
    world.engine.on_command(world.now, Command::Disable);
    let mut limited = 0;
    while world.last.state != State::Off {
        limited += u32::from(world.cycle().limited & 1);
    }
    assert_eq!(world.last.offset[0], 0.0);
    limited
}

/// True where the steepest rate and the largest acceleration of a ramp are inside the limits.
fn fits(ramp_s: f64, rate: f64, acceleration: f64, size: f64) -> bool {
    1.875 * size / ramp_s < rate && 5.7736 * size / (ramp_s * ramp_s) < acceleration
}

#[test]
fn a_ramp_inside_the_limits_is_not_limited() {
    let mut ramps = 0;
    for (rate, acceleration) in USUAL {
        for ramp_s in [0.1, 0.3, 0.5, 1.0, 2.0] {
            for size in [0.0003, 0.003, 0.010, 0.012_345_678, 0.02] {
                if fits(ramp_s, rate, acceleration, size) {
                    let limited = ramp_out(&mut world(ramp_s, rate, acceleration, size));
                    assert_eq!(limited, 0, "{size} mm in {ramp_s} s, {rate} mm/s, {acceleration} mm/s^2");
                    ramps += 1;
                }
            }
        }
    }
    assert!(ramps > 60, "{ramps}");
}

#[test]
fn a_ramp_steeper_than_the_limits_is_limited() {
    for (rate, acceleration) in USUAL {
        let (ramp_s, size) = (0.05, 0.03);
        assert!(!fits(ramp_s, rate, acceleration, size));
        let limited = ramp_out(&mut world(ramp_s, rate, acceleration, size));
        assert!(limited > 10, "{limited} cycles at {rate} mm/s, {acceleration} mm/s^2");
    }
}

/// Highest rate and acceleration in the time of this computer, mm/s and mm/s^2, of a ramp in and out while frames come four times as
/// often as announced, stamped `stamp_ns` apart.
fn at_a_quarter_of_the_cycle(limit_time: LimitTime, stamp_ns: i64) -> [f64; 2] {
    let limits = AxisLimits { rate: RATE, acceleration: ACCELERATION, ..LIMITS };
    let mut world =
        World::new(&EngineConfig { limit_time, ramp_s: 0.01, limits: vec![limits; 3], ..config() });
    world.engine.on_command(world.now, Command::Enable);
    let (dt, mut before, mut velocity) = (CYCLE_S / 4.0, 0.0, 0.0);
    let mut highest = [0.0_f64; 2];
    for k in 0..8000 {
        if k == 4000 {
            world.engine.on_command(world.now, Command::Disable);
        }
        world.now = world.now.plus_seconds(dt);
        world.frame.sequence += 1;
        world.frame.control_ns += stamp_ns;
        world.frame.applied = world.last.offset;
        let offset = world.send().offset[0];
        let rate = (offset - before) / dt;
        highest = [highest[0].max(rate.abs()), highest[1].max((rate - velocity).abs() / dt)];
        (before, velocity) = (offset, rate);
        assert!(k != 3999 || world.last.state == State::Active && offset == -0.010, "{offset}");
    }
    assert_eq!((world.last.state, before), (State::Off, 0.0));
    highest
}

const RATE: f64 = 0.1;
const ACCELERATION: f64 = 2.0;

#[test]
fn frames_faster_than_announced_keep_the_limits_in_the_time_of_their_stamps() {
    let [rate, acceleration] = at_a_quarter_of_the_cycle(LimitTime::Control, 250_000);
    assert!(rate <= RATE * 1.000_001 && acceleration <= ACCELERATION * 1.000_1, "{rate}, {acceleration}");
}

#[test]
fn stamps_that_run_ahead_keep_the_limits_in_the_time_of_this_computer() {
    let [rate, acceleration] = at_a_quarter_of_the_cycle(LimitTime::Computer, 1_000_000);
    assert!(rate <= RATE * 1.000_01 && acceleration <= ACCELERATION * 1.000_1, "{rate}, {acceleration}");
    let [rate, acceleration] = at_a_quarter_of_the_cycle(LimitTime::Control, 1_000_000);
    assert!(
        rate > 3.0 * RATE && acceleration > 4.0 * ACCELERATION,
        "{rate}, {acceleration} by the stamps alone"
    );
}

#[test]
fn jitter_of_honest_frames_costs_less_than_the_jitter_once() {
    let mut jittery = World::new(&EngineConfig { limit_time: LimitTime::Computer, ..config() });
    let mut even = World::new(&config());
    for world in [&mut jittery, &mut even] {
        world.engine.on_command(world.now, Command::Enable);
    }
    let mut largest = 0.0_f64;
    for k in 0..600_i32 {
        even.cycle();
        // four frames arrive together
        jittery.now = even.now.plus_seconds(CYCLE_S * f64::from(2 - k % 4));
        jittery.cycle();
        largest = largest.max((jittery.last.offset[0] - even.last.offset[0]).abs());
    }
    assert!(largest <= 4.0 * CYCLE_S * LIMITS.rate, "{largest} mm apart");
    assert_eq!((jittery.last.state, jittery.last.offset[0]), (State::Active, -0.010));
}

#[test]
fn a_ramp_that_begins_while_the_offset_moves_is_not_limited_either() {
    // 10 um per 100 mm; the offset changes by 10 um/s at 100 mm/s
    for (rate, acceleration) in USUAL {
        for sign in [1.0, -1.0] {
            let mut world = world(0.5, rate, acceleration, 0.0);
            let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
            let mut x = AxisSpec::new(AxisName::X);
            x.travel = Some([0.0, 500.0]);
            spec.axes.push(x);
            let slope = volcomp_model::curve::Table::new(
                vec![0.0, 500.0],
                vec![0.0, 0.05],
                None,
                volcomp_model::curve::Interpolation::Linear,
            )
            .unwrap();
            spec.errors
                .push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction::single(Curve::Table(slope))));
            world.frame.commanded[0] = 200.0;
            for _ in 0..20 {
                world.cycle();
            }
            world.use_model(Model::new(&spec).unwrap());
            while world.cycle().state != State::Active {}
            for k in 0..500 {
                world.frame.commanded[0] += sign * 0.1 * (f64::from(k) / 200.0).min(1.0);
                assert_eq!(world.cycle().limited, 0);
            }
            world.engine.on_command(world.now, Command::Disable);
            let mut limited = 0;
            while world.last.state != State::Off {
                world.frame.commanded[0] += sign * 0.1;
                limited += u32::from(world.cycle().limited & 1);
            }
            assert_eq!(limited, 0, "{rate} mm/s, {acceleration} mm/s^2, direction {sign}");
        }
    }
}
