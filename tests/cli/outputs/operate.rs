//! `volcomp predict`, `correct`, `filter`, `replay`, `audit`, `explain`, `schema`, and what the operator asks the daemon.

use super::each;

const VMC: &str = "config/examples/vmc-850/model.toml";

#[test]
fn predict() {
    let points = format!("predict --model {VMC} --points DATA/points.csv");
    each(
        "predict",
        &points,
        &[
            ("", "--out -"),
            ("-exact", "--out - --exact"),
            ("-addition", "--out - --add DATA/addition.toml"),
            ("-own", "--out DATA/points.csv"),
            ("-reading", "--out - --reading t1=20"),
        ],
    );
    each(
        "predict-full",
        "predict --model DATA/model-full.toml --points DATA/points.csv --out -",
        &[("", "")],
    );
    let circle = format!(
        "predict --model {VMC} --circle DATA/circle-one-feed.csv --centre-mm 400,250,-200 --radius-mm 150"
    );
    each(
        "predict-circle",
        &circle,
        &[("", ""), ("-json", "--json"), ("-page", "--html SCRATCH/page.html --plane yz")],
    );
    each(
        "predict-refused",
        &format!("predict --model {VMC}"),
        &[
            ("", ""),
            ("-centre", "--circle DATA/circle-one-feed.csv"),
            ("-columns", "--points DATA/plate.csv --out -"),
        ],
    );
}

#[test]
fn correct() {
    let program = format!("correct --model {VMC} --gcode DATA/program.nc --out SCRATCH/out.nc");
    each("correct", &program, &[("", "--start x=0"), ("-json", "--json --axes x,y"), ("-axis", "--axes c")]);
    each(
        "correct-gantry",
        "correct --model config/examples/gantry-5ax/model.toml --gcode DATA/program.nc --out -",
        &[("", "")],
    );
}

#[test]
fn filter() {
    each(
        "filter-show",
        "filter show",
        &[
            ("", "--socket SCRATCH/daemon.sock"),
            ("-json", "--socket SCRATCH/daemon.sock --json"),
            ("-svg", "--socket SCRATCH/daemon.sock --svg SCRATCH/run.svg"),
            ("-name", "--socket SCRATCH/daemon.sock --svg SCRATCH/run.png"),
            ("-without", "--recording tests/recordings/three-axes.vcrec"),
            ("-none", "--socket SCRATCH/none.sock"),
        ],
    );
    each("filter-forget", "filter forget ram --socket SCRATCH/daemon.sock", &[("", "--reason moved")]);
}

#[test]
fn status_and_operator_commands() {
    let outputs = [("", ""), ("-json", "--json")];
    each("status", "status --socket SCRATCH/daemon.sock", &outputs);
    each("enable", "enable --socket SCRATCH/daemon.sock --reason warm --shadow", &outputs);
    each("load", &format!("load {VMC} --socket SCRATCH/daemon.sock"), &outputs);
}

#[test]
fn replay() {
    let outputs = [("", ""), ("-json", "--json"), ("-model", "--model config/examples/vmc-850/model.toml")];
    each("replay-faults", "replay tests/recordings/faults.vcrec", &outputs);
    each("replay-live", "replay tests/recordings/live-filter.vcrec", &outputs[..2]);
}

#[test]
fn audit() {
    each(
        "audit",
        "audit",
        &[
            ("-show", "show DATA/audit.jsonl"),
            ("-show-last", "show DATA/audit.jsonl --last 1 --json"),
            ("-verify", "verify DATA/audit.jsonl"),
            ("-verify-json", "verify DATA/audit.jsonl --json --without-head"),
            ("-broken", "verify DATA/audit-broken.jsonl --json"),
            ("-no-log", "show DATA/head.toml"),
        ],
    );
}

#[test]
fn explain() {
    each(
        "explain",
        "explain",
        &[("", ""), ("-one", "VC-4001 read-back"), ("-json", "VC-4001 --json"), ("-unknown", "VC-1")],
    );
}

#[test]
fn operator_commands_without_a_daemon() {
    each("status-none", "status --socket SCRATCH/none.sock", &[("", ""), ("-json", "--json")]);
    each("enable-none", "enable --socket SCRATCH/none.sock", &[("", "")]);
    each(
        "gain-none",
        "gain --socket SCRATCH/none.sock",
        &[("", "0.5"), ("-beyond", "1.5"), ("-word", "half")],
    );
    each("load-none", "load --socket SCRATCH/none.sock", &[("", VMC), ("-missing", "nothing.toml")]);
}
