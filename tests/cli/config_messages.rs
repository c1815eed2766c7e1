//! Every message of the configuration: the bad text, and the lines it must give.

#![expect(clippy::expect_used, reason = "a test may stop at what it does not expect")]

use volcomp::config::{self, MachineConfig, model};

const MODEL: &str = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w X' b Y Z t]\"\n";
const ROTARY: &str = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y Z C (S) t]\"\n\
    axes.c.point-mm = [0, 0, 0]\n";
const LIMITS: &str = "limit-um = 50\nrate-um-per-s = 100\nacceleration-um-per-s2 = 1000\n";

/// A machine file of four lines of head and axis X, which ends on line 7.
pub(crate) fn machine(more: &str) -> String {
    format!(
        "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"model.toml\"\n[axes.x]\n{LIMITS}{more}"
    )
}

fn assert_shows(shown: &str, expected: &[&str]) {
    for part in expected {
        assert!(shown.contains(part), "expected: {part}\n--- shown:\n{shown}");
    }
    assert!(!shown.contains('\u{1b}'), "no colour codes in plain text");
}

#[track_caller]
fn model_shows(text: &str, expected: &[&str]) {
    let errors = model::parse("model.toml", text).expect_err("the text is bad");
    assert_shows(&errors.to_string(), expected);
}

#[track_caller]
pub(crate) fn machine_shows(text: &str, expected: &[&str]) {
    let errors = MachineConfig::parse("machine.toml", text).expect_err("the text is bad");
    assert_shows(&errors.to_string(), expected);
}

#[test]
fn one_message_in_full() {
    let text = format!("{MODEL}[errors.exx.table]\nposition-mm = [0, 415, 412]\nvalue-um = [0, 1, 2]\n");
    let errors = model::parse("model.toml", &text).expect_err("unsorted");
    assert_eq!(
        errors.to_string(),
        "error: errors.exx.table.position-mm: 412 mm (row 3) is not above 415 mm (row 2)\n \
         --> model.toml:5:24\n  \
         |\n\
         5 | position-mm = [0, 415, 412]\n  \
         |                        ^^^\n  \
         |\n  \
         = help: sort the rows so that positions increase, and move their values with them"
    );
}

#[test]
fn long_numbers_have_an_exponent() {
    let text = format!("{MODEL}[errors.exx.constant]\nvalue-um = 1e300\n");
    let shown = model::parse("model.toml", &text).expect_err("too large").to_string();
    assert!(shown.contains("EXX reaches 1.000e300 um") && !shown.contains("00000"), "{shown}");
    machine_shows("format = \"volcomp-machine/1\"\n[engine]\nramp-s = 1e300\n", &["ramp-s is 1e300 s"]);
}

#[test]
fn syntax() {
    model_shows("machine = \"m", &["not TOML", "model.toml:1:", "= help: write key = value"]);
    model_shows(
        "a = 1\na = 2\n",
        &["not TOML: duplicate key a, it stands in line 1", "model.toml:2:1", "take one"],
    );
    machine_shows("[link\naddress = 1\n", &["not TOML", "machine.toml:1:"]);
    let twice = "[axes.x]\nlimit-um = 5\n[engine]\nramp-s = 1\n[axes.x] # again\nrate-um-per-s = 1\n";
    machine_shows(
        twice,
        &["duplicate table [axes.x], it stands in line 1", "machine.toml:5:", "below one of them"],
    );
    let twice = "[engine]\nramp-s = 1\n[axes.x]\nramp-s = 1\nlimit-um = 5\nlimit-um = 6\n";
    machine_shows(twice, &["duplicate key limit-um, it stands in line 5", "machine.toml:6:1"]);
    machine_shows(
        "[engine]\nramp-s = 2,5 # s\n",
        &["ramp-s has a decimal comma", "machine.toml:2:", "write ramp-s = 2.5"],
    );
    machine_shows("[engine]\nhold-s = -0,25\n", &["write hold-s = -0.25"]);
    // every mistake in the syntax, not only the first
    model_shows("a = \nb = \n", &["model.toml:1:", "model.toml:2:", "2 mistakes"]);
}

