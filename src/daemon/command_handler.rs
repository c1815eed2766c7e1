//! Requests of the status socket and of the HTTP service: each is checked, carried out, awaited and audited.

mod compare;
mod exclusive_access;

use core::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use tracing::info;

use super::audit::{AuditEntry, Who};
use super::channels::Request;
use super::models::{Prepared, guard};
use super::sensors::Forgotten;
use super::service::Service;
use super::socket::{Answer, Ask, ModelChange, SentModel, Verb};
use super::sync::{Mutex, sleep, spawn_blocking, timeout};
use super::write_queue::Saved;
use exclusive_access::ExclusiveAccess;

use volcomp_config::{MachineConfig, Policy};
use volcomp_engine::Command;
use volcomp_engine::fault::Code;

/// Patience with the cycle thread to carry a command out.
const COMMAND_LIMIT: Duration = Duration::from_secs(2);
/// Patience with the disk.
const DISK_LIMIT: Duration = Duration::from_secs(2);
/// Interval at which it is looked whether something is done.
const POLL: Duration = Duration::from_millis(2);
/// Position frames beyond the window of the read-back by which an engine has faulted again whose fault is still there: those
/// that must be good before it ramps in, and some that are lost.
const SETTLE_FRAMES: u64 = 20;
/// Shortest and longest wait for them, s; in between four times what they take at the cycle time.
const SETTLE_LIMIT_S: [f64; 2] = [0.25, 1.0];
/// Time for at least one cycle to show a command's effect.
const SETTLE: Duration = Duration::from_millis(50);

/// Where a request came from.
#[derive(Debug, Clone, Copy)]
pub(super) enum Peer {
    /// A process on the status socket.
    Process { uid: u32, pid: Option<i32> },
    /// A client of the HTTP service that has the token.
    Http { address: IpAddr },
    /// The system does not say.
    Unknown,
}

impl Peer {
    /// Who it is, for the audit log; `name` is what a client of the HTTP service says of itself.
    fn who(self, name: Option<&str>) -> Who {
        match self {
            Self::Process { uid, pid } => Who::client(Some(uid), pid),
            Self::Http { address } => {
                let name = name.map(str::trim).filter(|name| !name.is_empty()).unwrap_or("unnamed");
                Who { name: Some(format!("{name} (HTTP, {address})")), ..Who::default() }
            }
            Self::Unknown => Who::default(),
        }
    }
}

/// Carries a request out.
pub(super) async fn carry_out(mut ask: Ask, service: &Mutex<Service>, peer: Peer) -> Answer {
    match ask.command {
        Verb::Status => {
            let status = service.lock().status();
            let answer = Answer::done(&status.state);
            return Answer { status: Some(Box::new(status)), ..answer };
        }
        Verb::Histograms => {
            let mut service = service.lock();
            let histograms = Some(Box::new(service.histograms()));
            return Answer { histograms, ..Answer::done(service.state()) };
        }
        Verb::Filter => {
            let service = service.lock();
            return match &service.sensors {
                Some(sensors) => {
                    let filter = Some(Box::new(sensors.health()));
                    Answer { filter, ..Answer::done(service.state()) }
                }
                None => Answer::refused(NO_SENSORS),
            };
        }
        _ => {}
    }
    if let Err(problem) = ask.check() {
        return Answer::refused(problem);
    }
    if ask.command == Verb::Compare {
        return compare::compare(ask.model, service).await;
    }
    let who = peer.who(ask.name.as_deref());
    info!(command = ?ask.command, uid = who.uid, pid = who.pid, name = who.name, reason = ask.reason, "command");
    let before = service.lock().model_hash().to_owned();
    let (what, detail) = described(&ask);
    let answer = match ask.command {
        Verb::Enable => enable(&ask, service).await,
        Verb::Disable => disable(service).await,
        Verb::ClearFault => clear_fault(service).await,
        Verb::Gain => gain(ask.gain, service).await,
        Verb::Load => load(&mut ask, &who, service).await,
        Verb::Rollback => rollback(&ask, &who, service).await,
        Verb::Forget => forget(&ask, service).await,
        Verb::Status | Verb::Histograms | Verb::Filter | Verb::Compare => Answer::default(),
    };
    let service = service.lock();
    // words about a file that was refused may quote it
    let result = answer.state.as_ref().or(answer.record.as_ref()).or(answer.error.as_ref());
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
    let sent = |model: &SentModel| {
        let hash = blake3::hash(model.text.as_bytes()).to_hex();
        format!("{}, {} bytes, blake3 {hash}", model.origin, model.text.len())
    };
    match ask.command {
        Verb::Enable if ask.shadow => ("shadow", None),
        Verb::Enable if ask.accept_expired => ("enable", Some("although the model has expired".to_owned())),
        Verb::Enable => ("enable", None),
        Verb::Disable => ("disable", None),
        Verb::ClearFault => ("clear-fault", None),
        Verb::Gain => ("gain", ask.gain.map(|gain| gain.to_string())),
        Verb::Load => {
            let sent = ask.model.as_ref().map_or_else(String::new, sent);
            let confirmed = ask.confirm.as_ref().map(|name| format!(", change confirmed by {name}"));
            ("load", Some(format!("{sent}{}", confirmed.unwrap_or_default())))
        }
        Verb::Rollback => ("rollback", None),
        Verb::Forget => ("forget", ask.map.clone()),
        Verb::Status | Verb::Histograms | Verb::Filter | Verb::Compare => ("status", None),
    }
}

