//! The daemon's status socket: one JSON object per line and direction (docs/reference/json-output.md, 1).

use std::path::Path;
use std::time::Duration;

use serde_json::Value;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::UnixStream;
use tokio::time::timeout;

/// Patience with the daemon.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest answer, bytes.
const ANSWER_MAX: u64 = 4 << 20;

/// Asks for the status.
///
/// # Errors
/// In words: nobody listens, no permission, no answer in time, or one that is no status.
pub async fn status(socket: &Path) -> Result<Value, String> {
    let conversation = async {
        let mut stream = UnixStream::connect(socket).await.map_err(|error| match error.kind() {
            std::io::ErrorKind::PermissionDenied => {
                "permission denied\n  hint: join the group of the socket".to_owned()
            }
            _ => format!(
                "volcompd is not running ({error})\n  hint: start it, or name its socket with --socket"
            ),
        })?;
        stream.write_all(b"{\"command\":\"status\"}\n").await.map_err(|e| e.to_string())?;
        let mut answer = Vec::new();
        let mut reader = stream.take(ANSWER_MAX);
        let mut part = [0; 16 * 1024];
        while !answer.ends_with(b"\n") {
            match reader.read(&mut part).await.map_err(|e| e.to_string())? {
                0 => break,
                n => answer.extend_from_slice(&part[..n]),
            }
        }
        let mut answer: Value = serde_json::from_slice(&answer)
            .map_err(|error| format!("not an answer of volcompd ({error})"))?;
        match answer.get_mut("status").map(Value::take) {
            Some(status) if status.is_object() => Ok(status),
            _ => Err("not an answer of volcompd (no status)".to_owned()),
        }
    };
    timeout(PATIENCE, conversation)
        .await
        .unwrap_or_else(|_| Err(format!("no answer in {} s", PATIENCE.as_secs())))
}
