//! Figures of a run: ratios, limits, JSON and a table. Every key is explained in `docs/development/benchmarks.md`.

use serde_json::{Map, Value, json};

use super::Options;
use super::files::Axes;
use super::outputs::STREAMS;
use super::partner::Times;
use super::rounds::{Mode, Round};
use super::thread::Granted;

/// Largest ratio of the median round trips, volcompd to the bare echo.
pub const RATIO_P50_MAX: f64 = 1.10;
/// Largest ratio of the 99th percentiles.
pub const RATIO_P99_MAX: f64 = 1.25;
/// Largest 99th percentile of the computation, three axes, us.
pub const COMPUTE_THREE_US_MAX: f64 = 1.0;
/// The same for five axes, us.
pub const COMPUTE_FIVE_US_MAX: f64 = 3.0;
/// Nanoseconds in a microsecond.
const NS_PER_US: f64 = 1e3;
/// Bytes in a megabyte.
const BYTES_PER_MB: f64 = 1e6;

/// What was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    axes: Axes,
    cycle_ms: f64,
    block_ms: f64,
    priority: u8,
    cpus: [Option<u16>; 2],
    lock_memory: bool,
    busy_poll_us: f64,
    tls: bool,
    outputs: bool,
}

/// What the computation alone costs.
#[derive(Debug, Clone, PartialEq)]
pub struct Compute {
    /// Which machine.
    pub axes: Axes,
    /// The object that `volcomp bench --json` prints.
    pub figures: Value,
}

/// Everything measured.
#[derive(Debug, Clone)]
pub struct Report {
    /// What was asked for.
    pub setting: Setting,
    /// What the system granted the measuring thread.
    pub granted: Granted,
    /// Load average of the last minute, before and after.
    pub load_average: [Option<f64>; 2],
    /// The computation alone.
    pub compute: Vec<Compute>,
    /// Every mode.
    pub rounds: Vec<Round>,
    /// What `volcomp status --json` says at the end.
    pub daemon: Value,
    /// What the readers of the outputs received.
    pub received: Option<[(&'static str, u64); 5]>,
}

impl Setting {
    pub(super) fn of(options: &Options) -> Self {
        Self {
            axes: options.axes,
            cycle_ms: options.cycle.as_secs_f64() * 1e3,
            block_ms: options.block.as_secs_f64() * 1e3,
            priority: options.priority,
            cpus: options.cpus,
            lock_memory: options.lock_memory,
            busy_poll_us: options.busy_poll.as_secs_f64() * 1e6,
            tls: options.tls,
            outputs: options.outputs,
        }
    }
}

impl Round {
    /// Median and 99th percentile of volcompd's round trips over those of the echo.
    #[must_use]
    pub fn ratios(&self) -> [f64; 2] {
        [0.50, 0.99].map(|q| us(&self.daemon, q) / us(&self.echo, q))
    }

    /// Name in figures.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}{}", self.mode.name(), if self.outputs { "_outputs" } else { "" })
    }

    /// Whether both ratios are within their limits.
    #[must_use]
    pub fn is_within_limits(&self) -> bool {
        let [p50, p99] = self.ratios();
        !exceeds(p50, RATIO_P50_MAX) && !exceeds(p99, RATIO_P99_MAX)
    }
}

impl Compute {
    /// The 99th percentile, us.
    #[must_use]
    pub fn p99_us(&self) -> f64 {
        self.figures["compute_us_p99"].as_f64().unwrap_or(f64::INFINITY)
    }

