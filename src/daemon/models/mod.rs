//! The models of a running daemon: which one is used, by whose choice, and what may take its place.
//!
//! [`guard`] decides, [`store`] remembers; the switch itself is done by the cycle thread. Reading order: this file.

mod comparison;
pub mod guard;

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;

use tracing::{info, warn};
use volcomp_state::disk::Disk;
use volcomp_state::utc;

use super::load::{LoadError, Loaded, number};
use super::status::ModelStatus;
use super::sync::Mutex;
pub use comparison::{ErrorCurves, ModelComparison};
use volcomp_config::{MachineConfig, Measured, ModelFile, model};
use volcomp_engine::fault::Code;
use volcomp_estimate::Thermal;
use volcomp_model::{Model, ModelSpec};
pub use volcomp_state::models as store;

use store::{Choice, Store};

/// A model that is ready to be used.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// What it says.
    pub spec: ModelSpec,
    /// Thermal displacements that it lists.
    pub thermal: Vec<Thermal>,
    /// Compiled.
    pub model: Arc<Model>,
    /// Its file as it was read.
    pub text: String,
    /// BLAKE3 of the file, in hex.
    pub hash: String,
    /// Where it came from.
    pub origin: String,
    /// Last day on which it should be used, where stated: the earliest of its parts.
    pub expiry: Option<String>,
    /// When and with what it was measured, where stated.
    pub measured: Measured,
}

impl Prepared {
    /// Reads a model for the machine of `config`.
    ///
    /// # Errors
    /// In words, with file, line and remedy.
    pub fn read(origin: &str, text: String, config: &MachineConfig) -> Result<Self, String> {
        let file = model::parse_file(origin, &text).map_err(|e| e.to_string())?;
        let model = Model::new(&file.spec).map_err(|e| format!("error: {origin}: {e}"))?;
        if let Some(mismatch) = config.check_model(&file.spec).into_iter().next() {
            return Err(format!(
                "error: {origin}: {}{mismatch}\n  hint: {}",
                number(&mismatch),
                mismatch.remedy()
            ));
        }
        let read = Self::new(origin, text, file, model);
        match config.guard.hash.as_ref().filter(|pinned| **pinned != read.hash) {
            Some(pinned) => Err(LoadError::pinned(origin, &read.hash, pinned)),
            None => Ok(read),
        }
    }

    /// The model of a file with its text.
    pub(super) fn new(origin: &str, text: String, file: ModelFile, model: Model) -> Self {
        Self {
            expiry: file.earliest_expiry().map(str::to_owned),
            measured: file.measured(),
            spec: file.spec,
            thermal: file.thermal,
            model: Arc::new(model),
            hash: blake3::hash(text.as_bytes()).to_hex().to_string(),
            text,
            origin: origin.to_owned(),
        }
    }

    /// That it is chosen now.
    fn chosen(&self, who: Option<String>, why: Option<String>) -> Choice {
        let since = utc::text(SystemTime::now());
        Choice { hash: self.hash.clone(), origin: self.origin.clone(), since, who, why }
    }
}

/// The models of a running daemon.
#[derive(Debug)]
pub struct Models {
    /// In use.
    pub active: Arc<Prepared>,
    /// In use before: what a rollback goes to.
    pub previous: Option<Arc<Prepared>>,
    /// Who chose the one in use, and when.
    pub choice: Choice,
    /// Hash of the model that the machine file names.
    configured: String,
    /// Locked by whoever may wait for the disk, never by the service.
    store: Option<Arc<Mutex<Kept>>>,
    /// Switches so far.
    switches: u64,
    /// What the operator should know about the choice.
    pub notes: Vec<String>,
    /// Why nobody knows which model was in use before: compensation must not begin by itself.
    pub unknown: Option<String>,
}

impl Models {
    /// Decides with which model the daemon starts: the one that was in use, where the machine file still names the
    /// same one as then; the machine file's, where it does not differ by more than the guard allows.
    ///
    /// `place`: the state directory and its disk. `first`: there was no run before, so nothing can be missing.
    /// `hold` makes an unknown state durable: without that the store is left as it is.
    pub(super) fn at_start(
        place: Option<(Arc<dyn Disk>, &Path)>,
        first: bool,
        loaded: &Loaded,
        hold: impl FnOnce(&str) -> io::Result<()>,
    ) -> Self {
        let configured = loaded.model.clone();
        let choice = configured.chosen(None, Some("named by the machine file".to_owned()));
        let mut models = Self {
            configured: configured.hash.clone(),
            active: Arc::new(configured),
            previous: None,
            choice,
            store: None,
            switches: 0,
            notes: Vec::new(),
            unknown: None,
        };
        if let Some((disk, directory)) = place {
            let (store, problem) = Store::open(disk, directory, &loaded.config.machine);
            models.unknown = match &problem {
                None if store.active().is_none() && !first => {
                    Some(format!("{} names no model in use", directory.join(store::FILE).display()))
                }
                _ => problem.clone(),
            };
            models.notes.extend(problem);
            models.remember(&store, &loaded.config);
            match models.unknown.as_deref().map_or(Ok(()), hold) {
                Ok(()) => models.keep(store),
                Err(e) => models.notes.push(format!("which model is in use is not kept: {e}")),
            }
        }
        for note in &models.notes {
            warn!("{note}");
        }
        models
    }

