//! Readings that are there more than once: copies look like repeats without noise, so they count once.

use std::collections::{BTreeMap, BTreeSet};

use super::super::moment::{Axis, Moment};
use super::{Note, Raw, Reading, Session, SessionError};

/// Share of the readings that must repeat the one before them to be taken for copies.
const COPIED_SHARE: f64 = 0.2;
/// Chance that two readings agree by rounding alone, above which equal values are no sign of a copy.
const CHANCE: f64 = 0.01;

/// Time, reading, direction and place of a row, as they stand in its file.
fn key(raw: &Raw, i: usize) -> Option<Vec<u64>> {
    let deviation = raw.column("deviation_um").map(|c| c[i]).filter(|d| d.is_finite())?;
    let names = ["t_s", "u_x", "u_y", "u_z"].map(str::to_owned).into_iter();
    let columns = names.chain(Axis::ALL.iter().map(|a| a.column()));
    let state = columns.filter_map(|n| raw.column(&n).map(|c| c[i].to_bits()));
    Some([deviation.to_bits()].into_iter().chain(state).collect())
}

/// Refuses a file whose readings all stand in another one.
pub(super) fn no_file_twice(raws: &[Raw]) -> Result<(), SessionError> {
    if raws.len() < 2 {
        return Ok(());
    }
    let keys: Vec<BTreeSet<Vec<u64>>> =
        raws.iter().map(|r| (0..r.len()).filter_map(|i| key(r, i)).collect()).collect();
    for (a, own) in keys.iter().enumerate() {
        for (b, other) in keys.iter().enumerate() {
            // of two equal files the second is the one too many
            let within = a != b && !own.is_empty() && own.is_subset(other);
            if within && (own.len() < other.len() || a > b) {
                return Err(SessionError::Twice {
                    file: raws[a].file.clone(),
                    other: raws[b].file.clone(),
                    rows: own.len(),
                });
            }
        }
    }
    Ok(())
}

/// True where a reading repeats the one before it in all but the time.
fn repeats(before: (&Reading, &Moment), now: (&Reading, &Moment)) -> bool {
    let ((r, m), (s, n)) = (before, now);
    (r.instrument, r.setup, r.run, r.repeat) == (s.instrument, s.setup, s.run, s.repeat)
        && r.deviation_um.to_bits() == s.deviation_um.to_bits()
        && m.position.map(f64::to_bits) == n.position.map(f64::to_bits)
        && m.u == n.u
}

impl Session {
    /// Rows that are there twice count once; so do readings that repeat the one before them too often for chance.
    pub(super) fn drop_copies(&mut self) {
        let mut seen = BTreeSet::new();
        let mut keep = Vec::with_capacity(self.readings.len());
        for (r, m) in self.readings.iter().zip(&self.moments) {
            let [x, y, z, ..] = m.position;
            let key = [m.t_s, r.deviation_um, m.u.x, m.u.y, m.u.z, x, y, z];
            keep.push(seen.insert((m.file, r.setup, r.run, r.repeat, key.map(f64::to_bits))));
        }
        let twice = keep.iter().filter(|k| !**k).count();
        if twice > 0 {
            self.retain(&keep);
            self.notes.push(Note::new(match twice {
                1 => "1 row was there twice and counts once".to_owned(),
                _ => format!("{twice} rows were there twice and count once"),
            }));
        }
        self.drop_echoes();
    }

    fn drop_echoes(&mut self) {
        let rows = || self.readings.iter().zip(&self.moments);
        let keep: Vec<bool> =
            [true].into_iter().chain(rows().zip(rows().skip(1)).map(|(a, b)| !repeats(a, b))).collect();
        let echoes = keep.iter().filter(|k| !**k).count();
        if (echoes as f64) < COPIED_SHARE * self.readings.len() as f64 {
            return;
        }
        let mut values: BTreeMap<u64, usize> = BTreeMap::new();
        for (r, _) in self.readings.iter().zip(&keep).filter(|(_, k)| **k) {
            *values.entry(r.deviation_um.to_bits()).or_default() += 1;
        }
        let left = (self.readings.len() - echoes) as f64;
        let equal: f64 = values.values().map(|n| (*n * (*n - 1)) as f64).sum();
        if equal > CHANCE * left * (left - 1.0) {
            return;
        }
        self.retain(&keep);
        self.notes.push(Note::new(format!(
            "{echoes} readings repeat the one before them in all but the time and count once: copies say nothing of the noise"
        )));
    }
}
