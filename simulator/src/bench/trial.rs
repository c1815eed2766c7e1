//! Certificates for one run over TLS.

use std::io::ErrorKind;
use std::path::Path;

use super::error::BenchError;
use crate::certificates::{Authority, Issued, Role, Validity};
use crate::control::ControlIdentity;

/// Writes the daemon's files into the folder and gives the control's identity.
pub(super) fn identity(folder: &Path) -> Result<ControlIdentity, BenchError> {
    let failed = |e: &dyn core::fmt::Display| BenchError::Tool { verb: "certificates", said: e.to_string() };
    let validity = Validity::days(1);
    let authority = Authority::new("bench-link", validity).map_err(|e| failed(&e))?;
    let issue = |role, name| authority.issue(role, &[name], validity).map_err(|e| failed(&e));
    let control = issue(Role::Control, "127.0.0.1")?;
    let daemon = issue(Role::Daemon, "volcompd")?;
    for (stem, issued) in [("ca", &authority.own()), ("control", &control), ("daemon", &daemon)] {
        keep(folder, stem, issued)?;
    }
    let [ca, certificate, key] = ["ca.pem", "control.pem", "control.key"].map(|name| folder.join(name));
    ControlIdentity::from_files(&ca, &certificate, &key).map_err(|e| failed(&e))
}

fn keep(folder: &Path, stem: &str, issued: &Issued) -> Result<(), BenchError> {
    for kind in ["key", "pem"] {
        // a folder that was used before holds the files of another run
        match std::fs::remove_file(folder.join(format!("{stem}.{kind}"))) {
            Err(source) if source.kind() != ErrorKind::NotFound => {
                return Err(BenchError::File { path: folder.join(stem), source });
            }
            _ => {}
        }
    }
    issued.write(folder, stem).map_err(|(path, source)| BenchError::File { path, source })
}
