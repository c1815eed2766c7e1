//! The daemon as a whole: from the machine file to the last frame.

use std::io;
use std::net::TcpListener;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use sd_notify::NotifyState;
use tokio::sync::oneshot;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};
use tracing::{error, info, warn};
use volcomp_state::counters::Recalled;

use super::channels::{CycleChannels, Progress, StopWish, channels};
use super::clock::Clock;
use super::control::{SERVICE_SILENT_S, Start};
use super::http::{self, Publisher};
use super::load::{LoadError, Loaded, load};
use super::logging::{self, LogError};
use super::models::{Models, guard};
use super::notify::{Fed, Headline, Watchdog, notify};
use super::recorder::{HealthSlot, Recorder};
use super::sensors::{self, EstimatorTime, Listener, Sensors, live_ends, live_ends_in_lock_step};
use super::server::{Server, SocketError};
use super::service::Service;
use super::signals::{self, STOP_LIMIT};
use super::state_writer::StateWriter;
use super::sync::Mutex;
use super::worker::Worker;
use volcomp_config::machine::is_this_computer;
use volcomp_config::{MachineConfig, Policy};
use volcomp_units::axes::AxisKind;
use volcomp_units::{UM_PER_MM, arcsec_from_rad, deg_from_rad};

/// Interval at which the service looks after the cycle thread's reports.
const TICK: Duration = Duration::from_millis(20);
/// Stack of the cycle thread, bytes; all of it may be locked into memory.
const STACK_BYTES: usize = 1 << 20;

