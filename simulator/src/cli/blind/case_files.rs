//! The files of a case: written by a generator inside this program or by a program of its own, and read for the judge.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::super::campaign::{save, write_all};
use super::super::tool::Tool;
use super::super::{EX_SOFTWARE, EX_USAGE, Failure, InputKind, read};
use super::{Args, Outputs};
use crate::blind::generator::{CaseTruth, Named};
use crate::blind::{Case, Column, Generator, Rows, Truth};
use crate::campaign::files::Text;

/// Where cases come from: inside, or a program.
pub(super) struct Source {
    /// Effects to draw from.
    pub(super) effects: Vec<Named>,
    program: Option<Tool>,
}

impl Source {
    /// Opens the generator that was asked for.
    pub(super) fn open(args: &Args) -> Result<Self, Failure> {
        if args.generator != Generator::Multibody {
            return Ok(Self { effects: args.generator.effects(), program: None });
        }
        let beside = || {
            let here = std::env::current_exe().ok()?;
            Some(here.parent()?.join("multibody")).filter(|p| p.exists())
        };
        let path: PathBuf = args.generator_program.clone().or_else(beside).ok_or_else(|| {
            Failure::new(
                EX_USAGE,
                "the multibody generator is a program of its own: cargo build --release --manifest-path \
                 simulator/multibody/Cargo.toml, then --generator-program simulator/multibody/target/release/multibody",
            )
        })?;
        let program = Tool::new(Some(&path))?;
        let text = program.run(Path::new("."), &["effects".to_owned()])?;
        let effects = serde_json::from_str(&text).map_err(|e| Failure::in_file(EX_SOFTWARE, &path, e))?;
        Ok(Self { effects, program: Some(program) })
    }

    /// Writes the files of a case; with them what the truth does at their rows, and the case as it became.
    pub(super) fn write(
        &self,
        args: &Args,
        case: &Case,
        outputs: &Outputs,
        fresh: bool,
    ) -> Result<(Case, Written), Failure> {
        let folder = &outputs.folder;
        let is_there = args.again && folder.join("model.toml").exists();
        if let (Some(program), Truth::Multibody(wanted)) = (&self.program, &case.truth) {
            let at =
                |path: &Path| std::path::absolute(path).map_err(|e| Failure::in_file(EX_SOFTWARE, path, e));
            let request = at(&outputs.sealed.with_extension("request.json"))?;
            let truth = at(&outputs.sealed.with_extension("truth.json"))?;
            let text = serde_json::to_string(wanted).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
            save(&request, &text)?;
            let words = [Path::new("case"), &request, &at(folder)?, &truth];
            if !is_there {
                program.run(Path::new("."), &words.map(|w| w.display().to_string()))?;
            }
            let truth: CaseTruth = serde_json::from_str(&read(&truth, InputKind::Table)?)
                .map_err(|e| Failure::in_file(EX_SOFTWARE, &truth, e))?;
            let became = Case {
                labels: truth.effects.iter().map(|e| e.label.clone()).collect(),
                levels: truth.effects.iter().map(|e| e.level).collect(),
                visible: truth.effects.iter().all(|e| e.visible),
                ..case.clone()
            };
            let sessions = truth.columns.keys().cloned().collect::<BTreeSet<_>>();
            let sessions = if sessions.is_empty() { csv_files(folder)? } else { sessions };
            return Ok((became, Written { sessions: sessions.into_iter().collect(), truth: Some(truth) }));
        }
        if is_there {
            let sessions = csv_files(folder)?.into_iter().collect();
            return Ok((case.clone(), Written { sessions, truth: None }));
        }
        let write = |folder: &Path, day: u64| {
            let files = case.truth.files(args.plan, day).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
            write_all(folder, files)
        };
        let sessions = write(folder, case.days[0])?;
        if fresh {
            write(&folder.join("fresh"), case.days[1])?;
        }
        Ok((case.clone(), Written { sessions, truth: None }))
    }
}

/// Session files in a folder.
#[expect(clippy::disallowed_methods, reason = "a program of its own wrote them")]
fn csv_files(folder: &Path) -> Result<BTreeSet<String>, Failure> {
    let failed = |e| Failure::in_file(EX_SOFTWARE, folder, e);
    let mut names = BTreeSet::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name().to_string_lossy().into_owned();
        if name.ends_with(".csv") && name != "history.csv" {
            names.insert(name);
        }
    }
    Ok(names)
}

