//! `cncsim dev bench-link` end to end: the real daemon and the bare echo, all modes, short.
//!
//! A test cannot ask for the ratios that a quiet computer shows (`cncsim dev bench-link --check` does that): other tests
//! run at the same time. It asks that both sides answer everything and that the figures are consistent.

#![expect(clippy::disallowed_methods, reason = "the test runs the program")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::process::{Command, Output};

use serde_json::Value;

fn bench(args: &[&str]) -> Output {
    // without priority and lock: tests must not take the processors of each other
    let calm = ["--priority", "0", "--no-lock-memory"];
    Command::new(env!("CARGO_BIN_EXE_cncsim")).arg("bench-link").args(calm).args(args).output().unwrap()
}

fn figures(args: &[&str]) -> Value {
    let out = bench(&[args, &["--json"]].concat());
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn number(of: &Value, key: &str) -> f64 {
    of[key].as_f64().unwrap_or_else(|| panic!("{key} in {of}"))
}

#[test]
fn both_sides_answer_in_every_mode() {
    let all = figures(&["--seconds", "1", "--mode", "back-to-back,paced", "--block-ms", "50"]);
    assert_eq!(all["format"], "volcomp-bench-link/1");
    assert_eq!(all["error_motions"], 18);
    for mode in ["back_to_back", "paced"] {
        let round = &all[mode];
        assert!(number(round, "blocks") >= 5.0, "{round}");
        for side in ["echo", "volcompd"] {
            let side = &round[side];
            assert!(number(side, "cycles") > 100.0, "{mode}: {side}");
            let p = ["min", "p10", "p50", "p90", "p99", "p999", "max"]
                .map(|p| number(side, &format!("roundtrip_us_{p}")));
            assert!(p.is_sorted() && p[0] > 0.0, "{mode}: {p:?}");
        }
        let ratio =
            number(&round["volcompd"], "roundtrip_us_p50") / number(&round["echo"], "roundtrip_us_p50");
        assert!((number(round, "ratio_p50") - ratio).abs() < 1e-9);
        // without optimisation the computation is most of the way: what is asked for is that nothing else waits
        let computed = number(&all["compute"]["three"], "compute_us_p99");
        // the fastest tenth: other tests take the processor from either side for more than half of a second
        let [bare, daemon] = ["echo", "volcompd"].map(|side| number(&round[side], "roundtrip_us_p10"));
        let most = 3.0 * (bare + computed);
        // far below the echo nothing was sent at all
        assert!(
            (0.1 * bare..most).contains(&daemon),
            "{mode}: {daemon} us, bare echo {bare} us, limit {most} us"
        );
    }
    // the daemon has counted what was sent to it
    let sent =
        number(&all["back_to_back"]["volcompd"], "cycles") + number(&all["paced"]["volcompd"], "cycles");
    assert!(number(&all["daemon_status"], "cycles") >= sent, "{all}");
    for (axes, least) in [("three", 3.0), ("five", 5.0)] {
        assert_eq!(number(&all["compute"][axes], "axes"), least);
        assert_eq!(number(&all["compute"][axes], "sensors"), 6.0, "live values are part of the cycle");
        assert!(number(&all["compute"][axes], "compute_us_p99") > 0.0);
    }
    assert_eq!(all["within_limits"], all["beyond_limits"].as_array().unwrap().is_empty());
}

#[test]
fn four_kilohertz_is_sustained_about_as_well_as_the_echo_does() {
    let args = ["--seconds", "3", "--mode", "sustained", "--paced-ms", "0.25", "--no-compute"];
    let all = figures(&args);
    let round = &all["sustained"];
    let [echo, daemon] = [&round["echo"], &round["volcompd"]];
    for side in [echo, daemon] {
        let there = number(side, "cycles") + number(side, "skipped_cycles");
        assert!((10_000.0..14_000.0).contains(&there), "{there} of 12000 cycles: {side}");
    }
    let [echo, daemon] = [echo, daemon].map(|side| number(side, "late_share"));
    assert!(daemon <= echo + 0.2, "late: volcompd {daemon}, bare echo {echo}");
}

#[test]
fn five_axes_and_busy_polling_work_alike() {
    let args = ["--seconds", "0.5", "--axes", "five", "--busy-poll-us", "100", "--no-compute"];
    let all = figures(&args);
    assert_eq!(all["error_motions"], 30);
    assert_eq!(number(&all["setting"], "busy_poll_us"), 100.0);
    assert!(number(&all["paced"]["volcompd"], "cycles") > 50.0);
}

#[test]
fn settings_that_cannot_be_measured_are_named() {
    for (args, says) in [
        (["--paced-ms", "0.1"], "--paced-ms 0.1; give 0.25 to 10"),
        (["--seconds", "0"], "'0' for '--seconds <S>': expected 0.01 to"),
        (["--block-ms", "5000"], "--block-ms 5000; give"),
    ] {
        let out = bench(&args);
        let message = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(64), "{message}");
        assert!(message.contains(says), "{message}");
    }
}