/// Where nothing is learned.
const NO_SENSORS: &str = "the machine file lists no sensor; see docs/how-to/sensors.md";

/// A map goes back to the offline map.
async fn forget(ask: &Ask, service: &Mutex<Service>) -> Answer {
    let Some(name) = &ask.map else { return Answer::refused("no map was named") };
    let answered = match &service.lock().sensors {
        Some(sensors) => sensors.forget(name),
        None => return Answer::refused(NO_SENSORS),
    };
    let Some(answered) = answered else {
        return Answer::refused("the estimator does not take orders; try again");
    };
    let done = async {
        loop {
            if let Ok(forgotten) = answered.try_recv() {
                return forgotten;
            }
            sleep(POLL).await;
        }
    };
    let number = match timeout(COMMAND_LIMIT, done).await {
        Ok(Forgotten::Done(number)) => number,
        Ok(Forgotten::NoSuchMap) => return Answer::refused(no_such_map(name, &service.lock().config())),
        Ok(Forgotten::Unused) => {
            return Answer::refused(format!(
                "{}: live estimation is off with the model in use: no map can be forgotten",
                Code::LIVE_UNUSED
            ));
        }
        Err(_) => {
            return Answer::refused(format!(
                "the estimator did not answer within {} s; it will carry this out as soon as it does",
                COMMAND_LIMIT.as_secs()
            ));
        }
    };
    // without a state directory a restart begins at the offline map anyway
    let note = durable(|service| service.forgotten_saved(number), |_| false, service).await;
    Answer { notes: note.into_iter().collect(), ..Answer::done(service.lock().state()) }
}

fn no_such_map(name: &str, config: &MachineConfig) -> String {
    let maps: Vec<&str> = config.sensors.spec.maps.iter().map(|map| map.name.as_str()).collect();
    match maps.as_slice() {
        [] => format!("unknown map \"{name}\"; the machine file lists none"),
        maps => format!("unknown map \"{name}\"; expected one of {}", maps.join(", ")),
    }
}

/// Passes a request to the cycle thread, waits until it shows, and until what a restart must not undo is durable.
async fn order(request: Request, service: &Mutex<Service>) -> Answer {
    let Some(number) = service.lock().request(request.clone()) else {
        return Answer::refused("too many commands are waiting; try again");
    };
    let done = async {
        while !service.lock().is_done(number) {
            sleep(POLL).await;
        }
    };
    let in_time = timeout(COMMAND_LIMIT, done).await.is_ok();
    // what the operator has switched off stays off whether or not the cycle thread has answered
    let kept = || durable(Service::retained_state_saved, |service| service.is_undone(&request), service);
    let note = kept().await;
    if !in_time && !service.lock().is_done(number) {
        let mut error = format!("the cycle thread did not answer within {} s", COMMAND_LIMIT.as_secs());
        if request.is_safe() {
            error.push_str("; it will carry this out as soon as it does");
        }
        return Answer { notes: note.into_iter().collect(), ..Answer::refused(error) };
    }
    if !service.lock().is_carried_out(number) {
        return Answer::refused(refusal(&request, &service.lock()));
    }
    let note = kept().await;
    sleep(SETTLE).await;
    let mut service = service.lock();
    service.drain();
    Answer { notes: note.into_iter().collect(), ..Answer::done(service.state()) }
}

/// Why the cycle thread has refused a request.
fn refusal(request: &Request, service: &Service) -> String {
    match (request, service.latched()) {
        (Request::Model { .. }, _) => {
            "the engine refuses: it does not fit the axes of the control".to_owned()
        }
        (Request::Engine(Command::ClearFault), Some(fault)) => {
            format!(
                "{fault}; a fault is cleared at zero offset only, with the link up: {}; try again",
                service.not_clearable()
            )
        }
        (_, Some(fault)) => format!("{fault}; once its cause is gone: `volcomp enable --clear-fault`"),
        (_, None) => "it was not carried out in time; try again".to_owned(),
    }
}

