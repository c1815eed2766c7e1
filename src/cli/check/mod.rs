//! `check`: reads machine and model files as the daemon would, and says what is in them or what is wrong.

mod plausibility;
mod settings;
mod text_report;

use std::io::IsTerminal as _;
use std::sync::Arc;

use self::settings::{Setting, settings};
pub(crate) use self::text_report::model_notes;
pub(super) use self::text_report::{Size, axis_json, error_json, kinds_of};
use self::text_report::{describe_machine, describe_model, expiry_note, machine_notes, model_as_json};
use crate::prelude::*;
use volcomp_config::{ConfigErrors, Diagnostic, FileKind};
use volcomp_daemon::with_additions;
use volcomp_effects::extend::Fate;
use volcomp_estimate::live::{LiveEstimator, LiveModel};

/// Check machine and model files: every mistake with file, line and remedy, or a summary of what is in them
///
/// A machine file is checked together with the model it names.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// Machine files (volcomp-machine/1) and model files (volcomp-model/1)
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// List what deviates from the datum and reference-line convention
    #[arg(long)]
    verbose: bool,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let outcomes: Vec<Outcome> = args.files.iter().map(|f| Outcome::of(f)).collect();
    let report = if args.json {
        let ok = outcomes.iter().all(|o| o.problem.is_none());
        let report = json!({"ok": ok, "files": outcomes.iter().map(Outcome::as_json).collect::<Vec<_>>()});
        serde_json::to_string_pretty(&report).map_err(|e| Failure::new(EX_SOFTWARE, e))? + "\n"
    } else {
        let right = outcomes.iter().filter(|o| o.problem.is_none());
        right.filter_map(|o| Some(o.found.as_ref()?.as_text(&o.file, args.verbose) + "\n")).collect()
    };
    super::exit::print(&report)?;
    let problems: Vec<&Problem> = outcomes.iter().filter_map(|o| o.problem.as_ref()).collect();
    let Some(code) = problems.iter().map(|p| p.code()).max() else { return Ok(()) };
    #[expect(clippy::disallowed_methods, reason = "colours are for a terminal, and NO_COLOR is respected")]
    let color = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let message = problems.iter().map(|p| p.as_text(color)).joined("\n\n");
    Err(Failure::new(code, message))
}

/// What came out of one file.
struct Outcome {
    file: String,
    found: Option<Found>,
    problem: Option<Problem>,
}

/// Why a file is not usable.
enum Problem {
    /// It (or the model it names) could not be read.
    Io(Failure),
    /// It is wrong.
    Config(ConfigErrors),
}

/// What is in a file.
enum Found {
    /// With the model that it names, additions in it, and what became of each effect of those.
    Machine {
        machine: Box<MachineConfig>,
        settings: Vec<Setting>,
        model: Option<(Box<ModelFile>, String)>,
        fates: Vec<(String, Fate)>,
    },
    /// With its hash, as of the model of a machine.
    Model(Box<ModelFile>, String),
}

impl Problem {
    const fn code(&self) -> u8 {
        match self {
            Self::Io(failure) => failure.code,
            Self::Config(_) => EX_CONFIG,
        }
    }

    fn as_text(&self, color: bool) -> String {
        match self {
            Self::Io(failure) => failure.message.clone(),
            Self::Config(errors) => errors.render(color),
        }
    }

    fn as_json(&self) -> Vec<Value> {
        match self {
            Self::Io(failure) => vec![json!({"message": failure.message})],
            Self::Config(errors) => {
                let one = |d: &Diagnostic| {
                    let (line, column) = errors.place(d).map(|p| (p.line, p.column)).unzip();
                    let (file, message, remedy) = (&errors.file, &d.message, &d.remedy);
                    json!({"file": file, "line": line, "column": column, "message": message, "remedy": remedy})
                };
                errors.diagnostics.iter().map(one).collect()
            }
        }
    }
}

impl From<Failure> for Problem {
    fn from(failure: Failure) -> Self {
        Self::Io(failure)
    }
}

impl From<ConfigErrors> for Problem {
    fn from(errors: ConfigErrors) -> Self {
        Self::Config(errors)
    }
}

