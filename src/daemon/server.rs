//! The Unix socket for status and commands.
//!
//! One JSON object per line in, one per line out. Who may open the socket may command: its mode is 0660, its
//! directory belongs to the service. Few clients, short lines, short patience: nothing here can starve the rest.
//!
//! Requests and answers: [`super::socket`]; what they lead to: [`super::command_handler`].

use std::collections::VecDeque;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::Semaphore;
use tokio::task::{JoinHandle, yield_now};
use tokio::time::{sleep, timeout};
use tracing::warn;

use super::command_handler::{Peer, carry_out};
use super::service::Service;
use super::socket::{Answer, Ask, REQUEST_BYTES_MAX, Verb};
use super::sync::Mutex;

/// Clients served at the same time.
const CLIENTS: usize = 8;
/// Requests carried out at the same time; the places beyond are for `disable`.
const ORDERS: usize = CLIENTS - 2;
/// Patience with a client that sends or takes nothing.
const PATIENCE: Duration = Duration::from_secs(2);
/// Why the socket cannot be offered.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another daemon answers there.
    #[error(
        "error: {}: another volcompd is already running there\n  \
         hint: one daemon per machine file; give each its own `socket`", path.display()
    )]
    InUse {
        /// The socket.
        path: PathBuf,
    },
    /// Something that is no socket is in the way.
    #[error("error: {}: exists and is not a socket\n  hint: name another `socket` or remove it", path.display())]
    NotASocket {
        /// The path.
        path: PathBuf,
    },
    /// The system refuses.
    #[error(
        "error: {}: {source}\n  hint: the folder must be one that the user of the daemon may write \
         (the unit makes /run/volcomp); to try things out, set `socket` in [status] to a path such as \"volcompd.sock\"",
        path.display()
    )]
    Bind {
        /// The socket.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// The bound socket; removes its file when dropped.
#[derive(Debug)]
pub(super) struct Server {
    listener: UnixListener,
    path: PathBuf,
}

impl Server {
    /// Binds the socket; a file left by a daemon that was killed is replaced.
    pub(super) fn bind(path: &Path) -> Result<Self, SocketError> {
        use std::os::unix::fs::FileTypeExt;
        let bind_error = |source| SocketError::Bind { path: path.to_owned(), source };
        match std::fs::symlink_metadata(path) {
            Ok(found) if !found.file_type().is_socket() => {
                return Err(SocketError::NotASocket { path: path.to_owned() });
            }
            Ok(_) if std::os::unix::net::UnixStream::connect(path).is_ok() => {
                return Err(SocketError::InUse { path: path.to_owned() });
            }
            Ok(_) => std::fs::remove_file(path).map_err(bind_error)?,
            Err(_) => {}
        }
        // a folder that is missing is made where the system lets us; otherwise binding says what is wrong
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            let _ = std::fs::create_dir_all(folder);
        }
        let listener = UnixListener::bind(path).map_err(bind_error)?;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o660)).map_err(bind_error)?;
        Ok(Self { listener, path: path.to_owned() })
    }

    /// Serves until dropped.
    pub(super) async fn run(self, service: Arc<Mutex<Service>>) {
        let mut places = Places::default();
        let orders = Arc::new(Semaphore::new(ORDERS));
        loop {
            let stream = match self.listener.accept().await {
                Ok((stream, _)) => stream,
                Err(error) => {
                    warn!(%error, "a client of the status socket could not be accepted");
                    sleep(Duration::from_secs(1)).await;
                    continue;
                }
            };
            if !places.make_room() {
                let _ = refuse(stream).await;
                continue;
            }
            let (service, orders, busy) =
                (Arc::clone(&service), Arc::clone(&orders), Arc::new(AtomicBool::new(false)));
            let shown = Arc::clone(&busy);
            let task = tokio::spawn(async move {
                // a client that goes away in between is its own affair
                let _ = converse(stream, &service, &orders, &shown).await;
            });
            places.clients.push_back(Client { task, busy });
            // a client whose request has come with it is served before it could be the one to make room
            yield_now().await;
        }
    }
}