#[test]
fn format() {
    model_shows(
        "machine = \"m\"\n",
        &["format is missing", "add format = \"volcomp-model/1\" as the first line"],
    );
    model_shows("format = 1\n", &["format must be a text in quotes, found a number", "model.toml:1:10"]);
    model_shows(
        "format = \"volcomp-model/2\"\nnonsense = 1\n",
        &["format is \"volcomp-model/2\", not \"volcomp-model/1\"", "model.toml:1:10", "this program reads"],
    );
    model_shows(&machine(""), &["format is \"volcomp-machine/1\"", "this is a machine file"]);
    machine_shows(MODEL, &["format is \"volcomp-model/1\"", "this is a model file"]);
    let unknown = config::kind_of_file("f.toml", "format = \"volcomp-modle/1\"\n").expect_err("unknown");
    assert_shows(&unknown.to_string(), &["f.toml:1:10", "did you mean volcomp-model/1?"]);
    let missing = config::kind_of_file("f.toml", "").expect_err("missing");
    assert_shows(&missing.to_string(), &["format is missing", "--> f.toml"]);
}

#[test]
fn machine_id() {
    model_shows(
        "format = \"volcomp-model/1\"\n",
        &["machine is missing", "the id that the control announces"],
    );
    model_shows(&MODEL.replace("\"m\"", "\"\""), &["machine is empty", "model.toml:2:11", "1 to 32 bytes"]);
    model_shows(&MODEL.replace("\"m\"", &format!("\"{}\"", "m".repeat(33))), &["machine has 33 bytes"]);
    model_shows(&MODEL.replace("\"m\"", "\" m\""), &["control characters or spaces"]);
    model_shows(&MODEL.replace("\"m\"", "7"), &["machine must be a text in quotes, found a number"]);
}

#[test]
fn chain() {
    let with = |chain: &str| MODEL.replace("\"[w X' b Y Z t]\"", chain);
    model_shows(
        "format = \"volcomp-model/1\"\nmachine = \"m\"\n",
        &["chain is missing", "chain = \"[w X' b Y Z t]\""],
    );
    model_shows(&with("3"), &["chain must be a text in quotes, found a number", "model.toml:3:9"]);
    // the caret stands under the word inside the quotes
    model_shows(
        &with("\"[w X b Y Z t]\""),
        &[
            "chain, column 4: axis X stands between w and b",
            "model.toml:3:13",
            "  |             ^\n",
            "write X'",
        ],
    );
    model_shows(&with("'[w b X Q t]'"), &["unknown axis 'Q'", "model.toml:3:17"]);
    model_shows(&with("\"[w b X X t]\""), &["axis X occurs twice", "model.toml:3:17"]);
    model_shows(&with("\"[w X Y t]\""), &["the bed b is missing", "model.toml:3:18"]);
    model_shows(
        &with("\"[w b Y' t]\""),
        &["axis Y has a prime but stands after the bed", "model.toml:3:15", "^^"],
    );
    model_shows(&with("\"[w b X S t]\""), &["the spindle S stands in parentheses", "model.toml:3:17"]);
    model_shows(&with("\"w b X t\""), &["a chain stands in brackets", "model.toml:3:10"]);
    model_shows(&with("\"\""), &["a chain stands in brackets", "model.toml:3:9"]);
    // escapes shift the columns: the whole value is marked
    model_shows(&with("\"[w\\u0020X b t]\""), &["model.toml:3:9"]);
    model_shows(&with(&format!("\"[w b {}t]\"", "X ".repeat(999))), &["chain is too long"]);
}