/// What was written of a case.
pub(super) struct Written {
    /// Session files, by name.
    pub(super) sessions: Vec<String>,
    truth: Option<CaseTruth>,
}

/// The re-expressions among the declared causes of a case, from the columns.
///
/// Reads the session files, so it comes before they are removed.
pub(super) fn re_expressions(
    args: &Args,
    tool: &Tool,
    case: &Case,
    written: &Written,
    folder: &Path,
    declared: &[String],
) -> Result<BTreeSet<String>, Failure> {
    if declared.iter().all(|d| case.labels.contains(d)) || case.labels.is_empty() {
        return Ok(BTreeSet::new());
    }
    let text = |name: &str| -> Result<Text, Failure> {
        let text = read(&folder.join(name), InputKind::Table)?;
        Ok(Text { name: name.to_owned(), text })
    };
    let sessions = written.sessions.iter().map(|n| text(n)).collect::<Result<Vec<_>, _>>()?;
    let failed = |e: String| Failure::in_file(EX_SOFTWARE, folder, e);
    let rows = Rows::read(&sessions, &text("history.csv")?, &text("model.toml")?).map_err(failed)?;
    let mut truth: BTreeMap<String, Column> = BTreeMap::new();
    for label in &case.labels {
        let by_file = match &written.truth {
            Some(t) => t
                .columns
                .iter()
                .filter_map(|(file, columns)| Some((file.clone(), columns.get(label)?.clone())))
                .collect(),
            None => case
                .truth
                .alone(label)
                .along_u(args.plan, case.days[0])
                .map_err(|e| Failure::new(EX_SOFTWARE, e))?,
        };
        truth.insert(label.clone(), rows.column(&by_file));
    }
    let causes = causes(tool, &rows, folder, declared)?;
    Ok(rows.re_expressions(&truth, &causes))
}

/// What each declared cause, as fitted, does at the rows; for instruments the columns of the effect.
fn causes(
    tool: &Tool,
    rows: &Rows,
    folder: &Path,
    declared: &[String],
) -> Result<BTreeMap<String, Vec<Column>>, Failure> {
    let path = folder.join("gap").join("addition.toml");
    let addition: toml::Table =
        read(&path, InputKind::Description)?.parse().map_err(|e| Failure::in_file(EX_SOFTWARE, &path, e))?;
    let effects = addition.get("effect").and_then(toml::Value::as_array).cloned().unwrap_or_default();
    let points = rows.points();
    save(&folder.join("gap").join("judge-points.csv"), &points.text)?;
    let mut causes = BTreeMap::new();
    for effect in effects {
        let word = |key: &str| effect.get(key).and_then(toml::Value::as_str).unwrap_or_default();
        let label = crate::blind::cases::label(word("name"), word("subject"));
        if !declared.contains(&label) {
            continue;
        }
        let mut columns = rows.of_instrument(word("name"));
        if columns.is_empty() && word("kind") == "machine" {
            let mut one = addition.clone();
            one.insert("effect".to_owned(), toml::Value::Array(vec![effect.clone()]));
            save(&folder.join("gap").join("judge-addition.toml"), &one.to_string())?;
            let words = "predict --model model.toml --add gap/judge-addition.toml --points gap/judge-points.csv \
                         --out gap/judge-prediction.csv";
            let words: Vec<String> = words.split_whitespace().map(str::to_owned).collect();
            tool.run(folder, &words)?;
            let out = folder.join("gap").join("judge-prediction.csv");
            let text = Text { name: "prediction".to_owned(), text: read(&out, InputKind::Table)? };
            let predicted =
                rows.predicted(&points, &text).map_err(|e| Failure::in_file(EX_SOFTWARE, &out, e))?;
            columns.push(predicted);
        }
        causes.insert(label, columns);
    }
    for name in ["judge-points.csv", "judge-addition.toml", "judge-prediction.csv"] {
        let path = folder.join("gap").join(name);
        if path.exists() {
            super::super::remove(&path).map_err(|e| Failure::in_file(EX_SOFTWARE, &path, e))?;
        }
    }
    Ok(causes)
}
