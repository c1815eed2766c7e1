//! `volcomp identify`: every method on a case of the reference vectors and on files of its instrument.

use super::each;

const TEXT_AND_JSON: &[(&str, &str)] = &[("", ""), ("-json", "--json")];
const CHAIN: &str = "--chain [w~X'~Y'~b~Z~t]";

/// A case of the vectors for people and for machines.
fn case(method: &str, file: &str, number: u32, more: &str) {
    let name = format!("identify-{method}-case-{number}");
    let id = format!("{file}-o{number}");
    each(
        &name,
        &format!("identify {method} --input tests/vectors/{method}.json --case {id} {more}"),
        TEXT_AND_JSON,
    );
}

#[test]
fn cases() {
    for number in [1, 3, 4, 5] {
        case("threepoint", "THREEPT", number, "");
    }
    for number in [1, 5] {
        case("circles", "CIRCLE", number, "");
    }
    for number in [1, 2, 5] {
        case("diagonals", "DIAG", number, "");
    }
    case("diagonals", "DIAG", 3, "--accept-bias-arcsec 5");
    case("fivedof", "FIVEDOF", 3, "");
    for number in [1, 2] {
        case("nineline", "NINELINE", number, "");
    }
    case("probe", "PROBE", 2, "");
    case("probe", "PROBE", 5, "");
    for number in [1, 2, 3] {
        case("ram", "RAM", number, "");
        case("straightness", "STRAIGHT", number, "");
        case("kalman", "KALMAN", number, "");
    }
}

#[test]
fn cases_of_fits() {
    for number in 1..=5 {
        let name = format!("identify-fits-case-{number}");
        let line = format!("identify fits --input tests/vectors/fits.json --case FIT-o{number} --json");
        each(&name, &line, &[("", "")]);
    }
    each(
        "identify-fits",
        "identify fits",
        &[
            (
                "-data",
                "--data DATA/fit/pitch.csv --x position_mm --y eyx_um --basis fourier --order 1 --json",
            ),
            (
                "-positional",
                "DATA/fit/pitch.csv --x position_mm --y eyx_um --basis polynomial --order 2 --json",
            ),
            ("-refused-column", "--data DATA/fit/pitch.csv --x position_mm --y eyz_um"),
            ("-refused-order", "--data DATA/fit/pitch.csv --x position_mm --y eyx_um --basis polynomial"),
            ("-refused-period", "--data DATA/fit/pitch.csv --x position_mm --y eyx_um --periods short"),
        ],
    );
}

#[test]
fn case_files() {
    each(
        "identify-case",
        "identify ram",
        &[
            ("-which", "--input tests/vectors/ram.json"),
            ("-unknown", "--input tests/vectors/ram.json --case RAM-o9"),
            ("-model", "--input tests/vectors/ram.json --case RAM-o1 --out SCRATCH/m.toml"),
            ("-other", "--input tests/vectors/nineline.json --case NINELINE-o1"),
            ("-absent", "--input tests/vectors/none.json"),
        ],
    );
}

#[test]
fn threepoint() {
    let stated = "--sigma-range-um 0.5 --sigma-angle-arcsec 0.75";
    let data = "identify threepoint --axis x --points DATA/threepoint/points.csv --data DATA/threepoint/threepoint-x.csv";
    let frame = "--registration DATA/threepoint/registration.csv";
    each(
        "identify-threepoint",
        &format!("{data} {frame} {stated} {CHAIN} --machine vmc-850"),
        &[
            ("", ""),
            ("-json", "--json"),
            ("-model", "--out SCRATCH/m.toml --motions SCRATCH/motions.csv --basis chebyshev"),
            ("-stdout", "--out - --basis table --straightness least-squares --zero-at-mm 212.5"),
            ("-reference", "--reference-mm 0,0,-600 --straightness as-measured"),
            ("-outside", "--zero-at-mm 1000"),
        ],
    );
    each(
        "identify-threepoint-rigidity",
        &format!("identify threepoint --rigidity DATA/threepoint/threepoint-x.csv {frame} {stated}"),
        TEXT_AND_JSON,
    );
    let plan =
        "identify threepoint --plan --axis x --points DATA/threepoint/points.csv --travel-mm 0,850 --stops 5";
    each(
        "identify-threepoint-plan",
        &format!("{plan} {CHAIN} --tracker-mm 2600,250,-450 {stated}"),
        &[
            ("", "--target-arcsec 0.7 --angles ec"),
            ("-json", "--target-arcsec 0.7 --angles ec --json"),
            ("-never", "--target-arcsec 0.1 --systematic-angle-arcsec 0.4"),
        ],
    );
    each(
        "identify-threepoint-refused",
        data,
        &[("-frame", ""), ("-noise", "--tracker-mm 0,0,0"), ("-half", "--sigma-range-um 1")],
    );
    each(
        "identify-threepoint-refused",
        "identify threepoint",
        &[("-nothing", ""), ("-axis", "--data none.csv")],
    );
    each(
        "identify-threepoint-refused",
        "identify threepoint --axis x --points DATA/threepoint/points.csv --noise-um 1",
        &[("-column", "--data DATA/fit/x.csv"), ("-empty", "--data DATA/none.csv")],
    );
}

