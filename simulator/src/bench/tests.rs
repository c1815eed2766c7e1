//! Files that volcomp accepts, figures that mean what they say.

use core::time::Duration;

use super::files::{Axes, DaemonSettings};
use super::partner::Times;
use super::report::{Compute, RATIO_P50_MAX, RATIO_P99_MAX};
use super::rounds::{Mode, Round};

fn times(base_ns: u64) -> Times {
    let mut times = Times::new().expect("histogram");
    for i in 0..1000 {
        times.roundtrip.record(base_ns + i).expect("in range");
    }
    times
}

fn round(echo_ns: u64, daemon_ns: u64) -> Round {
    Round {
        mode: Mode::Paced(Duration::from_millis(1)),
        outputs: false,
        echo: times(echo_ns),
        daemon: times(daemon_ns),
        seconds: 1.0,
        blocks: 1,
    }
}

#[test]
fn a_round_is_judged_by_both_ratios() {
    assert!(round(1_000_000, 1_000_000).is_within_limits());
    assert!(!round(1_000_000, 1_120_000).is_within_limits(), "median above {RATIO_P50_MAX}");
    let mut tail = round(1_000_000, 1_000_000);
    tail.daemon.roundtrip.record_n(2_000_000, 20).expect("in range");
    let [p50, p99] = tail.ratios();
    assert!(p50 < 1.01 && p99 > RATIO_P99_MAX, "{p50} {p99}");
    assert!(!tail.is_within_limits());
}

#[test]
fn late_and_skipped_cycles_are_both_part_of_the_share() {
    let mut times = times(1000);
    assert_eq!(times.late_share(), 0.0);
    times.late = 10;
    times.skipped = 250;
    assert!((times.late_share() - 260.0 / 1250.0).abs() < 1e-12);
    assert_eq!(Times::new().expect("histogram").late_share(), 0.0);
}

#[test]
fn figures_that_are_missing_are_beyond_the_limit() {
    let compute = Compute { axes: Axes::Three, figures: serde_json::json!({}) };
    assert!(compute.p99_us() > compute.limit_us());
}

#[test]
fn the_model_is_full() {
    for axes in [Axes::Three, Axes::Five] {
        let text = axes.model_file();
        assert_eq!(text.matches(".fourier]").count(), axes.motions());
        assert_eq!(text.matches(".live]").count(), 6);
        let settings = DaemonSettings {
            address: ([127, 0, 0, 1], 1).into(),
            cycle_ms: 1.0,
            priority: 0,
            cpu: Some(1),
            lock_memory: false,
            busy_poll_us: 0.0,
            tls: false,
        };
        let machine = axes.machine_file(&settings, std::path::Path::new("a.sock"));
        assert_eq!(machine.matches("[axes.").count(), axes.names().len());
    }
}

#[test]
fn the_tour_stays_within_the_travel() {
    for i in 0..2000 {
        let position = Axes::Five.position(f64::from(i) * 0.1);
        assert!(position[..5].iter().all(|p| (25.0..=475.0).contains(p)), "{position:?}");
        assert_eq!(position[5..], [0.0; 3]);
    }
}
