//! Recordings from the command line: several files of one run, in their order.

use std::path::{Path, PathBuf};

use super::{EX_CONFIG, EX_DATAERR, Failure};
use crate::config::{self, MachineConfig};
use crate::core::model::{Model, ModelSpec};
use crate::core::record::{Item, Meta, Note, Recording};

/// One file.
pub(super) struct RecordingFile {
    pub(super) path: PathBuf,
    pub(super) bytes: Vec<u8>,
}

/// Reads files whole.
pub(super) fn read(paths: &[PathBuf]) -> Result<Vec<RecordingFile>, Failure> {
    let read = |path: &PathBuf| {
        let bytes = std::fs::read(path).map_err(|e| Failure::io(path, &e))?;
        Ok(RecordingFile { path: path.clone(), bytes })
    };
    paths.iter().map(read).collect()
}

/// A file with its blocks found.
pub(super) struct Parsed<'a> {
    pub(super) path: &'a Path,
    pub(super) recording: Recording<'a>,
}

/// Finds the blocks of files of one run and puts them into their order.
pub(super) fn parse(files: &[RecordingFile]) -> Result<Vec<Parsed<'_>>, Failure> {
    let mut parsed = Vec::new();
    for RecordingFile { path, bytes } in files {
        let recording = Recording::parse(bytes)
            .map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {}: {e}", path.display())))?;
        parsed.push(Parsed { path, recording });
    }
    parsed.sort_by_key(|file| file.recording.meta.first_record);
    let runs = parsed.windows(2).find(|w| w[0].recording.meta.run != w[1].recording.meta.run);
    if let Some([a, b]) = runs {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {} and {} are of two runs of the daemon ({} and {}): give the files of one run at a time",
                a.path.display(),
                b.path.display(),
                a.recording.meta.run,
                b.recording.meta.run
            ),
        ));
    }
    Ok(parsed)
}

/// Goes through every item of every file; gives what was noted about the files, each with its name.
pub(super) fn walk(
    files: &[Parsed<'_>],
    mut each: impl FnMut(&Item) -> Result<(), Failure>,
) -> Result<Vec<String>, Failure> {
    let mut expected = 0;
    let mut notes = Vec::new();
    for Parsed { path, recording } in files {
        let mut reader = recording.reader(expected);
        for item in reader.by_ref() {
            each(&item)?;
        }
        expected = reader.next_record();
        let name = |note: &Note| format!("{}: {note}", path.display());
        notes.extend(recording.notes.iter().chain(&reader.notes).map(name));
    }
    Ok(notes)
}

/// The machine file inside a recording.
pub(super) fn machine(path: &Path, recording: &Recording<'_>) -> Result<MachineConfig, Failure> {
    let inside = format!("{} (machine file inside)", path.display());
    let Some((_, text)) = &recording.machine else {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!("error: {inside}: missing or damaged\n  hint: name it with --config"),
        ));
    };
    MachineConfig::parse(&inside, text).map_err(|e| Failure::new(EX_CONFIG, e))
}

/// A model inside a recording.
pub(super) struct Inside {
    pub(super) hash: [u8; 32],
    pub(super) spec: ModelSpec,
    pub(super) model: Model,
}

/// The models inside recordings, each once, in the order of their use.
pub(super) fn models(files: &[Parsed<'_>]) -> Result<Vec<Inside>, Failure> {
    let mut found: Vec<Inside> = Vec::new();
    for Parsed { path, recording } in files {
        let inside = format!("{} (model inside)", path.display());
        for (hash, text) in &recording.models {
            if found.iter().any(|known| known.hash == *hash) {
                continue;
            }
            let spec = config::model::parse(&inside, text).map_err(|e| Failure::new(EX_CONFIG, e))?;
            let model = Model::new(&spec)
                .map_err(|e| Failure::new(EX_CONFIG, format_args!("error: {inside}: {e}")))?;
            found.push(Inside { hash: *hash, spec, model });
        }
    }
    Ok(found)
}

/// The first file's description; there is always one.
pub(super) fn first<'p, 'a>(files: &'p [Parsed<'a>]) -> Result<(&'p Parsed<'a>, &'p Meta), Failure> {
    let first = files.first();
    first
        .map(|file| (file, &file.recording.meta))
        .ok_or_else(|| Failure::new(super::EX_USAGE, "error: no recording was named"))
}
