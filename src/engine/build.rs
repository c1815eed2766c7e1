//! Makes the table of faults and the names of their numbers from `fault/catalogue.toml`.

#![expect(clippy::disallowed_methods, reason = "a build script reads and writes files")]

use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::{env, fs};

const CATALOGUE: &str = "fault/catalogue.toml";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed={CATALOGUE}");
    let (mut rows, mut names) = (String::new(), String::new());
    for (code, entry) in fs::read_to_string(CATALOGUE)?.parse::<toml::Table>()? {
        let text =
            |key: &str| entry.get(key).and_then(toml::Value::as_str).ok_or(format!("{code}: no {key}"));
        let name = text("name")?.to_uppercase().replace('-', "_");
        writeln!(names, "#[doc = {:?}] pub const {name}: Self = Self({code});", text("text")?)?;
        writeln!(rows, "Entry {{ code: Code::{name}, severity: Severity::{},", text("severity")?)?;
        for key in ["name", "text", "cause", "reaction", "remedy"] {
            writeln!(rows, "{key}: {:?},", text(key)?)?;
        }
        writeln!(rows, "}},")?;
    }
    let made = format!(
        "/// Every entry, by number.\npub const CATALOGUE: &[Entry] = &[{rows}];\nimpl Code {{ {names} }}\n"
    );
    fs::write(Path::new(&env::var("OUT_DIR")?).join("catalogue.rs"), made)?;
    Ok(())
}