#[test]
fn unknown_keys_with_a_suggestion() {
    model_shows(
        &format!("{MODEL}author = \"x\"\n"),
        &["unknown key `author` in the top level", "model.toml:4:1"],
    );
    model_shows(
        &format!("{MODEL}[frame]\ntool-tpi-mm = [0,0,0]\n"),
        &["unknown key `tool-tpi-mm` in [frame]", "model.toml:5:1", "did you mean tool-tip-mm?"],
    );
    model_shows(
        &format!("{MODEL}[errors.exx.furier]\nspan-mm = 1\n"),
        &[
            "unknown key `furier` in [errors.exx]",
            "model.toml:4:13",
            "did you mean fourier?",
            "errors.exx has no curve",
        ],
    );
    machine_shows(
        &machine("[link]\nadress = \"127.0.0.1:1\"\n"),
        &["unknown key `adress` in [link]", "machine.toml:9:1", "did you mean address?"],
    );
    machine_shows(
        &machine("[colour]\n"),
        &["unknown key `colour` in the top level", "expected one of: format, machine"],
    );
}

#[test]
fn errors_that_do_not_exist() {
    let shows = |key: &str, expected: &[&str]| {
        model_shows(&format!("{ROTARY}[errors.{key}.constant]\nvalue-um = 1\n"), expected);
    };
    shows("eqq", &["eqq is not an error symbol of ISO 230-1", "model.toml:5:9"]);
    shows("EXX", &["EXX is not an error symbol", "lower case in keys: write exx"]);
    shows("ez0c", &["ez0c is not an error symbol", "along itself has no effect"]);
    shows("ec0x", &["squarenesses are ec0y (Y to X), eb0z (Z to X) and ea0z (Z to Y)"]);
    shows("exxx", &["did you mean exx?"]);
    shows("exu", &["EXU: axis U is not in the chain", "model.toml:5:9", "the chain is [w b X Y Z C (S) t]"]);
    model_shows(
        "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b Y t]\"\n[errors.ec0y.constant]\nvalue-arcsec = 1\n",
        &["EC0Y is a squareness to axis X, which is not in the chain", "model.toml:4:9"],
    );
    model_shows(
        &format!("{MODEL}[errors.ec0y.chebyshev]\nrange-mm = [0, 1]\ncoefficients-arcsec = [1]\n"),
        &["EC0Y is one number; write it as [errors.ec0y.constant]", "model.toml:4:9"],
    );
    model_shows(
        &format!("{MODEL}errors.exx = 3\n"),
        &["errors.exx must be a table, found a number", "model.toml:4:8"],
    );
    model_shows(
        &format!("{MODEL}[errors.exx]\n"),
        &["errors.exx has no curve", "a missing error is zero", "model.toml:4:9"],
    );
}

