//! Notes on settings that are allowed and defeat their purpose; one rule each, where the consequence can be computed.

use volcomp_config::AxisConfig;
use volcomp_estimate::live::{SensorKind, SensorSpec};

use crate::prelude::*;
use crate::quantities::offset_as_is;

/// Longest time for an offset at its limit to leave, s.
const LEAVING_S_MAX: f64 = 60.0;
/// Longest time over the travel at the fastest motion that is not taken for a jump, s.
const CROSSING_S_MAX: f64 = 600.0;

pub(super) fn notes(machine: &MachineConfig, model: &ModelSpec) -> Vec<String> {
    let cycle_s = machine.link.cycle_s;
    let of_axis = |axis: &AxisConfig| {
        let travel = model.axis(axis.name).travel;
        [
            slow_to_leave(axis, cycle_s),
            slow_motion(axis, travel, cycle_s),
            foreign_soft_limits(axis, travel),
            wide_tolerance(axis),
        ]
    };
    let axes = machine.axes.iter().flat_map(of_axis).flatten();
    axes.chain(missing_processor(machine.realtime.cpu, volcomp_daemon::last_processor()))
        .chain(
            machine.sensors.spec.sensors.iter().filter_map(|s| slow_sensor(s, machine.engine.live_max_age_s)),
        )
        .collect()
}

/// A sensor that may be silent for longer than its live value counts.
fn slow_sensor(sensor: &SensorSpec, max_age_s: f64) -> Option<String> {
    let tells = matches!(sensor.kind, SensorKind::Value | SensorKind::FiveDof { .. });
    if !tells || sensor.age_limit_s <= max_age_s {
        return None;
    }
    let (name, [age, max]) = (&sensor.name, [sensor.age_limit_s, max_age_s].map(|s| rounded(s * 1e3)));
    Some(format!(
        "sensor {name}: age-limit-ms {age} is longer than live-max-age-ms {max} of [engine], after which its live value is taken back \
         all the same; raise live-max-age-ms where it speaks less often than that"
    ))
}

/// Rate and acceleration at which an offset stays in the machine long after a stop.
fn slow_to_leave(axis: &AxisConfig, cycle_s: f64) -> Option<String> {
    let limits = &axis.limits;
    let way_s = limits.leaving_s(cycle_s);
    if way_s <= LEAVING_S_MAX {
        return None;
    }
    let (name, unit) = (axis.name, offset_unit(axis.name));
    let [distance, rate, acceleration, step] =
        [limits.size, limits.rate, limits.acceleration, limits.step].map(|v| short(offset_as_is(name, v)));
    let step = if limits.fastest(cycle_s) < limits.rate {
        format!(" and step-{unit} {step}")
    } else {
        String::new()
    };
    Some(format!(
        "axis {name}: an offset at its limit of {distance} {unit} takes {} to leave with rate-{unit}-per-s {rate}, \
         acceleration-{unit}-per-s2 {acceleration}{step}; raise them, or a stop leaves it in the machine for that long",
        duration(way_s)
    ))
}

/// A largest plausible change of position that ordinary motion exceeds.
fn slow_motion(axis: &AxisConfig, travel: Option<[f64; 2]>, cycle_s: f64) -> Option<String> {
    let travel = travel?;
    let crossing_s = (travel[1] - travel[0]) * cycle_s / axis.jump_limit;
    if crossing_s <= CROSSING_S_MAX {
        return None;
    }
    let (name, unit) = (axis.name, position_unit(axis.name));
    let [speed, jump] =
        [axis.jump_limit / cycle_s * 60.0, axis.jump_limit].map(|v| short(name.kind().position_out(v)));
    let (cycle_ms, travel, time) = (rounded(cycle_s * 1e3), range_words(name, travel), duration(crossing_s));
    Some(format!(
        "axis {name}: motion above {speed} {unit}/min is taken for a jump of position (VC-3003), {jump} {unit} per cycle of \
         {cycle_ms} ms; the travel {travel} takes {time} at that speed; raise jump-{unit} or feed-max-{unit}-per-min to the fastest \
         motion of the axis"
    ))
}

/// Soft limits of another place than the travel.
fn foreign_soft_limits(axis: &AxisConfig, travel: Option<[f64; 2]>) -> Option<String> {
    let (soft, travel) = (axis.soft_limits, travel?);
    if soft[0] < travel[1] && soft[1] > travel[0] {
        return None;
    }
    let (name, unit) = (axis.name, position_unit(axis.name));
    let [soft, travel] = [soft, travel].map(|range| range_words(name, range));
    Some(format!(
        "axis {name}: soft-limit-{unit} {soft} and the travel {travel} of the model have no stretch in common: the axis is \
         always beyond a soft limit and is offset only towards it (VC-4006); correct the one that is wrong"
    ))
}

/// A read-back tolerance that hides most wrong offsets.
fn wide_tolerance(axis: &AxisConfig) -> Option<String> {
    let (tolerance, limit) = (axis.read_back_tolerance, axis.limits.size);
    // the default may be half the limit
    if tolerance <= 0.500_001 * limit {
        return None;
    }
    let (name, unit) = (axis.name, offset_unit(axis.name));
    let [tolerance, half, limit] = [tolerance, 0.5 * tolerance, limit].map(|v| short(offset_as_is(name, v)));
    Some(format!(
        "axis {name}: read-back-tolerance-{unit} {tolerance} of a limit of {limit} {unit}: an offset applied twice is noticed \
         above {tolerance} {unit} only, one with the wrong sign above {half} {unit}; the resolution of the control is enough"
    ))
}

