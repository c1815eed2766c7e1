//! The bytes of one connection: plain TCP, or mutual TLS 1.3 on it.
//!
//! The control that asks for TLS asks for a certificate too: a daemon whose certificate was not issued by one of its
//! authorities gets no further than the handshake.

use core::fmt;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use rustls::crypto::ring::default_provider;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::WebPkiClientVerifier;
use rustls::version::TLS13;
use rustls::{CertificateError, InvalidMessage, RootCertStore, ServerConfig, ServerConnection};

/// Who the control is, and whose daemons it accepts.
#[derive(Clone)]
pub struct ControlIdentity(Arc<ServerConfig>);

impl fmt::Debug for ControlIdentity {
    /// Nothing of what is inside: a key is among it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ControlIdentity")
    }
}

impl PartialEq for ControlIdentity {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// Why a control has no identity.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum IdentityError {
    /// A file could not be read.
    #[error("{}: {source}", path.display())]
    Read { path: PathBuf, source: io::Error },
    /// A file does not hold what it should.
    #[error("{}: no {what} in it; give a PEM file", path.display())]
    Nothing { path: PathBuf, what: &'static str },
    /// The library refuses it.
    #[error("{}: {source}; make a set of files with cncsim dev certificates", path.display())]
    Unusable { path: PathBuf, source: rustls::Error },
    /// The authorities cannot be used to judge daemons.
    #[error("{}: {source}", path.display())]
    Authority { path: PathBuf, source: rustls::server::VerifierBuilderError },
}

impl ControlIdentity {
    /// From PEM files: the authorities of daemons, the control's own certificate, its key.
    ///
    /// # Errors
    /// A file that cannot be read or used.
    pub fn from_files(ca: &Path, certificate: &Path, key: &Path) -> Result<Self, IdentityError> {
        let unusable = |path: &Path, source| IdentityError::Unusable { path: path.to_owned(), source };
        let mut roots = RootCertStore::empty();
        for authority in certificates(ca)? {
            roots.add(authority).map_err(|e| unusable(ca, e))?;
        }
        let provider = Arc::new(default_provider());
        let verifier = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider))
            .build()
            .map_err(|source| IdentityError::Authority { path: ca.to_owned(), source })?;
        let secret = PrivateKeyDer::from_pem_slice(&read(key)?)
            .map_err(|_| IdentityError::Nothing { path: key.to_owned(), what: "private key" })?;
        let mut config = ServerConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&TLS13])
            .map_err(|e| unusable(certificate, e))?
            .with_client_cert_verifier(verifier)
            .with_single_cert(certificates(certificate)?, secret)
            .map_err(|e| unusable(certificate, e))?;
        // every link is a full handshake
        config.send_tls13_tickets = 0;
        Ok(Self(Arc::new(config)))
    }
}

/// Largest PEM file, bytes.
const PEM_MAX: u64 = 1 << 20;

/// A whole file of at most [`PEM_MAX`] bytes.
fn read(path: &Path) -> Result<Vec<u8>, IdentityError> {
    let failed = |source| IdentityError::Read { path: path.to_owned(), source };
    let mut bytes = Vec::new();
    File::open(path).and_then(|f| f.take(PEM_MAX + 1).read_to_end(&mut bytes)).map_err(failed)?;
    if bytes.len() as u64 > PEM_MAX {
        let what = format!("more than {} KiB; name a PEM file", PEM_MAX >> 10);
        return Err(failed(io::Error::new(io::ErrorKind::FileTooLarge, what)));
    }
    Ok(bytes)
}

fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, IdentityError> {
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&read(path)?).collect();
    let nothing = || IdentityError::Nothing { path: path.to_owned(), what: "certificate" };
    found.ok().filter(|found| !found.is_empty()).ok_or_else(nothing)
}

/// Why a connection did not become secure.
#[derive(Debug, Clone, PartialEq)]
pub enum Insecure {
    /// What the two ends said to each other.
    Tls(rustls::Error),
    /// The connection ended first.
    Gone(ErrorKind),
    /// It took too long.
    Late,
}

impl fmt::Display for Insecure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use CertificateError as Why;
        let error = match self {
            Self::Tls(error) => error,
            Self::Gone(kind) => return write!(f, "gone during the TLS handshake ({kind})"),
            Self::Late => return f.write_str("no TLS handshake in time"),
        };
        match error {
            rustls::Error::InvalidMessage(InvalidMessage::InvalidContentType) => {
                f.write_str("it does not speak TLS; add [link.tls] to the machine file of the daemon")
            }
            rustls::Error::NoCertificatesPresented => {
                f.write_str("it showed no certificate; give the daemon one of an authority of --tls-ca")
            }
            rustls::Error::InvalidCertificate(Why::UnknownIssuer | Why::BadSignature) => f.write_str(
                "the daemon's certificate was not issued by an authority of --tls-ca; give it one that was",
            ),
            rustls::Error::InvalidCertificate(Why::Expired | Why::ExpiredContext { .. }) => {
                f.write_str("the daemon's certificate has expired; give it a new one (or set the clock)")
            }
            rustls::Error::InvalidCertificate(Why::InvalidPurpose | Why::InvalidPurposeContext { .. }) => {
                f.write_str("the daemon's certificate is not one for a client; it needs the usage clientAuth")
            }
            rustls::Error::AlertReceived(alert) => {
                write!(f, "the daemon refuses this control's certificate ({alert:?}); its log says why")
            }
            other => write!(f, "TLS failed: {other}"),
        }
    }
}

