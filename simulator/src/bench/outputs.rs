//! Everything that reads the daemon while its link is measured: 200 event streams of the page, a scrape of `/metrics`
//! every second, a gateway to a Mosquitto broker with a subscriber, and MTConnect clients.

use core::net::SocketAddr;
use core::time::Duration;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Instant;

use super::error::BenchError;
use super::process::{Programs, Running, start};

/// Event streams of the page.
pub const STREAMS: usize = 200;
/// MTConnect clients, as many as the gateway takes.
const AGENTS: usize = 8;
/// Interval of scrapes, and of the gateway's messages.
const INTERVAL: Duration = Duration::from_secs(1);
/// Interval of an MTConnect client's `* PING`.
const PING: Duration = Duration::from_secs(5);
/// Pause between two looks at the connections.
const PAUSE: Duration = Duration::from_millis(20);
/// Patience with the start of everything.
const PATIENCE: Duration = Duration::from_secs(20);

/// Addresses that the machine file names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Addresses {
    http: SocketAddr,
    mqtt: SocketAddr,
    mtconnect: SocketAddr,
}

/// What the readers have received.
#[derive(Debug, Default)]
pub struct Received {
    /// Bytes of the event streams.
    stream_bytes: AtomicU64,
    /// Event streams that the daemon has ended.
    streams_ended: AtomicU64,
    /// Scrapes of `/metrics` that were answered in full.
    scrapes: AtomicU64,
    /// Messages that the MQTT subscriber got.
    messages: AtomicU64,
    /// Lines that MTConnect clients got.
    lines: AtomicU64,
}

/// Switches the readers on and off, from a thread that has neither the real-time class nor the processor of the control.
#[derive(Debug)]
pub struct Switch {
    ask: Option<Sender<bool>>,
    told: Receiver<Result<(), BenchError>>,
    received: Arc<Received>,
    thread: Option<JoinHandle<()>>,
}

/// Readers at work; they end with this value.
#[derive(Debug)]
struct Outputs {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
    processes: Vec<Running>,
}

impl Addresses {
    /// Free ports of loopback.
    ///
    /// # Errors
    /// The socket's.
    pub fn free() -> Result<Self, BenchError> {
        let link = |source| BenchError::Link { peer: "outputs", source };
        let listeners = [(); 3].map(|()| TcpListener::bind(("127.0.0.1", 0)));
        let mut found = [None; 3];
        for (place, listener) in found.iter_mut().zip(listeners) {
            *place = Some(listener.and_then(|l| l.local_addr()).map_err(link)?);
        }
        let [http, mqtt, mtconnect] = found.map(|a| a.unwrap_or(([127, 0, 0, 1], 0).into()));
        Ok(Self { http, mqtt, mtconnect })
    }

    /// The tables of the machine file.
    #[must_use]
    pub fn tables(&self) -> String {
        let Self { http, mqtt, mtconnect } = self;
        format!(
            "[http]\nlisten = \"{http}\"\n[mqtt]\nbroker = \"{mqtt}\"\ninterval-s = {:?}\n[mtconnect]\nlisten = \"{mtconnect}\"\n",
            INTERVAL.as_secs_f64()
        )
    }
}

impl Received {
    /// Counts by name.
    #[must_use]
    pub fn counts(&self) -> [(&'static str, u64); 5] {
        let of = |count: &AtomicU64| count.load(Relaxed);
        [
            ("stream_bytes", of(&self.stream_bytes)),
            ("streams_ended", of(&self.streams_ended)),
            ("scrapes", of(&self.scrapes)),
            ("mqtt_messages", of(&self.messages)),
            ("mtconnect_lines", of(&self.lines)),
        ]
    }
}

impl Outputs {
    /// Starts all readers and waits until each has received something.
    fn start(
        programs: &Programs,
        addresses: Addresses,
        config: &Path,
        received: &Arc<Received>,
    ) -> Result<Self, BenchError> {
        let port = addresses.mqtt.port().to_string();
        let quiet = |command: &mut Command, what| {
            start(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()), what)
        };
        let broker =
            quiet(Command::new("mosquitto").args(["-p", &port]), "mosquitto (Debian package mosquitto)")?;
        wait_for("mosquitto", || TcpStream::connect(addresses.mqtt).is_ok())?;
        let gateway = quiet(
            Command::new(&programs.cncsim).args(["volcomp", "gateway", "--config"]).arg(config),
            "volcomp gateway",
        )?;
        let mut subscriber = start(
            Command::new("mosquitto_sub")
                .args(["-p", &port, "-t", "#"])
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .stderr(Stdio::null()),
            "mosquitto_sub (Debian package mosquitto-clients)",
        )?;
        let stop = Arc::new(AtomicBool::new(false));
        let mut outputs = Self { stop, threads: Vec::new(), processes: Vec::new() };
        let messages = subscriber.stdout();
        outputs.processes.extend([gateway, subscriber, broker]);
        outputs.spawn(received, move |_, received| {
            for _ in messages.into_iter().flat_map(|m| BufReader::new(m).split(b'\n')).map_while(Result::ok) {
                received.messages.fetch_add(1, Relaxed);
            }
        });
        outputs.spawn(received, move |stop, received| browse(addresses.http, stop, received));
        outputs.spawn(received, move |stop, received| agents(addresses.mtconnect, stop, received));
        let before = received.counts();
        wait_for("what reads the daemon", || {
            let more = |k: usize| received.counts()[k].1 > before[k].1;
            [0, 2, 3, 4].into_iter().all(more)
        })?;
        Ok(outputs)
    }