    /// Takes over what the store knows.
    fn remember(&mut self, store: &Store, config: &MachineConfig) {
        let mut read = |choice: &Choice| -> Option<Arc<Prepared>> {
            let text = store.text(choice).map_err(|e| e.to_string());
            match text.and_then(|text| Prepared::read(&choice.origin, text, config)) {
                Ok(prepared) => Some(Arc::new(prepared)),
                Err(problem) => {
                    self.notes.push(format!("a model that was in use cannot be used any more: {problem}"));
                    None
                }
            }
        };
        let Some(chosen) = store.active().cloned() else { return };
        let was_active = read(&chosen);
        self.previous = store.previous().and_then(&mut read);
        let Some(was_active) = was_active else {
            self.unknown =
                Some(format!("the model in use before, {}, cannot be used any more", chosen.origin));
            return;
        };
        if chosen.hash == self.configured {
            self.choice = chosen;
            return;
        }
        if store.configured() == Some(self.configured.as_str()) {
            // loaded on purpose since
            info!(
                model = chosen.origin,
                hash = chosen.hash,
                since = chosen.since,
                "the model that was loaded last is used"
            );
            self.active = was_active;
            self.choice = chosen;
            return;
        }
        let judged =
            guard::size([&was_active.spec, &self.active.spec], [&was_active.thermal, &self.active.thermal])
                .map_err(|e| e.to_string())
                .and_then(|size| guard::judge(&size, &config.guard).map_err(|e| e.to_string()));
        match judged {
            Ok(()) => self.previous = Some(was_active),
            Err(why) => {
                self.notes.push(format!(
                    "{}: {} is not used: {why}. Still in use: {} (since {}). If the new one is right: \
                     volcomp load {} --confirm NAME --reason TEXT",
                    Code::MODEL_CHANGE,
                    self.active.origin,
                    chosen.origin,
                    chosen.since,
                    self.active.origin
                ));
                self.active = was_active;
                self.choice = chosen;
            }
        }
    }

    /// Writes down which model is in use at the start, unless the store knows.
    fn keep(&mut self, mut store: Store) {
        let same = store.active().is_some_and(|a| a.hash == self.active.hash);
        // a model that was held back stays to be confirmed: what the machine file named then is not touched
        let held_back = self.active.hash != self.configured;
        let known = same && (held_back || store.configured() == Some(self.configured.as_str()));
        if !known && let Err(e) = store.choose(self.choice.clone(), &self.active.text, &self.configured) {
            self.notes.push(format!("which model is in use is not kept: {e}"));
        }
        self.store = Some(Arc::new(Mutex::new(Kept { store, switch: 0 })));
    }

    /// For the status.
    pub(super) fn status(&self) -> ModelStatus {
        let Choice { since, who, why, .. } = self.choice.clone();
        ModelStatus {
            since,
            who,
            why,
            expiry: self.active.expiry.clone(),
            date: self.active.measured.date.clone(),
            instruments: self.active.measured.instruments.clone(),
            temperature_degc: None,
            previous: self.previous.as_ref().map(|p| p.origin.clone()),
            previous_hash: self.previous.as_ref().map(|p| p.hash.clone()),
            notes: self.notes.clone(),
        }
    }

    /// Another model has been taken into use; gives what is to be written down about it.
    pub(super) fn switched(
        &mut self,
        new: Arc<Prepared>,
        who: Option<String>,
        why: Option<String>,
    ) -> Keeping {
        let choice = new.chosen(who, why);
        let back = self.previous.as_ref().is_some_and(|p| p.hash == new.hash);
        self.previous = Some(core::mem::replace(&mut self.active, Arc::clone(&new)));
        self.choice = choice.clone();
        self.notes.clear();
        self.switches += 1;
        Keeping {
            store: self.store.clone(),
            switch: self.switches,
            choice,
            text: new.text.clone(),
            configured: self.configured.clone(),
            back,
        }
    }
}

/// The store, and the newest switch that it knows of.
#[derive(Debug)]
struct Kept {
    store: Store,
    switch: u64,
}

/// A choice on its way to the disk.
#[derive(Debug)]
pub(super) struct Keeping {
    store: Option<Arc<Mutex<Kept>>>,
    /// Number of the switch.
    switch: u64,
    choice: Choice,
    text: String,
    configured: String,
    back: bool,
}

impl Keeping {
    /// Writes it down, as long as that takes; says why the choice will not outlive a restart, where it will not.
    pub(super) fn write(self) -> Option<String> {
        let Some(store) = self.store else {
            return Some("no state directory: after a restart the machine file's model is used".to_owned());
        };
        let mut kept = store.lock();
        if self.switch <= kept.switch {
            // a disk that was slow has kept this one waiting until after the next
            return None;
        }
        kept.switch = self.switch;
        let store = &mut kept.store;
        let kept = if self.back && store.previous().is_some_and(|p| p.hash == self.choice.hash) {
            store.swap(self.choice)
        } else {
            store.choose(self.choice, &self.text, &self.configured)
        };
        kept.err().map(|e| format!("not kept, so a restart goes back to the model before: {e}"))
    }
}

#[cfg(test)]
mod tests;
