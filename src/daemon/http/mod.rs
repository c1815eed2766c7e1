//! The HTTP service: the page for operators, `/metrics`, and the status as JSON and as server-sent events.
//!
//! It runs on a thread of its own with the lowest share of the processor. Once a second the service hands it a
//! [`Snapshot`]; the answers are written once for each snapshot, so that their cost does not grow with the clients.
//! Connections, request heads, times and event streams are bounded. Nothing here can command.

mod metrics;
mod routes;
mod snapshot;

use std::io;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use socket2::SockRef;
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, watch};
use tokio::time::{sleep, timeout};
use tracing::warn;

use super::clock::Clock;
use super::sync;
use routes::Shared;
use volcomp_config::HttpConfig;
use volcomp_units::MonoTime;

use snapshot::{History, Rendered};
pub(super) use snapshot::{LatencyTotals, Snapshot};

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

/// The service's end.
#[derive(Debug)]
pub(super) struct Publisher {
    sender: watch::Sender<Arc<Snapshot>>,
    published: MonoTime,
}

impl Publisher {
    /// Starts the thread, which ends when the publisher is dropped.
    pub(super) fn start(
        listener: TcpListener,
        config: &HttpConfig,
        first: Snapshot,
        clock: Clock,
    ) -> io::Result<Self> {
        let (sender, receiver) = watch::channel(Arc::new(first));
        let hosts = config.hosts.clone();
        sync::spawn("volcomp-http", move || {
            // the cycle and the service come first; without the permission it runs as they do
            let _ = rustix::process::setpriority_process(None, NICE);
            if let Err(error) = run(listener, receiver, hosts) {
                warn!(%error, "the HTTP service ends; compensation goes on without it");
            }
        })?;
        Ok(Self { sender, published: clock.now() })
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
    hosts: Vec<String>,
) -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        let (sender, rendered) = watch::channel(Arc::default());
        tokio::select! {
            () = render(snapshots, sender) => {}
            () = accept(listener, Arc::new(Shared::new(rendered, hosts))) => {}
        }
        Ok(())
    })
}

/// Writes the answers of each snapshot; ends with the publisher.
async fn render(mut snapshots: watch::Receiver<Arc<Snapshot>>, rendered: watch::Sender<Arc<Rendered>>) {
    let mut history = History::default();
    loop {
        let snapshot = Arc::clone(&snapshots.borrow_and_update());
        history.push(&snapshot.status);
        rendered.send_replace(Arc::new(Rendered::new(&snapshot, &history)));
        if snapshots.changed().await.is_err() {
            return;
        }
    }
}

async fn accept(listener: tokio::net::TcpListener, shared: Arc<Shared>) {
    let places = Arc::new(Semaphore::new(CONNECTIONS));
    let router = routes::router(&shared);
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // no more descriptors or the like: once a second at most
            sleep(Duration::from_secs(1)).await;
            continue;
        };
        // one too many is closed at once
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else { continue };
        let service = TowerToHyperService::new(router.clone());
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