#[test]
fn wrong_units() {
    let table = "value-um = [0, 1]\n";
    model_shows(
        &format!("{MODEL}[errors.exx.table]\nposition-deg = [0, 10]\n{table}"),
        &[
            "errors.exx.table.position-deg has the wrong unit deg: axis X is linear",
            "model.toml:5:1",
            "write position-mm and give the values in mm",
        ],
    );
    model_shows(
        &format!("{MODEL}[errors.exx.table]\nposition = [0, 10]\n{table}"),
        &["errors.exx.table.position lacks its unit: axis X is linear", "write position-mm"],
    );
    model_shows(
        &format!("{MODEL}[errors.eax.table]\nposition-mm = [0, 10]\n{table}"),
        &[
            "errors.eax.table.value-um has the wrong unit um: EAX is an angle",
            "write value-arcsec and give the values in arcsec",
        ],
    );
    model_shows(
        &format!("{MODEL}[errors.exx.table]\nposition-mm = [0, 10]\nvalue-nm = [0, 10]\n"),
        &[
            "value-nm has the wrong unit nm: it is read in um",
            "write value-um and multiply the values by 0.001",
        ],
    );
    model_shows(
        &format!("{ROTARY}[errors.exc.fourier]\nspan-mm = 360\nperiod-deg = 360\n"),
        &["span-mm has the wrong unit mm: axis C is rotary", "write span-deg"],
    );
    model_shows(
        &format!("{MODEL}[axes.x]\ntravel-deg = [0, 1]\n"),
        &["axes.x.travel-deg has the wrong unit deg: axis X is linear"],
    );
    machine_shows(
        &machine("[axes.c]\nlimit-um = 1\nrate-arcsec-per-s = 1\nacceleration-arcsec-per-s2 = 1\n"),
        &[
            "axes.c.limit-um has the wrong unit um: axis C is rotary",
            "machine.toml:9:1",
            "write limit-arcsec and give the values in arcsec",
        ],
    );
    machine_shows(
        &machine("[axes.y]\nlimit-um = 1\nrate-mm-per-s = 1\nacceleration-um-per-s2 = 1\n"),
        &["axes.y.rate-mm-per-s has the wrong unit mm/s: it is read in um/s", "write rate-um-per-s = 1000"],
    );
    machine_shows(
        &machine("[link]\ncycle-us = 1000\n"),
        &["link.cycle-us has the wrong unit us", "write cycle-ms = 1"],
    );
    machine_shows(
        &machine("[axes.y]\nlimit-mm = 0.15\nrate-um-per-s = 1\nacceleration-um-per-s2 = 1\n"),
        &["axes.y.limit-mm has the wrong unit mm: it is read in um", "write limit-um = 150"],
    );
    // a key in the wrong unit is not reported as missing too
    let errors = model::parse("m", &format!("{MODEL}[errors.exx.table]\nposition-deg = [0, 10]\n{table}"));
    assert_eq!(errors.expect_err("bad").diagnostics.len(), 1);
}

#[test]
fn tables() {
    let shows = |rows: &str, expected: &[&str]| {
        model_shows(&format!("{MODEL}[errors.exx.table]\n{rows}\n"), expected)
    };
    shows(
        "position-mm = [0, 10, 10]\nvalue-um = [0, 1, 2]",
        &["10 mm occurs twice (rows 2 and 3)", "model.toml:5:23", "keep one row per position"],
    );
    shows(
        "position-mm = [0, 10, 5]\nvalue-um = [0, 1, 2]",
        &["5 mm (row 3) is not above 10 mm (row 2)", "model.toml:5:23"],
    );
    shows(
        "position-mm = [0, 10, nan]\nvalue-um = [0, inf, 2]",
        &[
            "errors.exx.table.position-mm, row 3, is not a finite number",
            "model.toml:5:23",
            "errors.exx.table.value-um, row 2, is not a finite number",
            "model.toml:6:16",
            "2 mistakes",
        ],
    );
    shows("position-mm = [0, 1e999]\nvalue-um = [0, 1]", &["model.toml:5:19"]);
    shows(
        "position-mm = [0, 10, 20]\nvalue-um = [0, 1]",
        &["value-um has 2 values for 3 positions", "model.toml:6:12", "give one value per position"],
    );
    shows(
        "position-mm = [0, 10]\nvalue-um = [0, 1]\nreverse-um = [1]",
        &["reverse-um has 1 values for 2 positions", "model.toml:7:14"],
    );
    shows(
        "position-mm = [5]\nvalue-um = [1]",
        &["at least 2 positions, found 1", "model.toml:5:15", "or write a constant"],
    );
    shows("position-mm = []\nvalue-um = []", &["at least 2 positions, found 0"]);
    shows("value-um = [0, 1]", &["errors.exx.table.position-mm is missing", "model.toml:4:13"]);
    shows("position-mm = [0, 1]", &["errors.exx.table.value-um is missing", "one value per position"]);
    shows(
        "position-mm = 5\nvalue-um = [1]",
        &["position-mm must be a list of numbers, found a number", "model.toml:5:15"],
    );
    shows(
        "position-mm = [0, \"1\"]\nvalue-um = [1, 2]",
        &["a list of numbers only, found a text", "model.toml:5:19", "write 1 without quotes"],
    );
    shows(
        "position-mm = [0, 1]\nvalue-um = [1, 2]\ninterpolation = \"cubik\"",
        &["interpolation does not know \"cubik\"", "model.toml:7:17", "did you mean cubic?"],
    );
}

