//! Recordings from the command line: several files of one run, in their order.

use core::fmt;
use std::io::Read;

use crate::prelude::*;
use volcomp_protocol::record::{Item, Meta, Note, Recording, block};
use volcomp_units::MonoTime;

/// A recording with its entries, before they are gone through.
pub(super) struct Parsed {
    pub(super) path: PathBuf,
    pub(super) meta: Meta,
    /// Hash and text of the models, the first one first.
    pub(super) models: Vec<([u8; 32], String)>,
    machine: Option<([u8; 32], String)>,
    pub(super) health: Vec<(i64, String)>,
    /// The content, where it cannot be read again or is the only one.
    bytes: Option<Vec<u8>>,
}

/// Reads the descriptions of files of one run and puts the files into their order. Of several files no more than one is
/// in memory at a time.
pub(super) fn read(paths: &[PathBuf]) -> Result<Vec<Parsed>> {
    let mut parsed = Vec::new();
    for path in paths {
        let bytes = content(path)?;
        let Recording { meta, models, machine, health, .. } = recording(path, &bytes)?;
        let bytes = (paths.len() == 1 || !input::is_regular(path)).then_some(bytes);
        parsed.push(Parsed { path: path.clone(), meta, models, machine, health, bytes });
    }
    parsed.sort_by_key(|file| file.meta.first_record);
    let runs = parsed.windows(2).find(|w| w[0].meta.run != w[1].meta.run);
    if let Some([a, b]) = runs {
        let ([first, second], [x, y]) = ([a, b].map(|file| file.path.display()), [a, b].map(|f| &f.meta.run));
        return Err(failure!(
            EX_DATAERR,
            "{first} and {second} are of two runs of the daemon ({x} and {y}): give the files of one run at a time"
        ));
    }
    Ok(parsed)
}

/// A whole file. One that does not begin like a recording is refused before the rest is read.
fn content(path: &Path) -> Result<Vec<u8>> {
    let mut source = input::open(path, InputKind::Recording)?;
    let mut first = Vec::new();
    (&mut source)
        .take(block::FILE_HEADER as u64)
        .read_to_end(&mut first)
        .map_err(|e| Failure::io(path, &e))?;
    block::check_file_header(&first).map_err(|e| Failure::data(path, e))?;
    input::read_rest(path, source, first)
}

fn recording<'a>(path: &Path, bytes: &'a [u8]) -> Result<Recording<'a>> {
    Recording::parse(bytes).map_err(|e| Failure::data(path, e))
}

/// Entries that a run had and the files have not.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Missing {
    /// The file that should hold them or that follows them.
    pub(super) file: String,
    /// How many, where that is known.
    pub(super) records: Option<u64>,
    /// Number of the next entry; `None` at the end of the last file.
    #[serde(rename = "before_record")]
    pub(super) before: Option<u64>,
    /// Time of the last entry before and of the first one after them, s since the first entry of the files.
    pub(super) from_s: Option<f64>,
    /// See `from_s`.
    pub(super) to_s: Option<f64>,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let records = match self.records {
            Some(1) => "1 record".to_owned(),
            Some(records) => format!("{records} records"),
            None => "an unknown number of records".to_owned(),
        };
        let place = self.before.map_or("at the end".to_owned(), |before| format!("before record {before}"));
        let times = match (self.from_s, self.to_s) {
            (Some(from), Some(to)) => format!(", from {from:.3} s to {to:.3} s"),
            (Some(from), None) => format!(", from {from:.3} s on"),
            (None, Some(to)) => format!(", up to {to:.3} s"),
            (None, None) => String::new(),
        };
        write!(f, "{records} {place} of {}{times}", self.file)
    }
}

/// What was found beside the entries.
#[derive(Debug, Clone, Default)]
pub(super) struct Walked {
    /// Damage and oddities, each with the name of its file.
    pub(super) notes: Vec<String>,
    /// What is not there.
    pub(super) missing: Vec<Missing>,
    /// Damaged places: blocks and bytes that could not be read.
    pub(super) damaged: usize,
}

