//! What the requests on the status socket lead to: each is checked, carried out, waited for, and audited.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::task::spawn_blocking;
use tokio::time::{sleep, timeout};
use tracing::info;

use super::audit::{AuditEntry, Who};
use super::models::{Prepared, guard};
use super::ports::Request;
use super::server::lock;
use super::service::Service;
use super::socket::{Answer, Ask, ModelChange, Verb};
use crate::core::engine::Command;
use crate::core::fault::Code;

/// Patience with the cycle thread to carry a command out.
const COMMAND_LIMIT: Duration = Duration::from_secs(2);
/// Patience with the disk.
const DISK_LIMIT: Duration = Duration::from_secs(2);
/// Time for at least one cycle to show a command's effect.
const SETTLE: Duration = Duration::from_millis(50);

/// User and process id of a client.
pub(super) type Peer = Option<(u32, Option<i32>)>;

/// Carries a request out.
pub(super) async fn carry_out(mut ask: Ask, service: &Mutex<Service>, peer: Peer) -> Answer {
    match ask.command {
        Verb::Status => {
            let status = lock(service).status();
            let state = Some(status.state.clone());
            return Answer { ok: true, state, status: Some(Box::new(status)), ..Answer::default() };
        }
        Verb::Histograms => {
            let mut service = lock(service);
            let histograms = Some(Box::new(service.histograms()));
            let state = Some(service.state().to_owned());
            return Answer { ok: true, state, histograms, ..Answer::default() };
        }
        Verb::Filter => {
            let service = lock(service);
            let state = Some(service.state().to_owned());
            return match &service.sensors {
                Some(sensors) => {
                    let filter = Some(Box::new(sensors.health()));
                    Answer { ok: true, state, filter, ..Answer::default() }
                }
                None => Answer::refused(NO_SENSORS.to_owned()),
            };
        }
        _ => {}
    }
    let (uid, pid) = peer.map_or((None, None), |(uid, pid)| (Some(uid), pid));
    info!(command = ?ask.command, uid, pid, reason = ask.reason, "command");
    let who = Who::client(uid, pid);
    let before = lock(service).model_hash().to_owned();
    let (what, detail) = described(&ask);
    let answer = match ask.command {
        Verb::Enable => enable(&ask, service).await,
        Verb::Disable => disable(service).await,
        Verb::ClearFault => order(Request::Engine(Command::ClearFault), service).await,
        Verb::Gain => gain(ask.gain, service).await,
        Verb::Load => load(&mut ask, &who, service).await,
        Verb::Rollback => rollback(&ask, &who, service).await,
        Verb::Forget => forget(&ask, service).await,
        Verb::Status | Verb::Histograms | Verb::Filter => Answer::default(),
    };
    let service = lock(service);
    let result = answer.state.as_ref().or(answer.error.as_ref());
    let after = service.model_hash().to_owned();
    service.audit().write(AuditEntry {
        who,
        what: what.to_owned(),
        why: ask.reason,
        old_model: (before != after).then_some(before),
        new_model: Some(after),
        result: result.cloned().unwrap_or_default(),
        detail,
    });
    answer
}

/// What the audit log calls a request.
fn described(ask: &Ask) -> (&'static str, Option<String>) {
    match ask.command {
        Verb::Enable if ask.shadow => ("shadow", None),
        Verb::Enable if ask.accept_expired => ("enable", Some("although the model has expired".to_owned())),
        Verb::Enable => ("enable", None),
        Verb::Disable => ("disable", None),
        Verb::ClearFault => ("clear-fault", None),
        Verb::Gain => ("gain", ask.gain.map(|gain| gain.to_string())),
        Verb::Load => {
            let origin = ask.model.as_ref().map_or("", |m| &m.origin);
            let confirmed = ask.confirm.as_ref().map(|name| format!(", change confirmed by {name}"));
            ("load", Some(format!("{origin}{}", confirmed.unwrap_or_default())))
        }
        Verb::Rollback => ("rollback", None),
        Verb::Forget => ("forget", ask.map.clone()),
        Verb::Status | Verb::Histograms | Verb::Filter => ("status", None),
    }
}

/// Where nothing is learned.
const NO_SENSORS: &str = "the machine file lists no sensor; see docs/sensors.md";

