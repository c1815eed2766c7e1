//! The other end of the status socket, for the command line.

use std::io::{self, BufRead, BufReader, ErrorKind, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::latency::Histograms;
use super::sensors::FilterStatus;
use super::socket::{Answer, Ask, Verb};
use super::status::Status;

/// Patience with the daemon.
const PATIENCE: Duration = Duration::from_secs(5);
/// Patience where it has to compare two models.
const COMPARISON: Duration = Duration::from_secs(120);

/// Why nobody answers at a socket.
fn reason(error: &io::Error) -> String {
    match error.kind() {
        ErrorKind::NotFound => "no such socket".to_owned(),
        ErrorKind::ConnectionRefused => "nobody listens at the socket".to_owned(),
        _ => error.to_string(),
    }
}

/// Why the daemon did not answer.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// Nobody listens.
    #[error(
        "error: {}: volcompd is not running ({})\n  \
         hint: start it (`systemctl start volcompd`), or name its machine file with --config or its socket \
         with --socket", socket.display(), reason(source)
    )]
    NotRunning {
        /// The socket.
        socket: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Not allowed.
    #[error(
        "error: {}: permission denied\n  hint: join the group of the socket, or run this as its owner",
        socket.display()
    )]
    Denied {
        /// The socket.
        socket: PathBuf,
    },
    /// The conversation broke off.
    #[error("error: {}: {source}", socket.display())]
    Io {
        /// The socket.
        socket: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The daemon ended, or was ended, before it answered.
    #[error(
        "error: {}: volcompd ended, or closed the connection, before it answered\n  \
         hint: `volcomp status`, once it runs again, tells whether the request was carried out", socket.display()
    )]
    Ended {
        /// The socket.
        socket: PathBuf,
    },
    /// What came back is no answer of a volcompd.
    #[error("error: {}: not an answer of volcompd ({source})\n  hint: are both of the same version?", socket.display())]
    NotUnderstood {
        /// The socket.
        socket: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// The daemon refuses.
    #[error("error: {}: {message}", socket.display())]
    Refused {
        /// The socket.
        socket: PathBuf,
        /// Its words.
        message: String,
    },
}

/// Asks for the status.
///
/// # Errors
/// See [`ClientError`].
pub fn status(socket: &Path) -> Result<Status, ClientError> {
    let answer = ask(socket, &Ask::default())?;
    answer.status.map(|status| *status).ok_or_else(|| refused(socket, answer.error))
}

/// Asks for the latency histograms of the present link.
///
/// # Errors
/// See [`ClientError`].
pub fn histograms(socket: &Path) -> Result<Histograms, ClientError> {
    let answer = ask(socket, &Ask { command: Verb::Histograms, ..Ask::default() })?;
    answer.histograms.map(|histograms| *histograms).ok_or_else(|| refused(socket, answer.error))
}

/// Asks for sensors and maps with their nodes.
///
/// # Errors
/// See [`ClientError`].
pub fn filter(socket: &Path) -> Result<FilterStatus, ClientError> {
    let answer = ask(socket, &Ask { command: Verb::Filter, ..Ask::default() })?;
    answer.filter.map(|filter| *filter).ok_or_else(|| refused(socket, answer.error))
}

fn refused(socket: &Path, message: Option<String>) -> ClientError {
    let message = message.unwrap_or_else(|| "an answer without content".to_owned());
    ClientError::Refused { socket: socket.to_owned(), message }
}

/// Sends a request; an answer that is not ok is an error.
///
/// # Errors
/// See [`ClientError`].
pub fn ask(socket: &Path, request: &Ask) -> Result<Answer, ClientError> {
    let io_error = |source: io::Error| ClientError::Io { socket: socket.to_owned(), source };
    let not_understood = |source| ClientError::NotUnderstood { socket: socket.to_owned(), source };
    let mut stream = UnixStream::connect(socket).map_err(|source| match source.kind() {
        ErrorKind::PermissionDenied => ClientError::Denied { socket: socket.to_owned() },
        _ => ClientError::NotRunning { socket: socket.to_owned(), source },
    })?;
    // two models are compared over the whole working volume
    let patience = if request.command == Verb::Load { COMPARISON } else { PATIENCE };
    stream.set_read_timeout(Some(patience)).map_err(io_error)?;
    stream.set_write_timeout(Some(PATIENCE)).map_err(io_error)?;
    let mut line = serde_json::to_vec(request).map_err(not_understood)?;
    line.push(b'\n');
    stream.write_all(&line).map_err(io_error)?;
    let mut answer = String::new();
    BufReader::new(stream).read_line(&mut answer).map_err(io_error)?;
    // an answer is a line: without its end nobody is there any more
    if !answer.ends_with('\n') {
        return Err(ClientError::Ended { socket: socket.to_owned() });
    }
    let answer: Answer = serde_json::from_str(&answer).map_err(not_understood)?;
    if answer.ok { Ok(answer) } else { Err(refused(socket, answer.error)) }
}