#[test]
fn series() {
    let shows =
        |text: &str, expected: &[&str]| model_shows(&format!("{MODEL}[errors.exx.{text}\n"), expected);
    shows("fourier]\nperiod-mm = 10", &["errors.exx.fourier.span-mm is missing", "model.toml:4:13"]);
    shows("fourier]\nspan-mm = 10", &["period-mm is missing", "wave length"]);
    shows(
        "fourier]\nspan-mm = 0\nperiod-mm = -3",
        &["span-mm is 0 mm", "period-mm is -3 mm", "above 0", "model.toml:6:13"],
    );
    shows(
        "fourier]\nspan-mm = 9\nperiod-mm = 9\nmean-um = nan",
        &["mean-um is not a finite number", "model.toml:7:11"],
    );
    let many = vec!["0"; 65].join(", ");
    shows(
        &format!("fourier]\nspan-mm = 9\nperiod-mm = 9\nsin-um = [{many}]"),
        &["65 terms exceed the limit of 64", "model.toml:7:10"],
    );
    shows(&format!("half-range]\nrange-mm = [0, 1]\nsin-um = [{many}]"), &["65 terms", "model.toml:6:10"]);
    shows(
        &format!("chebyshev]\nrange-mm = [0, 1]\ncoefficients-um = [{many}]"),
        &["65 terms", "model.toml:6:19"],
    );
    shows("half-range]\nsin-um = [1]", &["range-mm is missing", "add range-mm = [lower end, upper end]"]);
    shows(
        "chebyshev]\nrange-mm = [400, 0]\ncoefficients-um = [1]",
        &[
            "errors.exx.chebyshev.range-mm from 400 to 0 is empty",
            "model.toml:5:12",
            "write the lower end first",
        ],
    );
    shows(
        "chebyshev]\nrange-mm = [0, 1, 2]\ncoefficients-um = [1]",
        &["range-mm has 3 numbers", "write 2 numbers: [lower end, upper end]"],
    );
    shows("chebyshev]\nrange-mm = [0, 1]", &["coefficients-um is missing", "[c0, c1, ...]"]);
    shows("constant]", &["value-um is missing", "model.toml:4:13"]);
    shows(
        "constant]\nvalue-um = true",
        &["value-um must be a number, found true or false", "model.toml:5:12"],
    );
    shows("constant]\nvalue-um = \"1.5\"", &["found a text", "write 1.5 without quotes"]);
}

