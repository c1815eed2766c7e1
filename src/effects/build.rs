//! Makes the table of effects from `library/effects.toml`.

#![expect(clippy::disallowed_methods, reason = "a build script reads and writes files")]

use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::{env, fs};

use toml::{Table, Value};

const EFFECTS: &str = "library/effects.toml";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed={EFFECTS}");
    let file: Table = fs::read_to_string(EFFECTS)?.parse()?;
    let mut rows = String::new();
    for effect in file["effect"].as_array().into_iter().flatten() {
        writeln!(rows, "&Effect {{")?;
        for (key, value) in effect.as_table().into_iter().flatten() {
            match (key.as_str(), value) {
                ("kind", Value::String(name)) => writeln!(rows, "kind: Kind::{name},")?,
                ("subjects", Value::String(name)) => writeln!(rows, "subjects: Subjects::{name},")?,
                ("variants", Value::String(path)) => writeln!(rows, "variants: {path},")?,
                (_, Value::String(text)) => writeln!(rows, "{key}: {text:?},")?,
                (_, names) => {
                    let names = names.as_array().into_iter().flatten().filter_map(Value::as_str);
                    let paths: String = names.map(|name| format!("Measurement::{name}, ")).collect();
                    writeln!(rows, "{key}: &[{paths}],")?;
                }
            }
        }
        writeln!(rows, "}},")?;
    }
    fs::write(Path::new(&env::var("OUT_DIR")?).join("effects.rs"), format!("&[{rows}]"))?;
    Ok(())
}
