//! `/metrics`: OpenMetrics text, and the same in the text format of Prometheus.

use core::fmt;
use std::fmt::Write;

use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, NoLabelSet, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::Registry;

use super::snapshot::{BOUNDS_S, Buckets, Snapshot};
use volcomp_engine::State;
use volcomp_engine::fault::{CATALOGUE, Severity};
use volcomp_units::{mm_from_um, rad_from_arcsec};

/// Millimetres in a metre.
const MM_PER_M: f64 = 1e3;

/// A snapshot as a source of metrics.
#[derive(Debug)]
struct Source(Snapshot);

/// Values of one family: labels and value.
type Values<'a> = Vec<(Vec<(&'static str, &'a str)>, f64)>;

/// The text that scrapers ask for by `application/openmetrics-text`.
pub(super) fn open_metrics(snapshot: &Snapshot) -> Result<String, fmt::Error> {
    let mut registry = Registry::default();
    registry.register_collector(Box::new(Source(snapshot.clone())));
    let mut text = String::new();
    text::encode(&mut text, &registry)?;
    Ok(text)
}

/// The same in the text format of Prometheus: there a counter's description has the name of its samples.
pub(super) fn prometheus(open_metrics: &str) -> String {
    let counters: Vec<&str> = open_metrics
        .lines()
        .filter_map(|line| line.strip_prefix("# TYPE ")?.strip_suffix(" counter"))
        .collect();
    let mut text = String::with_capacity(open_metrics.len());
    for line in open_metrics.lines() {
        let described = line.strip_prefix("# HELP ").or_else(|| line.strip_prefix("# TYPE "));
        let name = described.and_then(|rest| rest.split(' ').next());
        // writing to a string cannot fail
        let _ = match name.filter(|name| counters.contains(name)) {
            Some(name) => writeln!(text, "{}", line.replacen(name, &format!("{name}_total"), 1)),
            None => writeln!(text, "{line}"),
        };
    }
    text
}

impl Collector for Source {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let e = &mut encoder;
        self.counters(e)?;
        self.codes(e)?;
        self.latency(e)?;
        self.state(e)?;
        self.axes(e)?;
        self.model(e)?;
        self.sensors(e)
    }
}

impl Source {
    fn counters(&self, e: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let status = &self.0.status;
        for (name, help, value) in [
            ("volcomp_cycles", "Position frames handled since the start of the daemon", status.cycles),
            (
                "volcomp_late_cycles",
                "Cycles answered more than one cycle after the sample, or not at all",
                status.late_cycles,
            ),
            (
                "volcomp_skipped_cycles",
                "Cycles not answered because a newer position was there",
                status.skipped_cycles,
            ),
            (
                "volcomp_limited_cycles",
                "Cycles in which a limit of size, rate or acceleration held an offset back",
                self.0.limited_cycles,
            ),
            (
                "volcomp_soft_limited_cycles",
                "Cycles in which a soft limit of the machine held an offset back",
                self.0.soft_limited_cycles,
            ),
            ("volcomp_links", "Links to the control that have come up", status.link.links),
            ("volcomp_records_dropped", "Records lost by statistics and recording", status.records_dropped),
            (
                "volcomp_readings_dropped",
                "Readings of sensors that found the estimator's queue full",
                status.readings_dropped,
            ),
            (
                "volcomp_readings_refused",
                "Messages of sensors that were answered with an error",
                status.readings_refused,
            ),
        ] {
            let mut metric = e.encode_descriptor(name, help, None, MetricType::Counter)?;
            metric.encode_counter::<NoLabelSet, _, u64>(&value, None)?;
        }
        Ok(())
    }

    /// Warnings and faults by number; all of them, so that the first occurrence is an increase.
    fn codes(&self, e: &mut DescriptorEncoder<'_>) -> fmt::Result {
        for (name, help, severity) in [
            ("volcomp_warnings", "Warnings by number since the start of the daemon", Severity::Warning),
            ("volcomp_faults", "Faults by number since the start of the daemon", Severity::Fault),
        ] {
            let mut metric = e.encode_descriptor(name, help, None, MetricType::Counter)?;
            for (entry, count) in CATALOGUE.iter().zip(self.0.codes) {
                if entry.severity == severity {
                    let code = entry.code.to_string();
                    let labels = [("code", code.as_str()), ("name", entry.name)];
                    metric.encode_family(&labels)?.encode_counter::<NoLabelSet, _, u64>(&count, None)?;
                }
            }
        }
        Ok(())
    }

