//! A case of the reference vectors: one JSON object with inputs in mm and rad; `expect` and `truth` are ignored. It
//! stands in a file of its own or, by its id, in a file of cases.

use serde::de::DeserializeOwned;
use volcomp_formats::text::NUMBER_LIMIT;

use crate::identify::prelude::*;

/// Where a case comes from and how the result is printed, the same for every method.
#[derive(Debug, clap::Args)]
pub(super) struct CaseArgs {
    /// One case of the reference vectors (JSON, mm and rad), or a file of cases with --case; - is stdin.
    #[arg(long, value_name = "FILE")]
    input: Option<PathBuf>,
    /// The file of --data.
    #[arg(value_name = "FILE", conflicts_with_all = ["data", "input"])]
    file: Option<PathBuf>,
    /// Which case of a file with several.
    #[arg(long, value_name = "ID", requires = "input")]
    case: Option<String>,
    /// Print one JSON object instead of a report.
    #[arg(long)]
    pub(super) json: bool,
}

impl CaseArgs {
    /// The file of data, by `--data` or as the positional argument.
    pub(super) fn data<'a>(&'a self, named: &'a Option<PathBuf>) -> Option<&'a PathBuf> {
        named.as_ref().or(self.file.as_ref())
    }

    /// The same where the parser asks for it or for a case.
    pub(super) fn required<'a>(&'a self, named: &'a Option<PathBuf>) -> Result<&'a Path> {
        self.data(named).map(PathBuf::as_path).ok_or_else(|| usage!("give --data or --input"))
    }

    /// The files of data, by `--data` or as the positional argument.
    pub(super) fn all<'a>(&'a self, named: &'a [PathBuf]) -> &'a [PathBuf] {
        if named.is_empty() { self.file.as_slice() } else { named }
    }

    /// The options of a method that writes a model from data only.
    pub(super) fn front<'a>(&'a self, model: impl Into<Option<&'a ModelWriter>>) -> Front<'a> {
        let file = self.input.as_deref().map(|path| CaseFile { path, id: self.case.as_deref() });
        Front { file, json: self.json, model: model.into(), writes_more: false, case_writes: false }
    }
}

/// A file with a case in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct CaseFile<'a> {
    pub(super) path: &'a Path,
    id: Option<&'a str>,
}

impl<'a> CaseFile<'a> {
    /// A message about the case.
    pub(super) fn bad(&self, what: impl core::fmt::Display) -> Failure {
        match self.id {
            Some(id) => data!(self.path, "{id}: {what}"),
            None => data!(self.path, "{what}"),
        }
    }

    /// Refuses files to write: a case is numbers alone, without axis, chain or frame.
    pub(super) fn writes_no_model(&self, wanted: bool) -> Result<()> {
        if wanted {
            return Err(usage!("--input computes and prints; files to write go with instrument data"));
        }
        Ok(())
    }

    /// Reads the case; of a file with several, the one that was named.
    pub(super) fn read<T: DeserializeOwned>(&self) -> Result<T> {
        let text = input::read_text(self.path, InputKind::Case)?;
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        let mut file: Value = serde_json::from_str(text).map_err(|e| self.at(&e))?;
        let Some(Value::Array(cases)) = file.get_mut("cases").map(Value::take) else {
            return match self.id {
                Some(id) if file["id"] != id => Err(self.missing(core::slice::from_ref(&file))),
                // once more from the text: then a message has a place
                _ => self.bounded(&file).and_then(|()| serde_json::from_str(text).map_err(|e| self.at(&e))),
            };
        };
        let Some(id) = self.id else {
            let (path, count, ids) = (self.path.display(), cases.len(), ids(&cases));
            if !cases.is_empty() && cases.iter().all(|c| c["id"].is_null()) {
                return Err(self.bad(format_args!(
                    "holds {count} cases and none has an id; give each an id for --case, or a file of its own"
                )));
            }
            return Err(usage!("{path}: holds {count} cases; choose one with --case: {ids}"));
        };
        match cases.iter().position(|c| c["id"] == id) {
            Some(i) => {
                self.bounded(&cases[i])?;
                T::deserialize(&cases[i]).map_err(|e| self.bad(e))
            }
            None => Err(self.missing(&cases)),
        }
    }

    /// Refuses inputs with numbers that text files may not hold either.
    fn bounded(&self, case: &Value) -> Result<()> {
        let inputs = case.as_object().into_iter().flatten();
        let mut inputs = inputs.filter(|(key, _)| !IGNORED.contains(&key.as_str()));
        let found = inputs.find_map(|(key, value)| Some((key, beyond(value)?)));
        found.map_or(Ok(()), |(key, value)| {
            Err(self.bad(format_args!(
                "{key}: {value:e} is beyond {NUMBER_LIMIT:e}; no length, angle or reading is, leave it out"
            )))
        })
    }

    fn missing(&self, cases: &[Value]) -> Failure {
        data!(self.path, "no case {}; there are: {}", self.id.unwrap_or_default(), ids(cases))
    }

    /// A message about a place in the file.
    fn at(&self, what: &serde_json::Error) -> Failure {
        let text = what.to_string();
        // the place stands in front already
        let text = text.rsplit_once(" at line ").map_or(text.as_str(), |(text, _)| text);
        let (path, line, column) = (self.path.display(), what.line(), what.column());
        failure!(
            EX_DATAERR,
            "{path}:{line}:{column}: {text}; a case is one JSON object with finite numbers in mm and rad, its keys stand in --help"
        )
    }
}

/// Keys of a case that are no inputs.
const IGNORED: [&str; 2] = ["expect", "truth"];

/// A number in a case that is beyond what text files may hold.
fn beyond(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64().filter(|v| v.abs() > NUMBER_LIMIT),
        Value::Array(values) => values.iter().find_map(beyond),
        Value::Object(keys) => keys.values().find_map(beyond),
        _ => None,
    }
}

fn ids(cases: &[Value]) -> String {
    let ids: Vec<&str> = cases.iter().filter_map(|c| c["id"].as_str()).collect();
    if ids.is_empty() { "none that has an id".to_owned() } else { ids.join(", ") }
}

/// What a case cannot determine is a result, too: `more` says how much of it is known.
pub(super) fn refused(mut more: Value, why: impl core::fmt::Display) -> Box<dyn Found> {
    more["refused"] = true.into();
    more["note"] = why.to_string().into();
    printed(more, || {})
}

/// The rows of a covariance of six error motions.
pub(super) fn rows(entry: impl Fn((usize, usize)) -> f64) -> [[f64; 6]; 6] {
    core::array::from_fn(|i| core::array::from_fn(|j| entry((i, j))))
}