/// The bytes of one connection.
#[derive(Debug)]
pub struct Wire {
    stream: TcpStream,
    tls: Option<Box<ServerConnection>>,
}

impl Wire {
    /// A connection that is used as it is.
    pub const fn plain(stream: TcpStream) -> Self {
        Self { stream, tls: None }
    }

    /// A connection made secure before the deadline.
    pub fn secure(
        stream: TcpStream,
        identity: &ControlIdentity,
        deadline: Instant,
    ) -> Result<Self, (Insecure, TcpStream)> {
        let mut tls = match ServerConnection::new(Arc::clone(&identity.0)) {
            Ok(tls) => Box::new(tls),
            Err(e) => return Err((Insecure::Tls(e), stream)),
        };
        match handshake(&mut tls, &stream, deadline) {
            Ok(()) => Ok(Self { stream, tls: Some(tls) }),
            Err(why) => Err((why, stream)),
        }
    }

    /// The socket, for its options.
    pub const fn stream(&self) -> &TcpStream {
        &self.stream
    }

    /// Reads once; `WouldBlock` where nothing is there within the socket's time.
    pub fn read(&mut self, space: &mut [u8]) -> io::Result<usize> {
        let Some(tls) = &mut self.tls else { return self.stream.read(space) };
        match take(tls, space) {
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            taken => return taken,
        }
        if tls.read_tls(&mut self.stream)? == 0 {
            return Ok(0);
        }
        let processed = tls.process_new_packets();
        pump(tls, &self.stream)?;
        processed.map_err(|e| io::Error::new(ErrorKind::InvalidData, e))?;
        take(tls, space)
    }

    /// Writes what the send buffer takes; over TLS it counts as written, and [`Self::pump`] brings the rest out.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(tls) = &mut self.tls else { return self.stream.write(bytes) };
        let count = tls.writer().write(bytes)?;
        pump(tls, &self.stream)?;
        Ok(count)
    }

    /// Brings out what is left of earlier writes; true where nothing is.
    pub fn pump(&mut self) -> io::Result<bool> {
        self.tls.as_mut().map_or(Ok(true), |tls| pump(tls, &self.stream))
    }

    /// Writes all of it, waiting as long as the socket does.
    pub fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match &mut self.tls {
            None => self.stream.write_all(bytes),
            Some(tls) => {
                tls.writer().write_all(bytes)?;
                pump(tls, &self.stream)?.then_some(()).ok_or_else(|| ErrorKind::TimedOut.into())
            }
        }
    }

    /// Says, where there is a way to say it, that nothing more comes.
    pub fn finish(&mut self) {
        if let Some(tls) = &mut self.tls {
            tls.send_close_notify();
            // the connection ends either way
            let _ = pump(tls, &self.stream);
        }
    }
}

fn handshake(tls: &mut ServerConnection, stream: &TcpStream, deadline: Instant) -> Result<(), Insecure> {
    let gone = |e: io::Error| Insecure::Gone(e.kind());
    let mut socket = stream;
    while tls.is_handshaking() {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(Insecure::Late);
        }
        stream.set_read_timeout(Some(left)).map_err(gone)?;
        match tls.read_tls(&mut socket) {
            Ok(0) => return Err(Insecure::Gone(ErrorKind::UnexpectedEof)),
            Ok(_) => {}
            Err(e) if is_wait(&e) => continue,
            Err(e) => return Err(gone(e)),
        }
        let processed = tls.process_new_packets();
        // an alert tells the other side what is wrong
        let pumped = pump(tls, stream);
        processed.map_err(Insecure::Tls)?;
        pumped.map_err(gone)?;
    }
    Ok(())
}

/// Sends what is due; true where all of it is out.
fn pump(tls: &mut ServerConnection, mut stream: &TcpStream) -> io::Result<bool> {
    while tls.wants_write() {
        match tls.write_tls(&mut stream) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(_) => {}
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) if is_wait(&e) => return Ok(false),
            Err(e) => return Err(e),
        }
    }
    Ok(true)
}

/// An end without TLS's own is an end like any other: the link has frames that say good-bye.
fn take(tls: &mut ServerConnection, space: &mut [u8]) -> io::Result<usize> {
    match tls.reader().read(space) {
        Err(e) if e.kind() == ErrorKind::UnexpectedEof => Ok(0),
        taken => taken,
    }
}

fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
