//! What was learned, on the disk: `live.json` in the state directory.
//!
//! Replaced as a whole (temporary file, sync, rename). It is put back only where machine, model, components, nodes and
//! numbers are right; the uncertainty grows by the time that passed. What cannot be put back is set aside under a name
//! with the date and reported: a map that is wrong is worse than none.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::super::counters::{replace, set_aside};
use super::super::utc;
use crate::core::live::{KeptGrowth, KeptMap, LiveEstimator};

const FORMAT: &str = "volcomp-live/1";
/// Its name in the state directory.
pub(super) const FILE: &str = "live.json";
/// A state from the future by more than this is of a clock that was wrong, s.
const FUTURE_S: f64 = 3600.0;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Kept {
    format: String,
    machine: String,
    model_hash: String,
    saved: String,
    saved_unix_s: f64,
    maps: Vec<Map>,
    /// Lags of growths by heat.
    #[serde(default)]
    growths: Vec<Growth>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Growth {
    name: String,
    /// Inputs behind their lags, in the order of the model file.
    lagged: Vec<f64>,
    /// Last reading of each input, degC or 1/min.
    last: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Map {
    name: String,
    components: Vec<String>,
    nodes_mm: [Vec<f64>; 3],
    /// Component by component: difference from the offline map and standard deviation; mm or rad.
    values: Vec<(f64, f64)>,
    evidence: f64,
}

fn unix_s(now: SystemTime) -> f64 {
    now.duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

/// Keeps what the estimator has learned.
pub(super) fn save(
    directory: &Path,
    machine: &str,
    model_hash: &str,
    estimator: &LiveEstimator,
    now: SystemTime,
) -> io::Result<()> {
    let map = |m: KeptMap| Map {
        name: m.name,
        components: m.components,
        nodes_mm: m.nodes,
        values: m.values,
        evidence: m.evidence,
    };
    let growth = |g: KeptGrowth| Growth { name: g.name, lagged: g.lagged, last: g.last };
    let kept = Kept {
        format: FORMAT.to_owned(),
        machine: machine.to_owned(),
        model_hash: model_hash.to_owned(),
        saved: utc::text(now),
        saved_unix_s: unix_s(now),
        maps: estimator.kept().into_iter().map(map).collect(),
        growths: estimator.kept_growths().into_iter().map(growth).collect(),
    };
    let mut text = serde_json::to_vec(&kept)?;
    text.push(b'\n');
    replace(&directory.join(FILE), &text)
}

/// Puts back what was kept; gives what should be known about it.
pub(super) fn restore(
    directory: &Path,
    machine: &str,
    model_hash: &str,
    estimator: &mut LiveEstimator,
    now: SystemTime,
) -> Vec<String> {
    let path = directory.join(FILE);
    let text = match fs::read(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return Vec::new(),
        Err(e) => return vec![format!("{}: {e}; maps begin at the offline map", path.display())],
    };
    let aside = |why: &str, word: &str| {
        let kept = match set_aside(&path, word) {
            Ok(aside) => format!("kept as {}", aside.display()),
            Err(e) => format!("and could not be set aside: {e}"),
        };
        vec![format!("VC-8013: {}: {why}; {kept}, maps begin at the offline map", path.display())]
    };
    let kept = match parse(&text, now) {
        Ok(kept) => kept,
        Err(why) => return aside(&why, "damaged"),
    };
    if kept.machine != machine {
        return aside(
            &format!("of machine \"{}\", this one is \"{machine}\"", kept.machine),
            "other-machine",
        );
    }
    if kept.model_hash != model_hash {
        return aside(&format!("learned about another model (blake3 {})", kept.model_hash), "other-model");
    }
    let age_s = unix_s(now) - kept.saved_unix_s;
    let maps: Vec<KeptMap> = kept
        .maps
        .into_iter()
        .map(|m| KeptMap {
            name: m.name,
            components: m.components,
            nodes: m.nodes_mm,
            values: m.values,
            evidence: m.evidence,
        })
        .collect();
    let growths: Vec<KeptGrowth> = kept
        .growths
        .into_iter()
        .map(|g| KeptGrowth { name: g.name, lagged: g.lagged, last: g.last })
        .collect();
    let mut problems = estimator.restore(&maps, age_s.max(0.0));
    problems.extend(estimator.restore_growths(&growths, age_s.max(0.0)));
    if problems.is_empty() {
        return vec![format!("what was learned until {} goes on, {:.1} h older", kept.saved, age_s / 3600.0)];
    }
    aside(&problems.join("; "), "refused")
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
    use std::sync::Arc;

    use super::*;
    use crate::core::live::{LiveModel, LiveSpec, MapSpec};
    use crate::core::model::curve::Live;
    use crate::core::model::{Chain, ErrorFunction, ErrorSymbol, Model, ModelSpec};

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
        assert!(restore(folder.path(), "m", hash, &mut it, now).is_empty(), "nothing there");
        let mut kept = it.kept();
        kept[0].values[2] = (3e-6, 1e-6);
        assert!(it.restore(&kept, 0.0).is_empty());
        save(folder.path(), "m", hash, &it, now).unwrap();
        let mut other = estimator();
        let notes = restore(folder.path(), "m", hash, &mut other, now);
        assert!(notes[0].contains("goes on"), "{notes:?}");
        assert!((other.kept()[0].values[2].0 - 3e-6).abs() < 1e-15);

        let path = folder.path().join(FILE);
        let good = fs::read_to_string(&path).unwrap();
        for (text, machine, model, words) in [
            (good.clone(), "n", hash, "other-machine"),
            (good.clone(), "m", "def", "other-model"),
            (good[..good.len() / 2].to_owned(), "m", hash, "damaged"),
            (good.replace("volcomp-live/1", "volcomp-live/9"), "m", hash, "damaged"),
            (good.replace("3e-6", "3e6"), "m", hash, "refused"),
            (good.replace("\"saved_unix_s\":", "\"saved_unix_s\":9e9,\"x\":"), "m", hash, "damaged"),
        ] {
            fs::write(&path, &text).unwrap();
            let mut fresh = estimator();
            let notes = restore(folder.path(), machine, model, &mut fresh, now);
            assert!(notes[0].contains(words) && !path.exists(), "{words}: {notes:?}");
            assert!(fresh.kept()[0].values.iter().all(|(x, _)| *x == 0.0));
        }
    }
}
