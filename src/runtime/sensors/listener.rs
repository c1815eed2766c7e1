//! Connections of sensors, on the service's event loop.
//!
//! A sensor connects, sends messages and listens for sentences about those that are wrong (`{"error": ".."}`, one line
//! each, a few per second). Few connections, bounded messages; a full queue drops a reading and counts it.

use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::Sender;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{Instant, sleep, timeout};
use tracing::{info, warn};

use super::super::clock::Clock;
use super::super::logging::LogLimiter;
use super::Arrived;
use super::wire::Stream;

/// Connections at the same time.
const CONNECTIONS: usize = 32;
/// Lines in the log about connections, and about what they send: so many at once, then one in each pause. A sensor that
/// connects for every reading must not flood it.
const LINES: u32 = 12;
const LINES_PAUSE: Duration = Duration::from_secs(10);
/// Sentences about mistakes per second and connection.
const COMPLAINTS_PER_S: u32 = 5;
/// Patience with a sensor that does not read them.
const PATIENCE: Duration = Duration::from_millis(100);

/// Lines in the log of all connections together.
#[derive(Debug, Clone)]
struct Lines {
    connections: Arc<Mutex<LogLimiter>>,
    mistakes: Arc<Mutex<LogLimiter>>,
}

impl Lines {
    fn new() -> Self {
        let limiter = || Arc::new(Mutex::new(LogLimiter::new(LINES, LINES_PAUSE)));
        Self { connections: limiter(), mistakes: limiter() }
    }
}

/// Whether a line may be written now; with the number of lines held back since the last one.
fn admit(limiter: &Mutex<LogLimiter>, clock: Clock) -> Option<u64> {
    limiter.lock().unwrap_or_else(PoisonError::into_inner).admit(clock.now())
}

/// The bound socket.
#[derive(Debug)]
pub(in crate::runtime) struct Listener {
    listener: TcpListener,
    readings: Sender<Arrived>,
    dropped: Arc<AtomicU64>,
    known: Arc<[String]>,
    clock: Clock,
}

impl Listener {
    /// Binds `address`; needs the event loop.
    pub(in crate::runtime) async fn bind(
        address: SocketAddr,
        readings: Sender<Arrived>,
        dropped: Arc<AtomicU64>,
        known: Arc<[String]>,
        clock: Clock,
    ) -> io::Result<Self> {
        let listener = TcpListener::bind(address).await?;
        info!(%address, "sensors connect here");
        Ok(Self { listener, readings, dropped, known, clock })
    }

    /// Serves until dropped.
    pub(in crate::runtime) async fn run(self) {
        let places = Arc::new(Semaphore::new(CONNECTIONS));
        let lines = Lines::new();
        loop {
            let (stream, peer) = match self.listener.accept().await {
                Ok(accepted) => accepted,
                Err(error) => {
                    // once a second at most
                    warn!(%error, "a sensor's connection could not be accepted");
                    sleep(Duration::from_secs(1)).await;
                    continue;
                }
            };
            let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
                if let Some(held_back) = admit(&lines.connections, self.clock) {
                    warn!(%peer, held_back, "more than {CONNECTIONS} connections of sensors; this one is closed");
                }
                continue;
            };
            let connection = Connection {
                readings: self.readings.clone(),
                dropped: Arc::clone(&self.dropped),
                known: Arc::clone(&self.known),
                clock: self.clock,
                lines: lines.clone(),
                complaints: (Instant::now(), 0),
            };
            let (lines, clock) = (lines.connections.clone(), self.clock);
            tokio::spawn(async move {
                if let Some(held_back) = admit(&lines, clock) {
                    info!(%peer, held_back, "a sensor's connection is open");
                }
                let end = connection.converse(stream).await;
                if let Some(held_back) = admit(&lines, clock) {
                    info!(%peer, held_back, "a sensor's connection is closed: {end}");
                }
                drop(place);
            });
        }
    }
}

struct Connection {
    readings: Sender<Arrived>,
    dropped: Arc<AtomicU64>,
    known: Arc<[String]>,
    clock: Clock,
    lines: Lines,
    /// Begin of the present second, and sentences in it.
    complaints: (Instant, u32),
}

impl Connection {
    /// Takes readings until the connection ends; says why it did.
    async fn converse(mut self, mut stream: TcpStream) -> String {
        let _ = stream.set_nodelay(true);
        let mut said = Stream::default();
        let mut buffer = vec![0; 16 * 1024];
        loop {
            let count = match stream.read(&mut buffer).await {
                Ok(0) => return "by the sensor".to_owned(),
                Ok(count) => count,
                Err(e) => return e.to_string(),
            };
            let now = self.clock.now();
            said.push(&buffer[..count]);
            while let Some(message) = said.next() {
                let problem = match message {
                    Ok(message) if self.known.contains(&message.sensor) => {
                        let arrived = Arrived { now, sensor: message.sensor, reading: message.reading };
                        if self.readings.try_send(arrived).is_err() {
                            self.dropped.fetch_add(1, Relaxed);
                        }
                        continue;
                    }
                    Ok(message) => format!(
                        "sensor \"{}\" is not in the machine file; it has {}",
                        message.sensor,
                        self.known.join(", ")
                    ),
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

    /// Tells the sensor what is wrong, not too often.
    async fn complain(&mut self, stream: &mut TcpStream, problem: &str) {
        let (since, count) = &mut self.complaints;
        if since.elapsed() >= Duration::from_secs(1) {
            (*since, *count) = (Instant::now(), 0);
        }
        *count += 1;
        if *count > COMPLAINTS_PER_S {
            return;
        }
        if let Some(held_back) = admit(&self.lines.mistakes, self.clock) {
            warn!(held_back, "a sensor sends what cannot be used: {problem}");
        }
        let mut line = serde_json::json!({ "error": problem }).to_string();
        line.push('\n');
        // one that does not listen is its own affair
        let _ = timeout(PATIENCE, stream.write_all(line.as_bytes())).await;
    }
}