/// Why the daemon ends without having been asked to.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The files.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Logging.
    #[error("error: {0}")]
    Log(#[from] LogError),
    /// The status socket.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// A socket that is listened at.
    #[error(
        "error: {key} {address}: {source}\n  hint: another program has this port, or this computer has no such address"
    )]
    Listen {
        /// The key of the machine file that states the address.
        key: &'static str,
        /// The address.
        address: std::net::SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// The system refuses a thread, a signal handler or the like.
    #[error("error: {what}: {source}")]
    System {
        /// What was asked for.
        what: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// The cycle thread panicked or hangs.
    #[error("error: the cycle thread {how}; this is a bug in volcompd, please report it with the log")]
    CycleThread {
        /// How it ended.
        how: &'static str,
    },
    /// Anything else that must not happen.
    #[error("error: internal: {what}; this is a bug in volcompd, please report it with the log")]
    Internal {
        /// What.
        what: &'static str,
    },
}

/// Runs the daemon until it is asked to stop.
///
/// # Errors
/// See [`DaemonError`]; after a clean stop there is none.
pub fn run(config: &Path) -> Result<(), DaemonError> {
    let loaded = Arc::new(load(config)?);
    logging::init(&loaded.config.log)?;
    let system = |what| move |source| DaemonError::System { what, source };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(system("the service's event loop"))?;
    // a panic of the service must end the process: nobody would watch the cycle any more
    catch_unwind(AssertUnwindSafe(|| runtime.block_on(serve(config, loaded))))
        .unwrap_or(Err(DaemonError::Internal { what: "the service panicked" }))
}

/// Says that the cycle thread has ended.
struct Ended(Arc<Progress>);

impl Drop for Ended {
    fn drop(&mut self) {
        self.0.cycle_ended.store(true, Relaxed);
    }
}

/// The cycle thread and the news of its end.
struct CycleThread {
    handle: JoinHandle<()>,
    ended: oneshot::Receiver<()>,
}

impl CycleThread {
    fn spawn(loaded: Arc<Loaded>, how: Start, channels: CycleChannels, clock: Clock) -> io::Result<Self> {
        let progress = Arc::clone(&channels.progress);
        Self::start(move || {
            // on return and on panic alike: the thread of the signals hears of both
            let _ended = Ended(progress);
            Worker::new(loaded, how, channels, clock).run();
        })
    }

    fn start(session: impl FnOnce() + Send + 'static) -> io::Result<Self> {
        let (end, ended) = oneshot::channel();
        let handle = std::thread::Builder::new()
            .name("volcomp-cycle".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(move || {
                // dropped on return and on panic alike: the service hears of both
                let _end: oneshot::Sender<()> = end;
                session();
            })?;
        Ok(Self { handle, ended })
    }

    /// Tells a clean end from a panic.
    fn join(self) -> Result<(), DaemonError> {
        self.handle.join().map_err(|_| DaemonError::CycleThread { how: "panicked" })
    }
}

async fn serve(config: &Path, loaded: Arc<Loaded>) -> Result<(), DaemonError> {
    let (mut cycle_channels, service_channels) = channels();
    let progress = Arc::clone(&service_channels.progress);
    signals::watch(Arc::clone(&progress))
        .map_err(|source| DaemonError::System { what: "the signal handlers", source })?;
    let socket = socket_path(config, &loaded.config);
    let server = socket.as_deref().map(Server::bind).transpose()?;
    let http = http_listener(&loaded.config)?;
    let sensor_socket = sensor_socket(&loaded.config)?;
    let clock = Clock::start();
    let mut state_writer = StateWriter::start(config, &loaded);
    let directory = state_writer.directory().map(Path::to_owned);
    let place = directory.as_deref().map(|directory| (state_writer.disk(), directory));
    let first = state_writer.recalled() == Some(&Recalled::First);
    let models = Models::at_start(place, first, &loaded, |why| state_writer.hold(why));
    let mut how = permit(&models, &loaded.config);
    let health = Arc::new(HealthSlot::default());
    let sensors = live(&loaded, &models, &state_writer, &mut how, (&health, clock))?;
    let listener = sensors.as_ref().zip(sensor_socket).map(|((sensors, time), socket)| {
        let idle = Duration::from_secs_f64(loaded.config.sensors.idle_s);
        let to = (sensors.readings.clone(), Arc::clone(&sensors.lost), Arc::clone(&sensors.known));
        Listener::new(socket, to, (clock, time.clone()), idle)
    });
    let listener = listener
        .transpose()
        .map_err(|source| DaemonError::System { what: "the socket of the sensors", source })?;
    let recorder = Recorder::start(config, &loaded, &models.active, health, clock)
        .map_err(|source| DaemonError::System { what: "the recorder's thread", source })?;
    let (tap, recorder) = recorder.unzip();
    cycle_channels.tap = tap;
    // what can keep the daemon from starting is open: ports, threads, state; the rest ends it with a `stop`
    state_writer.announce(&loaded, &models.active);
    let mut service =
        Service::new(Arc::clone(&loaded), service_channels, state_writer, recorder, models, clock)
            .map_err(|_| DaemonError::Internal { what: "the statistics could not be set up" })?;
    service.sensors = sensors.map(|(sensors, _)| sensors);
    let how = Start { permitted: service.begins(how.permitted), kept_fault: service.has_kept_fault(), ..how };
    let setup = |listener| http::Setup {
        listener,
        hosts: loaded.config.http.hosts.clone(),
        token: loaded.http_token.clone(),
        verification: loaded.config.http.verification.as_ref().map(|file| config.with_file_name(file)),
    };
    let publisher = http.map(|listener| Publisher::start(setup(listener), service.snapshot(), clock));
    let publisher = publisher.transpose().map_err(|source| {
        service.finish("failed");
        DaemonError::System { what: "the thread of the HTTP service", source }
    })?;
    let (publisher, orders) = publisher.unzip();
    let service = Arc::new(Mutex::new(service));
    if let Some(orders) = orders.flatten() {
        tokio::spawn(http::serve_orders(orders, Arc::clone(&service)));
    }
    log_start(config, &loaded);
    let mut thread = CycleThread::spawn(loaded, how, cycle_channels, clock).map_err(|source| {
        service.lock().finish("failed");
        DaemonError::System { what: "the cycle thread", source }
    })?;
    let server = server.map(|server| tokio::spawn(server.run(Arc::clone(&service))));
    let listener = listener.map(|listener| tokio::spawn(listener.run()));
    notify(&[NotifyState::Ready]);

    let result = watch(&service, &progress, &mut thread, publisher, clock).await;
    notify(&[NotifyState::Stopping]);
    if let Some(server) = server {
        server.abort();
        // wait for the abort, which removes the socket's file
        let _ = server.await;
    }
    if let Some(listener) = listener {
        listener.abort();
    }
    let result = result.and_then(|()| thread.join());
    service.lock().finish(if result.is_ok() { "ok" } else { "failed" });
    match &result {
        Ok(()) => info!("stopped"),
        Err(problem) => error!("{problem}"),
    }
    result
}

/// The socket of the HTTP service, where the machine file asks for one.
fn http_listener(config: &MachineConfig) -> Result<Option<TcpListener>, DaemonError> {
    let Some(address) = config.http.listen else { return Ok(None) };
    let listener = TcpListener::bind(address)
        .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
        .map_err(|source| DaemonError::Listen { key: "http.listen", address, source })?;
    if config.http.plain_remote && !is_this_computer(address.ip()) {
        warn!(%address, "plain-remote: whoever reaches this port can see the state of the machine");
    }
    let commands = if config.http.token_file.is_some() { "with the token" } else { "none" };
    info!(%address, commands, "the page and /metrics are served");
    Ok(Some(listener))
}

/// The socket of the sensors, where the machine file lists any.
fn sensor_socket(config: &MachineConfig) -> Result<Option<TcpListener>, DaemonError> {
    let config = &config.sensors;
    let Some(address) = config.listen.filter(|_| !config.spec.sensors.is_empty()) else { return Ok(None) };
    let socket = TcpListener::bind(address)
        .and_then(|socket| socket.set_nonblocking(true).map(|()| socket))
        .map_err(|source| DaemonError::Listen { key: "sensors.listen", address, source })?;
    if config.plain_remote && !is_this_computer(address.ip()) {
        warn!(%address, "plain-remote: anyone who reaches this port can send live values, within the limits of the model");
    }
    info!(%address, "sensors connect here");
    Ok(Some(socket))
}

/// The model to start with, and whether compensation may be on from the start.
fn permit(models: &Models, config: &MachineConfig) -> Start {
    let expiry = models.active.expiry.as_deref();
    let against = guard::hindrances(&config.guard, expiry, SystemTime::now(), None);
    for (hindrance, policy) in &against {
        match policy {
            Policy::Warn => warn!("{hindrance}"),
            Policy::Refuse | Policy::RampOut => warn!("compensation stays off: {hindrance}"),
        }
    }
    let permitted = against.iter().all(|(_, policy)| *policy == Policy::Warn);
    let model = Arc::clone(&models.active.model);
    Start { model, permitted, kept_fault: false, service_silent_s: SERVICE_SILENT_S, live: None }
}

/// The estimator and its time, where the machine file lists sensors.
fn live(
    loaded: &Loaded,
    models: &Models,
    state_writer: &StateWriter,
    how: &mut Start,
    (health, clock): (&Arc<HealthSlot>, Clock),
) -> Result<Option<(Sensors, EstimatorTime)>, DaemonError> {
    let config = &loaded.config.sensors;
    if config.spec.sensors.is_empty() {
        let named = models.active.spec.sensors();
        if models.active.thermal.iter().any(|t| named.contains(&t.name.as_str())) {
            warn!(
                "the model has thermal displacements, and the machine file lists no [[sensor]]: they stay zero"
            );
        }
        return Ok(None);
    }
    let hash = *blake3::hash(models.active.text.as_bytes()).as_bytes();
    let (cycle, end) = if config.lock_step { live_ends_in_lock_step(hash) } else { live_ends(hash) };
    let time = end.time(clock);
    if config.lock_step {
        warn!("sensors.time = \"control\": each frame waits for the estimator; for a simulated control only");
    }
    how.live = Some(cycle);
    let sensors = Sensors::start(sensors::Start {
        config: config.clone(),
        machine: loaded.config.machine.clone(),
        model: Arc::clone(&models.active),
        directory: state_writer.directory().map(Path::to_owned),
        record: loaded.config.recording.directory.is_some().then(|| Arc::clone(health)),
        end,
        time: time.clone(),
    })
    .map_err(|source| DaemonError::System { what: "the estimator's thread", source })?;
    Ok(Some((sensors, time)))
}

/// Looks after everything until the cycle thread ends.
async fn watch(
    service: &Mutex<Service>,
    progress: &Progress,
    thread: &mut CycleThread,
    mut publisher: Option<Publisher>,
    clock: Clock,
) -> Result<(), DaemonError> {
    let mut watchdog = Watchdog::from_environment();
    let mut headline = Headline::default();
    let mut stuck = false;
    let mut asked: Option<Instant> = None;
    let mut told = StopWish::No;
    let mut tick = interval(TICK);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let give_up = asked.map_or_else(|| Instant::now() + STOP_LIMIT, |asked| asked + STOP_LIMIT);
        tokio::select! {
            _ = &mut thread.ended => return Ok(()),
            _ = tick.tick() => {
                let mut service = service.lock();
                service.drain();
                progress.service_beat();
                let stop = progress.stop();
                if stop > told {
                    told = stop;
                    asked.get_or_insert_with(Instant::now);
                    log_stop(stop);
                }
                let now = clock.now();
                if let Some(publisher) = publisher.as_mut().filter(|publisher| publisher.is_due(now)) {
                    publisher.publish(now, service.snapshot());
                }
                headline.show(now, || service.headline());
                let fed = watchdog.look(now, progress.beats.load(Relaxed));
                if fed == Fed::Yes {
                    notify(&[NotifyState::Watchdog]);
                } else if fed == Fed::Stuck && !stuck {
                    error!("the cycle thread does not move; the watchdog is not fed any more");
                }
                stuck = fed == Fed::Stuck || stuck && fed == Fed::NotDue;
            }
            () = sleep_until(give_up), if asked.is_some() => {
                return Err(DaemonError::CycleThread { how: "does not stop" });
            }
        }
    }
}

fn log_stop(stop: StopWish) {
    match stop {
        StopWish::No => {}
        StopWish::Clean => {
            info!("stopping: the offset is taken to its rest value, then the link is closed");
        }
        StopWish::Now => {
            warn!("stopping at once after another signal; the control's watchdog takes the offset out");
        }
    }
}

/// Path of the status socket: relative to the machine file, like every other path in it.
#[must_use]
pub fn socket_path(config_path: &Path, config: &MachineConfig) -> Option<PathBuf> {
    config.status.socket.as_ref().map(|socket| config_path.with_file_name(socket))
}

fn log_start(config: &Path, loaded: &Loaded) {
    let machine = &loaded.config;
    info!(
        version = env!("CARGO_PKG_VERSION"),
        config = %config.display(),
        machine = machine.machine,
        model = %loaded.model.origin,
        model_hash = loaded.model.hash,
        control = %machine.link.address,
        tls = loaded.identity.is_some(),
        cycle_s = machine.link.cycle_s,
        start = machine.start.name(),
        "volcompd starts"
    );
    if machine.link.is_exposed() {
        warn!(
            control = %machine.link.address,
            "plain-remote: the link leaves this computer without authentication and encryption; whoever reaches that \
             wire can move the axes within the control's limits"
        );
    }
    for (effect, fate) in &loaded.fates {
        if fate.is_taken() {
            info!(effect, %fate, "an addition of the machine file");
        } else {
            warn!(effect, %fate, "an effect of an addition stays uncorrected");
        }
    }
    for axis in &loaded.uncorrected {
        warn!(%axis, "an axis of the model without limits in the machine file: it is never offset");
    }
    for axis in &machine.axes {
        let limits = &axis.limits;
        match axis.name.kind() {
            AxisKind::Linear => info!(
                axis = %axis.name,
                size_um = limits.size * UM_PER_MM,
                rate_mm_per_s = limits.rate,
                acceleration_mm_per_s2 = limits.acceleration,
                "limits of the offset"
            ),
            AxisKind::Rotary => info!(
                axis = %axis.name,
                size_arcsec = arcsec_from_rad(limits.size),
                rate_deg_per_s = deg_from_rad(limits.rate),
                acceleration_deg_per_s2 = deg_from_rad(limits.acceleration),
                "limits of the offset"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_the_cycle_thread_is_told_from_its_end() {
        let thread = CycleThread::start(|| {}).expect("starts");
        assert!(thread.join().is_ok());
        let thread = CycleThread::start(|| panic!("on purpose")).expect("starts");
        let error = thread.join().expect_err("told");
        assert!(matches!(error, DaemonError::CycleThread { how: "panicked" }), "{error}");
    }

    #[test]
    fn the_service_hears_of_a_panic_without_asking() {
        let thread = CycleThread::start(|| panic!("on purpose")).expect("starts");
        let ended = thread.ended;
        assert!(ended.blocking_recv().is_err(), "the sender is dropped");
    }
}
