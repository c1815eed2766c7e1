use super::*;
use volcomp_engine::LimitTime;
use volcomp_protocol::{Axis, Name};

const TEXT: &str = "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"model.toml\"\n\
    [axes.x]\nlimit-um = 50\nrate-um-per-s = 100\nacceleration-um-per-s2 = 1000\nread-back-tolerance-um = 2\n\
    [axes.c]\nlimit-arcsec = 20\nwarning-arcsec = 5\nrate-arcsec-per-s = 10\nacceleration-arcsec-per-s2 = 100\njump-deg = 2\n";

fn config() -> MachineConfig {
    MachineConfig::parse("m.toml", TEXT).unwrap()
}

fn hello(names: &[AxisName]) -> ControlHello {
    let axis = |name: AxisName| Axis {
        name,
        unit: if name.kind() == AxisKind::Linear { AxisUnit::Millimetre } else { AxisUnit::Degree },
    };
    let mut axes = [axis(names[0]); MAX_AXES];
    for (slot, name) in axes.iter_mut().zip(names) {
        *slot = axis(*name);
    }
    ControlHello {
        version: 1,
        machine: Name::new("m"),
        software: Name::new("test"),
        cycle_ns: 1_000_000,
        axis_count: u8::try_from(names.len()).unwrap(),
        axes,
    }
}

/// Two cycles of 1 ms at 60 m/min.
const JUMP_MM: f64 = 2.0;

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * b.abs()
}

#[test]
fn values_arrive_in_mm_rad_and_s() {
    let c = config();
    let arcsec = core::f64::consts::PI / 648_000.0;
    let x = c.axes.iter().find(|a| a.name == AxisName::X).unwrap();
    assert!(close(x.limits.size, 0.05) && close(x.limits.warning, 0.04) && close(x.limits.rate, 0.1));
    assert!(
        close(x.jump_limit, JUMP_MM)
            && close(x.reversal_deadband, 1e-3)
            && close(x.read_back_tolerance, 2e-3)
    );
    let c_axis = c.axes.iter().find(|a| a.name == AxisName::C).unwrap();
    assert!(close(c_axis.limits.size, 20.0 * arcsec) && close(c_axis.limits.warning, 5.0 * arcsec));
    assert!(close(c_axis.limits.acceleration, 100.0 * arcsec) && close(c_axis.jump_limit, 2f64.to_radians()));
    assert!(close(c.link.cycle_s, 1e-3) && close(c.engine.stale_s, 0.02));
}

#[test]
fn the_jump_limit_follows_cycle_and_fastest_motion_where_it_is_not_stated() {
    let jumps = |more: &str| -> Vec<f64> {
        let axes = MachineConfig::parse("m.toml", &format!("{TEXT}{more}")).unwrap().axes;
        axes.iter().map(|axis| axis.jump_limit).collect()
    };
    let stated = 2f64.to_radians();
    assert!(close(jumps("")[0], JUMP_MM) && close(jumps("")[1], stated));
    let slow = jumps("[link]\ncycle-ms = 8\n");
    assert!(close(slow[0], 16.0) && close(slow[1], stated), "{slow:?}");
    let text = TEXT.replace("jump-deg = 2\n", "feed-max-deg-per-min = 6000\n");
    let axes = MachineConfig::parse("m.toml", &text).unwrap().axes;
    assert!(close(axes[1].jump_limit, 0.2f64.to_radians()), "{}", axes[1].jump_limit);
    let text = TEXT.replace("limit-um = 50", "limit-um = 50\nfeed-max-mm-per-min = 120000");
    assert!(close(MachineConfig::parse("m.toml", &text).unwrap().axes[0].jump_limit, 4.0));
}

#[test]
fn settings_follow_the_order_of_the_control() {
    use AxisName::{C, X, Y};
    let engine = config().engine_config(&hello(&[C, Y, X])).unwrap();
    assert_eq!(engine.axes, [C, Y, X]);
    assert!(close(engine.limits[2].size, 0.05));
    assert!(engine.limits[0].size < 1e-3 && engine.limits[0].size > 0.0);
    assert!(close(engine.jump_limit[2], JUMP_MM));
}

#[test]
fn an_axis_that_is_not_listed_is_never_offset() {
    use AxisName::{C, X, Y};
    let engine = config().engine_config(&hello(&[X, Y, C])).unwrap();
    assert_eq!(engine.limits[1].size, 0.0);
    assert!(close(engine.read_back_tolerance[0], 2e-3) && engine.read_back_tolerance[2] < 1e-5);
    // what is made here is what the engine accepts
    assert_eq!(engine.validate(), Ok(()));
}

