//! Counters that survive a restart: how long, how late, how often, how far.
//!
//! Kept in `counters.json` of the state directory, replaced as a whole (temporary file, sync, rename) every few
//! seconds by the [`super::keeper`], never by the cycle. A file that is damaged, or of another machine, is set aside
//! under a name with the date, reported, and counting begins anew: numbers that are wrong are worse than none.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::ports::CycleRecord;
use super::status::Lifetime;
use super::utc;
use crate::core::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};
use crate::core::fault::Code;
use crate::core::units::{arcsec_from_rad, um_from_mm};

/// The `format` of the file.
const FORMAT: &str = "volcomp-counters/1";
/// Its name in the state directory.
const FILE: &str = "counters.json";

/// The file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Counters {
    format: String,
    machine: String,
    since: String,
    saved: String,
    starts: u64,
    cycles: u64,
    late_cycles: u64,
    enables: u64,
    faults: BTreeMap<String, u64>,
    limited_s: BTreeMap<String, f64>,
    largest_um: BTreeMap<String, f64>,
    largest_arcsec: BTreeMap<String, f64>,
    #[serde(default)]
    last_word: LastWord,
}

/// What a restart must not undo.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct LastWord {
    /// Somebody has switched compensation off.
    pub(super) off: bool,
    /// A fault that nobody has cleared, by its number.
    pub(super) fault: Option<String>,
    /// The gain that was ordered.
    pub(super) gain: Option<f64>,
}

impl LastWord {
    /// Why compensation does not begin by itself, where it does not.
    pub(super) fn objection(&self) -> Option<String> {
        match (&self.fault, self.off) {
            (Some(code), _) => Some(format!("fault {code} was latched before the restart and not cleared")),
            (None, true) => Some("compensation was switched off before the restart".to_owned()),
            (None, false) => None,
        }
    }
}

impl Counters {
    fn new(machine: &str) -> Self {
        let since = utc::text(SystemTime::now());
        Self { format: FORMAT.to_owned(), machine: machine.to_owned(), since, ..Self::default() }
    }

    /// From the file's text, where every number can be one.
    fn parse(text: &[u8], machine: &str) -> Result<Self, String> {
        let found: Self = serde_json::from_slice(text).map_err(|e| e.to_string())?;
        if found.format != FORMAT {
            return Err(format!("format is \"{}\", not \"{FORMAT}\"", found.format));
        }
        if found.machine != machine {
            return Err(format!("of machine \"{}\", this one is \"{machine}\"", found.machine));
        }
        let mut numbers =
            found.limited_s.values().chain(found.largest_um.values()).chain(found.largest_arcsec.values());
        if numbers.any(|v| !(v.is_finite() && *v >= 0.0)) {
            return Err("a time or an offset below zero".to_owned());
        }
        if found.last_word.gain.is_some_and(|g| !(0.0..=1.0).contains(&g)) {
            return Err("a gain that is not from 0 to 1".to_owned());
        }
        Ok(found)
    }

    /// Replaces the file as a whole.
    pub(super) fn save(&self, directory: &Path) -> io::Result<()> {
        let saved = Self { saved: utc::text(SystemTime::now()), ..self.clone() };
        let mut text = serde_json::to_vec_pretty(&saved)?;
        text.push(b'\n');
        replace(&directory.join(FILE), &text)
    }
}

/// Puts `bytes` in place of a file, so that after a power loss either the old or the new content is there.
pub(super) fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".tmp");
    let temporary = path.with_file_name(name);
    let mut file = File::create(&temporary)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(&temporary, path)?;
    match path.parent().filter(|p| !p.as_os_str().is_empty()) {
        Some(folder) => File::open(folder)?.sync_all(),
        None => Ok(()),
    }
}

/// Sets a file aside under a name that says why and when; gives that name.
pub(super) fn set_aside(path: &Path, why: &str) -> io::Result<PathBuf> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{why}-{}", utc::stamp(SystemTime::now())));
    let mut aside = path.with_file_name(&name);
    let mut k = 1;
    while aside.exists() {
        let mut other = name.clone();
        other.push(format!("-{k}"));
        aside = path.with_file_name(other);
        k += 1;
    }
    fs::rename(path, &aside)?;
    Ok(aside)
}