/// Where a walk through the entries is.
#[derive(Debug, Default)]
struct Clock {
    first: Option<MonoTime>,
    last: Option<MonoTime>,
}

impl Clock {
    fn s(&self, time: Option<MonoTime>) -> Option<f64> {
        Some(time?.seconds_since(self.first?))
    }

    fn is(&mut self, now: MonoTime) {
        self.first.get_or_insert(now);
        self.last = Some(now);
    }
}

/// Goes through every item of every file; gives what was noted about the files.
pub(super) fn walk(files: &mut [Parsed], mut each: impl FnMut(&Item) -> Result<()>) -> Result<Walked> {
    let (mut found, mut clock) = (Walked::default(), Clock::default());
    let mut expected = 0;
    let count = files.len();
    for (k, Parsed { path, bytes, .. }) in files.iter_mut().enumerate() {
        let bytes = bytes.take().map_or_else(|| content(path), Ok)?;
        let recording = recording(path, &bytes)?;
        let file = path.display().to_string();
        let mut reader = recording.reader(expected);
        // the gap whose end is the next entry
        let mut open = None;
        for item in reader.by_ref() {
            match &item {
                Item::Gap { record, dropped, .. } => {
                    open = Some(found.missing.len());
                    found.missing.push(Missing {
                        file: file.clone(),
                        records: Some(*dropped),
                        before: Some(*record),
                        from_s: clock.s(clock.last),
                        to_s: None,
                    });
                }
                Item::Entry { entry, .. } => {
                    clock.is(entry.now());
                    let to_s = clock.s(clock.last);
                    if let Some(missing) = open.take().and_then(|k| found.missing.get_mut(k)) {
                        missing.to_s = to_s;
                    }
                }
                Item::Unknown { .. } => {}
            }
            each(&item)?;
        }
        expected = reader.next_record();
        let notes = || recording.notes.iter().chain(&reader.notes);
        found.notes.extend(notes().map(|note| format!("{file}: {note}")));
        found.damaged += notes().filter(|note| note.is_damage()).count();
        // what is missing between two files shows in front of the second one
        if k + 1 < count {
            continue;
        }
        let ends_at = recording.end(notes());
        if let Err(why) = &ends_at {
            found.notes.push(format!("{file}: {why}"));
        }
        if !matches!(ends_at, Ok(end) if end <= expected) {
            let known = Note::known_end(notes()).max(ends_at.unwrap_or_default());
            found.missing.push(Missing {
                file,
                records: known.checked_sub(expected).filter(|records| *records > 0),
                before: None,
                from_s: clock.s(clock.last),
                to_s: None,
            });
        }
    }
    Ok(found)
}

/// The machine file inside a recording.
pub(super) fn machine(file: &Parsed) -> Result<MachineConfig> {
    let inside = format!("{} (machine file inside)", file.path.display());
    let Some((_, text)) = &file.machine else {
        return Err(data!(inside, "missing or damaged\n  hint: name it with --config"));
    };
    Ok(MachineConfig::parse(&inside, text)?)
}

/// A model inside a recording.
pub(super) struct Inside {
    pub(super) hash: [u8; 32],
    pub(super) spec: ModelSpec,
    pub(super) model: Model,
}

/// The models inside recordings, each once, in the order of their use.
pub(super) fn models(files: &[Parsed]) -> Result<Vec<Inside>> {
    let mut found: Vec<Inside> = Vec::new();
    for Parsed { path, models, .. } in files {
        let inside = format!("{} (model inside)", path.display());
        for (hash, text) in models {
            if found.iter().any(|known| known.hash == *hash) {
                continue;
            }
            let spec = config::model::parse(&inside, text)?;
            let model = Model::new(&spec).map_err(|e| mistake!(inside, "{e}"))?;
            found.push(Inside { hash: *hash, spec, model });
        }
    }
    Ok(found)
}

/// The first file; there is always one.
pub(super) fn first(files: &[Parsed]) -> Result<&Parsed> {
    files.first().ok_or_else(|| usage!("no recording was named"))
}
