//! The committed files: recordings as volcompd writes them, and what a reviewer reads of them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use volcomp_model::Model;
use volcomp_protocol::record::{
    Answer, BlockKind, EXTENSION, Encoder, Entry, IndexRow, Item, Meta, Recording, block, meta, reader,
};
use volcomp_units::axes::{AxisKind, AxisName};
use volcomp_units::um_from_mm;

use crate::catalogue::{CATALOGUE, Simulated, simulate};
use crate::machine::{Machine, hash_of, model_of};

/// Entries of one block.
const BLOCK_ENTRIES: usize = 4096;
/// Cycles from one row of a table to the next.
const TABLE_CYCLES: usize = 50;
/// Seconds of arc in a degree.
const ARCSEC_PER_DEG: f64 = 3600.0;

/// A committed recording.
#[derive(Debug)]
pub(crate) struct Committed {
    pub(crate) machine: Machine,
    pub(crate) models: BTreeMap<[u8; 32], Arc<Model>>,
    pub(crate) entries: Vec<Entry>,
}

pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/recordings")
}

/// Reads a recording; a damaged or incomplete one is refused.
pub(crate) fn read(name: &str) -> Committed {
    let path = folder().join(name).with_extension(EXTENSION);
    let bytes = fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let found = Recording::parse(&bytes).expect("a recording");
    assert!(found.closed && found.notes.is_empty(), "{name}: {:?}", found.notes);
    let (_, config_text) = found.machine.clone().expect("a machine file");
    let models = found.models.iter().map(|(hash, text)| (*hash, model_of(text))).collect();
    let machine = Machine::parse(config_text, found.models.first().expect("a model").1.clone());
    let mut reader = found.reader(0);
    let entries = reader.by_ref().map(|item| match item {
        Item::Entry { entry, .. } => entry,
        other => panic!("{name}: {other:?}"),
    });
    let entries = entries.collect();
    assert!(reader.notes.is_empty(), "{name}: {:?}", reader.notes);
    Committed { machine, models, entries }
}

/// A recording with one file, as volcompd would have written it.
fn bytes_of(name: &str, simulated: &Simulated) -> Vec<u8> {
    let (config_hash, model_hash) =
        (hash_of(&simulated.machine.config_text), hash_of(&simulated.machine.model_text));
    let hex = |hash: [u8; 32]| blake3::Hash::from(hash).to_hex().to_string();
    let meta = Meta {
        format: meta::FORMAT.to_owned(),
        software: "change indicator".to_owned(),
        machine: simulated.machine.config.machine.clone(),
        config: "machine.toml".to_owned(),
        config_hash: hex(config_hash),
        model: "model.toml".to_owned(),
        model_hash: hex(model_hash),
        begun: "1970-01-01T00:00:00Z".to_owned(),
        run: name.to_owned(),
        ..Meta::default()
    };
    let text = meta.to_text().expect("TOML");
    let mut out = block::file_header().to_vec();
    let other = |out: &mut Vec<u8>, kind, content: &[u8]| {
        out.extend(block::seal(kind, 0, 0, 0, content).expect("a short text"));
    };
    other(&mut out, BlockKind::Meta, text.as_bytes());
    other(&mut out, BlockKind::Model, &reader::hashed(&model_hash, &simulated.machine.model_text));
    other(&mut out, BlockKind::Machine, &reader::hashed(&config_hash, &simulated.machine.config_text));
    for text in &simulated.more_models {
        other(&mut out, BlockKind::Model, &reader::hashed(&hash_of(text), text));
    }
    let (mut encoder, mut rows) = (Encoder::new(), Vec::new());
    for part in simulated.entries.chunks(BLOCK_ENTRIES) {
        part.iter().for_each(|entry| encoder.push(entry));
        let (first_record, first_ns, records) = encoder.pending();
        rows.push(IndexRow { at: out.len() as u64, first_record, first_ns, records });
        out.extend(encoder.seal().expect("entries"));
    }
    let at = out.len() as u64;
    out.extend(block::index(&rows, at).expect("a short index"));
    out
}

