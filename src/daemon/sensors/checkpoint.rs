//! What was learned, on the disk: `live.json` in the state directory.
//!
//! Replaced as a whole (temporary file, sync, rename) by a thread of its own ([`super::map_writer`]), for a disk may be slow
//! or hang. It is put back only where machine, model, components, nodes and numbers are right; the uncertainty grows by the
//! time that passed. What cannot be put back is set aside under a name with the date and reported: a map that is wrong is
//! worse than none.

use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use volcomp_state::bounded_read::read_regular;
use volcomp_state::disk::{RealDisk, set_aside};
use volcomp_state::utc;

use super::Note;
use volcomp_engine::fault::Code;
use volcomp_estimate::live::{LiveEstimator, SavedMap, SavedThermalState};

const FORMAT: &str = "volcomp-live/1";
/// Its name in the state directory.
pub(super) const FILE: &str = "live.json";
/// Largest file, bytes.
const BYTES_MAX: u64 = 64 << 20;
/// A state from the future by more than this is of a clock that was wrong, s.
const FUTURE_S: f64 = 3600.0;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Kept {
    format: String,
    machine: String,
    model_hash: String,
    saved: String,
    saved_unix_s: f64,
    maps: Vec<SavedMap>,
    /// Lags of thermal displacements.
    #[serde(default)]
    growths: Vec<SavedThermalState>,
}

fn unix_s(now: SystemTime) -> f64 {
    now.duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

/// What the estimator has learned, as it is kept.
pub(super) fn text(
    machine: &str,
    model_hash: &str,
    estimator: &LiveEstimator,
    now: SystemTime,
) -> io::Result<Vec<u8>> {
    let kept = Kept {
        format: FORMAT.to_owned(),
        machine: machine.to_owned(),
        model_hash: model_hash.to_owned(),
        saved: utc::text(now),
        saved_unix_s: unix_s(now),
        maps: estimator.kept(),
        growths: estimator.saved_thermal(),
    };
    let mut text = serde_json::to_vec(&kept)?;
    text.push(b'\n');
    Ok(text)
}

/// Puts back what was kept; gives what should be known about it. `is_behind`: the disk has not taken what was learned, or
/// ordered forgotten, since.
pub(super) fn restore(
    directory: &Path,
    (machine, model_hash): (&str, &str),
    estimator: &mut LiveEstimator,
    now: SystemTime,
    is_behind: bool,
) -> Option<Note> {
    let path = directory.join(FILE);
    let text = match read_regular(&path, BYTES_MAX) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return None,
        Err(e) => {
            return Some(Note::plain(format!("{}: {e}; maps begin at the offline map", path.display())));
        }
    };
    let restored = if is_behind {
        Err(("the disk has not taken what came after it".to_owned(), "behind"))
    } else {
        restore_text(&text, machine, model_hash, estimator, now)
    };
    Some(match restored {
        Ok(note) => Note::plain(note),
        Err((why, word)) => {
            let kept = match set_aside(&RealDisk, &path, word) {
                Ok(aside) => format!("kept as {}", aside.display()),
                Err(e) => format!("and could not be set aside: {e}"),
            };
            let text = format!("{}: {why}; {kept}, maps begin at the offline map", path.display());
            Note::numbered(Code::LEARNED_STATE_REFUSED, text)
        }
    })
}

/// Puts a kept text back into the estimator; gives a note, or why not and a word for it.
pub(super) fn restore_text(
    text: &[u8],
    machine: &str,
    model_hash: &str,
    estimator: &mut LiveEstimator,
    now: SystemTime,
) -> Result<String, (String, &'static str)> {
    let kept = parse(text, now).map_err(|why| (why, "damaged"))?;
    if kept.machine != machine {
        let why = format!("of machine \"{}\", this one is \"{machine}\"", kept.machine);
        return Err((why, "other-machine"));
    }
    if kept.model_hash != model_hash {
        return Err((format!("learned about another model (blake3 {})", kept.model_hash), "other-model"));
    }
    let age_s = unix_s(now) - kept.saved_unix_s;
    let mut problems = estimator.restore(&kept.maps, age_s.max(0.0));
    problems.extend(estimator.restore_thermal(&kept.growths, age_s.max(0.0)));
    if problems.is_empty() {
        return Ok(format!("the map saved at {} continues, {:.1} h older", kept.saved, age_s / 3600.0));
    }
    Err((problems.join("; "), "refused"))
}

