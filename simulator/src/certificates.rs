//! Certificates to try the secure link with: an authority, a control, a daemon.
//!
//! Keys are ECDSA on P-256. What is made here is for trying and testing; a shop has its own authority, whose key does
//! not lie on the computer beside the machine.

#![expect(
    clippy::disallowed_methods,
    reason = "certificates are valid by the clock of this computer, and are files"
)]

use core::time::Duration;
use std::fs::OpenOptions;
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, ExtendedKeyUsagePurpose, IsCa, KeyPair,
    KeyUsagePurpose,
};

/// Clocks of two computers may differ by this much.
const CLOCK_MARGIN: Duration = Duration::from_secs(3600);
/// One day.
const DAY: Duration = Duration::from_secs(86_400);

/// A private key is its owner's.
const KEY_MODE: u32 = 0o600;
/// A certificate is everybody's.
const CERTIFICATE_MODE: u32 = 0o644;

/// What a certificate is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The control: it is connected to.
    Control,
    /// The daemon: it connects.
    Daemon,
}

/// When a certificate is valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Validity {
    /// From then on.
    pub from: SystemTime,
    /// Until then.
    pub until: SystemTime,
}

impl Validity {
    /// From now (an hour ago, for clocks that differ) for so many days.
    #[must_use]
    pub fn days(days: u32) -> Self {
        let now = SystemTime::now();
        Self { from: now - CLOCK_MARGIN, until: now + DAY * days }
    }

    /// Over since a day ago.
    #[must_use]
    pub fn over() -> Self {
        let now = SystemTime::now();
        Self { from: now - 10 * DAY, until: now - DAY }
    }
}

/// A certificate and its private key, both as PEM.
#[derive(Clone)]
pub struct Issued {
    /// The certificate.
    pub certificate: String,
    /// Its private key.
    pub key: String,
}

impl Issued {
    /// Writes `stem.pem` and `stem.key` into a folder; never over an existing file.
    ///
    /// # Errors
    /// The file that could not be written, and why.
    pub fn write(&self, folder: &Path, stem: &str) -> Result<(), (PathBuf, io::Error)> {
        let files = [("key", &self.key, KEY_MODE), ("pem", &self.certificate, CERTIFICATE_MODE)];
        for (kind, text, mode) in files {
            let path = folder.join(format!("{stem}.{kind}"));
            // the mode from the first byte on
            let opened = OpenOptions::new().write(true).create_new(true).mode(mode).open(&path);
            opened.and_then(|mut file| file.write_all(text.as_bytes())).map_err(|e| (path, e))?;
        }
        Ok(())
    }
}

/// Why a certificate cannot be made.
#[derive(Debug, thiserror::Error)]
#[error("cannot make a certificate: {0}")]
pub struct CertificateError(#[from] rcgen::Error);

/// An authority that issues certificates.
pub struct Authority {
    issuer: CertifiedIssuer<'static, KeyPair>,
}

impl Authority {
    /// A new authority.
    ///
    /// # Errors
    /// No random numbers.
    pub fn new(name: &str, validity: Validity) -> Result<Self, CertificateError> {
        let mut params = params(name, &[], validity)?;
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        Ok(Self { issuer: CertifiedIssuer::self_signed(params, KeyPair::generate()?)? })
    }

    /// The authority's own certificate, with its key.
    #[must_use]
    pub fn own(&self) -> Issued {
        Issued { certificate: self.issuer.pem(), key: self.issuer.key().serialize_pem() }
    }

    /// A certificate of this authority for these names (of hosts, or their numbers).
    ///
    /// # Errors
    /// A name that no certificate can carry.
    pub fn issue(&self, role: Role, names: &[&str], validity: Validity) -> Result<Issued, CertificateError> {
        let (title, usage) = match role {
            Role::Control => ("control", ExtendedKeyUsagePurpose::ServerAuth),
            Role::Daemon => ("volcompd", ExtendedKeyUsagePurpose::ClientAuth),
        };
        let mut params = params(title, names, validity)?;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![usage];
        params.use_authority_key_identifier_extension = true;
        let key = KeyPair::generate()?;
        let certificate = params.signed_by(&key, &self.issuer)?;
        Ok(Issued { certificate: certificate.pem(), key: key.serialize_pem() })
    }
}

fn params(title: &str, names: &[&str], validity: Validity) -> Result<CertificateParams, CertificateError> {
    let names: Vec<String> = names.iter().map(ToString::to_string).collect();
    let mut params = CertificateParams::new(names)?;
    params.distinguished_name.push(DnType::OrganizationName, "volcomp trial");
    params.distinguished_name.push(DnType::CommonName, title);
    params.not_before = validity.from.into();
    params.not_after = validity.until.into();
    Ok(params)
}