#[test]
fn grids() {
    let shows =
        |text: &str, expected: &[&str]| model_shows(&format!("{MODEL}[errors.ezy.grid]\n{text}\n"), expected);
    let rest = "y-mm = [0, 1]\nz-mm = [0, 1]";
    shows("value-um = [1]", &["errors.ezy.grid.axes is missing", "model.toml:4:13", "slowest first"]);
    shows(&format!("axes = [\"y\", \"z\"]\n{rest}"), &["value-um is missing", "last axis fastest"]);
    shows(
        &format!("axes = [\"y\", \"z\"]\n{rest}\nvalue-um = [1, 2, 3]"),
        &["value-um has 3 values for 2 x 2 = 4 points", "model.toml:8:12"],
    );
    shows("axes = [\"y\", \"z\"]\ny-mm = [0, 1]\nvalue-um = [1]", &["errors.ezy.grid.z-mm is missing"]);
    shows(
        "axes = [\"y\", \"z\"]\ny-mm = [0, 1]\nz-deg = [0, 1]\nvalue-um = [1]",
        &["z-deg has the wrong unit deg: linear axes are in mm", "write z-mm"],
    );
    shows(
        "axes = [\"y\", \"z\"]\ny-mm = [1, 0]\nz-mm = [0, 1]\nvalue-um = [1, 2, 3, 4]",
        &["0 mm (row 2) is not above 1 mm (row 1)", "model.toml:6:12"],
    );
    shows(
        &format!("axes = [\"y\", \"q\"]\n{rest}\nvalue-um = [1]"),
        &["axes does not know \"q\"", "model.toml:5:14"],
    );
    shows(
        &format!("axes = [\"y\"]\n{rest}\nvalue-um = [1, 2]"),
        &["a grid has two or three axes, found 1", "model.toml:5:8"],
    );
    shows(&format!("axes = [\"y\", \"y\"]\n{rest}\nvalue-um = [1, 2, 3, 4]"), &["a grid names axis Y twice"]);
    shows("axes = \"yz\"\nvalue-um = [1]", &["axes must be a list of texts in quotes, found a text"]);
    shows(
        "axes = [\"y\", \"u\"]\ny-mm = [0, 1]\nu-mm = [0, 1]\nvalue-um = [1, 2, 3, 4]",
        &["EZY: its grid runs over axis U, which is not in the chain", "model.toml:4:9"],
    );
}

#[test]
fn sizes_that_are_unit_mistakes() {
    model_shows(
        &format!("{MODEL}[errors.exx.table]\nposition-mm = [0, 1, 2]\nvalue-um = [0, 7000, 3]\n"),
        &[
            "EXX reaches 7000 um; the limit is 5000 um (5 mm): were these values in nm, not in um?",
            "model.toml:6:16",
        ],
    );
    model_shows(
        &format!("{MODEL}[errors.eax.constant]\nvalue-arcsec = -3000\n"),
        &[
            "EAX reaches 3000 arcsec; the limit is 2063 arcsec (10 mrad): were these values in urad, not in arcsec?",
            "model.toml:5:16",
        ],
    );
    model_shows(
        &format!("{MODEL}[errors.exx]\nstd-um = 9000\n[errors.exx.constant]\nvalue-um = 1\n"),
        &["errors.exx.std-um is 9000 um", "allowed is 0 to 5000 um"],
    );
}

#[test]
fn axes_and_frame() {
    let shows = |text: &str, expected: &[&str]| model_shows(&format!("{MODEL}{text}\n"), expected);
    shows("[axes.X]", &["unknown axis axes.X", "write [axes.x]", "model.toml:4:7"]);
    shows("[axes.q]", &["unknown axis axes.q", "expected one of x y z u v w a b c s"]);
    shows(
        "[axes.u]",
        &["axis U has an entry but is not in the chain", "model.toml:4:7", "the chain is [w X' b Y Z t]"],
    );
    shows("[axes.x]\ntravel-mm = [500, 0]", &["axes.x.travel-mm from 500 to 0 is empty", "model.toml:5:13"]);
    shows(
        "[axes.x]\nsense = \"absolute\"",
        &["sense does not know \"absolute\"", "write one of: relative, carriage"],
    );
    shows("[axes.x]\npoint-mm = [0, 0, 0]", &["only a rotary axis turns about a point", "model.toml:5:12"]);
    shows(
        "[axes.x]\nreference-points-mm = { q = [0, 0, 0] }",
        &["unknown key `q` in [axes.x.reference-points-mm]", "model.toml:5:25"],
    );
    shows(
        "[axes.x]\nreference-points-mm = { x = [0, 0] }",
        &["reference-points-mm.x has 2 numbers", "[x, y, z]"],
    );
    shows(
        "[axes.x]\nreference-points-mm = [0, 0, 0]",
        &["reference-points-mm must be a table, found a list"],
    );
    shows(
        "[axes.x]\nreference-body = \"table\"",
        &["reference-body does not know \"table\"", "carriage, bed"],
    );
    shows(
        "[axes.x]\nreference-body = { y = \"bde\" }",
        &["reference-body.y does not know \"bde\"", "did you mean bed?"],
    );
    shows("[axes.x]\nreference-body = 1", &["reference-body must be", "found a number"]);
    shows(
        "[frame]\ntool-tip-mm = [0, 0, inf]",
        &["tool-tip-mm, row 3, is not a finite number", "model.toml:5:22"],
    );
    shows("[frame]\ngauge-point-mm = 3", &["gauge-point-mm must be a list of numbers"]);
    let bare = ROTARY.replace("axes.c.point-mm = [0, 0, 0]\n", "");
    model_shows(&bare, &["rotary axis C has no [axes.c]", "model.toml:3:9", "point-mm = [x, y, z]"]);
    model_shows(&format!("{bare}[axes.c]\n"), &["axes.c.point-mm is missing", "model.toml:4:7"]);
    model_shows(
        &format!("{ROTARY}axes.c.reference-points-mm.x = [0, 0, 0]\n"),
        &["a rotary axis has point-mm"],
    );
    model_shows(&format!("{ROTARY}axes.c.reference-body = \"bed\"\n"), &["a rotary axis has point-mm"]);
}

