//! Makes the tables of effects and measurement procedures from `library/effects.toml`.

#![expect(clippy::disallowed_methods, reason = "a build script reads and writes files")]

use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::{env, fs};

use toml::{Table, Value};

const FILE: &str = "library/effects.toml";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed={FILE}");
    let file: Table = fs::read_to_string(FILE)?.parse()?;
    let made = format!(
        "/// All effects, in the order in which they are listed and searched.\n\
         pub static EFFECTS: &[&Effect] = &[{}];\n\
         /// Measurement procedures, in the order in which they are considered.\n\
         pub static PROCEDURES: &[Procedure] = &[{}];\n",
        rows(&file["effect"], "&Effect")?,
        rows(&file["procedure"], "Procedure")?
    );
    fs::write(Path::new(&env::var("OUT_DIR")?).join("effects.rs"), made)?;
    Ok(())
}

/// The tables of a list as values of a type; names of variants and functions stand without their paths in the file.
fn rows(list: &Value, name: &str) -> Result<String, Box<dyn Error>> {
    let mut rows = String::new();
    for row in list.as_array().into_iter().flatten() {
        write!(rows, "{name} {{ ")?;
        for (key, value) in row.as_table().into_iter().flatten() {
            match (key.as_str(), value) {
                ("kind", Value::String(name)) => write!(rows, "kind: Kind::{name}, ")?,
                ("subjects", Value::String(name)) => write!(rows, "subjects: Subjects::{name}, ")?,
                ("motion", Value::String(name)) => write!(rows, "motion: Measurement::{name}, ")?,
                ("variants", Value::String(path)) => write!(rows, "variants: {path}, ")?,
                (_, Value::String(text)) => write!(rows, "{key}: {text:?}, ")?,
                (_, Value::Array(names)) => {
                    let names = names.iter().filter_map(Value::as_str);
                    let paths: String = names.map(|name| format!("Measurement::{name}, ")).collect();
                    write!(rows, "{key}: &[{paths}], ")?;
                }
                (_, number) => write!(rows, "{key}: {number}, ")?,
            }
        }
        writeln!(rows, "}},")?;
    }
    Ok(rows)
}
