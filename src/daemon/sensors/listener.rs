//! Connections of sensors, on the service's event loop.
//!
//! A sensor connects, sends messages and listens for sentences about those that are wrong (`{"error": ".."}`, one line
//! each, a few per second). Few connections, bounded messages; a full queue drops a reading and counts it.

use std::io;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::Sender;
use socket2::{SockRef, TcpKeepalive};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{Instant, sleep, timeout};
use tracing::{info, warn};

use super::super::clock::Clock;
use super::super::logging::LogLimiter;
use super::configured::ConfiguredSensor;
use super::lock_step::EstimatorTime;
use super::wire::{Heard, Said, Stream};
use super::{Arrived, Lost};
use volcomp_units::MonoTime;

/// Connections at the same time.
const CONNECTIONS: usize = 32;
/// Lines in the log about connections, and about what they send: so many at once, then one in each pause. A sensor that
/// connects for every reading must not flood it.
const LINES: u32 = 12;
const LINES_PAUSE: Duration = Duration::from_secs(10);
/// Silence of a connection after which its other end is asked whether it is still there.
const KEEPALIVE: Duration = Duration::from_secs(30);
/// Sentences about mistakes per second and connection.
const COMPLAINTS_PER_S: u32 = 5;
/// Patience with a sensor that does not read them.
const PATIENCE: Duration = Duration::from_millis(100);

/// What all connections have in common.
#[derive(Debug, Clone)]
struct Common {
    readings: Sender<Arrived>,
    lost: Arc<Lost>,
    known: Arc<[ConfiguredSensor]>,
    clock: Clock,
    time: EstimatorTime,
    idle: Duration,
    /// Lines in the log about connections, and about what they send.
    connections: Arc<Mutex<LogLimiter>>,
    mistakes: Arc<Mutex<LogLimiter>>,
}

/// Whether a line may be written now; with the number of lines held back since the last one.
fn admit(limiter: &Mutex<LogLimiter>, clock: Clock) -> Option<u64> {
    limiter.lock().unwrap_or_else(PoisonError::into_inner).admit(clock.now())
}

/// The bound socket.
#[derive(Debug)]
pub(crate) struct Listener {
    listener: TcpListener,
    common: Common,
}

impl Listener {
    /// On a socket that is bound; needs the event loop. A connection that says nothing for `idle` is closed.
    pub(crate) fn new(
        socket: std::net::TcpListener,
        (readings, lost, known): (Sender<Arrived>, Arc<Lost>, Arc<[ConfiguredSensor]>),
        (clock, time): (Clock, EstimatorTime),
        idle: Duration,
    ) -> io::Result<Self> {
        let listener = TcpListener::from_std(socket)?;
        let limiter = || Arc::new(Mutex::new(LogLimiter::new(LINES, LINES_PAUSE)));
        let (connections, mistakes) = (limiter(), limiter());
        let common = Common { readings, lost, known, clock, time, idle, connections, mistakes };
        Ok(Self { listener, common })
    }

    /// Serves until dropped.
    pub(crate) async fn run(self) {
        let places = Arc::new(Semaphore::new(CONNECTIONS));
        loop {
            let (mut stream, peer) = match self.listener.accept().await {
                Ok(accepted) => accepted,
                Err(error) => {
                    // once a second at most
                    warn!(%error, "a sensor's connection could not be accepted");
                    sleep(Duration::from_secs(1)).await;
                    continue;
                }
            };
            let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
                if let Some(held_back) = admit(&self.common.connections, self.common.clock) {
                    warn!(%peer, held_back, "more than {CONNECTIONS} connections of sensors; this one is closed");
                }
                let why =
                    format!("there are {CONNECTIONS} connections of sensors already; this one is closed");
                tokio::spawn(async move { reply(&mut stream, &why).await });
                continue;
            };
            let common = self.common.clone();
            tokio::spawn(async move {
                if let Some(held_back) = admit(&common.connections, common.clock) {
                    info!(%peer, held_back, "a sensor's connection is open");
                }
                let end =
                    Connection { common: &common, complaints: (Instant::now(), 0) }.converse(stream).await;
                if let Some(held_back) = admit(&common.connections, common.clock) {
                    info!(%peer, held_back, "a sensor's connection is closed: {end}");
                }
                drop(place);
            });
        }
    }
}

