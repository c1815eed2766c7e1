//! `volcomp fit`: text, figures, model files, pages and messages.

use super::each;

const X: &str = "fit --axis x --errors DATA/fit/x.csv";
const ROTARY: &str = "fit --axis c --errors DATA/fit/c.csv";

#[test]
fn motions() {
    each(
        "fit",
        X,
        &[
            ("-text", "--out SCRATCH/m.toml"),
            ("-json", "--out SCRATCH/m.toml --json --basis half-range --order 3"),
            ("-stdout", "--out - --basis table --reversal mean --machine vmc-850 --chain [w~X'~Y'~b~Z~t]"),
            (
                "-robust",
                "--out SCRATCH/m.toml --robust --basis chebyshev --json SCRATCH/report.json --cycles 1-2",
            ),
            ("-page", "--out SCRATCH/m.toml --robust --html SCRATCH/fit.html --svg SCRATCH/fit.svg"),
            ("-travel", "--out - --travel x=0:500 --squareness ec0y=-3.1,eb0z=22.3 --direction forward"),
            ("-smooth", "--out - --basis table --smoothing auto --interpolation cubic"),
            (
                "-period",
                "--out SCRATCH/m.toml --json --basis fourier --order 2 --period-mm auto --linear yes",
            ),
        ],
    );
}

#[test]
fn other_axes_and_files() {
    each(
        "fit-rotary",
        ROTARY,
        &[
            ("-text", "--out SCRATCH/m.toml"),
            ("-json", "--out - --json SCRATCH/r.json --basis fourier --order 2"),
        ],
    );
    each(
        "fit-pitch",
        "fit --axis x --errors DATA/fit/pitch.csv --out SCRATCH/m.toml",
        &[
            ("-search", "--basis fourier --period-search 5,20 --json"),
            ("-two", "--basis fourier --period-mm 12.3,auto"),
        ],
    );
    each(
        "fit-instrument",
        "fit --axis x --errors tests/formats/sessions/stage.dat --out SCRATCH/m.toml",
        &[("-text", ""), ("-json", "--json")],
    );
    let csv = "fit --axis x --errors tests/formats/sessions/positioning.csv --out SCRATCH/m.toml";
    each("fit-test", csv, &[("-text", ""), ("-cycle", "--cycles 1 --direction reverse --screw-pitch-mm 10")]);
}

#[test]
fn messages() {
    each(
        "fit-refused",
        X,
        &[
            ("-target", ""),
            ("-stdout", "--out - --json"),
            ("-order", "--out SCRATCH/m.toml --basis table --order 3"),
            ("-period", "--out SCRATCH/m.toml --basis chebyshev --period-mm 20"),
            ("-degrees", "--out SCRATCH/m.toml --basis fourier --period-deg 20"),
            ("-given", "--out SCRATCH/m.toml --period-mm 20 --period-search 5,30"),
            ("-smoothing", "--out SCRATCH/m.toml --basis chebyshev --smoothing auto"),
            ("-cycles", "--out SCRATCH/m.toml --cycles 7"),
            ("-axes", "--out SCRATCH/m.toml --axis y --axis z"),
            ("-high", "--out SCRATCH/m.toml --basis chebyshev --order 60"),
        ],
    );
    each(
        "fit-refused",
        "fit --out SCRATCH/m.toml",
        &[
            ("-kind", "--axis c --errors tests/formats/sessions/positioning.csv"),
            ("-column", "--axis y --errors DATA/fit/x.csv"),
            ("-none", "--axis x --errors DATA/fit/none.csv"),
        ],
    );
}

#[test]
fn thermal() {
    each(
        "fit-thermal",
        "fit thermal DATA/fit/warmup.csv --displacement z_um --lags-s 0,600 --speed-lags-s 600,1800",
        &[
            ("-text", ""),
            ("-json", "--json"),
            ("-model", "--name spindle-z --symbol ezz --limit-um 80 --out - --json SCRATCH/r.json"),
            ("-page", "--html SCRATCH/t.html --svg SCRATCH/t.svg --hold-out-percent 0"),
            ("-refused-symbol", "--symbol ezz --limit-um 80"),
            ("-refused-column", "--temperatures none_degc"),
            ("-refused-stdout", "--out - --json"),
        ],
    );
}