/// Waits until an order is durable, as `saved` tells; why it is not, where the disk does not take it in time. `is_undone`:
/// whether a restart undoes it to the worse where there is no state directory.
async fn durable(
    saved: impl Fn(&Service) -> Saved,
    is_undone: impl Fn(&Service) -> bool,
    service: &Mutex<Service>,
) -> Option<String> {
    let mut verdict = saved(&service.lock());
    let waited = async {
        while verdict == Saved::Waiting {
            sleep(POLL).await;
            verdict = saved(&service.lock());
        }
    };
    let _ = timeout(DISK_LIMIT, waited).await;
    let why = match verdict {
        Saved::Yes => return None,
        Saved::Waiting => "the disk is slow".to_owned(),
        Saved::No(why) => why,
        Saved::Nowhere if is_undone(&service.lock()) => "no state directory ([state] directory)".to_owned(),
        Saved::Nowhere => return None,
    };
    Some(format!("not kept, so a restart may undo this: {why}"))
}

async fn enable(ask: &Ask, service: &Mutex<Service>) -> Answer {
    if ask.accept_expired && is_blank(ask.reason.as_ref()) {
        return Answer::refused("an expired model is only used for a reason: add --reason");
    }
    if let Some(degc) = ask.temperature_degc {
        service.lock().set_temperature(degc);
    }
    if ask.shadow {
        if service.lock().is_wanted() {
            return Answer::refused(
                "shadow mode is for a machine that is not compensated: `volcomp disable` first",
            );
        }
        return order(Request::Shadow(true), service).await;
    }
    let latched = service.lock().latched();
    if let Some(fault) = latched {
        return Answer::refused(format!("{fault}; once its cause is gone: `volcomp enable --clear-fault`"));
    }
    let against = service.lock().hindrances(ask.accept_expired);
    if let Some((hindrance, _)) = against.iter().find(|(_, policy)| *policy != Policy::Warn) {
        return Answer::refused(hindrance.to_string());
    }
    if service.lock().is_shadowing() {
        let _ = order(Request::Shadow(false), service).await;
    }
    if ask.accept_expired {
        service.lock().accept_expiry();
    }
    let mut notes: Vec<String> = against.iter().map(|(hindrance, _)| hindrance.to_string()).collect();
    let answer = order(Request::Engine(Command::Enable), service).await;
    notes.extend(answer.notes.iter().cloned());
    or_fault(Answer { notes, ..answer }, "compensation was enabled and ended at once", service).await
}

async fn clear_fault(service: &Mutex<Service>) -> Answer {
    let answer = order(Request::Engine(Command::ClearFault), service).await;
    or_fault(answer, "the fault was cleared and came back at once", service).await
}

/// The answer, or a refusal where a fault is latched before the engine has seen enough frames to show it.
async fn or_fault(answer: Answer, what: &str, service: &Mutex<Service>) -> Answer {
    if !answer.ok {
        return answer;
    }
    let (first, enough, cycle_s, latched) = {
        let mut service = service.lock();
        service.drain();
        let config = service.config();
        let enough = u64::from(config.engine.read_back_cycles) + SETTLE_FRAMES;
        (service.frames(), enough, config.link.cycle_s, service.latched())
    };
    let refused =
        |fault: String| Answer { notes: answer.notes.clone(), ..Answer::refused(format!("{what}: {fault}")) };
    let [shortest, longest] = SETTLE_LIMIT_S;
    let limit = Duration::from_secs_f64((4.0 * enough as f64 * cycle_s).clamp(shortest, longest));
    // a fault may have ended the link already
    let Some(first) = first else { return latched.map_or_else(|| answer.clone(), refused) };
    let fault = async {
        loop {
            {
                let mut service = service.lock();
                service.drain();
                let latched = service.latched();
                if latched.is_some() || service.frames().is_none_or(|frames| frames >= first + enough) {
                    return latched;
                }
            }
            sleep(POLL).await;
        }
    };
    match timeout(limit, fault).await {
        Ok(Some(fault)) => refused(fault),
        Ok(None) | Err(_) => Answer { state: Some(service.lock().state().to_owned()), ..answer },
    }
}

async fn disable(service: &Mutex<Service>) -> Answer {
    if service.lock().is_shadowing() {
        let _ = order(Request::Shadow(false), service).await;
    }
    order(Request::Engine(Command::Disable), service).await
}

async fn gain(gain: Option<f64>, service: &Mutex<Service>) -> Answer {
    match gain.filter(|g| (0.0..=1.0).contains(g)) {
        Some(gain) => order(Request::Engine(Command::SetGain(gain)), service).await,
        None => Answer::refused("a gain is a number from 0 to 1"),
    }
}