/// A map goes back to the offline map.
async fn forget(ask: &Ask, service: &Mutex<Service>) -> Answer {
    let Some(name) = &ask.map else { return Answer::refused("no map was named".to_owned()) };
    let answered = match &lock(service).sensors {
        Some(sensors) => sensors.forget(name),
        None => return Answer::refused(NO_SENSORS.to_owned()),
    };
    let Some(answered) = answered else {
        return Answer::refused("the estimator does not take orders; try again".to_owned());
    };
    let done = async {
        loop {
            if let Ok(found) = answered.try_recv() {
                return found;
            }
            sleep(Duration::from_millis(2)).await;
        }
    };
    match timeout(COMMAND_LIMIT, done).await {
        Ok(true) => {
            let state = Some(lock(service).state().to_owned());
            Answer { ok: true, state, ..Answer::default() }
        }
        Ok(false) => Answer::refused(format!("there is no map called \"{name}\"")),
        Err(_) => Answer::refused("the estimator did not answer".to_owned()),
    }
}

/// Passes a request to the cycle thread and waits until it shows.
async fn order(request: Request, service: &Mutex<Service>) -> Answer {
    let Some(number) = lock(service).request(request) else {
        return Answer::refused("too many commands are waiting; try again".to_owned());
    };
    let done = async {
        while !lock(service).is_done(number) {
            sleep(Duration::from_millis(2)).await;
        }
    };
    if timeout(COMMAND_LIMIT, done).await.is_err() {
        return Answer::refused(format!(
            "the cycle thread did not answer within {} s",
            COMMAND_LIMIT.as_secs()
        ));
    }
    sleep(SETTLE).await;
    let mut service = lock(service);
    service.drain();
    if service.is_refused(number) {
        return Answer::refused("the engine refuses: it does not fit the axes of the control".to_owned());
    }
    Answer { ok: true, state: Some(service.state().to_owned()), ..Answer::default() }
}

async fn enable(ask: &Ask, service: &Mutex<Service>) -> Answer {
    if ask.accept_expired && is_blank(ask.reason.as_ref()) {
        return Answer::refused("an expired model is only used for a reason: add --reason".to_owned());
    }
    if let Some(degc) = ask.temperature_degc {
        if !degc.is_finite() {
            return Answer::refused(format!("temperature {degc} is no number"));
        }
        lock(service).tell_temperature(degc);
    }
    if ask.shadow {
        if lock(service).is_wanted() {
            return Answer::refused(
                "shadow mode is for a machine that is not compensated: `volcomp disable` first".to_owned(),
            );
        }
        return order(Request::Shadow(true), service).await;
    }
    if let Some(fault) = lock(service).latched() {
        return Answer::refused(format!("{fault}; once its cause is gone: `volcomp enable --clear-fault`"));
    }
    let against = lock(service).hindrances(ask.accept_expired);
    if let Some((hindrance, _)) = against.iter().find(|(_, policy)| *policy != crate::config::Policy::Warn) {
        return Answer::refused(hindrance.to_string());
    }
    if lock(service).is_shadowing() {
        let _ = order(Request::Shadow(false), service).await;
    }
    if ask.accept_expired {
        lock(service).accept_expiry();
    }
    let notes = against.iter().map(|(hindrance, _)| hindrance.to_string()).collect();
    Answer { notes, ..order(Request::Engine(Command::Enable), service).await }
}

async fn disable(service: &Mutex<Service>) -> Answer {
    if lock(service).is_shadowing() {
        let _ = order(Request::Shadow(false), service).await;
    }
    order(Request::Engine(Command::Disable), service).await
}

async fn gain(gain: Option<f64>, service: &Mutex<Service>) -> Answer {
    match gain.filter(|g| (0.0..=1.0).contains(g)) {
        Some(gain) => order(Request::Engine(Command::SetGain(gain)), service).await,
        None => Answer::refused("a gain is a number from 0 to 1".to_owned()),
    }
}

/// Reads, compares, asks for a confirmation where needed, switches, remembers.
async fn load(ask: &mut Ask, who: &Who, service: &Mutex<Service>) -> Answer {
    let Some(sent) = ask.model.take() else {
        return Answer::refused("no model was sent".to_owned());
    };
    let Some(_turn) = Turn::take(service) else {
        return Answer::refused("another model is being looked at; try again when that is done".to_owned());
    };
    let (config, active) = {
        let service = lock(service);
        (service.config(), Arc::clone(&service.models().active))
    };
    let limits = config.guard.clone();
    let old = Arc::clone(&active);
    // reading and comparing takes up to seconds: not on the thread that serves everybody
    let work = spawn_blocking(move || {
        let new = Prepared::read(&sent.origin, sent.text, &config)?;
        let size = guard::size(&old.spec, &new.spec).map_err(|e| e.to_string())?;
        Ok::<_, String>((new, size))
    });
    let (new, size) = match work.await {
        Ok(Ok(found)) => found,
        Ok(Err(problem)) => {
            return Answer::refused(format!("{}: the model is not used\n{problem}", Code::MODEL_INVALID));
        }
        Err(_) => {
            return Answer::refused("internal: the comparison broke off; the model in use stays".to_owned());
        }
    };
    if new.hash == active.hash {
        let service = lock(service);
        let notes = vec!["this model is in use already".to_owned()];
        return Answer { ok: true, state: Some(service.state().to_owned()), notes, ..Answer::default() };
    }
    let finite = |value: f64| Some(value).filter(|v| v.is_finite());
    let change = Some(ModelChange {
        old_hash: active.hash.clone(),
        new_hash: new.hash.clone(),
        largest_um: finite(size.largest_um),
        largest_arcsec: finite(size.largest_arcsec),
    });
    if let Err(too_different) = guard::judge(&size, &limits)
        && (is_blank(ask.confirm.as_ref()) || is_blank(ask.reason.as_ref()))
    {
        let error = format!(
            "{}: {too_different}\n  hint: look at `volcomp diff`; if it is right, load it with --confirm NAME and \
             --reason TEXT",
            Code::MODEL_CHANGE
        );
        return Answer { change, ..Answer::refused(error) };
    }
    if let Err(refusal) = may_be_used(&new, service) {
        return Answer { change, ..Answer::refused(refusal) };
    }
    Answer {
        change,
        ..switch(Arc::new(new), ask.confirm.clone().or_else(|| who.name.clone()), ask.reason.clone(), service)
            .await
    }
}