#[test]
fn provenance() {
    let shows =
        |text: &str, expected: &[&str]| model_shows(&format!("{MODEL}[provenance]\n{text}\n"), expected);
    shows(
        "date = \"yesterday\"",
        &["provenance.date is not a date: \"yesterday\"", "model.toml:5:8", "year-month-day"],
    );
    shows("expiry = 2026", &["provenance.expiry must be a date, found a number"]);
    shows("temperature-degc = 293", &["temperature-degc is 293 degC", "allowed is -40 to 100 degC"]);
    shows("instrument = 1", &["instrument must be a text in quotes"]);
    shows(
        "temperature-k = 293",
        &["unknown key `temperature-k` in [provenance]", "did you mean temperature-degc?"],
    );
}

#[test]
fn everything_wrong_is_reported_at_once() {
    let text = "format = \"volcomp-model/1\"\nchain = \"[w b X\"\n[axes.x]\ntravel-mm = [1, 0]\n[errors.exx.table]\n\
        position-mm = [1, 0]\nvalue-um = [nan, 0]\n[errors.eqx.constant]\nvalue-um = 1\n";
    model_shows(
        text,
        &[
            "machine is missing",
            "model.toml:2:10",
            "model.toml:4:13",
            "model.toml:6:19",
            "model.toml:7:13",
            "model.toml:8:9",
            "model.toml: 6 mistakes",
        ],
    );
    let text = "format = \"volcomp-machine/1\"\n[link]\ncycle-ms = 20\n[axes.x]\n[engine]\ngain = 2\n";
    machine_shows(
        text,
        &[
            "machine is missing",
            "model is missing",
            "machine.toml:3:12",
            "axes.x.limit-um is missing",
            "axes.x.rate-um-per-s is missing",
            "axes.x.acceleration-um-per-s2 is missing",
            "machine.toml:6:8",
            "7 mistakes",
        ],
    );
}

#[test]
fn a_flood_of_mistakes_is_cut_and_counted() {
    let text = format!(
        "{MODEL}[errors.exx.table]\nposition-mm = [{}]\nvalue-um = [1, 2]\n",
        vec!["nan"; 500].join(", ")
    );
    model_shows(&text, &["500 mistakes, the first 30 are shown"]);
}

#[test]
fn windows_files_give_the_same_places() {
    let text = format!("{MODEL}[errors.exx.table]\nposition-mm = [0, 10, 5]\nvalue-um = [0, 1, 2]\n");
    let windows = format!("\u{feff}{}", text.replace('\n', "\r\n"));
    let unix = model::parse("m.toml", &text).expect_err("bad").to_string();
    assert_eq!(model::parse("m.toml", &windows).expect_err("bad").to_string(), unix);
}
