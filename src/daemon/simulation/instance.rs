//! One life of a simulated daemon: its threads, its clients, and what goes wrong meanwhile.

use std::path::Path;
use std::sync::Arc;
use std::sync::Mutex as Notes;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use super::memory_disk::Health;
use shuttle::future::block_on;
use shuttle::rand::{Rng, rngs::ThreadRng};
use shuttle::thread::spawn;
use volcomp_state::counters::Recalled;

use super::control::cycle;
use super::history::{History, must_not_begin};
use super::{Plan, World, faulty};
use crate::channels::{StopWish, channels};
use crate::clock::Clock;
use crate::command_handler::{Peer, carry_out};
use crate::control::{Control, SERVICE_SILENT_S, Start};
use crate::models::Models;
use crate::service::Service;
use crate::socket::{Ask, SentModel, Verb};
use crate::state_writer::StateWriter;
use crate::sync::{Mutex, pause, point};
use crate::write_queue::Saved;

/// Interval of the service's loop.
const TICK: Duration = Duration::from_millis(20);

/// What may go wrong in one life.
#[derive(Debug, Default)]
pub(super) struct Instance {
    dead: AtomicBool,
    over: AtomicBool,
    hanging: AtomicBool,
    full: AtomicBool,
    /// The next write is cut off behind so many bytes, and the power is gone.
    torn: Notes<Option<usize>>,
}

impl Instance {
    pub(super) fn is_dead(&self) -> bool {
        self.dead.load(Relaxed)
    }

    /// Nobody will ask for anything any more.
    pub(super) fn is_over(&self) -> bool {
        self.over.load(Relaxed)
    }

    /// The thread is not scheduled for a while, now and then.
    pub(super) fn stall(&self, random: &mut ThreadRng) {
        if random.gen_bool(0.004) {
            pause(Duration::from_millis(random.gen_range(100..3000)));
        }
    }

    /// What the disk does with an operation.
    fn gate(&self) -> Health {
        point();
        while self.hanging.load(Relaxed) && !self.is_dead() {
            point();
        }
        if self.is_dead() {
            return Health::Off;
        }
        let torn = self.torn.lock().expect("notes").take();
        if let Some(bytes) = torn {
            self.dead.store(true, Relaxed);
            return Health::Torn(bytes);
        }
        if self.full.load(Relaxed) { Health::Full } else { Health::Well }
    }

    /// Something goes wrong.
    fn go_wrong(&self, service: &Mutex<Service>, progress: &crate::channels::Progress) {
        let mut random = shuttle::rand::thread_rng();
        for _ in 0..random.gen_range(0..4) {
            pause(Duration::from_millis(random.gen_range(0..800)));
            match random.gen_range(0..8) {
                0 => self.hanging.store(true, Relaxed),
                1 => self.full.store(true, Relaxed),
                2 | 3 => {
                    self.hanging.store(false, Relaxed);
                    self.full.store(false, Relaxed);
                }
                4 => *self.torn.lock().expect("notes") = Some(random.gen_range(0..1200)),
                5 => self.dead.store(true, Relaxed),
                6 => {
                    let again = progress.stop() != StopWish::No;
                    progress.ask_stop(if again { StopWish::Now } else { StopWish::Clean });
                }
                _ => {
                    // the service hangs in its lock
                    let _held = service.lock();
                    pause(Duration::from_millis(random.gen_range(500..4000)));
                }
            }
        }
    }
}

/// A client's requests, one after the other.
fn client(plan: Plan, service: &Mutex<Service>, history: &History, progress: &crate::channels::Progress) {
    let mut random = shuttle::rand::thread_rng();
    for _ in 0..random.gen_range(1..4) {
        let ask = match random.gen_range(0..14) {
            0 | 1 | 10 => Ask { command: Verb::Enable, ..Ask::default() },
            2 | 3 | 11 => Ask { command: Verb::Disable, ..Ask::default() },
            4 | 12 => Ask { command: Verb::ClearFault, ..Ask::default() },
            5 => Ask {
                command: Verb::Gain,
                gain: Some(f64::from(random.gen_range(0..5)) / 4.0),
                ..Ask::default()
            },
            6 | 7 => {
                let origin = "sent.toml".to_owned();
                let text = super::model(random.gen_range(0..6) % 5);
                Ask { command: Verb::Load, model: Some(SentModel { origin, text }), ..Ask::default() }
            }
            8 => Ask { command: Verb::Rollback, reason: Some("worse".to_owned()), ..Ask::default() },
            _ => Ask { command: Verb::Status, ..Ask::default() },
        };
        if plan == Plan::FaultyTurn && ask.command == Verb::Load {
            faulty::load(service);
            continue;
        }
        let verb = ask.command;
        let number = history.begin(verb);
        let answer = block_on(carry_out(ask, service, Peer::Unknown));
        history.end(number, &answer, progress);
    }
}