/// Counts for the status and the file.
#[derive(Debug)]
pub(super) struct Tally {
    /// What was there before this daemon, and the rare things since.
    base: Counters,
    file: Option<String>,
    note: Option<String>,
    axes: Vec<AxisName>,
    limited_cycles: [u64; MAX_AXES],
    largest: AxisArray,
    cycle_s: f64,
}

impl Tally {
    /// Counts on from the file in `directory`, where there is one.
    pub(super) fn open(directory: Option<&Path>, machine: &str, cycle_s: f64) -> Self {
        let mut note =
            directory.is_none().then(|| "no state directory: counted since the start only".to_owned());
        let mut base = Counters::new(machine);
        let path = directory.map(|d| d.join(FILE));
        if let Some(path) = &path {
            match fs::read(path) {
                Ok(text) => match Counters::parse(&text, machine) {
                    Ok(found) => base = found,
                    Err(why) => {
                        let kept = match set_aside(path, "damaged") {
                            Ok(aside) => format!("kept as {}", aside.display()),
                            Err(e) => format!("and could not be set aside: {e}"),
                        };
                        let (code, path) = (Code::COUNTERS_DAMAGED, path.display());
                        note = Some(format!("{code}: {path}: {why}; {kept}, counting begins anew"));
                    }
                },
                Err(e) if e.kind() == ErrorKind::NotFound => {}
                Err(e) => note = Some(format!("{}: {e}", path.display())),
            }
        }
        base.starts = base.starts.saturating_add(1);
        let file = path.map(|p| p.display().to_string());
        let (limited_cycles, largest) = ([0; MAX_AXES], [0.0; MAX_AXES]);
        Self { base, file, note, axes: Vec::new(), limited_cycles, largest, cycle_s }
    }

    /// What a restart must not undo.
    pub(super) const fn last_word(&mut self) -> &mut LastWord {
        &mut self.base.last_word
    }

    /// What was wrong with the file.
    pub(super) fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// The axes of the records that follow.
    pub(super) fn set_axes(&mut self, axes: Vec<AxisName>) {
        if axes != self.axes {
            self.settle();
            self.axes = axes;
        }
    }

    pub(super) fn record(&mut self, record: &CycleRecord) {
        for k in 0..self.axes.len().min(MAX_AXES) {
            self.limited_cycles[k] += u64::from(record.limited >> k & 1);
            self.largest[k] = self.largest[k].max(record.offset[k].abs());
        }
    }

    pub(super) fn enabled(&mut self) {
        self.base.enables = self.base.enables.saturating_add(1);
    }

    /// Counts a fault under its number or name.
    pub(super) fn fault(&mut self, name: &str) {
        let count = self.base.faults.entry(name.to_owned()).or_default();
        *count = count.saturating_add(1);
    }

    /// Moves what was counted by wire index to the names of the axes.
    fn settle(&mut self) {
        for (k, axis) in self.axes.iter().enumerate().take(MAX_AXES) {
            let letter = axis.lower().to_string();
            let limited = std::mem::take(&mut self.limited_cycles[k]);
            if limited > 0 {
                *self.base.limited_s.entry(letter.clone()).or_default() += limited as f64 * self.cycle_s;
            }
            let largest = std::mem::take(&mut self.largest[k]);
            let (map, value) = match axis.kind() {
                AxisKind::Linear => (&mut self.base.largest_um, um_from_mm(largest)),
                AxisKind::Rotary => (&mut self.base.largest_arcsec, arcsec_from_rad(largest)),
            };
            let known = map.entry(letter).or_default();
            *known = known.max(value);
        }
    }

    /// Everything counted; `cycles` and `late` are those of this daemon.
    pub(super) fn counters(&mut self, cycles: u64, late: u64) -> Counters {
        self.settle();
        Counters {
            cycles: self.base.cycles.saturating_add(cycles),
            late_cycles: self.base.late_cycles.saturating_add(late),
            ..self.base.clone()
        }
    }

