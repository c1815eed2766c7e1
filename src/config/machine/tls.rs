//! Whom the link trusts: `[link.tls]`, `plain-remote`, and the rule that nothing leaves this computer unprotected
//! unless somebody says so.

use crate::prelude::*;

use super::is_this_computer;

/// Mutual TLS on the link: files as written (relative to the machine file), all of them PEM.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlsConfig {
    /// Certificates of the authorities from which the control's certificate may come.
    pub ca: PathBuf,
    /// The daemon's own certificate, with those in between its authority and itself behind it.
    pub certificate: PathBuf,
    /// The private key of that certificate.
    pub key: PathBuf,
    /// Name or number that the control's certificate must carry.
    pub server_name: String,
}

/// Longest name of a host, bytes.
const NAME_MAX: usize = 253;
/// Longest part of it between dots, bytes.
const LABEL_MAX: usize = 63;

/// Reads `[link.tls]`; `Some(None)` where it is not written, `None` where it is wrong.
pub(super) fn read_tls(link: &Section<'_>, address: Option<SocketAddr>) -> Option<Option<TlsConfig>> {
    let tls = link.section("tls");
    let [ca, certificate, key] = [
        ("ca", "certificates of the authority that issued the control's certificate"),
        ("certificate", "the daemon's own certificate"),
        ("key", "the private key of that certificate"),
    ]
    .map(|(key, what)| {
        if tls.place().is_some() {
            tls.require(key, &format!("add {key} = \"...\", {what}, a path seen from this file"));
        }
        tls.path(key, what)
    });
    let name = tls.text("server-name");
    let named = match &name {
        Some(name) => is_host(name.value).then(|| name.value.to_owned()),
        None => address.map(|a| a.ip().to_string()),
    };
    if let (Some(name), None) = (&name, &named) {
        tls.report_at(
            name.place.clone(),
            format!("{} \"{}\" is not a name of a host", tls.named_key("server-name"), name.value),
            "write a name or number that stands in the control's certificate, for example \"cnc-1.shop\"",
        );
    }
    tls.finish();
    if tls.place().is_none() {
        return Some(None);
    }
    Some(Some(TlsConfig { ca: ca?, certificate: certificate?, key: key?, server_name: named? }))
}

/// A number, or labels of letters, digits, `-` and `_` with dots in between.
pub(super) fn is_host(name: &str) -> bool {
    let label = |label: &str| {
        (1..=LABEL_MAX).contains(&label.len())
            && label.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
            && !label.starts_with('-')
            && !label.ends_with('-')
    };
    name.parse::<IpAddr>().is_ok() || name.len() <= NAME_MAX && name.split('.').all(label)
}

/// Reports a link that would cross a network without protection and without permission.
pub(super) fn check_remote(link: &Section<'_>, address: &Placed<SocketAddr>, tls: bool, plain_remote: bool) {
    if tls || plain_remote || is_this_computer(address.value.ip()) {
        return;
    }
    link.report_at(
        address.place.clone(),
        format!(
            "link.address {} is on another computer, and the link has neither authentication nor encryption",
            address.value
        ),
        "add [link.tls]; or plain-remote = true to [link] where that wire connects the control with this computer \
         and with nothing else",
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_hosts() {
        for good in ["cnc-1", "cnc-1.shop", "127.0.0.1", "::1", "a_b.c", &"a".repeat(63)] {
            assert!(is_host(good), "{good}");
        }
        for bad in ["", ".", "cnc..shop", "cnc-1.", "-a", "a-", "a b", "cnc\n", "ä", &"a".repeat(64)] {
            assert!(!is_host(bad), "{bad:?}");
        }
        assert!(!is_host(&["abcdefg"; 40].join(".")), "longer than a name may be");
    }
}