#[test]
fn nineline() {
    let lines = "identify nineline --axis x --lines DATA/nineline/lines.csv";
    each(
        "identify-nineline",
        &format!("{lines} --noise-um 0.1 --data DATA/nineline/nineline-x.csv {CHAIN}"),
        &[
            ("", ""),
            ("-json", "--json"),
            ("-model", "--out SCRATCH/m.toml --motions SCRATCH/motions.csv --sigma-straightness-um 0.2"),
        ],
    );
    each(
        "identify-nineline-all",
        &format!("{lines} DATA/nineline/all-x.csv"),
        &[("", "--noise-um 0.1"), ("-json", "--noise-um 0.1 --json"), ("-misfit", "--noise-um 0.01")],
    );
    each(
        "identify-nineline-refused",
        "identify nineline --axis x --lines DATA/nineline/lines.csv",
        &[
            ("-noise", "--data DATA/nineline/nineline-x.csv"),
            ("-data", "--noise-um 1"),
            ("-column", "--noise-um 1 --data DATA/fit/x.csv"),
            ("-compare", "--noise-um 1 --data DATA/nineline/nineline-x.csv --compare DATA/fit/x.csv"),
        ],
    );
}

#[test]
fn nineline_against_another_method() {
    each(
        "identify-nineline-compare",
        "identify nineline --axis x --lines DATA/nineline/lines.csv --noise-um 0.1 --data DATA/nineline/nineline-x.csv",
        &[
            ("", "--compare DATA/nineline/motions.csv"),
            ("-json", "--compare DATA/nineline/motions.csv --json"),
        ],
    );
}

#[test]
fn fivedof() {
    let instrument = "identify fivedof --axis x --calibration DATA/fivedof/head.toml";
    let resting = "--resting DATA/fivedof/fivedof-rest-x.csv";
    each(
        "identify-fivedof-resting",
        &format!("{instrument} {resting}"),
        &[("", ""), ("-json", "--json"), ("-write", "--write-calibration SCRATCH/head.toml")],
    );
    let data = format!("{instrument} --data DATA/fivedof/fivedof-x.csv {CHAIN} --sense carriage");
    each(
        "identify-fivedof",
        &data,
        &[
            ("", ""),
            ("-json", "--json"),
            ("-skip", "--roll skip --json"),
            ("-model", "--point-mm 400,250,-600 --out SCRATCH/m.toml"),
            ("-detrended", "--roll detrended --basis table --out - --rule least-squares"),
        ],
    );
    each("identify-fivedof-both", &format!("{data} {resting} --out SCRATCH/m.toml"), TEXT_AND_JSON);
    each(
        "identify-fivedof-refused",
        "identify fivedof",
        &[
            ("-nothing", ""),
            ("-axis", "--calibration DATA/fivedof/head.toml"),
            ("-file", "--axis x --calibration DATA/straightness/sixd-signs.toml --data none.csv"),
            ("-column", "--axis y --calibration DATA/fivedof/head.toml --data DATA/fivedof/fivedof-x.csv"),
            ("-other", "--axis x --calibration DATA/fivedof/head.toml --resting DATA/fivedof/fivedof-x.csv"),
        ],
    );
    each("identify-fivedof-refused", instrument, &[("-data", "")]);
    let without = "--data DATA/fivedof/fivedof-x.csv --out SCRATCH/m.toml --chain [w~X'~Y'~b~Z~t]";
    each("identify-fivedof-refused", &format!("{instrument} {without}"), &[("-sense", "")]);
}