    /// Its limit, us.
    #[must_use]
    pub const fn limit_us(&self) -> f64 {
        match self.axes {
            Axes::Three => COMPUTE_THREE_US_MAX,
            Axes::Five => COMPUTE_FIVE_US_MAX,
        }
    }
}

impl Report {
    /// What is above its limit, in words.
    #[must_use]
    pub fn beyond_limits(&self) -> Vec<String> {
        let mut beyond = Vec::new();
        for round in &self.rounds {
            for (name, ratio, limit) in
                [("p50", round.ratios()[0], RATIO_P50_MAX), ("p99", round.ratios()[1], RATIO_P99_MAX)]
            {
                if exceeds(ratio, limit) {
                    beyond.push(format!(
                        "{}: round trip {name} is {ratio:.3} times the bare echo's, limit {limit}",
                        round.name()
                    ));
                }
            }
        }
        if let Some(ended) = self.received.map(|r| r[1].1).filter(|n| *n > 0) {
            beyond.push(format!("{ended} event streams were ended by volcompd"));
        }
        for compute in &self.compute {
            if exceeds(compute.p99_us(), compute.limit_us()) {
                beyond.push(format!(
                    "compute, {} axes: p99 is {:.2} us, limit {} us",
                    compute.axes.name(),
                    compute.p99_us(),
                    compute.limit_us()
                ));
            }
        }
        beyond
    }

    /// The figures as JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        let Setting { axes, cycle_ms, block_ms, priority, cpus, lock_memory, busy_poll_us, tls, outputs } =
            &self.setting;
        let mut object = json!({
            "format": "volcomp-bench-link/1",
            "axes": axes.name(),
            "error_motions": axes.motions(),
            "frame_bytes_out": super::echo::POSITION_BYTES,
            "frame_bytes_back": 84,
            "setting": {
                "cycle_ms": cycle_ms, "block_ms": block_ms, "priority": priority, "cpu_control": cpus[0],
                "cpu_daemon": cpus[1], "lock_memory": lock_memory, "busy_poll_us": busy_poll_us,
                "tls": tls, "outputs": outputs,
            },
            "received": self.received.map(|r| r.map(|(k, n)| (k.to_owned(), n.into())).into_iter().collect::<Map<_, Value>>()),
            "granted": { "control": self.granted, "volcompd": self.daemon["realtime"] },
            "processors": std::thread::available_parallelism().map_or(0, usize::from),
            "load_average_before": self.load_average[0],
            "load_average_after": self.load_average[1],
            "limits": {
                "ratio_p50": RATIO_P50_MAX, "ratio_p99": RATIO_P99_MAX,
                "compute_three_us_p99": COMPUTE_THREE_US_MAX, "compute_five_us_p99": COMPUTE_FIVE_US_MAX,
            },
            "beyond_limits": self.beyond_limits(),
            "within_limits": self.beyond_limits().is_empty(),
            "daemon_status": self.status(),
        });
        for round in &self.rounds {
            object[round.name()] = round_json(round);
        }
        for compute in &self.compute {
            object["compute"][compute.axes.name()] = compute.figures.clone();
        }
        object
    }

    /// The daemon's own figures of the same run.
    fn status(&self) -> Value {
        let keys = [
            "cycles",
            "late_cycles",
            "skipped_cycles",
            "records_dropped",
            "age_us_p50",
            "age_us_p99",
            "roundtrip_us_p50",
            "roundtrip_us_p99",
            "compute_us_p50",
            "compute_us_p99",
        ];
        keys.into_iter().map(|key| (key.to_owned(), self.daemon[key].clone())).collect()
    }

