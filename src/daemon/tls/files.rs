//! The files of `[link.tls]`: read once at start, by their open handle, so that what is checked is what is read.

use core::fmt;
use std::fs::{File, Metadata};
use std::path::Path;
use std::sync::Arc;

use rustls::client::Resumption;
use rustls::crypto::ring::default_provider;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::version::TLS13;
use rustls::{ClientConfig, RootCertStore};

use volcomp_state::bounded_read::read_open;

use super::TlsFileError;
use crate::private_file::{self, Exposed};
use volcomp_config::TlsConfig;

/// Largest file, bytes.
const BYTES_MAX: u64 = 1 << 20;

/// Whom the daemon trusts, who it is, and how it proves that.
#[derive(Clone)]
pub struct Identity {
    pub(super) config: Arc<ClientConfig>,
    pub(super) server_name: ServerName<'static>,
}

impl fmt::Debug for Identity {
    /// The name only: nothing that belongs to a key can come into a log this way.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Identity").field("server_name", &self.server_name).finish_non_exhaustive()
    }
}

impl Identity {
    /// Reads and checks the three files.
    pub(super) fn read(tls: &TlsConfig) -> Result<Self, TlsFileError> {
        let server_name = ServerName::try_from(tls.server_name.clone())
            .map_err(|_| TlsFileError::Name { name: tls.server_name.clone() })?;
        let mut roots = RootCertStore::empty();
        for certificate in certificates("ca", &tls.ca)? {
            roots.add(certificate).map_err(|source| unusable("ca", &tls.ca, source))?;
        }
        let chain = certificates("certificate", &tls.certificate)?;
        let key = private_key(&tls.key)?;
        let mut config = ClientConfig::builder_with_provider(Arc::new(default_provider()))
            .with_protocol_versions(&[&TLS13])
            .map_err(TlsFileError::Library)?
            .with_root_certificates(roots)
            .with_client_auth_cert(chain, key)
            .map_err(|source| match source {
                rustls::Error::InconsistentKeys(_) => {
                    TlsFileError::Mismatch { path: tls.key.clone(), certificate: tls.certificate.clone() }
                }
                rustls::Error::InvalidCertificate(_) => unusable("certificate", &tls.certificate, source),
                _ => unusable("key", &tls.key, source),
            })?;
        // every link is a full handshake: nothing is kept that could be stolen or go stale
        config.resumption = Resumption::disabled();
        Ok(Self { config: Arc::new(config), server_name })
    }
}

fn unusable(key: &'static str, path: &Path, source: rustls::Error) -> TlsFileError {
    TlsFileError::Unusable { key, path: path.to_owned(), source }
}

/// Opens a file, judges what it is, reads it.
fn read(
    key: &'static str,
    path: &Path,
    judge: impl FnOnce(&Metadata) -> Result<(), TlsFileError>,
) -> Result<Vec<u8>, TlsFileError> {
    let failed = |source| TlsFileError::Read { key, path: path.to_owned(), source };
    let file = File::open(path).map_err(failed)?;
    judge(&file.metadata().map_err(failed)?)?;
    read_open(&file, BYTES_MAX).map_err(failed)
}

fn certificates(key: &'static str, path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsFileError> {
    let bytes = read(key, path, |_| Ok(()))?;
    let none = || TlsFileError::NoCertificate { key, path: path.to_owned() };
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&bytes).collect();
    found.ok().filter(|found| !found.is_empty()).ok_or_else(none)
}

fn private_key(path: &Path) -> Result<PrivateKeyDer<'static>, TlsFileError> {
    let exposed = |Exposed { mode, allowed }| TlsFileError::Exposed { path: path.to_owned(), mode, allowed };
    let bytes = read("key", path, |metadata| private_file::check(metadata).map_err(exposed))?;
    // what the parser says could quote the file
    PrivateKeyDer::from_pem_slice(&bytes).map_err(|_| TlsFileError::NoKey { path: path.to_owned() })
}
