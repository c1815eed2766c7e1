//! Measurement sessions with known truth from a simulated boring mill, for `cncsim dev blind --generator multibody`.
//!
//! `multibody effects` lists the effects as JSON. `multibody case REQUEST.json OUT TRUTH.json` simulates a case: session files,
//! `history.csv` and `model.toml` into OUT, those of another day into OUT/fresh, the truth into a file of its own.
//!
//! Reading order: `machine` (bodies and frames), `path`, `program` (what is measured), `dynamics` (drives and joints, rapier),
//! `solid` (beams and conduction on grids), `heat`, `faults`, `instruments`, `files`, `case`.

mod case;
mod dynamics;
mod faults;
mod files;
mod heat;
mod instruments;
mod machine;
mod path;
mod program;
mod random;
mod solid;

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

/// Why nothing was simulated.
#[derive(Debug)]
pub struct Failure(String);

impl Failure {
    fn of(what: impl Into<String>) -> Self {
        Self(what.into())
    }

    fn at(path: &Path, why: &dyn core::fmt::Display) -> Self {
        Self(format!("{}: {why}", path.display()))
    }
}

/// The list of effects.
#[derive(serde::Serialize)]
struct Listed {
    name: &'static str,
    subject: &'static str,
    outside: bool,
    families: Vec<String>,
    physics: &'static str,
}

fn effects() -> Result<String, Failure> {
    let all: Vec<Listed> = faults::CATALOGUE
        .iter()
        .flat_map(|e| {
            e.subjects.iter().map(|subject| Listed {
                name: e.name,
                subject,
                outside: e.name.starts_with("outside-"),
                families: faults::families(e.name, subject),
                physics: e.physics,
            })
        })
        .collect();
    serde_json::to_string_pretty(&all).map_err(|e| Failure::of(e.to_string()))
}

fn run(args: &[String]) -> Result<(), Failure> {
    let words: Vec<&str> = args.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["effects"] => {
            let text = effects()?;
            writeln!(std::io::stdout(), "{text}").map_err(|e| Failure::of(e.to_string()))
        }
        ["case", request, out, truth] => {
            let path = Path::new(request);
            let text = std::fs::read_to_string(path).map_err(|e| Failure::at(path, &e))?;
            let request: case::Request = serde_json::from_str(&text).map_err(|e| Failure::at(path, &e))?;
            let made = case::simulate(&request, Path::new(out))?;
            let text = serde_json::to_string(&made).map_err(|e| Failure::of(e.to_string()))?;
            let path = Path::new(truth);
            std::fs::write(path, text).map_err(|e| Failure::at(path, &e))
        }
        _ => Err(Failure::of("usage: multibody effects | multibody case REQUEST.json OUT TRUTH.json")),
    }
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure(why)) => {
            let _ = writeln!(std::io::stderr(), "error: {why}");
            ExitCode::from(if why.starts_with("usage") { 64 } else { 70 })
        }
    }
}