/// A processor that this computer does not have.
fn missing_processor(cpu: Option<u16>, last: Option<u16>) -> Option<String> {
    let (cpu, last) = (cpu?, last?);
    (cpu > last).then(|| {
        let has = if last == 0 {
            "processor 0 only".to_owned()
        } else {
            format!("{}, 0 to {last}", counted(usize::from(last) + 1, "processor"))
        };
        format!(
            "realtime.cpu is {cpu}; this computer has {has}: volcompd runs here on any of them, with a warning (VC-7005); write \
             one that exists"
        )
    })
}

/// Six digits, with an exponent where the number would be long.
fn short(v: f64) -> String {
    figure(format!("{v:.5e}").parse().unwrap_or(v))
}

/// Above a minute: in minutes, hours or days.
fn duration(seconds: f64) -> String {
    let (value, unit) = match seconds {
        s if s < 7200.0 => (s / 60.0, "min"),
        s if s < 172_800.0 => (s / 3600.0, "h"),
        s => (s / 86_400.0, "days"),
    };
    let value: f64 = format!("{value:.1e}").parse().unwrap_or(value);
    format!("{} {unit}", short(value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::Chain;
    use volcomp_model::spec::AxisSpec;
    use volcomp_units::axes::AxisName;

    /// The notes of axis X with a travel of 0 to 850 mm and these keys instead of ordinary ones.
    fn noted(keys: &[(&str, &str)]) -> Vec<String> {
        let ordinary = [
            ("limit-um", "150"),
            ("rate-um-per-s", "200"),
            ("acceleration-um-per-s2", "1000"),
            ("soft-limit-mm", "[-1, 851]"),
        ];
        let mut text =
            "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"m.toml\"\n[axes.x]\n".to_owned();
        for (key, value) in ordinary.iter().filter(|(key, _)| !keys.iter().any(|(k, _)| k == key)).chain(keys)
        {
            text += &format!("{key} = {value}\n");
        }
        let machine = MachineConfig::parse("m.toml", &text).unwrap();
        let mut model = ModelSpec::new("m", Chain::parse("[w b X t]").unwrap());
        model.axes.push(AxisSpec { travel: Some([0.0, 850.0]), ..AxisSpec::new(AxisName::X) });
        notes(&machine, &model)
    }

    fn only(keys: &[(&str, &str)], parts: &[&str]) {
        let found = noted(keys);
        assert!(found.len() == 1 && parts.iter().all(|part| found[0].contains(part)), "{keys:?}: {found:?}");
    }

    #[test]
    fn a_sensor_that_may_be_silent_for_longer_than_its_value_counts() {
        let sensor = |kind, age_limit_s| SensorSpec { age_limit_s, ..SensorSpec::new("probe", kind) };
        assert_eq!(slow_sensor(&sensor(SensorKind::Value, 0.5), 0.5), None);
        assert_eq!(slow_sensor(&sensor(SensorKind::Temperature, 60.0), 0.5), None);
        let note = slow_sensor(&sensor(SensorKind::Value, 2.0), 0.5).unwrap();
        assert!(
            note.contains("sensor probe: age-limit-ms 2000 is longer than live-max-age-ms 500"),
            "{note}"
        );
    }

    #[test]
    fn ordinary_settings_have_no_note() {
        assert_eq!(noted(&[]), [""; 0]);
        assert_eq!(noted(&[("soft-limit-mm", "[100, 200]"), ("read-back-tolerance-um", "75")]), [""; 0]);
        assert_eq!(noted(&[("rate-um-per-s", "5"), ("feed-max-mm-per-min", "1000")]), [""; 0]);
        assert_eq!(noted(&[("limit-um", "0.4")]), [""; 0]);
    }

    #[test]
    fn an_offset_that_needs_hours_to_leave() {
        only(&[("rate-um-per-s", "0.001")], &["takes 42 h to leave", "rate-um-per-s 0.001,"]);
        only(&[("acceleration-um-per-s2", "0.001")], &["takes 13 min", "acceleration-um-per-s2 0.001;"]);
        only(&[("step-um", "0.0001")], &["takes 25 min", "and step-um 0.0001;"]);
        only(&[("rate-um-per-s", "1e-7")], &["takes 17000 days", "rate-um-per-s 1e-7"]);
    }

    #[test]
    fn motion_that_is_taken_for_a_jump() {
        only(
            &[("jump-mm", "0.0001")],
            &["above 6 mm/min", "VC-3003", "0.0001 mm per cycle of 1 ms", "takes 2.4 h"],
        );
        only(&[("feed-max-mm-per-min", "10")], &["above 20 mm/min", "takes 42 min"]);
    }

    #[test]
    fn soft_limits_beside_the_travel() {
        let parts = ["soft-limit-mm 900 to 1000 mm and the travel 0 to 850 mm", "VC-4006"];
        only(&[("soft-limit-mm", "[900, 1000]")], &parts);
        only(&[("soft-limit-mm", "[-20, -10]")], &["-20 to -10 mm"]);
    }

    #[test]
    fn a_tolerance_that_hides_wrong_offsets() {
        let parts = ["read-back-tolerance-um 100 of a limit of 150 um", "the wrong sign above 50 um"];
        only(&[("read-back-tolerance-um", "100")], &parts);
    }

    #[test]
    fn a_processor_that_does_not_exist() {
        let note = missing_processor(Some(77), Some(1)).unwrap();
        assert!(note.contains("realtime.cpu is 77; this computer has 2 processors, 0 to 1"), "{note}");
        assert!(missing_processor(Some(1), Some(0)).unwrap().contains("processor 0 only"));
        for (cpu, last) in [(Some(1), Some(1)), (None, Some(1)), (Some(77), None)] {
            assert_eq!(missing_processor(cpu, last), None);
        }
    }
}
