//! `volcomp schema`: shipped files are valid, files that `volcomp check` refuses are not, and the key table, from which the
//! schemas come, says the same as the reference page.

#![expect(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test reads files and runs the program"
)]

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Map, Value};
use volcomp::config::{self, Allowed, Shape, machine, model};

const VOLCOMP: &str = env!("CARGO_BIN_EXE_volcomp");

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn schema(kind: &str) -> Value {
    let output = Command::new(VOLCOMP).args(["schema", kind]).output().expect("volcomp runs");
    assert!(output.status.success());
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// True for a name that the patterns of the schemas describe: `^`, literals, `[classes]`, `.+`, `$`, and one `(a|b)`.
fn matches(pattern: &str, name: &str) -> bool {
    let inner = pattern.trim_start_matches('^').trim_end_matches('$');
    if let Some((before, rest)) = inner.split_once('(') {
        let (choices, behind) = rest.split_once(')').expect("closed");
        return choices.split('|').any(|choice| matches(&format!("^{before}{choice}{behind}$"), name));
    }
    if let Some((before, behind)) = inner.split_once(".+") {
        let middle = name.strip_prefix(before).and_then(|rest| rest.strip_suffix(behind));
        return middle.is_some_and(|middle| !middle.is_empty());
    }
    let (mut pattern, mut name) = (inner.chars(), name.chars());
    while let Some(p) = pattern.next() {
        let Some(n) = name.next() else { return false };
        let class: String =
            if p == '[' { pattern.by_ref().take_while(|c| *c != ']').collect() } else { p.into() };
        if !class.contains(n) {
            return false;
        }
    }
    name.next().is_none()
}

/// What is wrong with a value; the keywords are those that the schemas use.
fn wrong(schema: &Value, value: &Value, at: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut fail = |what: &dyn core::fmt::Display| found.push(format!("{at}: {what}"));
    let empty = Map::new();
    let object = value.as_object().unwrap_or(&empty);
    let list = value.as_array().map_or(&[][..], Vec::as_slice);
    let number = value.as_f64();
    let none = Value::Null;
    let part = |keyword: &str| schema.get(keyword).unwrap_or(&none);
    let known = |name: &str| -> Vec<&Value> {
        let named = part("properties").get(name);
        let patterns = part("patternProperties").as_object().into_iter().flatten();
        named.into_iter().chain(patterns.filter(|(p, _)| matches(p, name)).map(|(_, s)| s)).collect()
    };
    let mut below = Vec::new();
    for (keyword, limit) in schema.as_object().expect("a schema") {
        let bound = || limit.as_f64().expect("a number");
        match keyword.as_str() {
            "$schema" | "title" | "description" | "default" | "patternProperties" => {}
            "type" => {
                let types: Vec<&Value> = limit.as_array().map_or(vec![limit], |all| all.iter().collect());
                let is = |name: &str| match name {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "boolean" => value.is_boolean(),
                    "integer" => value.is_i64(),
                    "number" => value.is_number(),
                    "null" => value.is_null(),
                    other => panic!("type {other}"),
                };
                if !types.iter().any(|t| is(t.as_str().expect("a type"))) {
                    fail(&format_args!("not of type {limit}"));
                }
            }
            "const" if value != limit => fail(&format_args!("not {limit}")),
            "enum" if !limit.as_array().expect("words").contains(value) => {
                fail(&format_args!("none of {limit}"))
            }
            "minimum" if number.is_some_and(|v| v < bound()) => fail(&format_args!("below {limit}")),
            "maximum" if number.is_some_and(|v| v > bound()) => fail(&format_args!("above {limit}")),
            "exclusiveMinimum" if number.is_some_and(|v| v <= bound()) => {
                fail(&format_args!("not above {limit}"))
            }
            "minItems" if list.len() < bound() as usize => fail(&"too short"),
            "maxItems" if list.len() > bound() as usize => fail(&"too long"),
            "const" | "enum" | "minimum" | "maximum" | "exclusiveMinimum" | "minItems" | "maxItems" => {}
            "items" => {
                for (i, item) in list.iter().enumerate() {
                    below.extend(wrong(limit, item, &format!("{at}[{i}]")));
                }
            }
            "required" => {
                let names = limit.as_array().into_iter().flatten().filter_map(Value::as_str);
                for name in names.filter(|name| !object.contains_key(*name)) {
                    fail(&format_args!("{name} is missing"));
                }
            }
            "properties" => {
                for (name, value) in object {
                    for schema in known(name) {
                        below.extend(wrong(schema, value, &format!("{at}.{name}")));
                    }
                }
            }
            "additionalProperties" => {
                for name in object.keys().filter(|name| known(name).is_empty()) {
                    fail(&format_args!("unknown key {name}"));
                }
            }
            "anyOf" => {
                let all: Vec<_> =
                    limit.as_array().into_iter().flatten().map(|s| wrong(s, value, at)).collect();
                if all.iter().all(|one| !one.is_empty()) {
                    below.extend(all.into_iter().flatten());
                }
            }
            other => panic!("keyword {other}"),
        }
    }
    found.extend(below);
    found
}

fn of_toml(text: &str) -> Value {
    let table: toml::Table = text.parse().unwrap_or_else(|e| panic!("{e}\n{text}"));
    serde_json::to_value(table).expect("TOML is JSON here")
}

fn examples(name: &str) -> Vec<PathBuf> {
    let folders = std::fs::read_dir(root().join("config/examples")).expect("examples");
    folders.flatten().map(|f| f.path().join(name)).filter(|path| path.is_file()).collect()
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

#[test]
fn shipped_files_are_valid() {
    let mut machines = examples("machine.toml");
    machines
        .extend(["config/machine.toml", "fuzz/corpus/machine_file/every_key.toml"].map(|p| root().join(p)));
    let models = examples("model.toml");
    assert!(machines.len() > 6 && models.len() > 3, "{machines:?} {models:?}");
    for (kind, files) in [("machine", machines), ("model", models)] {
        let schema = schema(kind);
        for file in files {
            let found = wrong(&schema, &of_toml(&read(&file)), kind);
            assert!(found.is_empty(), "{}: {}", file.display(), found.join("\n"));
        }
    }
}

#[test]
fn mistakes_that_check_finds_are_found() {
    let machine = read(&root().join("config/examples/vmc-850/machine.toml"));
    let model = read(&root().join("config/examples/vmc-850/model.toml"));
    let cases: &[(&str, &str, &str, &str)] = &[
        ("machine", "machine = ", "machin = ", "unknown key machin"),
        ("machine", "[axes.x]", "[axes.q]", "unknown key q"),
        ("machine", "\nlimit-um = ", "\nlimit-mm = ", "unknown key limit-mm"),
        ("machine", "\nlimit-um = ", "\nlimit-um = -", "not above 0"),
        ("machine", "volcomp-machine/1", "volcomp-machine/9", "not \"volcomp-machine/1\""),
        ("model", "chain = ", "chian = ", "chain is missing"),
        ("model", "[errors.exx", "[errors.exq", "unknown key exq"),
    ];
    for (kind, from, to, says) in cases {
        let text = if *kind == "machine" { &machine } else { &model };
        assert!(text.contains(from), "{from}");
        let changed = text.replacen(from, to, 1);
        let found = wrong(&schema(kind), &of_toml(&changed), kind).join("\n");
        assert!(found.contains(says), "{to}: {found}");
        let refused = match *kind {
            "machine" => config::MachineConfig::parse("m.toml", &changed).is_err(),
            _ => model::parse("m.toml", &changed).is_err(),
        };
        assert!(refused, "{to}");
    }
}

#[test]
fn variants_of_thermal_displacements_are_valid() {
    let base = read(&root().join("config/examples/vmc-850/model.toml"));
    let growth = "[thermal.a]\n[[thermal.a.input]]\nsensor = \"t\"\nrange-degc = [10, 40]\ngrowth-um-per-k = [1.5]\n\
                  [[thermal.a.input]]\nsensor = \"n\"\nrange-rpm = [0, 9000]\ngrowth-um-per-krpm = [0.5]\n";
    let expansion = "[thermal.b]\nkind = \"expansion\"\n[[thermal.b.input]]\nsensor = \"t\"\nrange-degc = [10, 40]\n\
                     strain-um-per-m-k = [11.5]\n";
    let schema = schema("model");
    for more in [growth, expansion] {
        let text = format!("{base}\n{more}");
        let found = wrong(&schema, &of_toml(&text), "model");
        assert!(found.is_empty(), "{}", found.join("\n"));
    }
    let bad = format!("{base}\n{}", growth.replace("sensor = \"t\"\n", ""));
    assert!(wrong(&schema, &of_toml(&bad), "model").join("\n").contains("sensor is missing"));
}

#[test]
fn grids_over_any_axes_and_lists_of_sources_are_valid() {
    let head = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w C' b X Y Z t]\"\n\
                [axes.c]\npoint-mm = [0, 0, 0]\n";
    let sources = "sources = [{ source = \"a.csv\", source-hash = \"blake3:00\", instrument = \"laser\", date = \"2026-03-12\" }]\n";
    let grid = "[errors.ezy.grid]\naxes = [\"y\", \"z\"]\ny-mm = [0, 200]\nz-mm = [-300, 0]\nvalue-um = [0, 0, -6, -1]\n";
    let turned = "[[errors.eac.grid]]\naxes = [\"c\", \"x\"]\nc-deg = [0, 90]\nx-mm = [0, 1]\nvalue-arcsec = [0, 0, 1, 1]\n";
    let schema = schema("model");
    for more in [
        format!("[provenance]\n{sources}"),
        grid.to_owned(),
        turned.to_owned(),
        format!("{grid}[errors.ezy]\n{sources}"),
        format!("[errors.ec0y]\n{sources}[errors.ec0y.constant]\nvalue-arcsec = 1\n"),
    ] {
        let text = format!("{head}{more}");
        assert!(model::parse("m.toml", &text).is_ok(), "{text}");
        let found = wrong(&schema, &of_toml(&text), "model");
        assert!(found.is_empty(), "{text}{}", found.join("\n"));
    }
    let bad = format!("{head}[provenance]\n{}", sources.replace("source-hash", "hash"));
    assert!(wrong(&schema, &of_toml(&bad), "model").join("\n").contains("unknown key hash"));
}

#[test]
fn rows_of_a_session_are_described() {
    let schema = schema("session");
    let row = "{\"t_s\": 1.5, \"instrument\": \"laser\", \"setup\": 1, \"run\": 1, \"repeat\": 1, \"x_mm\": 10, \
               \"dir_x\": 1, \"u_x\": 1, \"u_y\": 0, \"u_z\": 0, \"deviation_um\": 2.5, \"temp_bed_degc\": 21.5}";
    let row: Value = serde_json::from_str(row).expect("JSON");
    assert_eq!(wrong(&schema, &Value::Array(vec![row.clone()]), "row"), Vec::<String>::new());
    for (name, value, says) in [("setup", 1.5.into(), "type"), ("temp_bed_degc", "warm".into(), "type")] {
        let mut bad = row.clone();
        bad[name] = value;
        assert!(wrong(&schema, &Value::Array(vec![bad]), "row").join(" ").contains(says), "{name}");
    }
    let mut bad = row;
    bad.as_object_mut().expect("a row").remove("x_mm");
    assert!(!wrong(&schema, &Value::Array(vec![bad]), "row").is_empty(), "no position");
}

/// A number as the pages write it.
fn number(text: &str) -> Option<f64> {
    match text.split_once('^') {
        Some((base, power)) => Some(base.parse::<f64>().ok()?.powi(power.parse().ok()?)),
        None => text.parse().ok(),
    }
}

#[test]
fn ranges_and_defaults_of_the_page_are_those_of_the_key_table() {
    let page = read(&root().join("docs/reference/configuration.md"));
    let keys = machine::known_keys();
    let (mut ranges, mut defaults, mut table) = (0, 0, String::new());
    for line in page.lines() {
        let heading = line.strip_prefix("| ").unwrap_or(line);
        if let Some(rest) = heading.strip_prefix("`[") {
            let path = rest.split(']').next().unwrap_or_default();
            table = path.trim_start_matches('[').to_owned();
        }
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let name = cells[0].trim_matches('`');
        let Some(key) = keys.get(&format!("{table}.{name}")).filter(|_| cells.len() > 2) else { continue };
        // `[axes.x]` has a column of rotary keys first
        let [default, allowed] = if table == "axes.x" { [cells[2], cells[3]] } else { [cells[1], cells[2]] };
        if let (Some(stated), Some(known)) = (number(default), key.default) {
            assert_eq!(stated, known, "{table}.{name}: default");
            defaults += 1;
        }
        let Some((low, high)) = allowed.split_once(" to ") else { continue };
        let (Some(low), Some(high)) = (number(low), number(high.trim_start_matches("above 0 up to "))) else {
            continue;
        };
        let known = match key.shape {
            Shape::Number(Allowed::Within { low, high }) => [low, high],
            Shape::Whole(low, high) => [f64::from(low), f64::from(high)],
            ref other => panic!("{table}.{name}: {other:?}"),
        };
        assert_eq!([low, high], known, "{table}.{name}: range");
        ranges += 1;
    }
    assert!(ranges > 30 && defaults > 10, "{ranges} ranges, {defaults} defaults");
}