struct Connection<'a> {
    common: &'a Common,
    /// Begin of the present second, and sentences in it.
    complaints: (Instant, u32),
}

impl Connection<'_> {
    /// Takes readings until the connection ends; says why it did.
    async fn converse(mut self, mut stream: TcpStream) -> String {
        let _ = stream.set_nodelay(true);
        // a sensor that lost its power is noticed within a minute, one that only says nothing by `idle`
        let keepalive = TcpKeepalive::new().with_time(KEEPALIVE).with_interval(KEEPALIVE / 3).with_retries(3);
        let _ = SockRef::from(&stream).set_tcp_keepalive(&keepalive);
        let mut said = Stream::default();
        let mut buffer = vec![0; 16 * 1024];
        loop {
            let count = match timeout(self.common.idle, stream.read(&mut buffer)).await {
                Ok(Ok(0)) => return "by the sensor".to_owned(),
                Ok(Ok(count)) => count,
                Ok(Err(e)) => return e.to_string(),
                Err(_) => {
                    let why = format!(
                        "nothing was said for {} s (idle-s); the connection is closed",
                        self.common.idle.as_secs_f64()
                    );
                    reply(&mut stream, &why).await;
                    return why;
                }
            };
            let now = self.common.time.now();
            said.push(&buffer[..count]);
            while let Some(message) = said.next() {
                let problem = match message {
                    Ok(Heard::Reading(message)) => match self.pass_on(now, message) {
                        None => continue,
                        Some(problem) => problem,
                    },
                    Ok(Heard::Sync(number)) => {
                        write(&mut stream, &serde_json::json!({ "sync": number })).await;
                        continue;
                    }
                    Err(e) => {
                        let text = e.to_string();
                        if e.is_fatal() {
                            self.complain(&mut stream, &text).await;
                            return text;
                        }
                        text
                    }
                };
                self.complain(&mut stream, &problem).await;
            }
        }
    }

    /// A message goes to the estimator; gives what is wrong with it.
    fn pass_on(&self, now: MonoTime, said: Said) -> Option<String> {
        let Said { sensor, reading } = said;
        let Some(known) = self.common.known.iter().find(|known| known.name == sensor) else {
            let names: Vec<&str> = self.common.known.iter().map(|known| known.name.as_str()).collect();
            let names = names.join(", ");
            return Some(format!("sensor \"{sensor}\" is not in the machine file; it has {names}"));
        };
        // one of another kind is passed on, too: the status names the sensor that says it
        let objection = known.objection(&reading);
        if self.common.readings.try_send(Arrived { now, sensor, reading }).is_err() {
            self.common.lost.dropped.fetch_add(1, Relaxed);
        }
        objection
    }

    /// Counts a message that is refused and tells the sensor what is wrong, not too often.
    async fn complain(&mut self, stream: &mut TcpStream, problem: &str) {
        self.common.lost.refused.fetch_add(1, Relaxed);
        let (since, count) = &mut self.complaints;
        if since.elapsed() >= Duration::from_secs(1) {
            (*since, *count) = (Instant::now(), 0);
        }
        *count += 1;
        if *count > COMPLAINTS_PER_S {
            return;
        }
        if let Some(held_back) = admit(&self.common.mistakes, self.common.clock) {
            warn!(held_back, "a sensor sends what cannot be used: {problem}");
        }
        reply(stream, problem).await;
    }
}

/// One sentence to a sensor.
async fn reply(stream: &mut TcpStream, problem: &str) {
    write(stream, &serde_json::json!({ "error": problem })).await;
}

/// One line to a sensor.
async fn write(stream: &mut TcpStream, object: &serde_json::Value) {
    let mut line = object.to_string();
    line.push('\n');
    // one that does not listen is its own affair
    let _ = timeout(PATIENCE, stream.write_all(line.as_bytes())).await;
}
