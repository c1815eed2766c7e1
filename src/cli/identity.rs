//! What `check` has to say about how the link and the commands by HTTP are protected.

use crate::prelude::*;
use volcomp_daemon::{http_token, identity};

/// Something wrong with the files of `[link.tls]` or the token of `[http]`.
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
    let link = || identity(path, machine).err().map(|error| (error.is_io(), error.to_string()));
    let token = || http_token(path, machine).err().map(|error| (error.is_io(), error.to_string()));
    let (is_io, said) = link().or_else(token)?;
    let (message, remedy) =
        said.split_once("\n  hint: ").unwrap_or((&said, "the path is seen from the machine file"));
    // messages begin with the key they are about
    let key = message.split([':', ' ']).next().filter(|key| key.contains('.')).unwrap_or("link.tls");
    let key = key.split('.').map(str::to_owned).collect();
    Some(Mistake { is_io, key, message: message.to_owned(), remedy: remedy.to_owned() })
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