#[test]
fn straightness() {
    let run = "identify straightness --axis x --signs DATA/straightness/sixd-signs.toml --data DATA/straightness/sixd-x.csv";
    let tilt = "--tilt-test DATA/straightness/sixd-tilt.csv";
    let points = "--sense carriage --body carriage --abbe-mm 400,250,-600 --bryan-mm 430,250,-560";
    each(
        "identify-straightness",
        run,
        &[
            ("", ""),
            ("-json", "--json"),
            ("-zone", "--rule minimum-zone"),
            ("-base", "--point-mm 400,250,-600 --base-point-mm 400,250,0 --json"),
            ("-refused-base", "--base-point-mm 400,250,0"),
        ],
    );
    each(
        "identify-straightness-model",
        &format!("{run} {tilt} {CHAIN} {points}"),
        &[
            ("", "--out SCRATCH/m.toml"),
            ("-stdout", "--out - --basis table --store carriage"),
            ("-json", "--json --out SCRATCH/m.toml"),
        ],
    );
    each(
        "identify-straightness-tilt",
        &format!("identify straightness --axis x {tilt}"),
        &[("", "--write-signs SCRATCH/signs.toml"), ("-known", "--signs DATA/straightness/sixd-signs.toml")],
    );
    each(
        "identify-straightness-errors",
        "identify straightness --axis x --data DATA/fit/x.csv",
        &[("", ""), ("-model", "--out SCRATCH/m.toml")],
    );
    each(
        "identify-straightness-refused",
        "identify straightness",
        &[
            ("-axis", "DATA/straightness/sixd-x.csv"),
            ("-nothing", "--axis x"),
            ("-signs", "--axis x --data DATA/straightness/sixd-x.csv"),
            (
                "-section",
                "--axis y --data DATA/straightness/sixd-x.csv --signs DATA/straightness/sixd-signs.toml",
            ),
            ("-column", "--axis x --data DATA/nineline/all-x.csv"),
            ("-chain", "--axis u --data DATA/straightness/u.csv --out SCRATCH/m.toml --chain [w~b~X~Y~Z~t]"),
            (
                "-mirror",
                "--axis x --data DATA/straightness/sixd-x.csv --signs DATA/straightness/mirrored.toml",
            ),
            (
                "-tilt",
                "--axis x --tilt-test DATA/straightness/sixd-tilt.csv --signs DATA/straightness/mirrored.toml",
            ),
        ],
    );
}

#[test]
fn diagonals() {
    let data =
        "identify diagonals --data DATA/diagonals/diagonals.csv --low-mm 0,0,-500 --box-mm 850,500,500";
    each(
        "identify-diagonals",
        &format!("{data} --model DATA/diagonals/angles.toml"),
        &[
            ("", ""),
            ("-json", "--json"),
            ("-noise", "--noise-um 0.5 --reflector-mm 0,0,0"),
            ("-model", "--out SCRATCH/m.toml"),
            ("-stdout", "--into DATA/diagonals/angles.toml --out -"),
        ],
    );
    each(
        "identify-diagonals-bias",
        &format!("{data} --accept-bias-arcsec 5 {CHAIN}"),
        &[("", ""), ("-json", "--json"), ("-model", "--out SCRATCH/m.toml --machine vmc-850")],
    );
    each(
        "identify-diagonals-refused",
        "identify diagonals",
        &[
            ("-nothing", ""),
            ("-box", "DATA/diagonals/diagonals.csv"),
            ("-angles", "DATA/diagonals/diagonals.csv --box-mm 850,500,500"),
            ("-length", "DATA/diagonals/diagonals.csv --box-mm 850,500,400 --accept-bias-arcsec 5"),
            ("-column", "DATA/fit/x.csv --box-mm 850,500,500 --accept-bias-arcsec 5"),
            ("-case", "--input tests/vectors/diagonals.json --case DIAG-o4"),
        ],
    );
}

