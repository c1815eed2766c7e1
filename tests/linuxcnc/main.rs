//! volcompd on a control that nobody here wrote: LinuxCNC, started in namespaces of its own, with the bridge of
//! `adapters/linuxcnc` and a machine with play, screw error and squareness behind its motors.
//!
//! Everything is counted in servo cycles. Skipped with a line that says why where LinuxCNC or the right to make namespaces
//! is missing; `VOLCOMP_LINUXCNC_REQUIRED=1` makes that a failure.

#![cfg(feature = "daemon")]
#![expect(clippy::expect_used, reason = "a test stops where its own set-up is wrong")]
#![expect(clippy::disallowed_methods, reason = "a test with processes, sockets and files")]
#![expect(clippy::print_stdout, reason = "measured figures, and why a test was skipped")]

mod control;
mod daemon;
mod faults;
mod link;
mod namespaces;
mod peers;
mod trace;

use control::{Cnc, Wiring};
use daemon::Daemon;
use namespaces::in_namespaces;
use trace::{Size, example_model};

/// The bars of this test.
const PATH_RESIDUAL_UM: f64 = 0.1;
const SHARE_REMOVED: f64 = 0.95;
/// After a reversal the offset takes out the play: 20 ms at the limits of the example, and as long again to be sure.
const REVERSAL_CYCLES: usize = 60;

const CIRCLE: [&str; 2] = ["G0 X100 Y0 Z0", "G2 X100 Y0 I-100 J0 F2000"];
const DIAGONAL: [&str; 2] = ["G0 X-120 Y-120 Z-90", "G1 X120 Y120 Z90 F2000"];

/// Runs circle and diagonal; the rows carry `mark` and `mark + 1`.
fn run_both(cnc: &mut Cnc, mark: i32) {
    for (number, [start, motion]) in (mark..).zip([CIRCLE, DIAGONAL]) {
        cnc.mdi(start);
        cnc.mark(number);
        cnc.mdi(motion);
        cnc.mark(0);
    }
}

fn report(what: &str, size: Size) {
    println!("{what:<44} RMS {:8.3} um, largest {:8.3} um", size.rms_um, size.max_um);
}

fn compensates(wiring: Wiring) {
    let mut cnc = Cnc::start(wiring, |_| {});
    run_both(&mut cnc, 1);
    let daemon = Daemon::start(wiring, |text| text);
    daemon.wait_for_state("active");
    run_both(&mut cnc, 3);
    let status = daemon.status();
    let trace = cnc.trace();
    let lag = trace.moving(1).lag();
    println!(
        "{wiring:?}: nominal to motor {lag} cycles; {} cycles, {} coalesced",
        cnc.pin("volcomp.cycles"),
        cnc.pin("volcomp.coalesced")
    );
    println!("daemon: {status}");
    let model = example_model();
    for (number, what) in [(1, "circle"), (2, "diagonal")] {
        let (without, with) = (trace.moving(number), trace.moving(number + 2).while_active());
        let (error, left) = (without.error(lag), with.error(lag));
        println!("{what}: compensated in {:.1} % of the cycles", 100.0 * with.judged());
        assert!(with.judged() > 0.5, "{what}: this computer has too much to do:\n{}", daemon.log());
        report(&format!("{what}, without"), error);
        report(&format!("{what}, with volcompd"), left);
        report(&format!("{what}, way of the correction"), with.path_residual(lag, &model, 0));
        let path = with.path_residual(lag, &model, REVERSAL_CYCLES);
        report(&format!("{what}, the same, not at reversals"), path);
        println!("{what}: {:.2} % removed", 100.0 * (1.0 - left.rms_um / error.rms_um));
        assert!(left.rms_um <= (1.0 - SHARE_REMOVED) * error.rms_um, "{what}: too little was removed");
        assert!(
            path.rms_um <= PATH_RESIDUAL_UM,
            "{what}: the correction does not reach the motor as it should"
        );
    }
    daemon.wait_for_state("active");
}

#[test]
fn circle_and_diagonal_on_external_offsets() {
    in_namespaces("circle_and_diagonal_on_external_offsets", || compensates(Wiring::ExternalOffsets));
}

#[test]
fn circle_and_diagonal_behind_the_motion_controller() {
    in_namespaces("circle_and_diagonal_behind_the_motion_controller", || compensates(Wiring::Injection));
}
