//! volcompd on a control that nobody here wrote: LinuxCNC, started in namespaces of its own, with the bridge of
//! `adapters/linuxcnc` and a machine with play, screw error and squareness behind its motors.
//!
//! Everything is counted in servo cycles. Ignored, because LinuxCNC and the right to make namespaces are needed:
//! `cargo test --test linuxcnc -- --ignored --skip side_by_side --skip withheld` runs all but the measurements for
//! `docs/how-to/linuxcnc.md`.

#![expect(clippy::expect_used, reason = "a test stops where its own set-up is wrong")]
#![expect(clippy::disallowed_methods, reason = "a test with processes, sockets and files")]
#![expect(clippy::print_stdout, reason = "measured figures")]

mod control;
mod daemon;
mod faults;
mod link;
mod namespaces;
mod peers;
mod stalls;
mod trace;
mod withheld;

use control::{Cnc, Wiring};
use daemon::Daemon;
use namespaces::in_namespaces;
use trace::{Size, Trace, example_model};
use volcomp::model::Model;

/// The bars of this test; what the way of the correction leaves is judged with the reversals, where limits of rate and
/// acceleration take the play out within 7 ms: the diagonal begins with three of them at once.
const PATH_RESIDUAL_UM: f64 = 0.1;
const SHARE_REMOVED: f64 = 0.95;
/// After a reversal the offset takes out the play: 20 ms at the limits of the example, and as long again to be sure.
const REVERSAL_CYCLES: usize = 60;

/// Share of the cycles of a motion in which volcompd must compensate for it to be judged.
const JUDGED: f64 = 0.6;

const MOTIONS: [(&str, [&str; 2]); 2] = [
    ("circle", ["G0 X100 Y0 Z0", "G2 X100 Y0 I-100 J0 F2000"]),
    ("diagonal", ["G0 X-120 Y-120 Z-90", "G1 X120 Y120 Z90 F2000"]),
];

/// Runs a motion; its rows carry `mark`.
fn run_motion(cnc: &mut Cnc, [start, motion]: [&str; 2], mark: i32) {
    cnc.mdi(start);
    cnc.mark(mark);
    cnc.mdi(motion);
    cnc.mark(0);
}

/// Both, with `mark` and `mark + 1`.
fn run_both(cnc: &mut Cnc, mark: i32) {
    for (number, (_, motion)) in (mark..).zip(MOTIONS) {
        run_motion(cnc, motion, number);
    }
}

fn report(what: &str, size: Size) {
    println!("{what:<44} RMS {:8.3} um, largest {:8.3} um", size.rms_um, size.max_um);
}

/// What one run of a motion has shown.
struct Shown {
    /// Share of the cycles in which volcompd compensated.
    judged: f64,
    left: Size,
    path: Size,
}

impl Shown {
    fn holds(&self, without: Size) -> bool {
        self.judged > JUDGED
            && self.left.rms_um <= (1.0 - SHARE_REMOVED) * without.rms_um
            && self.path.rms_um <= PATH_RESIDUAL_UM
    }
}

fn shown(what: &str, trace: &Trace, lag: usize, model: &Model, without: Size) -> Shown {
    let with = trace.clone().while_active();
    let shown =
        Shown { judged: with.judged(), left: with.error(lag), path: with.path_residual(lag, model, 0) };
    println!("{what}: compensated in {:.1} % of the cycles", 100.0 * shown.judged);
    report(&format!("{what}, with volcompd"), shown.left);
    report(&format!("{what}, way of the correction"), shown.path);
    let between = with.path_residual(lag, model, REVERSAL_CYCLES);
    report(&format!("{what}, the same, not at reversals"), between);
    println!("{what}: {:.2} % removed", 100.0 * (1.0 - shown.left.rms_um / without.rms_um));
    shown
}

fn compensates(wiring: Wiring) {
    let mut cnc = Cnc::start(wiring, |_| {});
    run_both(&mut cnc, 1);
    let trace = cnc.trace();
    let lag = trace.moving(1).lag();
    let daemon = Daemon::start(wiring, |text| text);
    let model = example_model();
    for (number, (what, motion)) in (1..).zip(MOTIONS) {
        let without = trace.moving(number).error(lag);
        report(&format!("{what}, without"), without);
        daemon.wait_for_state("active");
        let mark = 10 + number;
        run_motion(&mut cnc, motion, mark);
        let shown = shown(what, &cnc.trace().moving(mark), lag, &model, without);
        assert!(shown.holds(without), "{what}, daemon: {}\n{}", daemon.status(), daemon.log());
    }
    println!(
        "{wiring:?}: nominal to motor {lag} cycles; {} cycles, {} coalesced",
        cnc.pin("volcomp.cycles"),
        cnc.pin("volcomp.coalesced")
    );
    daemon.wait_for_state("active");
    what_the_agent_reads(&cnc, wiring);
}

/// Pins that the INI file names to LinuxCNC's MTConnect agent are there, and say that volcompd compensates.
fn what_the_agent_reads(cnc: &Cnc, wiring: Wiring) {
    let ini = std::fs::read_to_string(cnc.dir.path().join("sim").join(wiring.ini())).expect("INI file");
    let items: Vec<&str> = ini.lines().filter_map(|line| line.strip_prefix("HAL_ITEM = pin=")).collect();
    assert_eq!(items.len(), 4, "{ini}");
    let page = std::fs::read_to_string("adapters/linuxcnc/README.md").expect("page");
    for item in items {
        assert!(page.contains(item), "adapters/linuxcnc/README.md has no {item}");
        let value: f64 = cnc.pin(item.split(',').next().unwrap_or_default()).parse().expect("a number");
        assert!(value.is_finite(), "{item}: {value}");
        if item.starts_with("volcomp.compensated,") {
            assert!((50.0..=100.0).contains(&value), "{item}: {value}");
        }
    }
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn circle_and_diagonal_on_external_offsets() {
    in_namespaces("circle_and_diagonal_on_external_offsets", || compensates(Wiring::ExternalOffsets));
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn circle_and_diagonal_behind_the_motion_controller() {
    in_namespaces("circle_and_diagonal_behind_the_motion_controller", || compensates(Wiring::Injection));
}