    /// The same for the status.
    pub(super) fn lifetime(&mut self, cycles: u64, late: u64) -> Lifetime {
        let Counters {
            since,
            starts,
            cycles,
            late_cycles,
            enables,
            faults,
            limited_s,
            largest_um,
            largest_arcsec,
            ..
        } = self.counters(cycles, late);
        Lifetime {
            since,
            starts,
            cycles,
            late_cycles,
            enables,
            faults,
            limited_s,
            largest_um,
            largest_arcsec,
            file: self.file.clone(),
            note: self.note.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::engine::State;
    use crate::core::protocol::MachineState;

    fn record(limited: u8, x_mm: f64) -> CycleRecord {
        let mut offset = [0.0; MAX_AXES];
        offset[0] = x_mm;
        CycleRecord {
            state: State::Active,
            machine_state: MachineState::default(),
            limited,
            warning: 0,
            out_of_range: 0,
            offset,
            applied: offset,
            age_ns: 0,
            turnaround_ns: 0,
            compute_ns: 0,
        }
    }

    #[test]
    fn what_was_counted_is_counted_on_after_a_restart() {
        let dir = tempfile::tempdir().expect("directory");
        let mut first = Tally::open(Some(dir.path()), "m", 1e-3);
        assert_eq!(first.note(), None);
        first.set_axes(vec![AxisName::X, AxisName::C]);
        first.record(&record(0b11, -0.012));
        first.record(&record(0b01, 0.003));
        first.enabled();
        first.fault("read-back");
        first.counters(100, 3).save(dir.path()).expect("saved");

        let mut second = Tally::open(Some(dir.path()), "m", 1e-3);
        second.set_axes(vec![AxisName::C, AxisName::X]);
        second.record(&record(0b10, 0.0));
        second.fault("read-back");
        let all = second.lifetime(50, 1);
        assert_eq!((all.starts, all.cycles, all.late_cycles, all.enables), (2, 150, 4, 1));
        assert_eq!(all.faults["read-back"], 2);
        assert!((all.limited_s["x"] - 3e-3).abs() < 1e-12 && (all.limited_s["c"] - 1e-3).abs() < 1e-12);
        assert!((all.largest_um["x"] - 12.0).abs() < 1e-9 && all.largest_arcsec["c"] == 0.0);
        assert_eq!(second.lifetime(50, 1), all, "asking changes nothing");
    }

    #[test]
    fn a_damaged_or_foreign_file_is_kept_aside_and_named() {
        let dir = tempfile::tempdir().expect("directory");
        let mut good = Tally::open(Some(dir.path()), "m", 1e-3);
        good.counters(7, 0).save(dir.path()).expect("saved");
        let text = fs::read(dir.path().join(FILE)).expect("there");
        let negative =
            String::from_utf8_lossy(&text).replace("\"limited_s\": {}", "\"limited_s\": {\"x\": -1.0}");
        for (bytes, why) in [
            (&text[..text.len() / 2], "EOF"),
            (b"\0\0\0\0".as_slice(), "expected value"),
            (negative.as_bytes(), "below zero"),
        ] {
            fs::write(dir.path().join(FILE), bytes).expect("written");
            let mut anew = Tally::open(Some(dir.path()), "m", 1e-3);
            let note = anew.note().expect("reported").to_owned();
            assert!(note.contains(why) && note.contains("counters.json.damaged-"), "{note}");
            assert_eq!(anew.lifetime(0, 0).cycles, 0);
            assert!(!dir.path().join(FILE).exists());
        }
        fs::write(dir.path().join(FILE), &text).expect("written");
        let foreign = Tally::open(Some(dir.path()), "other", 1e-3);
        assert!(foreign.note().expect("reported").contains("of machine \"m\""));
        let aside = fs::read_dir(dir.path()).expect("folder").count();
        assert_eq!(aside, 4, "every file is kept");
    }
}