/// Where another load or rollback has the turn.
const BUSY: &str = "another model is being looked at; try again when that is done";
/// Where there is nothing to go back to.
const NO_PREVIOUS: &str = "no previous model";
/// Where a decision was made on another picture.
const OTHER_SINCE: &str = "another model was taken into use since the comparison; compare again";

/// Reads, compares, asks for a confirmation where needed, switches, remembers.
async fn load(ask: &mut Ask, who: &Who, service: &Mutex<Service>) -> Answer {
    let Some(sent) = ask.model.take() else {
        return Answer::refused("no model was sent");
    };
    let Some(_turn) = ExclusiveAccess::take(service.lock().loading()) else {
        return Answer::refused(BUSY);
    };
    let (config, active) = {
        let service = service.lock();
        (service.config(), Arc::clone(&service.models().active))
    };
    if let Some(problem) = compare::stale(ask.old_hash.as_deref(), &active, OTHER_SINCE) {
        return problem;
    }
    let limits = config.guard.clone();
    let old = Arc::clone(&active);
    // reading and comparing takes up to seconds: not on the thread that serves everybody
    let work = spawn_blocking(move || {
        let new = Prepared::read(&sent.origin, sent.text, &config)?;
        let size =
            guard::size([&old.spec, &new.spec], [&old.thermal, &new.thermal]).map_err(|e| e.to_string())?;
        Ok::<_, String>((new, size))
    });
    let (new, size) = match work.await {
        Ok(Ok(found)) => found,
        Ok(Err(problem)) => {
            let record = Some(format!("{}: refused, not a model for this machine", Code::MODEL_INVALID));
            let error = format!("{}: the model is not used\n{problem}", Code::MODEL_INVALID);
            return Answer { record, ..Answer::refused(error) };
        }
        Err(_) => {
            return Answer::refused("internal: the comparison broke off; the model in use stays");
        }
    };
    if new.hash == active.hash {
        let notes = vec!["this model is in use already".to_owned()];
        return Answer { notes, ..Answer::done(service.lock().state()) };
    }
    let change = Some(ModelChange::new(&active, &new, &size));
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
    let service = service.lock();
    if !service.is_wanted() {
        return Ok(());
    }
    match service.hindrances_of(new, false).iter().find(|(_, policy)| *policy != Policy::Warn) {
        Some((hindrance, _)) => Err(format!(
            "{hindrance}\n  hint: `volcomp disable` first; enabling then asks for what is needed"
        )),
        None => Ok(()),
    }
}

async fn rollback(ask: &Ask, who: &Who, service: &Mutex<Service>) -> Answer {
    // one model at a time: what a load has compared with must still be in use when it is switched to
    let Some(_turn) = ExclusiveAccess::take(service.lock().loading()) else {
        return Answer::refused(BUSY);
    };
    let Some(previous) = service.lock().models().previous.clone() else {
        return Answer::refused(NO_PREVIOUS);
    };
    let active = Arc::clone(&service.lock().models().active);
    let expected = [(ask.old_hash.as_deref(), &active), (ask.new_hash.as_deref(), &previous)];
    if let Some(problem) =
        expected.into_iter().find_map(|(hash, model)| compare::stale(hash, model, OTHER_SINCE))
    {
        return problem;
    }
    if let Err(refusal) = may_be_used(&previous, service) {
        return Answer::refused(refusal);
    }
    let limits = service.lock().config().guard.clone();
    let new = Arc::clone(&previous);
    let compared = move || {
        guard::size([&active.spec, &new.spec], [&active.thermal, &new.thermal]).map_err(|e| e.to_string())
    };
    let size = spawn_blocking(compared).await;
    let too_different = match size {
        Ok(Ok(size)) => guard::judge(&size, &limits).err().map(|e| e.to_string()),
        Ok(Err(problem)) => Some(problem),
        Err(_) => {
            return Answer::refused("internal: the comparison broke off; the model in use stays");
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
    let _old = Arc::clone(&service.lock().models().active);
    service.lock().announce(&new);
    let answer = order(request, service).await;
    if !answer.ok {
        return answer;
    }
    let keeping = service.lock().switched(new, who, why);
    // a disk that hangs must not keep anybody waiting but its own thread
    let note = match timeout(DISK_LIMIT, spawn_blocking(move || keeping.write())).await {
        Ok(Ok(note)) => note,
        Ok(Err(_)) => Some("internal: writing the choice down broke off; a restart goes back".to_owned()),
        Err(_) => Some(
            "the disk is slow: the choice is being written down, until then a restart goes back".to_owned(),
        ),
    };
    if let Some(note) = &note {
        service.lock().note_model(note.clone());
    }
    Answer { notes: note.into_iter().collect(), ..answer }
}

fn is_blank(text: Option<&String>) -> bool {
    text.is_none_or(|text| text.trim().is_empty())
}