/// While the machine is compensated, a model that could not be enabled must not slip in either.
fn may_be_used(new: &Prepared, service: &Mutex<Service>) -> Result<(), String> {
    let service = lock(service);
    if !service.is_wanted() {
        return Ok(());
    }
    match service
        .hindrances_of(new, false)
        .into_iter()
        .find(|(_, policy)| *policy != crate::config::Policy::Warn)
    {
        Some((hindrance, _)) => Err(format!(
            "{hindrance}\n  hint: `volcomp disable` first; enabling then asks for what is needed"
        )),
        None => Ok(()),
    }
}

async fn rollback(ask: &Ask, who: &Who, service: &Mutex<Service>) -> Answer {
    let Some(previous) = lock(service).models().previous.clone() else {
        return Answer::refused("there is no model before this one".to_owned());
    };
    if let Err(refusal) = may_be_used(&previous, service) {
        return Answer::refused(refusal);
    }
    let (limits, old) = {
        let service = lock(service);
        (service.config().guard.clone(), Arc::clone(&service.models().active))
    };
    let new = Arc::clone(&previous);
    let size = spawn_blocking(move || guard::size(&old.spec, &new.spec).map_err(|e| e.to_string())).await;
    let too_different = match size {
        Ok(Ok(size)) => guard::judge(&size, &limits).err().map(|e| e.to_string()),
        Ok(Err(problem)) => Some(problem),
        Err(_) => {
            return Answer::refused("internal: the comparison broke off; the model in use stays".to_owned());
        }
    };
    if let Some(too_different) = too_different.filter(|_| is_blank(ask.reason.as_ref())) {
        return Answer::refused(format!("VC-5006: {too_different}\n  hint: say why with --reason TEXT"));
    }
    switch(previous, who.name.clone(), ask.reason.clone(), service).await
}

/// Takes another model into use: first the engine, then the disk.
async fn switch(
    new: Arc<Prepared>,
    who: Option<String>,
    why: Option<String>,
    service: &Mutex<Service>,
) -> Answer {
    let hash = blake3::hash(new.text.as_bytes());
    let request = Request::Model { model: Arc::clone(&new.model), hash: *hash.as_bytes() };
    // until the cycle thread has answered, the old model is held here: nothing is freed on the cycle
    let _old = Arc::clone(&lock(service).models().active);
    lock(service).announce(&new);
    let answer = order(request, service).await;
    if !answer.ok {
        return answer;
    }
    let keeping = lock(service).switched(new, who, why);
    // a disk that hangs must not keep anybody waiting but its own thread
    let note = match timeout(DISK_LIMIT, spawn_blocking(|| keeping.write())).await {
        Ok(Ok(note)) => note,
        Ok(Err(_)) => Some("internal: writing the choice down broke off; a restart goes back".to_owned()),
        Err(_) => Some(
            "the disk is slow: the choice is being written down, until then a restart goes back".to_owned(),
        ),
    };
    if let Some(note) = &note {
        lock(service).note_model(note.clone());
    }
    Answer { notes: note.into_iter().collect(), ..answer }
}

/// The one place for a model that is being read and compared: several at once would take the memory of the machine.
struct Turn<'a>(&'a Mutex<Service>);

impl<'a> Turn<'a> {
    fn take(service: &'a Mutex<Service>) -> Option<Self> {
        lock(service).begin_load().then_some(Self(service))
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        lock(self.0).end_load();
    }
}

fn is_blank(text: Option<&String>) -> bool {
    text.is_none_or(|text| text.trim().is_empty())
}