fn parse(text: &[u8], now: SystemTime) -> Result<Kept, String> {
    let kept: Kept = serde_json::from_slice(text).map_err(|e| e.to_string())?;
    if kept.format != FORMAT {
        return Err(format!("format is \"{}\", not \"{FORMAT}\"", kept.format));
    }
    if !kept.saved_unix_s.is_finite() || kept.saved_unix_s > unix_s(now) + FUTURE_S {
        return Err(format!("saved at {}, which is still to come", kept.saved));
    }
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::Arc;
    use std::time::Duration;

    use super::super::map_writer::Writer;
    use super::*;
    use volcomp_estimate::live::{LiveModel, LiveSpec, MapSpec};
    use volcomp_model::curve::Live;
    use volcomp_model::{Chain, ErrorFunction, ErrorSymbol, Model, ModelSpec};

    fn estimator() -> LiveEstimator {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
        let live = vec![Live { sensor: "ram.eaz".to_owned(), limit: 1e-4, reference: None }];
        let function = ErrorFunction { live, ..ErrorFunction::default() };
        spec.errors.push((ErrorSymbol::parse("eaz").unwrap(), function));
        let nodes = [vec![0.0, 1.0], vec![0.0, 1.0], vec![0.0, 1.0]];
        let live = LiveSpec { sensors: Vec::new(), maps: vec![MapSpec::new("ram", nodes)] };
        let model = Arc::new(Model::new(&spec).unwrap());
        LiveEstimator::new(&live, LiveModel { spec: &spec, thermal: &[], model, hash: [3; 32] }).unwrap()
    }

    #[test]
    fn what_was_kept_comes_back_and_anything_else_is_set_aside_and_told() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::now();
        let hash = "abc";
        let mut it = estimator();
        assert_eq!(restore(folder.path(), ("m", hash), &mut it, now, false), None, "nothing there");
        let mut kept = it.kept();
        kept[0].values[2] = (3e-6, 1e-6);
        assert!(it.restore(&kept, 0.0).is_empty());
        let writer = Writer::start(folder.path()).unwrap();
        writer.write(text("m", hash, &it, now).unwrap());
        assert!(writer.wait(Duration::from_secs(10)));
        assert_eq!(writer.problem(), None);
        writer.finish(Some(text("m", hash, &it, now).unwrap()));
        let mut other = estimator();
        let note = restore(folder.path(), ("m", hash), &mut other, now, false).unwrap();
        assert!(note.code.is_none() && note.text.contains("continues"), "{note}");
        assert!((other.kept()[0].values[2].0 - 3e-6).abs() < 1e-15);

        let path = folder.path().join(FILE);
        let good = fs::read_to_string(&path).unwrap();
        // a map that was forgotten since must not come back with a change of the model
        let mut fresh = estimator();
        let note = restore(folder.path(), ("m", hash), &mut fresh, now, true).unwrap();
        assert!(note.text.contains("behind") && !path.exists(), "{note}");
        assert!(fresh.kept()[0].values.iter().all(|(x, _)| *x == 0.0));
        // files of earlier versions have these keys
        let keys = ["maps", "growths", "name", "components", "nodes_mm", "values", "evidence"];
        assert!(keys.iter().all(|key| good.contains(&format!("\"{key}\":"))), "{good}");
        for (kept, machine, model, words) in [
            (good.clone(), "n", hash, "other-machine"),
            (good.clone(), "m", "def", "other-model"),
            (good[..good.len() / 2].to_owned(), "m", hash, "damaged"),
            (good.replace("volcomp-live/1", "volcomp-live/9"), "m", hash, "damaged"),
            (good.replace("3e-6", "3e6"), "m", hash, "refused"),
            (good.replace("\"saved_unix_s\":", "\"saved_unix_s\":9e9,\"x\":"), "m", hash, "damaged"),
        ] {
            fs::write(&path, &kept).unwrap();
            let mut fresh = estimator();
            let note = restore(folder.path(), (machine, model), &mut fresh, now, false).unwrap();
            assert!(note.text.contains(words) && !path.exists(), "{words}: {note}");
            assert!(fresh.kept()[0].values.iter().all(|(x, _)| *x == 0.0));
        }
    }

    #[test]
    fn a_file_cut_at_any_byte_or_without_its_data_teaches_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::now();
        let mut it = estimator();
        let mut kept = it.kept();
        kept[0].values[2] = (3e-6, 1e-6);
        assert!(it.restore(&kept, 0.0).is_empty());
        let good = text("m", "abc", &it, now).unwrap();
        let path = folder.path().join(FILE);
        let cuts = (0..good.len()).map(|k| good[..k].to_vec());
        let lost = [vec![0; good.len()], vec![0; 4096]];
        for (k, bytes) in cuts.chain(lost).enumerate() {
            fs::write(&path, &bytes).unwrap();
            // what a write that was cut off leaves beside it
            fs::write(folder.path().join("live.json.tmp"), &good).unwrap();
            let mut fresh = estimator();
            let note = restore(folder.path(), ("m", "abc"), &mut fresh, now, false).unwrap();
            if bytes.len() + 1 == good.len() && k + 1 == good.len() {
                // without its line feed it is whole
                assert!(note.text.contains("continues"), "{note}");
                continue;
            }
            assert!(note.to_string().starts_with("VC-8013: "), "{k}: {note}");
            assert!(fresh.kept()[0].values.iter().all(|(x, _)| *x == 0.0), "{k}");
        }
    }
}