/// Reads a text file; what is not UTF-8 is a mistake in the file, not of the system.
fn read(path: &Path) -> Result<String, Problem> {
    let bytes = input::read(path, InputKind::Model)?;
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let line = e.as_bytes()[..at].iter().filter(|b| **b == b'\n').count() + 1;
        let message = format!("byte {at} (line {line}) is not UTF-8");
        let diagnostics = vec![Diagnostic::of_file(message, "save the file as UTF-8")];
        Problem::Config(ConfigErrors::new(&path.display().to_string(), "", diagnostics))
    })
}

impl Outcome {
    fn of(path: &Path) -> Self {
        let file = path.display().to_string();
        match look(path, &file) {
            Ok((found, problem)) => Self { file, found: Some(found), problem },
            Err(problem) => Self { file, found: None, problem: Some(problem) },
        }
    }

    fn as_json(&self) -> Value {
        let mut out = match &self.found {
            Some(found) => found.as_json(),
            None => json!({}),
        };
        out["file"] = json!(self.file);
        out["ok"] = json!(self.problem.is_none());
        out["mistakes"] = json!(self.problem.as_ref().map(Problem::as_json).unwrap_or_default());
        out
    }
}

/// Reads a file; a machine file that is right by itself may still have a problem with its model.
fn look(path: &Path, file: &str) -> Result<(Found, Option<Problem>), Problem> {
    let text = read(path)?;
    if config::kind_of_file(file, &text)? == FileKind::Model {
        let model = config::model::parse_file(file, &text)?;
        return Ok((Found::Model(Box::new(model), hash(&text)), None));
    }
    InputKind::Machine.check_length(path, text.len())?;
    let machine = Box::new(MachineConfig::parse(file, &text)?);
    let (model, fates, problem) = match look_at_model(path, file, &text, &machine) {
        Ok((model, hash, fates)) => {
            let problem = look_at_hash(file, &text, &machine, &hash)
                .and_then(|()| look_at_identity(path, file, &text, &machine));
            (Some((Box::new(model), hash)), fates, problem.err())
        }
        Err(problem) => (None, Vec::new(), Some(problem)),
    };
    let settings = settings(&text, &machine);
    Ok((Found::Machine { machine, settings, model, fates }, problem))
}

/// A model, its hash, and what became of each effect of the additions.
type Looked = (ModelFile, String, Vec<(String, Fate)>);

