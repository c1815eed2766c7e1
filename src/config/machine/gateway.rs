//! What `volcomp gateway` tells other systems: `[mqtt]` and `[mtconnect]`.

use crate::prelude::*;

use super::http::read_listen;
use super::is_this_computer;
use super::tls::is_host;

/// The broker to which the status is published.
#[derive(Debug, Clone, PartialEq)]
pub struct MqttConfig {
    /// Host of the broker and its port.
    pub broker: (String, u16),
    /// First levels of all topics, without a slash at the end; `None`: `volcomp/` and the machine id.
    pub topic: Option<String>,
    /// Interval between two statuses, s.
    pub interval_s: f64,
    /// User name at the broker.
    pub user: Option<String>,
    /// File whose first line is the password.
    pub password_file: Option<PathBuf>,
}

/// The adapter that an MTConnect agent connects to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct MtconnectConfig {
    /// Where it listens; `None`: nowhere.
    pub listen: Option<SocketAddr>,
}

pub(super) fn read_mqtt(mqtt: &Section<'_>) -> Option<MqttConfig> {
    let plain_remote = mqtt.flag("plain-remote").unwrap_or(false);
    let broker = read_broker(mqtt, plain_remote);
    let interval_s =
        mqtt.number("interval-s", Allowed::Within { low: 0.1, high: 3600.0 }).map_or(1.0, |n| n.value);
    let topic = read_topic(mqtt);
    let text = |key| mqtt.text(key).map(|t| t.value).filter(|t| !t.is_empty());
    let (user, password_file) = (text("user").map(str::to_owned), text("password-file").map(PathBuf::from));
    Some(MqttConfig { broker: broker?, topic, interval_s, user, password_file })
}

fn read_broker(mqtt: &Section<'_>, plain_remote: bool) -> Option<(String, u16)> {
    let text = mqtt.text("broker").filter(|text| !text.value.is_empty())?;
    let parts = text.value.rsplit_once(':').and_then(|(host, port)| {
        let bare = host.trim_start_matches('[').trim_end_matches(']');
        let known = bare.parse::<IpAddr>().is_ok() || is_host(bare);
        let port = port.parse::<u16>().ok().filter(|port| *port != 0)?;
        known.then(|| (bare.to_owned(), port))
    });
    let Some((host, port)) = parts else {
        return mqtt.refuse(
            text.place,
            format!("mqtt.broker \"{}\" is not a host with a port from 1 to 65535", text.value),
            "write a name or number and a port, for example \"127.0.0.1:1883\"; \"\" publishes nowhere",
        );
    };
    let here = host == "localhost" || host.parse::<IpAddr>().is_ok_and(is_this_computer);
    if !here && !plain_remote {
        mqtt.report_at(
            text.place,
            format!("mqtt.broker {host}:{port} is another computer, and the connection is not encrypted"),
            "use a broker on this computer that forwards over TLS (a bridge); or plain-remote = true where everybody on \
             that network may see the state of the machine and the password",
        );
    }
    Some((host, port))
}

fn read_topic(mqtt: &Section<'_>) -> Option<String> {
    let text = mqtt.text("topic").filter(|text| !text.value.is_empty())?;
    let bad = text.value.contains(['+', '#', '\0'])
        || text.value.starts_with(['/', '$'])
        || text.value.ends_with('/');
    if bad || text.value.len() > 200 {
        return mqtt.refuse(
            text.place,
            format!("mqtt.topic \"{}\" is not a topic", text.value),
            "write levels without wildcards, at most 200 bytes, for example \"plant-2/cell-7/volcomp\"",
        );
    }
    Some(text.value.to_owned())
}

pub(super) fn read_mtconnect(mtconnect: &Section<'_>) -> MtconnectConfig {
    let plain_remote = mtconnect.flag("plain-remote").unwrap_or(false);
    MtconnectConfig { listen: read_listen(mtconnect, plain_remote, "7872", "SHDR has") }
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
    fn both_are_off_unless_asked_for() {
        for off in ["", "[mqtt]\n", "[mqtt]\nbroker = \"\"\n", "[mtconnect]\nlisten = \"\"\n"] {
            let config = read(off).expect("valid");
            assert_eq!((config.mqtt, config.mtconnect.listen), (None, None), "{off}");
        }
        let text = "[mqtt]\nbroker = \"[::1]:1883\"\ninterval-s = 0.5\nuser = \"v\"\n\
            password-file = \"p\"\n[mtconnect]\nlisten = \"127.0.0.1:7872\"\n";
        let config = read(text).expect("valid");
        let mqtt = config.mqtt.expect("on");
        assert_eq!((mqtt.broker, mqtt.interval_s), (("::1".to_owned(), 1883), 0.5));
        assert_eq!(config.mtconnect.listen.expect("on").port(), 7872);
    }

    #[test]
    fn mistakes_name_file_line_value_limit_and_remedy() {
        for (text, words) in [
            (
                "[mqtt]\nbroker = \"broker\"\n",
                &["m.toml:9:10", "\"broker\" is not a host", "127.0.0.1:1883"][..],
            ),
            ("[mqtt]\nbroker = \"plant:1883\"\n", &["plant:1883 is another computer", "plain-remote"]),
            ("[mqtt]\nbroker = \"localhost:0\"\n", &["1 to 65535"]),
            ("[mqtt]\nbroker = \"localhost:1\"\ntopic = \"a/#\"\n", &["m.toml:10:9", "wildcards"]),
            ("[mqtt]\nbroker = \"localhost:1\"\ninterval-s = 0\n", &["0.1 to 3600"]),
            (
                "[mtconnect]\nlisten = \"0.0.0.0:7872\"\n",
                &["mtconnect.listen 0.0.0.0:7872", "SHDR has neither"],
            ),
            ("[mtconnect]\nport = 1\n", &["port"]),
        ] {
            let error = read(text).expect_err(text);
            for word in words {
                assert!(error.contains(word), "{text}: no {word} in {error}");
            }
        }
    }
}
