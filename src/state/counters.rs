//! Counters and orders that survive a restart: how long, how late, how often, how far, and what must not be undone.
//!
//! `counters.json` is replaced as a whole (temporary file, sync, rename). [`recall`] reads it back and tells a first
//! start from a known and an unknown state: what is damaged, missing, unreadable or of another machine is unknown, and
//! an unknown state never permits compensation to begin by itself.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use crate::disk::{Disk, replace, set_aside};
use crate::utc;

/// The `format` of the file.
const FORMAT: &str = "volcomp-counters/1";
/// Its name in the state directory.
pub const FILE: &str = "counters.json";
/// Largest file, bytes.
pub const BYTES_MAX: u64 = 1 << 20;
/// Locked by the daemon that owns the state directory; says nothing about an earlier run.
pub const LOCK_FILE: &str = "lock";
/// Names in a state directory that no daemon has written.
const NO_TRACES: [&str; 2] = [LOCK_FILE, "lost+found"];

/// The file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counters {
    format: String,
    machine: String,
    /// When counting began, UTC.
    pub since: String,
    saved: String,
    /// Starts of the daemon.
    pub starts: u64,
    /// Position frames handled.
    pub cycles: u64,
    /// Of these: late.
    pub late_cycles: u64,
    /// Times that compensation was switched on.
    pub enables: u64,
    /// Faults by name.
    pub faults: BTreeMap<String, u64>,
    /// Time that the offset of an axis was limited, s.
    pub limited_s: BTreeMap<String, f64>,
    /// Largest offset per linear axis, um.
    pub largest_um: BTreeMap<String, f64>,
    /// Largest offset per rotary axis, arcsec.
    pub largest_arcsec: BTreeMap<String, f64>,
    /// What a restart must not undo.
    #[serde(rename = "last_word")]
    pub retained: RetainedState,
}

/// What a restart must not undo.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RetainedState {
    /// An operator has switched compensation off.
    pub off: bool,
    /// The latched fault, by its number.
    #[serde(deserialize_with = "Option::deserialize")]
    pub fault: Option<String>,
    /// Axis, value and limit of that fault, as they were shown; none in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault_numbers: Option<String>,
    /// The gain that was ordered.
    #[serde(deserialize_with = "Option::deserialize")]
    pub gain: Option<f64>,
    /// Any other reason why compensation does not begin by itself, in words; lifted by an operator's enable.
    #[serde(default)]
    pub hold: Option<String>,
}

impl RetainedState {
    /// Why compensation does not begin by itself, where it does not.
    #[must_use]
    pub fn objection(&self) -> Option<String> {
        if let Some(code) = &self.fault {
            return Some(format!("fault {code} was latched before the restart and not cleared"));
        }
        if let Some(hold) = &self.hold {
            return Some(hold.clone());
        }
        self.off.then(|| "compensation was switched off before the restart".to_owned())
    }
}

/// What a state directory says about the run before.
#[derive(Debug, Clone, PartialEq)]
pub enum Recalled {
    /// There was none: the directory is empty.
    First,
    /// What it left.
    Known(Box<Counters>),
    /// Nobody knows, in words: compensation must not begin by itself.
    Unknown(String),
}

/// Reads back what the run before has left; what is damaged or of another machine is set aside.
#[must_use]
pub fn recall(disk: &dyn Disk, directory: &Path, machine: &str) -> Recalled {
    let path = directory.join(FILE);
    match disk.read(&path, BYTES_MAX) {
        Ok(text) => match Counters::parse(&text, machine) {
            Ok(found) => Recalled::Known(Box::new(found)),
            Err(why) => {
                let kept = match set_aside(disk, &path, "damaged") {
                    Ok(aside) => format!("kept as {}", aside.display()),
                    Err(e) => format!("and could not be set aside: {e}"),
                };
                Recalled::Unknown(format!("{}: {why}; {kept}", path.display()))
            }
        },
        Err(e) if e.kind() == ErrorKind::NotFound => match disk.list(directory) {
            Ok(names) => match names.into_iter().find(|name| !NO_TRACES.contains(&name.as_str())) {
                None => Recalled::First,
                Some(name) => Recalled::Unknown(format!(
                    "{} is missing, but the directory holds {name} of an earlier run",
                    path.display()
                )),
            },
            Err(e) => Recalled::Unknown(format!("{}: {e}", directory.display())),
        },
        Err(e) => Recalled::Unknown(format!("{}: {e}", path.display())),
    }
}

impl Counters {
    /// Counting begins.
    #[must_use]
    pub fn new(machine: &str) -> Self {
        let since = utc::text(SystemTime::now());
        Self { format: FORMAT.to_owned(), machine: machine.to_owned(), since, ..Self::default() }
    }

    /// Reads the file's text.
    ///
    /// # Errors
    /// Not the text of such a file, of another machine, or a number out of its range.
    pub fn parse(text: &[u8], machine: &str) -> Result<Self, String> {
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
        if found.retained.gain.is_some_and(|g| !(0.0..=1.0).contains(&g)) {
            return Err("a gain that is not from 0 to 1".to_owned());
        }
        Ok(found)
    }

    /// Replaces the file as a whole and makes it durable.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn save(&self, disk: &dyn Disk, directory: &Path) -> io::Result<()> {
        let saved = Self { saved: utc::text(SystemTime::now()), ..self.clone() };
        let mut text = serde_json::to_vec_pretty(&saved)?;
        text.push(b'\n');
        replace(disk, &directory.join(FILE), &text)
    }
}

#[cfg(test)]
mod tests;