/// BLAKE3 of the text of a model, in hexadecimal digits.
fn hash(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

/// Whether the model is the one that `[guard]` names, if any.
fn look_at_hash(file: &str, text: &str, machine: &MachineConfig, hash: &str) -> Result<(), Problem> {
    let Some(pinned) = machine.guard.hash.as_ref().filter(|pinned| *pinned != hash) else { return Ok(()) };
    let key = ["guard", "hash"].map(str::to_owned).to_vec();
    let message = format!("guard.hash is {pinned}, the model has hash {hash}: volcompd refuses it (VC-5005)");
    let remedy = "name the file that was released, or write the hash of this one once it is".to_owned();
    Err(mistakes_at(file, text, vec![(key, message, remedy)]).into())
}

/// The model that a machine file names, with its additions, checked against it; its hash is that of what the daemon would use.
fn look_at_model(path: &Path, file: &str, text: &str, machine: &MachineConfig) -> Result<Looked, Problem> {
    let named = path.parent().unwrap_or(Path::new("")).join(&machine.model);
    let model_text = read(&named).map_err(|problem| match problem {
        Problem::Io(Failure { code, message }) => {
            let message = message.trim_start_matches("error: ");
            let (message, remedy) = message
                .split_once("\n  hint: ")
                .unwrap_or((message, "the path is seen from the machine file"));
            let found = vec![(vec!["model".to_owned()], message.to_owned(), remedy.to_owned())];
            Failure::new(code, mistakes_at(file, text, found)).into()
        }
        wrong @ Problem::Config(_) => wrong,
    })?;
    let mut model = config::model::parse_file(&named.display().to_string(), &model_text)?;
    let fates = with_additions(path, machine, (&mut model, &model_text)).map_err(|e| {
        let code = if e.is_io() { EX_IOERR } else { EX_CONFIG };
        Problem::from(Failure::new(code, e))
    })?;
    let hash = if fates.is_empty() {
        hash(&model_text)
    } else {
        hash(&config::model::write_file(&model, &[format!("{} with additions.", machine.model.display())]))
    };
    let mismatches = machine.check_model(&model.spec);
    if mismatches.is_empty() {
        return match look_at_sensors(&model, machine) {
            None => Ok((model, hash, fates)),
            Some((message, remedy)) => {
                Err(mistakes_at(file, text, vec![(vec!["sensors".to_owned()], message, remedy)]).into())
            }
        };
    }
    let found = mismatches.iter().map(|m| (m.key(), m.to_string(), m.remedy())).collect();
    Err(mistakes_at(file, text, found).into())
}

/// Whether sensors and maps go with the model, as the daemon would see it; what does not, and the remedy.
fn look_at_sensors(file: &ModelFile, machine: &MachineConfig) -> Option<(String, String)> {
    let live = &machine.sensors.spec;
    if live.sensors.is_empty() && live.maps.is_empty() {
        return None;
    }
    let remedy = "see docs/how-to/sensors.md: live values of the model, the inputs of its growths and the names of maps and sensors".to_owned();
    // what the model itself breaks is told where the model is checked
    let model = Arc::new(Model::new(&file.spec).ok()?);
    let of = LiveModel { spec: &file.spec, thermal: &file.thermal, model, hash: [0; 32] };
    let problem = LiveEstimator::new(live, of).err()?;
    Some((problem.to_string(), remedy))
}

/// The files of `[link.tls]` and the token of `[http]`, read as the daemon would.
fn look_at_identity(path: &Path, file: &str, text: &str, machine: &MachineConfig) -> Result<(), Problem> {
    let Some(found) = super::identity::mistake(path, machine) else { return Ok(()) };
    let errors = mistakes_at(file, text, vec![(found.key, found.message, found.remedy)]);
    Err(if found.is_io { Failure::new(EX_IOERR, errors).into() } else { errors.into() })
}

/// Mistakes at keys of a file: key, message, remedy.
fn mistakes_at(file: &str, text: &str, found: Vec<(Vec<String>, String, String)>) -> ConfigErrors {
    let text = text.trim_start_matches('\u{feff}');
    let diagnostic = |(key, message, remedy): (Vec<String>, _, _)| {
        let path: Vec<&str> = key.iter().map(String::as_str).collect();
        Diagnostic { span: config::place_of(text, &path), message, remedy: Some(remedy) }
    };
    ConfigErrors::new(file, text, found.into_iter().map(diagnostic).collect())
}

impl Found {
    fn as_text(&self, file: &str, details: bool) -> String {
        let mut lines = vec![format!("{file}: ok")];
        match self {
            Self::Model(model, hash) => {
                lines.extend(expiry_note(model, None).map(|n| format!("  note: {n}")));
                describe_model(&mut lines, model, hash, details);
            }
            Self::Machine { machine, settings, model, fates } => {
                describe_machine(&mut lines, machine);
                lines.extend(settings::lines(settings));
                if let Some((model, hash)) = model {
                    lines.extend(machine_notes(machine, model).into_iter().map(|n| format!("  note: {n}")));
                    lines.push(format!("  model {}", machine.model.display()));
                    describe_model(&mut lines, model, hash, details);
                    lines.extend(fates.iter().map(|(effect, fate)| format!("  addition {effect}: {fate}")));
                }
            }
        }
        lines.iter().map(|line| micro(line)).joined("\n")
    }

    fn as_json(&self) -> Value {
        match self {
            Self::Model(model, hash) => {
                let mut out = model_as_json(model, hash);
                out["format"] = json!(config::model::FORMAT);
                let expired = expiry_note(model, None);
                out["notes"] = expired.into_iter().chain(model_notes(model)).collect();
                out
            }
            Self::Machine { machine, settings, model, fates } => json!({
                "format": config::machine::FORMAT,
                "machine": machine.machine,
                "address": machine.link.address.to_string(),
                "tls": machine.link.tls.is_some(),
                "cycle_ms": machine.link.cycle_s * 1e3,
                "axes": machine.axes.iter().map(|a| json!({
                    "axis": a.name.lower().to_string(),
                    format!("limit_{}", offset_unit(a.name)): offset_out(a.name, a.limits.size),
                    format!("warning_{}", offset_unit(a.name)): offset_out(a.name, a.limits.warning),
                })).collect::<Vec<_>>(),
                "settings": settings.iter().map(Setting::as_json).collect::<Vec<_>>(),
                "model_file": machine.model.display().to_string(),
                "additions": fates.iter().map(|(effect, fate)| json!({
                    "effect": effect, "taken": fate.is_taken(), "fate": fate.to_string(),
                })).collect::<Vec<_>>(),
                "model": model.as_ref().map(|(m, hash)| model_as_json(m, hash)),
                "notes": model.as_ref().map(|(m, _)| machine_notes(machine, m)).unwrap_or_default(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::EX_IOERR;
    use super::*;

    fn write(dir: &Path, name: &str, text: &str) -> PathBuf {
        let path = dir.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    const AXIS_X: &str = "[axes.x]\nlimit-um = 50\nrate-um-per-s = 100\nacceleration-um-per-s2 = 1000\n";
    const MODEL: &str = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y t]\"\n\
        [axes.x]\ntravel-mm = [0, 500]\n[errors.exx.table]\nposition-mm = [0, 400]\nvalue-um = [0, 80]\n";

    fn machine(id: &str, model: &str) -> String {
        format!("format = \"volcomp-machine/1\"\nmachine = \"{id}\"\nmodel = \"{model}\"\n{AXIS_X}")
    }

    fn code_of(path: &Path) -> Option<u8> {
        Outcome::of(path).problem.map(|p| p.code())
    }

    #[test]
    fn a_machine_file_is_read_with_its_model() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), "model.toml", MODEL);
        let text = format!("{}[engine]\nramp-s = 3\n", machine("m", "model.toml"));
        let outcome = Outcome::of(&write(dir.path(), "machine.toml", &text));
        assert!(outcome.problem.is_none());
        let text = outcome.found.unwrap().as_text("machine.toml", false);
        for part in [
            "machine.toml: ok",
            "axis X: offset up to 50 µm, warning at 40 µm",
            "[engine] start on-command (default), limit-time control (default), ramp-s 3 s (stated), stale-ms 20 ms (default), hold-s 0.2 s (default)",
            "[axes.x] step-um 0.2 µm (default), stop-um 150 µm (default), jump-mm 2 mm = 120 m/min (default)",
            "chain [w b X Y t]",
            "exx  table  0 to 400 mm    0.00    80.00  80.00  µm",
            "note: axis Y is in the chain but has no [axes.y]: it is never offset",
            "note: EXX covers 0 to 400 mm of the travel 0 to 500 mm",
            "note: EXX alone reaches 80.00 µm, above the limit of 50 µm of axis X",
            "note: axis Y has no travel",
        ] {
            assert!(text.contains(part), "{part} not in\n{text}");
        }
    }

    #[test]
    fn a_model_is_checked_against_the_guard() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), "model.toml", &format!("{MODEL}[provenance]\nexpiry = \"2020-01-31\"\n"));
        let good = machine("m", "model.toml");
        let text = |name: &str, text: &str| {
            let outcome = Outcome::of(&write(dir.path(), name, text));
            let found = outcome.found.unwrap().as_text(name, false);
            (found, outcome.problem.map(|p| p.as_text(false)))
        };
        let (found, problem) = text("a.toml", &good);
        assert_eq!(problem, None);
        assert!(
            found.contains("note: VC-5003: the model expired on 2020-01-31: compensation stays off"),
            "{found}"
        );
        for (name, hint) in [("model.toml", "[guard] of the machine file"), ("a.toml", "--accept-expired")] {
            let outcome = Outcome::of(&dir.path().join(name));
            let note = outcome.as_json()["notes"].to_string();
            assert!(
                note.contains("VC-5003: the model expired on 2020-01-31") && note.contains(hint),
                "{note}"
            );
            let text = outcome.found.unwrap().as_text(name, false);
            assert!(text.contains("note: VC-5003") && text.contains(hint), "{text}");
        }
        let hash = found.lines().find_map(|l| l.trim().strip_prefix("hash ")).unwrap().to_owned();
        assert_eq!(hash, super::hash(&std::fs::read_to_string(dir.path().join("model.toml")).unwrap()));
        assert_eq!(text("b.toml", &format!("{good}[guard]\nhash = \"{hash}\"\n")).1, None);
        let other = "a".repeat(64);
        let problem = text("c.toml", &format!("{good}[guard]\nhash = \"{other}\"\n")).1.unwrap();
        assert!(problem.contains(&hash) && problem.contains("VC-5005"), "{problem}");
        assert!(problem.contains("c.toml:9:8"), "{problem}");
    }

    #[test]
    fn a_model_of_another_machine_is_shown_at_the_id() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), "model.toml", MODEL);
        let outcome = Outcome::of(&write(dir.path(), "machine.toml", &machine("other", "model.toml")));
        let problem = outcome.problem.unwrap();
        assert_eq!(problem.code(), EX_CONFIG);
        let text = problem.as_text(false);
        assert!(text.contains("the model is of machine \"m\", the machine file is for \"other\""), "{text}");
        assert!(text.contains("machine.toml:2:11"), "{text}");
    }

    #[test]
    fn an_axis_that_the_chain_lacks_is_shown_at_its_heading() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), "model.toml", &MODEL.replace("X Y t", "X t"));
        let text = machine("m", "model.toml") + &AXIS_X.replace("axes.x", "axes.z");
        let problem = Outcome::of(&write(dir.path(), "machine.toml", &text)).problem.unwrap().as_text(false);
        assert!(problem.contains("axis Z has limits but is not in the model's chain [w b X t]"), "{problem}");
        assert!(problem.contains("machine.toml:8:7"), "{problem}");
    }

    #[test]
    fn exit_codes_tell_files_from_their_content() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(code_of(&dir.path().join("absent.toml")), Some(EX_IOERR));
        assert_eq!(code_of(&write(dir.path(), "a.toml", &machine("m", "absent.toml"))), Some(EX_IOERR));
        assert_eq!(code_of(&write(dir.path(), "b.toml", "format = 1")), Some(EX_CONFIG));
        assert_eq!(code_of(&write(dir.path(), "c.toml", "")), Some(EX_CONFIG));
        std::fs::write(dir.path().join("d.toml"), b"# a\n\xff\n").unwrap();
        assert_eq!(code_of(&dir.path().join("d.toml")), Some(EX_CONFIG));
        assert_eq!(code_of(&write(dir.path(), "e.toml", MODEL)), None);
    }

    #[test]
    fn a_model_file_that_is_missing_is_shown_where_it_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let problem =
            Outcome::of(&write(dir.path(), "a.toml", &machine("m", "absent.toml"))).problem.unwrap();
        let text = problem.as_text(false);
        assert!(text.contains("a.toml:3:9") && text.contains("absent.toml"), "{text}");
    }

    #[test]
    fn json_carries_lines_and_sizes() {
        let dir = tempfile::tempdir().unwrap();
        let good = Outcome::of(&write(dir.path(), "model.toml", MODEL)).as_json();
        assert_eq!(good["ok"], true);
        assert_eq!(good["errors"][0]["highest_um"], 80.0);
        assert_eq!(good["errors"][0]["range_mm"], json!([0.0, 400.0]));
        let bad = Outcome::of(&write(dir.path(), "bad.toml", &MODEL.replace("[0, 400]", "[0, 0]"))).as_json();
        assert_eq!(bad["ok"], false);
        assert_eq!(bad["mistakes"][0]["line"], 7);
        assert_eq!(bad["mistakes"][0]["column"], 19);
    }
}
