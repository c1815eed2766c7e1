//! `volcomp evaluate` and `volcomp verify`.

use super::each;

const TEXT_JSON_PAGE: [(&str, &str); 3] =
    [("", ""), ("-json", "--json"), ("-page", "--html SCRATCH/page.html --svg SCRATCH/plot.svg")];
const STATED: &str = "--u-device-um 0.6 --u-device-um-per-m 1.2 --misalignment-mm 1 --drift-um 0.5 --u-temperature-degc 0.5 \
                      --expansion-um-per-m-degc 11 --head DATA/head.toml --tolerance m-um=8";

#[test]
fn positioning() {
    each("evaluate-iso230-2", "evaluate iso230-2 tests/formats/sessions/stage.dat", &TEXT_JSON_PAGE);
    each("evaluate-iso230-2-alone", "evaluate iso230-2 DATA/linear-after.csv", &TEXT_JSON_PAGE);
    let before = format!("evaluate iso230-2 DATA/linear-after.csv --before DATA/linear-before.csv {STATED}");
    each("evaluate-iso230-2-before", &before, &TEXT_JSON_PAGE);
    let rotary = "evaluate iso230-2 --data DATA/rotary.csv --u-device-arcsec 0.3 --active-model config/examples/vmc-850/model.toml";
    each("evaluate-iso230-2-rotary", rotary, &TEXT_JSON_PAGE);
    each("evaluate-iso230-2-one-way", "evaluate iso230-2 DATA/one-way.csv", &TEXT_JSON_PAGE);
    each(
        "evaluate-iso230-2-refused",
        "evaluate iso230-2 DATA/linear-after.csv",
        &[
            ("-kind", "--before DATA/rotary.csv"),
            ("-unit", "--u-device-arcsec 1"),
            ("-cycles", "--cycles 7-9"),
            ("-figure", "--tolerance q-um=1"),
            ("-limit", "--tolerance a-um=-1"),
            ("-stdout", "--json --svg -"),
        ],
    );
}

#[test]
fn circles() {
    each("evaluate-iso230-4", "evaluate iso230-4 DATA/circle-after.csv", &TEXT_JSON_PAGE);
    let before = "evaluate iso230-4 DATA/circle-after.csv --before DATA/circle-before.csv --plane zx --radius-mm 150 \
                  --u-device-um 0.7 --u-length-um 0.4 --drift-um 0.2 --head DATA/head.toml --title Test";
    each("evaluate-iso230-4-before", before, &TEXT_JSON_PAGE);
    each(
        "evaluate-iso230-4-refused",
        "evaluate iso230-4",
        &[
            ("-feeds", "DATA/circle-feeds.csv"),
            ("-feed", "DATA/circle-feeds.csv --feed-mm-per-min 77"),
            ("-plane", "DATA/circle-after.csv --plane xx"),
            ("-column", "DATA/linear-after.csv"),
        ],
    );
    each(
        "evaluate-iso230-4-raw",
        "evaluate iso230-4 DATA/circle-feeds.csv --feed-mm-per-min 3000 --centring none",
        &[("", "")],
    );
}

#[test]
fn ballbar() {
    let plan = "--radius-mm 150 --plane xy";
    each("evaluate-ballbar", &format!("evaluate ballbar DATA/circle-feeds.csv {plan}"), &TEXT_JSON_PAGE);
    let trend = format!(
        "evaluate ballbar --data 2026-01-12=DATA/circle-feeds.csv --data 2026-03-12=DATA/circle-later.csv {plan} --head DATA/head.toml"
    );
    each("evaluate-ballbar-trend", &trend, &TEXT_JSON_PAGE);
    let undated = "--data DATA/circle-feeds.csv --data 2026-03-12=DATA/circle-later.csv";
    each("evaluate-ballbar-refused", "evaluate ballbar --radius-mm 150", &[("", undated)]);
}

#[test]
fn diagonals() {
    each("evaluate-iso230-6", "evaluate iso230-6 DATA/diagonals-after.csv", &TEXT_JSON_PAGE);
    let before =
        format!("evaluate iso230-6 DATA/diagonals-after.csv --before DATA/diagonals-before.csv {STATED}")
            .replace("--tolerance m-um=8", "");
    each("evaluate-iso230-6-before", &before, &TEXT_JSON_PAGE);
    each("evaluate-iso230-6-refused", "evaluate iso230-6 DATA/linear-after.csv", &[("", "")]);
}

#[test]
fn plates() {
    each("evaluate-plate", "evaluate plate DATA/plate.csv --std-um 0.2", &TEXT_JSON_PAGE);
    each("evaluate-plate-rigid", "evaluate plate DATA/plate.csv --model rigid --norm l4", &TEXT_JSON_PAGE);
    each(
        "evaluate-plate-similarity",
        "evaluate plate tests/formats/sessions/plate.txt --model similarity",
        &TEXT_JSON_PAGE,
    );
    each(
        "evaluate-plate-refused",
        "evaluate plate DATA/plate.csv",
        &[("-std", "--std-um 0"), ("-diameter", "--nominal-diameter-mm 2")],
    );
}

#[test]
fn gears() {
    let of = "--teeth 17 --module-mm 4 --face-width-mm 20 --tip-diameter-mm 79 --control-diameter-mm 65.2";
    each("evaluate-gear", &format!("evaluate gear DATA/gear-after.csv {of}"), &TEXT_JSON_PAGE);
    let before = format!("evaluate gear DATA/gear-after.csv --before DATA/gear-before.csv {of}");
    each("evaluate-gear-before", &before, &TEXT_JSON_PAGE);
    let no_gear = "--teeth 17 --module-mm 4 --face-width-mm 20 --tip-diameter-mm 60 --control-diameter-mm 65";
    each("evaluate-gear-refused", "evaluate gear DATA/gear-after.csv", &[("", no_gear)]);
}

#[test]
fn verify() {
    let outputs = [("", ""), ("-json", "--json"), ("-page", "--html SCRATCH/page.html")];
    let of = |what: &str| format!("verify --before DATA/{what}-before.csv --after DATA/{what}-after.csv");
    let linear = of("linear") + " --u-device-um 0.5 --head DATA/head.toml";
    each("verify-linear", &linear, &outputs);
    each("verify-circle", &(of("circle") + " --radius-mm 150 --plane yz"), &outputs);
    each("verify-diagonals", &of("diagonals"), &outputs);
    each("verify-motions", &(of("motions") + " --title Lines"), &outputs);
    let record = "--record SCRATCH/record.json --date 2026-05-03 --instrument laser";
    each("verify-record", &of("linear"), &[("", record)]);
    each(
        "verify-refused",
        "verify --before DATA/linear-before.csv",
        &[
            ("-kind", "--after DATA/circle-after.csv"),
            ("-device", "--after DATA/linear-after.csv --u-device-um=-1"),
            ("-stdout", "--after DATA/linear-after.csv --json --html -"),
            ("-day", "--after DATA/linear-after.csv --record SCRATCH/r.json --date may --instrument laser"),
        ],
    );
}
