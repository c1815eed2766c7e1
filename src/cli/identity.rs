//! What `check` has to say about how the link is protected.

use std::path::Path;

use volcomp_config::MachineConfig;
use volcomp_daemon::identity;

/// Something wrong with the files of `[link.tls]`.
pub(super) struct Mistake {
    /// A file could not be read at all.
    pub(super) is_io: bool,
    /// The key of the machine file.
    pub(super) key: Vec<String>,
    pub(super) message: String,
    pub(super) remedy: String,
}

/// Reads the files as the daemon would.
pub(super) fn mistake(path: &Path, machine: &MachineConfig) -> Option<Mistake> {
    let error = identity(path, machine).err()?;
    let said = error.to_string();
    let (message, remedy) =
        said.split_once("\n  hint: ").unwrap_or((&said, "the path is seen from the machine file"));
    let mut key = vec!["link".to_owned(), "tls".to_owned()];
    // messages begin with the key they are about
    key.extend(message.strip_prefix("link.tls.").and_then(|m| m.split([':', ' ']).next()).map(str::to_owned));
    Some(Mistake { is_io: error.is_io(), key, message: message.to_owned(), remedy: remedy.to_owned() })
}

/// The note about a link that leaves this computer as it is.
pub(super) fn exposed(machine: &MachineConfig) -> String {
    format!(
        "plain-remote: the link to {} has neither authentication nor encryption; nothing but the control and this \
         computer may be on that wire",
        machine.link.address
    )
}

/// How the link is protected, behind the control's address.
pub(super) fn protection(machine: &MachineConfig) -> String {
    machine.link.tls.as_ref().map_or_else(String::new, |tls| format!(" over TLS as \"{}\"", tls.server_name))
}