/// One life: from what is on the disk to its end.
pub(super) fn live(plan: Plan, world: &World) {
    let instance = Arc::new(Instance::default());
    let theirs = Arc::clone(&instance);
    let disk = Arc::new(world.disk.behind(move || theirs.gate()));
    let history = Arc::clone(&world.history);
    let forbidden = must_not_begin(&world.disk).or_else(|| history.forbids());
    let clock = Clock::start();
    let directory = Path::new(super::DIRECTORY);
    let loaded = super::loaded();
    let mut state_writer =
        StateWriter::on(disk.clone(), directory, super::MACHINE).expect("the disk is well at the start");
    let first = state_writer.recalled() == Some(&Recalled::First);
    let models = Models::at_start(Some((disk, directory)), first, &loaded, |why| state_writer.hold(why));
    let (cycle_channels, service_channels) = channels();
    let progress = Arc::clone(&service_channels.progress);
    let mut service = Service::new(Arc::clone(&loaded), service_channels, state_writer, None, models, clock)
        .expect("set up");
    let permitted = service.begins(true);
    let kept_fault = service.has_kept_fault();
    if let Some(why) = forbidden.filter(|_| permitted) {
        panic!("compensation begins by itself, although {why}");
    }
    history.begins(permitted);
    let model = Arc::clone(&service.models().active.model);
    let start = Start { model, permitted, kept_fault, service_silent_s: SERVICE_SILENT_S, live: None };
    let control = Control::new(cycle_channels, &loaded.config, start);
    assert_eq!(progress.wanted.load(Relaxed), permitted && !kept_fault);
    assert_eq!(progress.is_faulted(), kept_fault);
    let service = Arc::new(Mutex::new(service));

    let cycle_thread = {
        let (instance, loaded) = (Arc::clone(&instance), Arc::clone(&loaded));
        spawn(move || cycle(&instance, &loaded, control, clock))
    };
    let service_loop = {
        let (instance, service, progress) =
            (Arc::clone(&instance), Arc::clone(&service), Arc::clone(&progress));
        spawn(move || {
            while !instance.is_over() && !instance.is_dead() {
                service.lock().drain();
                progress.service_beat();
                pause(TICK);
            }
        })
    };
    let trouble = {
        let (instance, service, progress) =
            (Arc::clone(&instance), Arc::clone(&service), Arc::clone(&progress));
        spawn(move || instance.go_wrong(&service, &progress))
    };
    let clients: Vec<_> = (0..shuttle::rand::thread_rng().gen_range(2..4))
        .map(|_| {
            let (service, history, progress) =
                (Arc::clone(&service), Arc::clone(&history), Arc::clone(&progress));
            spawn(move || client(plan, &service, &history, &progress))
        })
        .collect();
    for client in clients {
        client.join().expect("every request is answered");
    }
    trouble.join().expect("trouble");
    let healed = shuttle::rand::thread_rng().gen_bool(0.7);
    if healed {
        instance.hanging.store(false, Relaxed);
        instance.full.store(false, Relaxed);
    }
    instance.over.store(true, Relaxed);
    let control = cycle_thread.join().expect("the cycle thread");
    service_loop.join().expect("the service");
    service.lock().finish("ok");
    let killed = instance.is_dead();
    if !killed && healed {
        agree(world, &service, &control);
    }
    // whatever still writes is in a process that is gone
    instance.dead.store(true, Relaxed);
}

/// Service, engine and disk say the same when nothing is under way.
fn agree(world: &World, service: &Mutex<Service>, control: &Control) {
    let mut service = service.lock();
    service.drain();
    let progress = &control.channels.progress;
    let retained = service.retained();
    let off = retained.off || retained.hold.is_some() || retained.fault.is_some();
    let wanted = progress.wanted.load(Relaxed);
    // a thread that was told to end at once leaves its last requests
    if progress.stop() == StopWish::No {
        assert_eq!(wanted, !off, "the engine and a restart disagree: {retained:?}");
        assert_eq!(progress.is_faulted(), retained.fault.is_some(), "{retained:?}");
        world.history.check(wanted);
    }
    assert_eq!(service.retained_state_saved(), Saved::Yes);
    assert_eq!(super::history::retained_on(&world.disk), Some(retained), "the disk has the last word");
    assert!(
        Arc::ptr_eq(&service.models().active.model, control.model()),
        "service and engine have one model"
    );
    super::history::check_model(&world.disk, service.models());
}