    fn latency(&self, e: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let totals = &self.0.latency;
        for (name, help, Buckets { counts, sum_s }) in [
            ("volcomp_age_seconds", "Age of the position when its correction left", totals.age),
            (
                "volcomp_round_trip_seconds",
                "From a position in hand to its correction handed to the kernel",
                totals.round_trip,
            ),
            (
                "volcomp_computation_seconds",
                "From a position in hand to its correction computed",
                totals.computation,
            ),
        ] {
            let bounds = BOUNDS_S.iter().copied().chain([f64::INFINITY]);
            let buckets: Vec<(f64, u64)> = bounds.zip(counts).collect();
            let mut metric = e.encode_descriptor(name, help, None, MetricType::Histogram)?;
            metric.encode_histogram::<NoLabelSet>(sum_s, counts.iter().sum(), &buckets, None)?;
        }
        Ok(())
    }

    fn state(&self, e: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let status = &self.0.status;
        let states = State::ALL.iter().map(|state| state.name()).chain(["disconnected"]);
        let values = states.map(|name| (vec![("state", name)], f64::from(u8::from(name == status.state))));
        gauge(e, "volcomp_state", "1 for the present state", values.collect())?;
        let flag = |on: bool| f64::from(u8::from(on));
        for (name, help, value) in [
            (
                "volcomp_health",
                "0 ok, 1 warning, 2 held, 3 disconnected, 4 faulted",
                f64::from(status.health.exit_code),
            ),
            ("volcomp_enabled", "1 where compensation is wanted", flag(status.enabled)),
            ("volcomp_link_up", "1 while the link to the control is up", flag(status.link.up)),
            ("volcomp_gain_ratio", "Share of the correction that is applied, as ordered", status.gain),
            ("volcomp_uptime_seconds", "Time since the start of the daemon", status.uptime_s),
            ("volcomp_control_cycle_seconds", "Interval between position frames", status.link.cycle_s),
        ] {
            gauge(e, name, help, vec![(Vec::new(), value)])?;
        }
        if let Some(degc) = status.temperature_degc {
            let help = "Temperature of the machine as stated";
            gauge(e, "volcomp_machine_temperature_celsius", help, vec![(Vec::new(), degc)])?;
        }
        Ok(())
    }

    fn axes(&self, e: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let status = &self.0.status;
        let metres = |um: f64| mm_from_um(um) / MM_PER_M;
        let linear = [(&status.correction_um, "sent"), (&status.applied_um, "applied")];
        let rotary = [(&status.correction_arcsec, "sent"), (&status.applied_arcsec, "applied")];
        gauge(e, "volcomp_offset_meters", "Offset of a linear axis", offsets(linear, metres))?;
        gauge(e, "volcomp_offset_radians", "Offset of a rotary axis", offsets(rotary, rad_from_arcsec))?;
        for (unit, name, help, of) in [
            (
                "um",
                "volcomp_offset_limit_meters",
                "Warning threshold and limit of a linear axis",
                metres as fn(f64) -> f64,
            ),
            (
                "arcsec",
                "volcomp_offset_limit_radians",
                "Warning threshold and limit of a rotary axis",
                rad_from_arcsec,
            ),
        ] {
            let of_unit = status.limits.iter().filter(|(_, limits)| limits.unit == unit);
            let values = of_unit.flat_map(|(axis, limits)| {
                [("warning", limits.warning), ("limit", limits.limit)]
                    .map(|(kind, value)| (vec![("axis", axis.as_str()), ("kind", kind)], of(value)))
            });
            gauge(e, name, help, values.collect())?;
        }
        let limited = status
            .limits
            .keys()
            .map(|axis| (vec![("axis", axis.as_str())], f64::from(u8::from(status.limited.contains(axis)))));
        gauge(e, "volcomp_axis_limited", "1 while the offset of an axis is limited", limited.collect())
    }