/// A client being served.
#[derive(Debug)]
struct Client {
    task: JoinHandle<()>,
    /// Its request is being carried out.
    busy: Arc<AtomicBool>,
}

/// The clients being served, oldest first.
#[derive(Debug, Default)]
struct Places {
    clients: VecDeque<Client>,
}

impl Places {
    /// Makes room for one more: at the expense of the oldest client that waits or sends nothing. False where none does.
    fn make_room(&mut self) -> bool {
        self.clients.retain(|client| !client.task.is_finished());
        if self.clients.len() < CLIENTS {
            return true;
        }
        let idle = self.clients.iter().position(|client| !client.busy.load(Relaxed));
        let Some(client) = idle.and_then(|idle| self.clients.remove(idle)) else { return false };
        client.task.abort();
        true
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // a file that stays is replaced at the next start
        let _ = std::fs::remove_file(&self.path);
    }
}

async fn refuse(mut stream: UnixStream) -> io::Result<()> {
    let line = line(&Answer::refused(format!("{CLIENTS} clients are being served; try again")));
    stream.try_write(&line)?;
    stream.shutdown().await
}

async fn converse(
    mut stream: UnixStream,
    service: &Mutex<Service>,
    orders: &Semaphore,
    busy: &AtomicBool,
) -> io::Result<()> {
    let peer = stream.peer_cred().map_or(Peer::Unknown, |c| Peer::Process { uid: c.uid(), pid: c.pid() });
    let (reader, mut writer) = stream.split();
    let mut reader = BufReader::new(reader);
    loop {
        let mut request = Vec::new();
        let mut limited = (&mut reader).take(REQUEST_BYTES_MAX);
        match timeout(PATIENCE, limited.read_until(b'\n', &mut request)).await {
            Ok(Ok(1..)) => {}
            Ok(Ok(0)) | Err(_) => return Ok(()),
            Ok(Err(error)) => return Err(error),
        }
        let complete = request.ends_with(b"\n");
        if request.len() as u64 >= REQUEST_BYTES_MAX && !complete {
            let line =
                line(&Answer::refused(format!("the request is longer than {REQUEST_BYTES_MAX} bytes")));
            let _ = timeout(PATIENCE, writer.write_all(&line)).await;
            return Ok(());
        }
        let answer = match serde_json::from_slice::<Ask>(&request) {
            Ok(ask) if complete => {
                busy.store(true, Relaxed);
                let answer = in_turn(ask, service, orders, peer).await;
                busy.store(false, Relaxed);
                answer
            }
            Ok(_) => Answer::refused("the request does not end with a line feed"),
            Err(error) => Answer::refused(format!("the request is not understood: {error}")),
        };
        let again = answer.ok;
        let line = line(&answer);
        match timeout(PATIENCE, writer.write_all(&line)).await {
            Ok(Ok(())) if again => {}
            _ => return Ok(()),
        }
    }
}

/// Carries a request out; `disable` always, others where the requests in progress leave a place for it.
async fn in_turn(ask: Ask, service: &Mutex<Service>, orders: &Semaphore, peer: Peer) -> Answer {
    let _place = match orders.try_acquire() {
        Ok(place) => Some(place),
        Err(_) if ask.command == Verb::Disable => None,
        Err(_) => return Answer::refused(format!("{ORDERS} requests are being carried out; try again")),
    };
    carry_out(ask, service, peer).await
}

fn line(answer: &Answer) -> Vec<u8> {
    let mut bytes = serde_json::to_vec(answer)
        .unwrap_or_else(|e| format!("{{\"ok\":false,\"error\":\"{e}\"}}").into_bytes());
    bytes.push(b'\n');
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_in_the_way_is_not_removed() {
        let dir = tempfile::tempdir().expect("directory");
        let path = dir.path().join("data");
        std::fs::write(&path, "precious").expect("written");
        let error = Server::bind(&path).expect_err("refused");
        assert!(matches!(error, SocketError::NotASocket { .. }), "{error}");
        assert_eq!(std::fs::read_to_string(&path).expect("still there"), "precious");
    }
}
