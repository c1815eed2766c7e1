//! Where the page and the metrics are served: `[http]`.

use crate::prelude::*;

use super::is_this_computer;
use super::tls::is_host;

/// The HTTP service.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct HttpConfig {
    /// Where it listens; `None`: nowhere.
    pub listen: Option<SocketAddr>,
    /// Clients on other computers are served without authentication and encryption.
    pub plain_remote: bool,
    /// Host names by which browsers may address it, beside `localhost` and numeric addresses.
    pub hosts: Vec<String>,
    /// File with the token that commands need, as written (relative to the machine file); `None`: read-only.
    pub token_file: Option<PathBuf>,
    /// The newest result of `volcomp verify --record`, as written (relative to the machine file).
    pub verification: Option<PathBuf>,
}

/// Most names in `hosts`.
const HOSTS_MAX: usize = 16;

pub(super) fn read_http(http: &Section<'_>) -> HttpConfig {
    let plain_remote = http.flag("plain-remote").unwrap_or(false);
    let hosts = read_hosts(http);
    let listen = read_listen(http, plain_remote, "7870", "HTTP has");
    let path = |key| http.text(key).map(|t| t.value).filter(|t| !t.is_empty()).map(PathBuf::from);
    let (token_file, verification) = (path("token-file"), path("verification"));
    if let Some(address) = listen.filter(|a| token_file.is_some() && !is_this_computer(a.ip())) {
        http.report_here(
            format!("http.token-file and http.listen {address}: the token would cross the network unencrypted"),
            "listen on 127.0.0.1 and forward by ssh or a reverse proxy with TLS; or leave token-file out, for a page that can only be read",
        );
    }
    HttpConfig { listen, plain_remote, hosts, token_file, verification }
}

/// The address at which a section's service listens; `example` is one for the remedy, `lacks` says why other computers
/// need `plain-remote`.
pub(super) fn read_listen(
    section: &Section<'_>,
    plain_remote: bool,
    example: &str,
    lacks: &str,
) -> Option<SocketAddr> {
    let text = section.text("listen").filter(|text| !text.value.is_empty())?;
    let key = section.named_key("listen");
    let Some(address) = text.value.parse::<SocketAddr>().ok().filter(|address| address.port() != 0) else {
        return section.refuse(
            text.place,
            format!("{key} \"{}\" is not an address with a port from 1 to 65535", text.value),
            format!("write a number of this computer and a port, for example \"127.0.0.1:{example}\" or \"[::1]:{example}\"; \"\" listens nowhere"),
        );
    };
    if !plain_remote && !is_this_computer(address.ip()) {
        section.report_at(
            text.place,
            format!("{key} {address} serves other computers, and {lacks} neither authentication nor encryption"),
            "listen on 127.0.0.1 and forward by ssh or a reverse proxy; or plain-remote = true where everybody on that network may see the state of the machine",
        );
    }
    Some(address)
}

fn read_hosts(http: &Section<'_>) -> Vec<String> {
    let Some(hosts) = http.texts("hosts") else { return Vec::new() };
    if hosts.value.len() > HOSTS_MAX {
        let message = format!("http.hosts has {} names, the limit is {HOSTS_MAX}", hosts.value.len());
        http.report_at(hosts.place, message, "keep the names by which browsers address the page");
    }
    for host in hosts.value.iter().filter(|host| !is_host(host.value)) {
        http.report_at(
            host.place.clone(),
            format!("http.hosts \"{}\" is not a name of a host", host.value),
            "write a name without scheme and port, for example \"cell-7.shop\"",
        );
    }
    hosts.value.iter().map(|host| host.value.to_ascii_lowercase()).collect()
}

#[cfg(test)]
mod tests {
    use crate::MachineConfig;

    const BASE: &str = "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"model.toml\"\n\
        [axes.x]\nlimit-um = 50\nrate-um-per-s = 100\nacceleration-um-per-s2 = 1000\n";

    fn read(text: &str) -> Result<MachineConfig, String> {
        MachineConfig::parse("m.toml", &format!("{BASE}{text}")).map_err(|e| e.to_string())
    }

    #[test]
    fn it_is_off_unless_an_address_is_written() {
        for off in ["", "[http]\n", "[http]\nlisten = \"\"\n"] {
            assert_eq!(read(off).expect("valid").http.listen, None, "{off}");
        }
        let http =
            read("[http]\nlisten = \"127.0.0.1:7870\"\nhosts = [\"Cell-7.shop\"]\n").expect("valid").http;
        assert_eq!(http.listen.expect("on").to_string(), "127.0.0.1:7870");
        assert_eq!(http.hosts, ["cell-7.shop"]);
        assert_eq!((&http.token_file, &http.verification), (&None, &None));
        assert!(read("[http]\nlisten = \"0.0.0.0:7870\"\nplain-remote = true\n").is_ok());
        let http =
            read("[http]\nlisten = \"[::1]:7870\"\ntoken-file = \"http.token\"\n").expect("valid").http;
        assert_eq!(http.token_file.expect("on").to_str(), Some("http.token"));
    }

    #[test]
    fn mistakes_name_file_line_value_limit_and_remedy() {
        for (text, words) in [
            ("[http]\nlisten = \"0.0.0.0:7870\"\n", &["m.toml:9:10", "0.0.0.0:7870", "plain-remote"][..]),
            ("[http]\nlisten = \"here\"\n", &["m.toml:9:10", "\"here\" is not an address", "127.0.0.1:7870"]),
            ("[http]\nlisten = \"127.0.0.1:0\"\n", &["1 to 65535"]),
            ("[http]\nlisten = 7870\n", &["http.listen must be a text"]),
            ("[http]\nhosts = [\"http://a\"]\n", &["m.toml:9:10", "not a name of a host", "cell-7.shop"]),
            ("[http]\nlisten-on = \"\"\n", &["listen-on"]),
            (
                "[http]\nlisten = \"0.0.0.0:7870\"\nplain-remote = true\ntoken-file = \"token\"\n",
                &["token-file", "unencrypted", "reverse proxy"],
            ),
        ] {
            let error = read(text).expect_err(text);
            for word in words {
                assert!(error.contains(word), "{text}: no {word} in {error}");
            }
        }
        let many = format!("[http]\nhosts = [{}]\n", "\"a\",".repeat(17));
        assert!(read(&many).expect_err("too many").contains("17 names, the limit is 16"));
    }
}
