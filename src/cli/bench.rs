//! `volcomp bench`: what a cycle costs on this computer.

use crate::prelude::*;
use volcomp_daemon::SelfBenchmarkError;

/// Nanoseconds in a microsecond.
const NS_PER_US: f64 = 1e3;
/// Most cycles that are measured.
const CYCLES_MAX: u64 = 100_000_000;

/// Measure what a cycle with this machine file and its model costs on this computer, without touching any machine.
///
/// From a position frame's bytes in hand to its correction's bytes in hand: check sum, engine, model, frame; and apart
/// from it what comes behind the answer, live values for the next frame and the record. No socket; `cncsim dev bench-link`
/// measures with it. The thread has the real-time settings of the machine file.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// The machine file; the model it names is taken relative to it.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Cycles to measure.
    #[arg(long, value_name = "N", default_value = "200000")]
    cycles: u64,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if !(1..=CYCLES_MAX).contains(&args.cycles) {
        return Err(usage!("--cycles {}; give 1 to {CYCLES_MAX}", args.cycles));
    }
    input::check(&args.config, InputKind::Machine)?;
    let loaded = volcomp_daemon::load(&args.config)
        .map_err(|e| Failure::new(if e.is_io() { EX_IOERR } else { EX_CONFIG }, &e))?;
    let benchmark = volcomp_daemon::run_self_benchmark(&loaded, args.cycles).map_err(|e| {
        let code = match e {
            SelfBenchmarkError::Hello(_) | SelfBenchmarkError::Engine(_) => EX_CONFIG,
            SelfBenchmarkError::NotActive(_)
            | SelfBenchmarkError::Histogram(_)
            | SelfBenchmarkError::Panicked => EX_SOFTWARE,
        };
        Failure::new(code, format_args!("error: {}: {e}", args.config.display()))
    })?;
    let us = |quantile: f64| benchmark.compute_ns.value_at_quantile(quantile) as f64 / NS_PER_US;
    let max_us = benchmark.compute_ns.max() as f64 / NS_PER_US;
    let calm_us = benchmark.calm_p99_ns as f64 / NS_PER_US;
    let clock_us = benchmark.clock_ns as f64 / NS_PER_US;
    let behind_us = |quantile: f64| benchmark.behind_ns.value_at_quantile(quantile) as f64 / NS_PER_US;
    if args.json {
        let object = serde_json::json!({
            "axes": benchmark.axes, "sensors": benchmark.sensors, "cycles": benchmark.compute_ns.len(),
            "compute_us_p50": us(0.5), "compute_us_p90": us(0.9), "compute_us_p99": us(0.99),
            "compute_us_p999": us(0.999), "compute_us_max": max_us,
            "compute_us_p99_calm": calm_us, "behind_us_p50": behind_us(0.5), "behind_us_p99": behind_us(0.99),
            "clock_us": clock_us, "realtime": benchmark.realtime,
        });
        say!("{object}");
        return Ok(());
    }
    say!("frame in to frame out, {} axes, {} live values", benchmark.axes, benchmark.sensors);
    let [p50, p90, p99, p999] = [0.5, 0.9, 0.99, 0.999].map(us);
    say_text!(
        "compute     p50 {p50:.2} us, p90 {p90:.2} us, p99 {p99:.2} us, p99.9 {p999:.2} us, max {max_us:.2} us"
    );
    say_text!("calm        p99 {calm_us:.2} us in the calmest tenth of the blocks of 1000 cycles");
    let [p50, p99] = [0.5, 0.99].map(behind_us);
    say_text!("behind      p50 {p50:.2} us, p99 {p99:.2} us: live values and the record, after the answer");
    say_text!("cycles      {}, the clock's own {clock_us:.3} us taken off each", benchmark.compute_ns.len());
    Ok(())
}
