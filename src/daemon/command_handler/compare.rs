//! `compare`: what `load` or `rollback` would change; nothing is changed.

use std::sync::Arc;

use super::exclusive_access::ExclusiveAccess;
use super::{BUSY, NO_PREVIOUS, may_be_used};
use crate::models::{ModelComparison, Prepared};
use crate::service::Service;
use crate::socket::{Answer, SentModel};
use crate::sync::{Mutex, spawn_blocking};
use volcomp_engine::fault::Code;

/// The refusal where a model is not the one that a client has in mind.
pub(super) fn stale(expected: Option<&str>, model: &Prepared, words: &str) -> Option<Answer> {
    expected.filter(|hash| *hash != model.hash).map(|_| Answer::refused(words))
}

/// Compares the model in use with the one sent, or with the one before it.
pub(super) async fn compare(sent: Option<SentModel>, service: &Mutex<Service>) -> Answer {
    let Some(_turn) = ExclusiveAccess::take(service.lock().loading()) else {
        return Answer::refused(BUSY);
    };
    let (config, active, previous) = {
        let service = service.lock();
        let models = service.models();
        (service.config(), Arc::clone(&models.active), models.previous.clone())
    };
    if sent.is_none() && previous.is_none() {
        return Answer::refused(NO_PREVIOUS);
    }
    // reading and comparing takes up to seconds: not on the thread that serves everybody
    let work = spawn_blocking(move || {
        let new = match (sent, previous) {
            (Some(sent), _) => Arc::new(Prepared::read(&sent.origin, sent.text, &config)?),
            (None, Some(previous)) => previous,
            (None, None) => return Err(NO_PREVIOUS.to_owned()),
        };
        ModelComparison::of(&active, &new, &config.guard).map(|comparison| (new, comparison))
    });
    match work.await {
        Ok(Ok((new, comparison))) => {
            let refusal = may_be_used(&new, service).err();
            let comparison = Some(Box::new(ModelComparison { refusal, ..comparison }));
            Answer { comparison, ..Answer::done(service.lock().state()) }
        }
        Ok(Err(problem)) => Answer::refused(format!("{}: {problem}", Code::MODEL_INVALID)),
        Err(_) => Answer::refused("internal: the comparison broke off"),
    }
}
