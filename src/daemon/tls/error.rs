//! What can be wrong with the files of `[link.tls]`. No message ever shows a byte of a key file.

use std::io;
use std::path::PathBuf;

/// Why there is no identity.
#[derive(Debug, thiserror::Error)]
pub enum TlsFileError {
    /// A file could not be read.
    #[error("link.tls.{key}: {}: {source}", path.display())]
    Read {
        /// The key of the machine file.
        key: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Others than the daemon's user may read or change the private key.
    #[error(
        "link.tls.key: {}: its mode is {mode:04o}, so others may read or change the private key\n  \
         hint: chmod {allowed:04o} {}", path.display(), path.display()
    )]
    Exposed {
        /// The key file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
        /// The most it may have.
        allowed: u32,
    },
    /// A file without any certificate.
    #[error(
        "link.tls.{key}: {}: no certificate in it\n  hint: the file must be PEM, with lines BEGIN CERTIFICATE and END \
         CERTIFICATE", path.display()
    )]
    NoCertificate {
        /// The key of the machine file.
        key: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// A file without a private key.
    #[error(
        "link.tls.key: {}: no private key in it\n  hint: the file must be PEM, with a line BEGIN PRIVATE KEY (or EC or \
         RSA PRIVATE KEY); a key with a password cannot be used by a service", path.display()
    )]
    NoKey {
        /// The key file.
        path: PathBuf,
    },
    /// Key and certificate are not of a pair.
    #[error(
        "link.tls.key: {}: this is not the key of the certificate {}\n  hint: name the two files that were made together",
        path.display(), certificate.display()
    )]
    Mismatch {
        /// The key file.
        path: PathBuf,
        /// The certificate file.
        certificate: PathBuf,
    },
    /// A name that no certificate can carry.
    #[error(
        "link.tls.server-name \"{name}\" is not a name of a host\n  hint: write a name of the control's certificate"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// The library cannot use what is in a file.
    #[cfg(feature = "tls")]
    #[error(
        "link.tls.{key}: {}: {source}\n  hint: use certificates of version 3 with ECDSA (P-256, P-384), Ed25519 or RSA keys",
        path.display()
    )]
    Unusable {
        /// The key of the machine file.
        key: &'static str,
        /// The file.
        path: PathBuf,
        /// What the library says.
        source: rustls::Error,
    },
    /// The library cannot be set up.
    #[cfg(feature = "tls")]
    #[error("link.tls: {0}; this is a bug in volcompd, please report it")]
    Library(rustls::Error),
    /// This program cannot do it.
    #[cfg(not(feature = "tls"))]
    #[error("link.tls: this program was built without TLS\n  hint: build it with the Cargo feature tls")]
    NotBuilt,
}

impl TlsFileError {
    /// True where a file could not be read at all, false where what is in it (or its mode) is wrong.
    #[must_use]
    pub const fn is_io(&self) -> bool {
        matches!(self, Self::Read { .. })
    }
}
