//! What the daemon says, for shop-floor systems: published by MQTT, and as an MTConnect adapter (SHDR).
//!
//! A process of its own (`volcomp gateway`) that asks the daemon's status socket, so that nothing of it runs beside the
//! cycle. It is read-only: nothing that a broker or an agent sends can command. Clients, lines, queues and times are bounded.
//!
//! Reading order: [`run`], [`mtconnect`] (lines of SHDR, then the clients), [`mqtt`].

#![expect(clippy::disallowed_methods, reason = "the shell: sockets, files and the clock")]

pub mod mqtt;
pub mod mtconnect;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};
use volcomp_config::MachineConfig;
use volcomp_daemon::Status;
use volcomp_daemon::client;

/// Interval at which the daemon is asked where nothing shorter is wanted.
const ASK: Duration = Duration::from_secs(1);
/// Patience with the outputs when the gateway is stopped.
const FAREWELL: Duration = Duration::from_secs(2);

/// The last status; `None` while the daemon does not answer.
pub type Reading = Option<Arc<Status>>;
/// Where the gateway reports what happens to it, a line each.
pub type Report = Arc<dyn Fn(&str) + Send + Sync>;

/// Why there is no gateway.
#[derive(Debug, thiserror::Error)]
pub enum GatewayError {
    /// Neither output is asked for.
    #[error(
        "error: {}: nothing to do\n  hint: write [mqtt] with `broker = \"127.0.0.1:1883\"`, or [mtconnect] with \
         `listen = \"127.0.0.1:7872\"`", file.display()
    )]
    NothingToDo {
        /// The machine file.
        file: PathBuf,
    },
    /// The address is taken, or not one of this computer.
    #[error(
        "error: mtconnect.listen {address}: {source}\n  hint: choose a free port of an address of this computer"
    )]
    Listen {
        /// The address.
        address: std::net::SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// The password cannot be read.
    #[error("error: {}: {source}\n  hint: mqtt.password-file is seen from the machine file; its first line is the password", file.display())]
    Password {
        /// The file.
        file: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// No runtime or no signals.
    #[error("error: {0}")]
    System(#[from] io::Error),
}

/// Runs until SIGTERM or SIGINT. `file` is the machine file that `config` was read from, `socket` the daemon's.
///
/// # Errors
/// See [`GatewayError`].
pub fn run(config: &MachineConfig, file: &Path, socket: PathBuf, report: Report) -> Result<(), GatewayError> {
    if config.mqtt.is_none() && config.mtconnect.listen.is_none() {
        return Err(GatewayError::NothingToDo { file: file.to_owned() });
    }
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?
        .block_on(serve(config, file, socket, report))
}

async fn serve(
    config: &MachineConfig,
    file: &Path,
    socket: PathBuf,
    report: Report,
) -> Result<(), GatewayError> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    let (sender, readings) = watch::channel::<Reading>(None);
    let (stop, stopped) = watch::channel(false);
    let mut ask = ASK;
    let mut outputs = tokio::task::JoinSet::new();
    if let Some(mqtt) = &config.mqtt {
        let every = Duration::from_secs_f64(mqtt.interval_s);
        ask = ask.min(every);
        let publisher = mqtt::Publisher::new(mqtt, file, &config.machine)?;
        report(&format!("publishing to {}:{} below {}", mqtt.broker.0, mqtt.broker.1, publisher.topic()));
        outputs.spawn(publisher.run(readings.clone(), stopped.clone(), Arc::clone(&report)));
    }
    if let Some(address) = config.mtconnect.listen {
        let listener =
            TcpListener::bind(address).await.map_err(|source| GatewayError::Listen { address, source })?;
        report(&format!("MTConnect adapter on {address}"));
        outputs.spawn(mtconnect::serve(listener, readings, stopped));
    }
    let asking = poll(socket, ask, sender, report);
    tokio::select! {
        () = asking => {}
        _ = terminate.recv() => {}
        _ = interrupt.recv() => {}
    }
    // the outputs say goodbye
    let _ = stop.send(true);
    let all = async { while outputs.join_next().await.is_some() {} };
    let _ = tokio::time::timeout(FAREWELL, all).await;
    Ok(())
}

/// Asks the daemon at an interval for as long as somebody listens.
async fn poll(socket: PathBuf, every: Duration, sender: watch::Sender<Reading>, report: Report) {
    let mut ticks = interval(every);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut answered = None;
    while !sender.is_closed() {
        ticks.tick().await;
        let asked = socket.clone();
        let answer = tokio::task::spawn_blocking(move || client::status(&asked)).await;
        let reading = match answer {
            Ok(Ok(status)) => Ok(Arc::new(status)),
            Ok(Err(error)) => Err(error.to_string()),
            Err(error) => Err(error.to_string()),
        };
        if answered != Some(reading.is_ok()) {
            answered = Some(reading.is_ok());
            match &reading {
                Ok(status) => report(&format!("volcompd of {} answers", status.machine)),
                Err(error) => report(error),
            }
        }
        sender.send_replace(reading.ok());
    }
}

/// The wish to stop, or that nobody can have it any more.
async fn wish(stopped: &mut watch::Receiver<bool>) {
    // the guard must not live across an await
    let _ = stopped.wait_for(|stop| *stop).await.map(drop);
}

/// Limits how often the same thing is reported.
#[derive(Debug, Default)]
struct Seldom {
    last: Option<(String, Instant)>,
}

impl Seldom {
    /// True where `text` is another one, or was reported a minute ago.
    fn is_due(&mut self, text: &str, now: Instant) -> bool {
        let due = self.last.as_ref().is_none_or(|(last, at)| {
            last != text || now.saturating_duration_since(*at) >= Duration::from_secs(60)
        });
        if due {
            self.last = Some((text.to_owned(), now));
        }
        due
    }
}
