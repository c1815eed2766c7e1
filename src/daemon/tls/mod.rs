//! Mutual TLS 1.3 between the daemon and the control.
//!
//! [`files`] turns the files of `[link.tls]` into an [`Identity`], once, at start. [`stream`] is what lies between
//! the socket and the frames of a link. [`explain`] says in words what went wrong and what to do about it.
//!
//! Trust: the control must show a certificate that an authority of `ca` issued for `server-name`; the daemon shows its
//! own, and a control that does not know its authority ends the handshake. There is no other trust store, no
//! resumption, no older version of TLS and nothing that writes keys to a file.
//!
//! **Cycle.** Once the handshake is done a frame out is one record and one `send`, and a frame in is one `recv`;
//! nothing else waits. The record layer of rustls allocates and frees one small block per frame in each direction, so
//! the promise of a cycle without allocation holds for plain links only (`docs/how-to/tls.md` has the figures).
//!
//! Without the Cargo feature `tls` a machine file with `[link.tls]` is refused (`absent.rs`).

#[cfg(not(feature = "tls"))]
mod absent;
mod error;
#[cfg(feature = "tls")]
mod explain;
#[cfg(feature = "tls")]
mod files;
#[cfg(feature = "tls")]
mod stream;
#[cfg(test)]
pub(super) mod test_identity;

use std::path::{Path, PathBuf};

use volcomp_config::{MachineConfig, TlsConfig};

#[cfg(not(feature = "tls"))]
pub(super) use absent::{TlsError, TlsStream};
pub use error::TlsFileError;
#[cfg(feature = "tls")]
pub(super) use explain::TlsError;
#[cfg(feature = "tls")]
pub(super) use stream::TlsStream;

#[cfg(not(feature = "tls"))]
pub use absent::Identity;
#[cfg(feature = "tls")]
pub use files::Identity;

/// The daemon's identity on the link, where the machine file has one; its files are seen from the machine file.
///
/// # Errors
/// A file cannot be read, is not what it should be, or the key is open to others.
pub fn identity(config: &Path, machine: &MachineConfig) -> Result<Option<Identity>, TlsFileError> {
    let seen = |path: &PathBuf| config.with_file_name(path);
    let placed = |tls: &TlsConfig| TlsConfig {
        ca: seen(&tls.ca),
        certificate: seen(&tls.certificate),
        key: seen(&tls.key),
        server_name: tls.server_name.clone(),
    };
    machine.link.tls.as_ref().map(|tls| Identity::read(&placed(tls))).transpose()
}
