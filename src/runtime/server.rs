//! The Unix socket for status and commands.
//!
//! One JSON object per line in, one per line out. Who may open the socket may command: its mode is 0660, its
//! directory belongs to the service. Few clients, short lines, short patience: nothing here can starve the rest.
//!
//! Requests: `{"command": "status" | "histograms" | "enable" | "disable" | "clear-fault"}`, with a `"reason"` for the
//! audit log where there is one. Answers: `{"ok": true, "state": ..}`, with `"status": {..}` or `"histograms": {..}` for
//! the first two, or `{"ok": false, "error": ".."}`.

use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tracing::{info, warn};

use super::audit::{AuditEntry, Who};
use super::latency::Histograms;
use super::ports::Request;
use super::service::Service;
use super::status::Status;
use crate::core::engine::Command;

/// Clients served at the same time.
const CLIENTS: usize = 8;
/// Longest request line, bytes.
const LINE_MAX: u64 = 1024;
/// Patience with a client that sends or takes nothing.
const PATIENCE: Duration = Duration::from_secs(2);
/// Patience with the cycle thread to carry a command out.
const COMMAND_LIMIT: Duration = Duration::from_secs(2);
/// Time for at least one cycle to show a command's effect.
const SETTLE: Duration = Duration::from_millis(50);

/// What a client asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Verb {
    Status,
    Histograms,
    Enable,
    Disable,
    ClearFault,
}

/// One request line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Ask {
    pub(super) command: Verb,
    /// Why, for the audit log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) reason: Option<String>,
}

/// One answer line.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Answer {
    pub(super) ok: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) state: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) status: Option<Box<Status>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) histograms: Option<Box<Histograms>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) error: Option<String>,
}

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
        let places = Arc::new(Semaphore::new(CLIENTS));
        loop {
            let stream = match self.listener.accept().await {
                Ok((stream, _)) => stream,
                Err(error) => {
                    warn!(%error, "a client of the status socket could not be accepted");
                    sleep(Duration::from_secs(1)).await;
                    continue;
                }
            };
            match Arc::clone(&places).try_acquire_owned() {
                Ok(place) => {
                    let service = Arc::clone(&service);
                    tokio::spawn(async move {
                        // a client that goes away in between is its own affair
                        let _ = converse(stream, &service).await;
                        drop(place);
                    });
                }
                Err(_) => {
                    let _ = refuse(stream).await;
                }
            }
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // a file that stays is replaced at the next start
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Locks the service; a task that panicked while it held the lock does not stop the others.
pub(super) fn lock(service: &Mutex<Service>) -> MutexGuard<'_, Service> {
    service.lock().unwrap_or_else(PoisonError::into_inner)
}

async fn refuse(mut stream: UnixStream) -> io::Result<()> {
    let line = line(&failure(format!("{CLIENTS} clients are being served; try again")));
    stream.try_write(&line)?;
    stream.shutdown().await
}

async fn converse(mut stream: UnixStream, service: &Mutex<Service>) -> io::Result<()> {
    let peer = stream.peer_cred().map(|c| (c.uid(), c.pid())).ok();
    let (reader, mut writer) = stream.split();
    let mut reader = BufReader::new(reader);
    loop {
        let mut request = Vec::new();
        let mut limited = (&mut reader).take(LINE_MAX);
        match timeout(PATIENCE, limited.read_until(b'\n', &mut request)).await {
            Ok(Ok(1..)) => {}
            Ok(Ok(0)) | Err(_) => return Ok(()),
            Ok(Err(error)) => return Err(error),
        }
        let complete = request.ends_with(b"\n");
        let answer = match serde_json::from_slice::<Ask>(&request) {
            Ok(ask) if complete => carry_out(ask, service, peer).await,
            Ok(_) => failure("the request does not end with a line feed".to_owned()),
            Err(error) => failure(format!("the request is not understood: {error}")),
        };
        let again = answer.ok;
        let line = line(&answer);
        match timeout(PATIENCE, writer.write_all(&line)).await {
            Ok(Ok(())) if again => {}
            _ => return Ok(()),
        }
    }
}

async fn carry_out(ask: Ask, service: &Mutex<Service>, peer: Option<(u32, Option<i32>)>) -> Answer {
    let (what, command) = match ask.command {
        Verb::Status => {
            let status = lock(service).status();
            return Answer {
                ok: true,
                state: Some(status.state.clone()),
                status: Some(Box::new(status)),
                ..Answer::default()
            };
        }
        Verb::Histograms => {
            let mut service = lock(service);
            let histograms = Some(Box::new(service.histograms()));
            return Answer {
                ok: true,
                state: Some(service.state().to_owned()),
                histograms,
                ..Answer::default()
            };
        }
        Verb::Enable => ("enable", Command::Enable),
        Verb::Disable => ("disable", Command::Disable),
        Verb::ClearFault => ("clear-fault", Command::ClearFault),
    };
    let (uid, pid) = peer.map_or((None, None), |(uid, pid)| (Some(uid), pid));
    info!(command = ?ask.command, uid, pid, reason = ask.reason, "command");
    let answer = order(command, service).await;
    let service = lock(service);
    let result = answer.state.as_ref().or(answer.error.as_ref());
    service.audit().write(AuditEntry {
        who: Who::client(uid, pid),
        what: what.to_owned(),
        why: ask.reason,
        new_model: Some(service.model_hash().to_owned()),
        result: result.cloned().unwrap_or_default(),
        ..AuditEntry::default()
    });
    answer
}

/// Passes a command to the cycle thread and waits until it shows.
async fn order(command: Command, service: &Mutex<Service>) -> Answer {
    let Some(number) = lock(service).request(Request::Engine(command)) else {
        return failure("too many commands are waiting; try again".to_owned());
    };
    let done = async {
        while !lock(service).is_done(number) {
            sleep(Duration::from_millis(2)).await;
        }
    };
    if timeout(COMMAND_LIMIT, done).await.is_err() {
        return failure(format!("the cycle thread did not answer within {} s", COMMAND_LIMIT.as_secs()));
    }
    sleep(SETTLE).await;
    let mut service = lock(service);
    service.drain();
    Answer { ok: true, state: Some(service.state().to_owned()), ..Answer::default() }
}

fn failure(error: String) -> Answer {
    Answer { ok: false, error: Some(error), ..Answer::default() }
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
    fn requests_are_read_to_the_letter() {
        let ask: Ask = serde_json::from_str(r#"{"command": "clear-fault"}"#).expect("known");
        assert_eq!(ask.command, Verb::ClearFault);
        assert_eq!(ask.reason, None);
        let ask: Ask = serde_json::from_str(r#"{"command": "enable", "reason": "warm"}"#).expect("known");
        assert_eq!(ask.reason.as_deref(), Some("warm"));
        for wrong in [r#"{"command": "Enable"}"#, r#"{"command": "enable", "force": true}"#, "{}", "[]"] {
            assert!(serde_json::from_str::<Ask>(wrong).is_err(), "{wrong}");
        }
    }

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