#[test]
fn a_control_that_does_not_fit_is_refused_with_the_reason() {
    use AxisName::{C, X, Y};
    let good = hello(&[X, Y, C]);
    let refuse = |h: ControlHello| config().engine_config(&h).unwrap_err().to_string();

    let other = refuse(ControlHello { machine: Name::new("n"), ..good });
    assert!(other.contains("machine \"n\", the machine file is for \"m\""), "{other}");

    let lacks = refuse(hello(&[X, Y]));
    assert!(lacks.contains("no axis C; it has X Y: take [axes.c] out"), "{lacks}");

    let mut unit = good;
    unit.axes[2].unit = AxisUnit::Millimetre;
    assert_eq!(
        config().engine_config(&unit).unwrap_err(),
        HelloMismatch::AxisUnit { axis: C, found: AxisUnit::Millimetre }
    );
    assert!(refuse(unit).contains("axis C in mm, but it is rotary and needs deg"));

    let cycle = refuse(ControlHello { cycle_ns: 2_000_000, ..good });
    assert!(cycle.contains("cycle is 2 ms, the machine file says cycle-ms = 1"), "{cycle}");

    assert!(refuse(hello(&[X, C, X])).contains("axis X twice"));
    assert!(refuse(ControlHello { axis_count: 0, ..good }).contains("announces 0 axes"));
    assert!(refuse(ControlHello { axis_count: 200, ..good }).contains("announces 200 axes"));
}

#[test]
fn a_rounded_cycle_time_still_matches() {
    let third = MachineConfig::parse("m.toml", &format!("{TEXT}[link]\ncycle-ms = 0.333\n")).unwrap();
    let hello = ControlHello { cycle_ns: 333_333, ..hello(&[AxisName::X, AxisName::C]) };
    assert!(third.engine_config(&hello).is_ok());
}

#[test]
fn a_model_that_does_not_fit_is_refused_with_every_reason() {
    let model = ModelSpec::new("n", Chain::parse("[w b Y (S) t]").unwrap());
    let found: Vec<String> = config().check_model(&model).iter().map(ToString::to_string).collect();
    assert_eq!(found.len(), 3, "{found:?}");
    assert_eq!(config().uncorrected_axes(&model), [AxisName::Y]);
    let model = ModelSpec::new("m", Chain::parse("[w C' b X Z t]").unwrap());
    assert_eq!(config().check_model(&model), []);
    assert_eq!(config().uncorrected_axes(&model), [AxisName::Z]);
}

#[test]
fn only_a_control_on_this_computer_is_in_lock_step_with_the_estimator() {
    let of = |link: &str| {
        MachineConfig::parse("m.toml", &format!("{TEXT}{link}\n[sensors]\ntime = \"control\"\n"))
    };
    assert!(of("").unwrap().sensors.lock_step && !config().sensors.lock_step);
    let remote =
        of("[link]\naddress = \"192.168.0.10:7878\"\nplain-remote = true\n").unwrap_err().to_string();
    assert!(remote.contains("sensors.time") && remote.contains("another computer"), "{remote}");
}

#[test]
fn a_control_on_another_computer_is_bounded_by_this_clock() {
    let of = |text: &str| {
        let text = format!("{TEXT}{text}");
        MachineConfig::parse("m.toml", &text).unwrap().engine.limit_time
    };
    let remote = "[link]\naddress = \"192.168.0.10:7878\"\nplain-remote = true\n";
    assert_eq!(of(""), LimitTime::Control);
    assert_eq!(of("[link]\naddress = \"[::1]:7878\"\n"), LimitTime::Control);
    assert_eq!(of("[engine]\nlimit-time = \"computer\"\n"), LimitTime::Computer);
    assert_eq!(of(remote), LimitTime::Computer);
    assert_eq!(of(&format!("{remote}[engine]\nlimit-time = \"control\"\n")), LimitTime::Control);
}

#[test]
fn a_tolerance_that_no_wrong_offset_leaves_is_refused() {
    let axis = |tolerance: &str| {
        format!(
            "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"m.toml\"\n\
             [axes.x]\nlimit-um = 50\nrate-um-per-s = 100\nacceleration-um-per-s2 = 1000\n{tolerance}"
        )
    };
    assert!(MachineConfig::parse("m.toml", &axis("read-back-tolerance-um = 49.0\n")).is_ok());
    let said =
        MachineConfig::parse("m.toml", &axis("read-back-tolerance-um = 50.0\n")).unwrap_err().to_string();
    assert!(said.contains("is 50 um, not below limit-um (50 um)"), "{said}");
    let small = axis("").replace("limit-um = 50", "limit-um = 0.4");
    let found = MachineConfig::parse("m.toml", &small).unwrap();
    assert!((found.axes[0].read_back_tolerance - 0.2e-3).abs() < 1e-12);
}