#[test]
fn circles() {
    let data = "identify circles --data DATA/circles/circles.csv --tip-beyond-mm 100";
    each(
        "identify-circles",
        data,
        &[
            ("", ""),
            ("-json", "--json --noise-um 2"),
            ("-noise", "--noise-um 0.1"),
            ("-model", "--noise-um 2 --nominal-tip-mm 0.15,-0.1,-500 --out SCRATCH/m.toml"),
            ("-stdout", "--nominal-tip-mm 0.15,-0.1,-500 --out -"),
            (
                "-pose",
                "--nominal-tip-mm 0.15,-0.1,-500 --add-pose SCRATCH/p.csv --c-deg 0 --a-deg 0 --z-mm -20",
            ),
            ("-refused-tip", "--out SCRATCH/m.toml"),
            ("-refused-axis", "--nominal-tip-mm 0,0,0 --nominal-axis 0,0.1,1 --out SCRATCH/m.toml"),
            ("-refused-pose", "--nominal-tip-mm 0,0,0 --add-pose DATA/fit/x.csv --c-deg 0 --a-deg 0"),
        ],
    );
    each(
        "identify-circles-two",
        "identify circles --data DATA/circles/one.csv --data-2 DATA/circles/two.csv --tip-beyond-mm 100",
        &[("", ""), ("-json", "--between-um 3 --json"), ("-between", "--between-um 3")],
    );
    each(
        "identify-circles-refused",
        "identify circles",
        &[
            ("-nothing", ""),
            ("-column", "--tip-beyond-mm 1 --data DATA/fit/x.csv"),
            ("-one", "--tip-beyond-mm 1 --data DATA/circles/one.csv"),
        ],
    );
}

#[test]
fn ram() {
    let head = "--a-axis-mm 0.15,-0.1,-180 --tool-length-mm 320";
    let noise = "--sigma-position-um 2 --sigma-direction-arcsec 2";
    let data = "identify ram --axis z --data DATA/ram/poses.csv";
    each(
        "identify-ram",
        &format!("{data} {head} {noise}"),
        &[
            ("", ""),
            ("-json", "--json"),
            ("-model", "--out SCRATCH/m.toml --motions SCRATCH/motions.csv --machine gantry-5ax"),
            ("-prior", "--prior-std-arcsec 5 --prior-std-um 50 --head config/examples/gantry-5ax/model.toml"),
        ],
    );
    each(
        "identify-ram-misfit",
        &format!("{data} {head} --sigma-position-um 0.1 --sigma-direction-arcsec 0.1"),
        &[("", "")],
    );
    each(
        "identify-ram-single",
        &format!("identify ram --data DATA/ram/single.csv {head} {noise}"),
        &[("", ""), ("-json", "--json"), ("-refused", "--out SCRATCH/m.toml")],
    );
    each("identify-ram-refused", data, &[("-head", noise), ("-noise", head)]);
    each(
        "identify-ram-refused",
        &format!("identify ram {head} {noise}"),
        &[
            ("-data", ""),
            ("-column", "--data DATA/fit/x.csv"),
            ("-one", "--data DATA/ram/one.csv"),
            ("-side", "--data DATA/ram/poses.csv --chain [w~Z'~b~X~Y~C~A~t]"),
        ],
    );
}

#[test]
fn probe() {
    let bar = "--bar-radius-mm 15";
    let arm = "--arm-mm 147.7328670 --arm-zero-deg=23.962488975";
    each(
        "identify-probe",
        &format!("identify probe --data DATA/probe/contacts.csv {arm} {bar}"),
        &[
            ("", ""),
            ("-json", "--json --robust"),
            ("-noise", "--noise-um 0.1 --ball-radius-mm 1.5"),
            ("-model", "--nominal-mm=-80,-60 --out SCRATCH/m.toml"),
            ("-stdout", "--nominal-mm=-80,-60 --out - --machine grinder-ab"),
            ("-refused-nominal", "--out SCRATCH/m.toml"),
        ],
    );
    each("identify-probe-one-side", &format!("identify probe DATA/probe/one-side.csv {bar}"), TEXT_AND_JSON);
    each(
        "identify-probe-refused",
        "identify probe",
        &[
            ("-nothing", ""),
            ("-radius", "DATA/probe/one-side.csv"),
            ("-arm", "--bar-radius-mm 15 --data DATA/probe/contacts.csv"),
            ("-both", &format!("--bar-radius-mm 15 --data DATA/probe/one-side.csv {arm}")),
            ("-column", "--bar-radius-mm 15 --data DATA/fit/x.csv"),
            ("-other", "--bar-radius-mm 15 --data DATA/circles/one.csv"),
            ("-bar", "--data DATA/probe/one-side.csv --bar-radius-mm 150"),
        ],
    );
}