/// Every answer in its order, with the number of its entry and the control's time, s; that of deadlines is not known.
fn answers(entries: &[Entry]) -> impl Iterator<Item = (usize, Option<f64>, Answer)> + '_ {
    entries.iter().enumerate().filter_map(|(record, entry)| match entry {
        Entry::Cycle(cycle) => Some((record, Some(cycle.frame.control_ns as f64 * 1e-9), cycle.answer?)),
        Entry::Deadline { answer, .. } => Some((record, None, (*answer)?)),
        _ => None,
    })
}

/// A value of an axis as it is read, um or arcsec.
pub(crate) fn shown(axis: AxisName, value: f64) -> f64 {
    match axis.kind() {
        AxisKind::Linear => um_from_mm(value),
        AxisKind::Rotary => value * ARCSEC_PER_DEG,
    }
}

/// The unit of [`shown`].
pub(crate) const fn unit(axis: AxisName) -> &'static str {
    match axis.kind() {
        AxisKind::Linear => "µm",
        AxisKind::Rotary => "arcsec",
    }
}

/// The offsets of every 50th cycle and of every change of state, to 1e-9 um and 1e-9 arcsec.
fn table_of(machine: &Machine, entries: &[Entry]) -> String {
    let axes: Vec<AxisName> = machine.axis_names().collect();
    let mut text = String::from("record,time_s,state,cause,lag_cycles,limited");
    for axis in &axes {
        let suffix = if axis.kind() == AxisKind::Linear { "um" } else { "arcsec" };
        let _ = write!(text, ",offset_{}_{suffix}", axis.letter().to_ascii_lowercase());
    }
    text.push('\n');
    for (k, (record, time_s, answer)) in answers(entries).enumerate() {
        if !k.is_multiple_of(TABLE_CYCLES) && answer.change.is_none() {
            continue;
        }
        let time = time_s.map(|time_s| format!("{time_s:.4}")).unwrap_or_default();
        let cause = answer.change.map(|change| change.cause.to_string()).unwrap_or_default();
        let Answer { state, lag_cycles, limited, offset, .. } = answer;
        let _ = write!(text, "{record},{time},{state:?},{cause},{lag_cycles},{limited}");
        for (axis, offset) in axes.iter().zip(offset) {
            // no minus zero
            let _ = write!(text, ",{:.9}", shown(*axis, offset) + 0.0);
        }
        text.push('\n');
    }
    text
}

/// One row for each recording: BLAKE3 over the exact bits of all offsets, and over those of all commanded positions.
fn digest_of(name: &str, entries: &[Entry]) -> String {
    let (mut offsets, mut commanded) = (blake3::Hasher::new(), blake3::Hasher::new());
    let add = |hasher: &mut blake3::Hasher, value: f64| {
        hasher.update(&value.to_bits().to_le_bytes());
    };
    let (mut cycles, mut count) = (0_u32, 0_u32);
    for entry in entries {
        if let Entry::Cycle(cycle) = entry {
            cycles += 1;
            cycle.frame.commanded.iter().for_each(|v| add(&mut commanded, *v));
        }
    }
    for (record, _, answer) in answers(entries) {
        count += 1;
        offsets.update(&(record as u64).to_le_bytes());
        answer.offset.iter().for_each(|v| add(&mut offsets, *v));
    }
    format!("{name},{cycles},{count},{},{}\n", offsets.finalize().to_hex(), commanded.finalize().to_hex())
}

const DIGEST_HEAD: &str = "recording,cycles,answers,offsets_blake3,commanded_blake3\n";

/// What stands beside the recordings: file names and contents.
pub(crate) fn tables() -> Vec<(PathBuf, String)> {
    let mut digests = DIGEST_HEAD.to_owned();
    let mut tables = Vec::new();
    for (name, _) in CATALOGUE {
        let committed = read(name);
        digests.push_str(&digest_of(name, &committed.entries));
        let path = folder().join(name).with_extension("csv");
        tables.push((path, table_of(&committed.machine, &committed.entries)));
    }
    tables.push((folder().join("digests.csv"), digests));
    tables
}

/// Makes all recordings and tables anew.
pub(crate) fn update() {
    fs::create_dir_all(folder()).expect("tests/recordings");
    for (name, _) in CATALOGUE {
        let path = folder().join(name).with_extension(EXTENSION);
        fs::write(path, bytes_of(name, &simulate(name))).expect("written");
    }
    for (path, text) in tables() {
        fs::write(path, text).expect("written");
    }
}
