//! The HTTP service: the page for operators, `/metrics`, and the status as JSON and as server-sent events.
//!
//! It runs on a thread of its own with the lowest share of the processor. Once a second the service hands it a
//! [`Snapshot`]; the answers are written once for each snapshot, so that their cost does not grow with the clients.
//! Connections, request heads, times and event streams are bounded. Commands need a token that the machine file names;
//! they are handed to the service and carried out there.

mod commands;
mod metrics;
mod routes;
mod snapshot;
mod token;
mod verification;
mod volume;

use std::io;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use socket2::SockRef;
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, watch};
use tokio::time::{sleep, timeout};
use tracing::warn;

use super::clock::Clock;
use super::sync;
use commands::{Client, Commands};
use routes::Shared;
use volcomp_units::MonoTime;

pub(super) use commands::{Orders, serve_orders};
use snapshot::{History, Rendered, Slow};
pub(super) use snapshot::{LatencyTotals, Snapshot};
pub use token::{Token, TokenError, http_token};
pub use verification::Verification;

/// Connections at the same time.
const CONNECTIONS: usize = 256;
/// Of these: event streams.
const STREAMS: usize = 224;
/// Longest request head, bytes.
const HEAD_MAX: usize = 16 << 10;
/// Header lines of a request.
const HEADERS_MAX: usize = 64;
/// Time for a request head, and between two requests of a connection.
const HEAD_PATIENCE: Duration = Duration::from_secs(5);
/// Time in which a client must acknowledge what was sent to it.
const SEND_PATIENCE: Duration = Duration::from_secs(20);
/// Longest connection; a browser connects anew by itself.
const LIFE: Duration = Duration::from_secs(3600);
/// Interval between two snapshots, s.
const PUBLISH_S: f64 = 1.0;
/// Nice value of the thread.
const NICE: i32 = 10;

/// What the thread works with.
#[derive(Debug)]
pub(super) struct Setup {
    pub(super) listener: TcpListener,
    /// Names by which browsers may address the service.
    pub(super) hosts: Vec<String>,
    /// What commands need; `None`: read-only.
    pub(super) token: Option<Token>,
    /// The file of the last verification.
    pub(super) verification: Option<PathBuf>,
}

/// The service's end.
#[derive(Debug)]
pub(super) struct Publisher {
    sender: watch::Sender<Arc<Snapshot>>,
    published: MonoTime,
}

impl Publisher {
    /// Starts the thread, which ends when the publisher is dropped; gives the orders of its clients, where it takes any.
    pub(super) fn start(setup: Setup, first: Snapshot, clock: Clock) -> io::Result<(Self, Option<Orders>)> {
        let (sender, receiver) = watch::channel(Arc::new(first));
        let Setup { listener, hosts, token, verification } = setup;
        let (commands, orders) = token.map(|token| Commands::new(token, clock)).unzip();
        sync::spawn("volcomp-http", move || {
            // the cycle and the service come first; without the permission it runs as they do
            let _ = rustix::process::setpriority_process(None, NICE);
            if let Err(error) =
                run(listener, receiver, verification.as_deref(), |r| Shared::new(r, hosts, commands))
            {
                warn!(%error, "the HTTP service ends; compensation goes on without it");
            }
        })?;
        Ok((Self { sender, published: clock.now() }, orders))
    }

    /// Whether it is time for a snapshot.
    pub(super) fn is_due(&self, now: MonoTime) -> bool {
        now.seconds_since(self.published) >= PUBLISH_S
    }

    /// Hands a snapshot over; never waits.
    pub(super) fn publish(&mut self, now: MonoTime, snapshot: Snapshot) {
        self.published = now;
        self.sender.send_replace(Arc::new(snapshot));
    }
}

fn run(
    listener: TcpListener,
    snapshots: watch::Receiver<Arc<Snapshot>>,
    verification: Option<&Path>,
    shared: impl FnOnce(watch::Receiver<Arc<Rendered>>) -> Shared,
) -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        let (sender, rendered) = watch::channel(Arc::default());
        tokio::select! {
            () = render(snapshots, sender, verification) => {}
            () = accept(listener, Arc::new(shared(rendered))) => {}
        }
        Ok(())
    })
}

/// Writes the answers of each snapshot; ends with the publisher.
async fn render(
    mut snapshots: watch::Receiver<Arc<Snapshot>>,
    rendered: watch::Sender<Arc<Rendered>>,
    verification: Option<&Path>,
) {
    let (mut history, mut slow) = (History::default(), Slow::default());
    loop {
        let snapshot = Arc::clone(&snapshots.borrow_and_update());
        history.push(&snapshot.status);
        slow.look(&snapshot.model, verification);
        rendered.send_replace(Arc::new(Rendered::new(&snapshot, &history, &slow)));
        if snapshots.changed().await.is_err() {
            return;
        }
    }
}

async fn accept(listener: tokio::net::TcpListener, shared: Arc<Shared>) {
    let places = Arc::new(Semaphore::new(CONNECTIONS));
    let router = routes::router(&shared);
    loop {
        let Ok((stream, client)) = listener.accept().await else {
            // no more descriptors or the like: once a second at most
            sleep(Duration::from_secs(1)).await;
            continue;
        };
        // one too many is closed at once
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else { continue };
        let router = TowerToHyperService::new(router.clone());
        let service = service_fn(move |mut request: Request<Incoming>| {
            request.extensions_mut().insert(Client(client.ip()));
            router.call(request)
        });
        tokio::spawn(async move {
            prepare(&stream);
            let connection = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEAD_PATIENCE)
                .max_headers(HEADERS_MAX)
                .max_buf_size(HEAD_MAX)
                .serve_connection(TokioIo::new(stream), service);
            // a client that goes away or sends nonsense is its own affair
            let _ = timeout(LIFE, connection).await;
            drop(place);
        });
    }
}

/// A client that takes nothing is given up by the kernel. Without the options it costs its place for longer.
fn prepare(stream: &TcpStream) {
    let socket = SockRef::from(stream);
    let _ = socket.set_tcp_user_timeout(Some(SEND_PATIENCE));
    let _ = socket.set_tcp_nodelay(true);
}