    fn model(&self, e: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let status = &self.0.status;
        let labels = vec![
            ("machine", status.machine.as_str()),
            ("model", status.model.as_str()),
            ("hash", status.model_hash.as_str()),
            ("expiry", status.model_choice.expiry.as_deref().unwrap_or("")),
            ("version", status.version.as_str()),
        ];
        gauge(e, "volcomp_model_info", "The model in use", vec![(labels, 1.0)])?;
        if let Some(seconds) = status.model_choice.expiry.as_deref().and_then(end_of_day) {
            let help = "End of the last day on which the model should be used, UTC";
            gauge(e, "volcomp_model_expiry_timestamp_seconds", help, vec![(Vec::new(), seconds)])?;
        }
        let errors = &status.model_errors;
        let motions = [("covered", errors.covered), ("possible", errors.possible)];
        let motions = motions.map(|(kind, count)| (vec![("kind", kind)], count as f64));
        let help = "Error motions of the model, of those that the chain of the machine has";
        gauge(e, "volcomp_model_error_motions", help, motions.to_vec())?;
        let Some(benefit) = status.benefit else { return Ok(()) };
        let values = [("without", benefit.without_um), ("with", benefit.with_um)]
            .map(|(kind, um)| (vec![("compensation", kind)], mm_from_um(um) / MM_PER_M));
        let help = "Error of the tool tip that the model predicts";
        gauge(e, "volcomp_predicted_tool_tip_error_meters", help, values.to_vec())
    }

    fn sensors(&self, e: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let sensors = &self.0.status.sensors;
        let good = sensors.iter().map(|sensor| {
            let labels = vec![("sensor", sensor.name.as_str()), ("kind", sensor.kind.as_str())];
            (labels, f64::from(u8::from(sensor.state == "good")))
        });
        gauge(e, "volcomp_sensor_good", "1 where the readings of a sensor are used", good.collect())?;
        let ages =
            sensors.iter().filter_map(|sensor| Some((vec![("sensor", sensor.name.as_str())], sensor.age_s?)));
        gauge(e, "volcomp_sensor_age_seconds", "Time since a sensor was heard", ages.collect())?;
        let innovations = sensors
            .iter()
            .filter_map(|sensor| Some((vec![("sensor", sensor.name.as_str())], sensor.innovation?)));
        let help = "RMS innovation of the last reading, in standard deviations";
        gauge(e, "volcomp_sensor_innovation", help, innovations.collect())
    }
}

/// The end of a day `2026-11-21` in seconds since 1970, UTC.
fn end_of_day(date: &str) -> Option<f64> {
    let mut parts = date.get(..10)?.split('-').map(|part| part.parse::<i64>().ok());
    let [year, month, day] = [parts.next()??, parts.next()??, parts.next()??];
    // days of the Gregorian calendar, with years that begin in March
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days = 365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 719_469;
    Some(((days + 1) * 86_400) as f64)
}

/// One family; left out where it has no values.
fn gauge(e: &mut DescriptorEncoder<'_>, name: &str, help: &str, values: Values<'_>) -> fmt::Result {
    if values.is_empty() {
        return Ok(());
    }
    let mut metric = e.encode_descriptor(name, help, None, MetricType::Gauge)?;
    for (labels, value) in values {
        if labels.is_empty() {
            metric.encode_gauge(&value)?;
        } else {
            metric.encode_family(&labels)?.encode_gauge(&value)?;
        }
    }
    Ok(())
}

type AxisMap = std::collections::BTreeMap<String, f64>;

fn offsets<'a>(maps: [(&'a AxisMap, &'static str); 2], of: impl Fn(f64) -> f64 + Copy) -> Values<'a> {
    let values = maps.into_iter().flat_map(|(map, kind)| {
        map.iter().map(move |(axis, value)| (vec![("axis", axis.as_str()), ("kind", kind)], of(*value)))
    });
    values.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_expiry_is_the_end_of_its_day() {
        assert_eq!(end_of_day("1970-01-01"), Some(86_400.0));
        assert_eq!(end_of_day("2024-02-29"), Some(1_709_251_200.0));
        assert_eq!(end_of_day("2026-11-24"), Some(1_795_564_800.0));
        assert_eq!(end_of_day("soon"), None);
    }

    #[test]
    fn counters_are_described_under_the_name_of_their_samples() {
        let text = "# HELP a_b Help.\n# TYPE a_b counter\na_b_total 1\n# TYPE a_bc gauge\na_bc 2\n# EOF\n";
        let wanted = "# HELP a_b_total Help.\n# TYPE a_b_total counter\na_b_total 1\n# TYPE a_bc gauge\na_bc 2\n# EOF\n";
        assert_eq!(prometheus(text), wanted);
    }
}