    fn spawn(
        &mut self,
        received: &Arc<Received>,
        work: impl FnOnce(&AtomicBool, &Received) + Send + 'static,
    ) {
        let (stop, received) = (Arc::clone(&self.stop), Arc::clone(received));
        self.threads.push(std::thread::spawn(move || work(&stop, &received)));
    }
}

impl Switch {
    /// Readers that are off.
    #[must_use]
    pub fn new(programs: &Programs, addresses: Addresses, config: &Path) -> Self {
        let (ask, asked) = channel::<bool>();
        let (tell, told) = channel();
        let received = Arc::new(Received::default());
        let (programs, config, counts) = (programs.clone(), config.to_owned(), Arc::clone(&received));
        let thread = std::thread::spawn(move || {
            let mut running = None;
            for on in asked {
                // those of before end first
                drop(running.take());
                let started = on.then(|| Outputs::start(&programs, addresses, &config, &counts)).transpose();
                let said = started.map(|outputs| running = outputs);
                if tell.send(said).is_err() {
                    return;
                }
            }
        });
        Self { ask: Some(ask), told, received, thread: Some(thread) }
    }

    /// Starts or ends the readers.
    ///
    /// # Errors
    /// A program does not start, or a reader receives nothing.
    pub fn set(&self, on: bool) -> Result<(), BenchError> {
        let gone = || BenchError::Tool { verb: "gateway", said: "the readers have panicked".to_owned() };
        self.ask.as_ref().ok_or_else(gone)?.send(on).map_err(|_| gone())?;
        self.told.recv().map_err(|_| gone())?
    }

    /// What was received.
    #[must_use]
    pub fn received(&self) -> &Received {
        &self.received
    }
}

impl Drop for Switch {
    fn drop(&mut self) {
        self.ask = None;
        if let Some(thread) = self.thread.take() {
            // a thread that panicked has said so
            let _ = thread.join();
        }
    }
}

impl Drop for Outputs {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        self.processes.clear();
        for thread in self.threads.drain(..) {
            // a reader that panicked has been missed before
            let _ = thread.join();
        }
    }
}

fn wait_for(what: &'static str, mut done: impl FnMut() -> bool) -> Result<(), BenchError> {
    let deadline = Instant::now() + PATIENCE;
    while !done() {
        if Instant::now() > deadline {
            return Err(BenchError::Timeout { peer: what, what: "answer", limit_s: PATIENCE.as_secs_f64() });
        }
        std::thread::sleep(PAUSE);
    }
    Ok(())
}

/// A connection that never waits; `None` where it is refused.
fn open(address: SocketAddr, request: &str) -> Option<TcpStream> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.write_all(request.as_bytes()).ok()?;
    stream.set_nonblocking(true).ok()?;
    Some(stream)
}

/// Reads what is there; gives the bytes, and whether the connection is still open.
fn drain(stream: &mut TcpStream, buffer: &mut [u8], mut visit: impl FnMut(&[u8])) -> bool {
    loop {
        match stream.read(buffer) {
            Ok(0) => return false,
            Ok(count) => visit(&buffer[..count]),
            Err(e) if e.kind() == ErrorKind::WouldBlock => return true,
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(_) => return false,
        }
    }
}

fn get(address: SocketAddr, path: &str, more: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n{more}\r\n")
}

/// The event streams, and a scrape every interval.
fn browse(address: SocketAddr, stop: &AtomicBool, received: &Received) {
    let events = get(address, "/api/v1/events", "");
    let scrape = get(address, "/metrics", "Connection: close\r\n");
    let mut streams: Vec<TcpStream> = (0..STREAMS).filter_map(|_| open(address, &events)).collect();
    received.streams_ended.fetch_add((STREAMS - streams.len()) as u64, Relaxed);
    let mut buffer = vec![0; 1 << 16];
    let (mut pending, mut next): (Option<(TcpStream, u64)>, _) = (None, Instant::now());
    while !stop.load(Relaxed) {
        streams.retain_mut(|stream| {
            let is_open = drain(stream, &mut buffer, |bytes| {
                received.stream_bytes.fetch_add(bytes.len() as u64, Relaxed);
            });
            received.streams_ended.fetch_add(u64::from(!is_open), Relaxed);
            is_open
        });
        if Instant::now() >= next && pending.is_none() {
            next += INTERVAL;
            pending = open(address, &scrape).map(|stream| (stream, 0));
        }
        if let Some((stream, bytes)) = &mut pending
            && !drain(stream, &mut buffer, |found| *bytes += found.len() as u64)
        {
            received.scrapes.fetch_add(u64::from(*bytes > 1000), Relaxed);
            pending = None;
        }
        std::thread::sleep(PAUSE);
    }
}

/// The MTConnect clients.
fn agents(address: SocketAddr, stop: &AtomicBool, received: &Received) {
    let mut clients: Vec<TcpStream> = Vec::new();
    let (mut buffer, mut next) = (vec![0; 1 << 14], Instant::now());
    while !stop.load(Relaxed) {
        if clients.len() < AGENTS {
            clients.extend(open(address, ""));
        }
        if Instant::now() >= next {
            next += PING;
            clients.retain_mut(|client| client.write_all(b"* PING\n").is_ok());
        }
        clients.retain_mut(|client| {
            drain(client, &mut buffer, |bytes| {
                let lines = bytes.iter().filter(|b| **b == b'\n').count();
                received.lines.fetch_add(lines as u64, Relaxed);
            })
        });
        std::thread::sleep(PAUSE);
    }
}