    /// The figures as lines for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "{} axes, {} error motions{}; load {} before, {} after",
            self.setting.axes.name(),
            self.setting.axes.motions(),
            if self.setting.tls { ", volcompd over TLS" } else { "" },
            self.load_average[0].map_or_else(|| "?".to_owned(), |l| format!("{l:.2}")),
            self.load_average[1].map_or_else(|| "?".to_owned(), |l| format!("{l:.2}")),
        )];
        for round in &self.rounds {
            lines.push(String::new());
            lines.push(head(round));
            lines.push(format!(
                "{:<10} {:>9} {:>9} {:>9} {:>9} {:>10} {:>9} {:>11}",
                "us", "p50", "p90", "p99", "p99.9", "max", "cycles", "late"
            ));
            lines.push(row("bare echo", &round.echo));
            lines.push(row("volcompd", &round.daemon));
            let [p50, p99] = round.ratios();
            lines.push(format!(
                "ratio      {p50:>9.3} {:>9} {p99:>9.3}   limits {RATIO_P50_MAX} and {RATIO_P99_MAX}",
                ""
            ));
        }
        if let Some([bytes, _, scrapes, messages, shdr]) = self.received.map(|r| r.map(|(_, n)| n)) {
            lines.push(format!(
                "read: {:.1} MB by {STREAMS} event streams, {scrapes} scrapes, {messages} MQTT messages, {shdr} MTConnect lines",
                bytes as f64 / BYTES_PER_MB
            ));
        }
        if !self.compute.is_empty() {
            lines.push(String::new());
        }
        for compute in &self.compute {
            let figure = |key: &str| compute.figures[key].as_f64().unwrap_or(f64::NAN);
            lines.push(format!(
                "compute, {:<5} axes  p50 {:.2} us, p99 {:.2} us   limit {} us   (calmest tenth of the blocks: p99 {:.2} us)",
                compute.axes.name(),
                figure("compute_us_p50"),
                compute.p99_us(),
                compute.limit_us(),
                figure("compute_us_p99_calm"),
            ));
        }
        lines
    }
}

/// What is no number is no success.
const fn exceeds(figure: f64, limit: f64) -> bool {
    figure.is_nan() || figure > limit
}

fn head(round: &Round) -> String {
    let (seconds, blocks) = (round.seconds, round.blocks);
    let mode = match round.mode {
        Mode::BackToBack => format!("back to back, {blocks} blocks each in {seconds:.0} s"),
        Mode::Paced(c) => {
            format!("paced at {} ms, {blocks} blocks each in {seconds:.0} s", c.as_secs_f64() * 1e3)
        }
        Mode::Sustained(c) => {
            format!("sustained at {} ms, both all the time for {seconds:.0} s", c.as_secs_f64() * 1e3)
        }
    };
    if round.outputs { format!("{mode}; all outputs read") } else { mode }
}

fn row(name: &str, times: &Times) -> String {
    let h = &times.roundtrip;
    format!(
        "{name:<10} {:>9.2} {:>9.2} {:>9.2} {:>9.2} {:>10.1} {:>9} {:>9.4} %",
        us(times, 0.50),
        us(times, 0.90),
        us(times, 0.99),
        us(times, 0.999),
        h.max() as f64 / NS_PER_US,
        h.len(),
        100.0 * times.late_share()
    )
}

fn us(times: &Times, quantile: f64) -> f64 {
    times.roundtrip.value_at_quantile(quantile) as f64 / NS_PER_US
}

fn round_json(round: &Round) -> Value {
    let [ratio_p50, ratio_p99] = round.ratios();
    json!({
        "cycle_ms": round.mode.cycle().map(|c| c.as_secs_f64() * 1e3),
        "seconds": round.seconds,
        "blocks": round.blocks,
        "echo": times_json(&round.echo),
        "volcompd": times_json(&round.daemon),
        "ratio_p50": ratio_p50,
        "ratio_p99": ratio_p99,
        "within_limits": round.is_within_limits(),
    })
}

fn times_json(times: &Times) -> Value {
    let h = &times.roundtrip;
    json!({
        "cycles": h.len(),
        "roundtrip_us_min": h.min() as f64 / NS_PER_US, "roundtrip_us_p10": us(times, 0.10),
        "roundtrip_us_p50": us(times, 0.50), "roundtrip_us_p90": us(times, 0.90),
        "roundtrip_us_p99": us(times, 0.99), "roundtrip_us_p999": us(times, 0.999),
        "roundtrip_us_max": h.max() as f64 / NS_PER_US,
        "late_cycles": times.late, "skipped_cycles": times.skipped, "late_share": times.late_share(),
    })
}