#[test]
fn grinder() {
    let drawing = "identify grinder --drawing DATA/grinder/drawing.toml";
    let steps = format!("{drawing} --step a=DATA/grinder/a.csv --step b=DATA/grinder/b.csv");
    each(
        "identify-grinder",
        &steps,
        &[
            ("", ""),
            ("-json", "--json --noise-um 0.3"),
            ("-model", "--noise-um 0.3 --out SCRATCH/m.toml --basis auto --machine mill"),
            ("-some", "--motions x,a,b"),
        ],
    );
    each(
        "identify-grinder-next",
        &format!("{drawing} --step a=DATA/grinder/a.csv"),
        &[
            ("", "--next b=SCRATCH/b.csv --positions 3"),
            ("-stdout", "--next b=SCRATCH/b.csv --positions 2 --out -"),
        ],
    );
    each(
        "identify-grinder-refused",
        "identify grinder",
        &[
            ("-nothing", ""),
            ("-out", "--next a=SCRATCH/a.csv --out SCRATCH/m.toml"),
            ("-column", "--drawing DATA/grinder/drawing.toml --step a=DATA/fit/x.csv"),
            ("-axis", "--step q=DATA/fit/x.csv"),
            ("-model", "--drawing DATA/grinder/a.csv --step a=DATA/grinder/a.csv"),
        ],
    );
}

#[test]
fn ballbar() {
    let both =
        "identify ballbar xy=DATA/ballbar/ballbar-xy.csv zx=DATA/ballbar/ballbar-zx.csv --radius-mm 150";
    each(
        "identify-ballbar",
        &format!("{both} --centre-mm=425,250,-250"),
        &[
            ("", ""),
            ("-json", "--json --length-std-um 0.5 --pitch-mm x=10"),
            ("-model", "--out SCRATCH/m.toml --length-std-um 0.5"),
            ("-stdout", "--out - --chain [w~X'~Y'~b~Z~t]"),
        ],
    );
    each(
        "identify-ballbar-refused",
        "identify ballbar --radius-mm 150",
        &[
            ("-nothing", ""),
            ("-twice", "xy=DATA/ballbar/ballbar-xy.csv xy=DATA/ballbar/ballbar-xy.csv"),
            ("-column", "xy=DATA/fit/x.csv"),
            ("-plane", "xz=DATA/ballbar/ballbar-xy.csv"),
        ],
    );
}

#[test]
fn kalman() {
    let grid = "--axes y,z,x --first 0,300 --second 0,200,400 --third 0,200";
    let data = format!("identify kalman --data DATA/kalman/eaz.csv {grid} --sigma 2.5 --noise 0.8");
    each(
        "identify-kalman",
        &data,
        &[
            ("", "--correlation-mm 500"),
            ("-json", "--correlation-mm 500 --adaptive --walk-per-sqrt-h 0.1 --limit 4 --json"),
            ("-model", "--correlation-mm 500 --out SCRATCH/m.toml --json"),
            ("-stdout", "--out - --chain [w~b~X~Y~Z~t]"),
        ],
    );
    let ezz = "identify kalman DATA/kalman/ezz.csv --first 0,200 --second 0,300 --third 0,400";
    each(
        "identify-kalman-length",
        &format!("{ezz} --sigma 5 --noise 0.5"),
        &[("", ""), ("-model", "--out SCRATCH/m.toml")],
    );
    each(
        "identify-kalman-refused",
        "identify kalman --first 0,200 --second 0,300 --third 0,400",
        &[
            ("-nothing", ""),
            ("-time", "--data DATA/kalman/ezz.csv --walk-per-sqrt-h 1 --sigma 5 --noise 0.5"),
            ("-column", "--data DATA/fit/x.csv --sigma 5 --noise 0.5"),
            ("-other", "--data DATA/kalman/other.csv --sigma 5 --noise 0.5"),
            ("-second", "--data DATA/kalman/second.csv --sigma 5 --noise 0.5"),
            ("-axes", "--data DATA/kalman/ezz.csv --axes x,y --sigma 5 --noise 0.5"),
            ("-twice", "--data DATA/kalman/ezz.csv --axes x,x,y --sigma 5 --noise 0.5"),
            ("-none", "--data DATA/kalman/ezz.csv --sigma 0.0001 --noise 0.0001"),
        ],
    );
}

#[test]
fn helps() {
    for method in [
        "threepoint",
        "nineline",
        "fivedof",
        "straightness",
        "diagonals",
        "circles",
        "ram",
        "probe",
        "grinder",
        "ballbar",
        "fits",
        "kalman",
    ] {
        each(&format!("identify-{method}-help"), &format!("identify {method} --help"), &[("", "")]);
    }
    each("fit", "fit", &[("-help", "--help"), ("-thermal-help", "thermal --help")]);
}
