//! Publishing by MQTT 5: plain JSON, retained state, a last will.
//!
//! | topic below the first levels | payload | |
//! |---|---|---|
//! | `availability` | `online` while the daemon answers, else `offline` | retained; last will |
//! | `status` | the object of `volcomp status --json` | retained, at the interval |
//! | `health` | `time state verdict code cause remedy` | retained, where it has changed |
//! | `event` | `time code name severity count numbers` | each new one once |

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use rumqttc::mqttbytes::QoS;
use rumqttc::{AsyncClient, Event, Incoming, LastWill, MqttOptions, PublishOptions};
use serde_json::{Value, json};
use tokio::sync::watch;
use volcomp_config::MqttConfig;
use volcomp_daemon::Status;
use volcomp_state::bounded_read::read_bounded;
use volcomp_state::utc;

use super::{GatewayError, Reading, Report, Seldom};

/// Messages that wait for the broker; beyond them the newest is left out and comes with the next interval.
const QUEUE: usize = 64;
/// Interval of the keep-alive: a broker publishes the last will 1.5 times this after the connection has died.
const KEEP_ALIVE_S: u16 = 10;
/// Pause between two attempts to connect.
const PAUSE: Duration = Duration::from_secs(2);
/// Largest password file, bytes.
const PASSWORD_MAX: u64 = 4096;

/// What is published where.
pub struct Publisher {
    options: MqttOptions,
    topic: String,
    every: Duration,
}

impl Publisher {
    /// Reads the password.
    ///
    /// # Errors
    /// The password file cannot be read.
    pub fn new(config: &MqttConfig, file: &Path, machine: &str) -> Result<Self, GatewayError> {
        let topic = config.topic.clone().unwrap_or_else(|| format!("volcomp/{machine}"));
        let (host, port) = &config.broker;
        let mut options = MqttOptions::new(format!("volcomp-{machine}"), (host.clone(), *port));
        options.set_keep_alive(KEEP_ALIVE_S);
        let will = LastWill::new(below(&topic, "availability"), "offline", QoS::AtLeastOnce, true, None);
        options.set_last_will(will);
        if let Some(user) = &config.user {
            let password = config.password_file.as_ref().map(|name| {
                let path = file.parent().unwrap_or(Path::new("")).join(name);
                read_bounded(&path, PASSWORD_MAX)
                    .map_err(|source| GatewayError::Password { file: path.clone(), source })
            });
            let bytes = password.transpose()?.unwrap_or_default();
            let first = bytes.split(|b| *b == b'\n' || *b == b'\r').next().unwrap_or_default().to_vec();
            options.set_credentials(user.clone(), first);
        }
        Ok(Self { options, topic, every: Duration::from_secs_f64(config.interval_s) })
    }

    /// First levels of all topics.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Publishes until `stopped`; connects again for as long as it takes.
    pub async fn run(
        self,
        readings: watch::Receiver<Reading>,
        mut stopped: watch::Receiver<bool>,
        report: Report,
    ) {
        let (client, mut broker) = AsyncClient::builder(self.options.clone()).capacity(QUEUE).build();
        let (sender, connected) = watch::channel(false);
        // a task of its own: an attempt to connect is not given up because a status is due
        let link = tokio::spawn(async move {
            let mut seldom = Seldom::default();
            loop {
                match broker.poll().await {
                    Ok(Event::Incoming(Incoming::ConnAck(_))) => {
                        report("connected to the broker");
                        sender.send_replace(true);
                    }
                    Ok(_) => {}
                    Err(rumqttc::ConnectionError::RequestsDone) => break,
                    Err(error) => {
                        sender.send_replace(false);
                        let text = format!("no connection to the broker: {error}");
                        if seldom.is_due(&text, Instant::now()) {
                            report(&text);
                        }
                        tokio::time::sleep(PAUSE).await;
                    }
                }
            }
        });
        tokio::select! {
            () = self.publish(&client, readings, connected) => {}
            () = super::wish(&mut stopped) => {}
        }
        let retained = PublishOptions::at_least_once().retained();
        let _ = client.try_publish(below(&self.topic, "availability"), "offline", retained);
        let _ = client.disconnect().await;
        let _ = link.await;
    }

    async fn publish(
        &self,
        client: &AsyncClient,
        readings: watch::Receiver<Reading>,
        mut connected: watch::Receiver<bool>,
    ) {
        let mut ticks = tokio::time::interval(self.every);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut said = Said::default();
        loop {
            ticks.tick().await;
            if !*connected.borrow_and_update() {
                // the broker may have forgotten everything
                said.forget();
                if connected.changed().await.is_err() {
                    return;
                }
                continue;
            }
            let reading = readings.borrow().clone();
            for (name, payload, retained) in said.messages(reading, SystemTime::now()) {
                let options = PublishOptions::at_least_once().retain(retained);
                // a full queue: the next interval says it again
                let _ = client.try_publish(below(&self.topic, name), payload, options);
            }
        }
    }
}

fn below(topic: &str, name: &str) -> String {
    format!("{topic}/{name}")
}

/// What was published last.
#[derive(Debug, Default)]
struct Said {
    available: Option<bool>,
    health: Option<Value>,
    /// Time and number of the newest event that was published; those before the first connection are not events.
    newest: Option<String>,
}

impl Said {
    fn forget(&mut self) {
        (self.available, self.health) = (None, None);
    }

    /// Name below the first levels, payload, retained.
    fn messages(
        &mut self,
        reading: Option<Arc<Status>>,
        now: SystemTime,
    ) -> Vec<(&'static str, String, bool)> {
        let mut out = Vec::new();
        let available = reading.is_some();
        if self.available.replace(available) != Some(available) {
            out.push(("availability", if available { "online" } else { "offline" }.to_owned(), true));
        }
        let health = health_of(reading.as_deref());
        if self.health.as_ref() != Some(&health) {
            let mut stamped = health.clone();
            stamped["time"] = utc::text(now).into();
            out.push(("health", stamped.to_string(), true));
            self.health = Some(health);
        }
        let Some(status) = reading else { return out };
        let key = |time: &str, code: &str| format!("{time} {code}");
        if let Some(last) = &self.newest {
            // in the order of their first occurrence on the wire
            let mut new: Vec<_> = status.events.iter().filter(|e| key(&e.time, &e.code) > *last).collect();
            new.sort_by_key(|e| key(&e.time, &e.code));
            for event in new {
                out.push(("event", json!(event).to_string(), false));
            }
        }
        let newest = status.events.iter().map(|e| key(&e.time, &e.code)).max().unwrap_or_default();
        self.newest = self.newest.take().max(Some(newest));
        if let Ok(text) = serde_json::to_string(&*status) {
            out.push(("status", text, true));
        }
        out
    }
}

/// State and verdict; unknown where the daemon does not answer, so that no retained one speaks for it.
fn health_of(reading: Option<&Status>) -> Value {
    let Some(Status { state, health, .. }) = reading else {
        return json!({
            "state": null, "verdict": "unknown", "code": null, "cause": "the daemon does not answer",
            "remedy": "volcomp status on its computer says more",
        });
    };
    json!({
        "state": state, "verdict": health.verdict, "code": health.code, "cause": health.cause,
        "remedy": health.remedy,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mtconnect::tests::{event, status};

    fn names(messages: &[(&'static str, String, bool)]) -> Vec<&'static str> {
        messages.iter().map(|m| m.0).collect()
    }

    #[test]
    fn states_are_retained_and_said_where_they_change_and_events_are_said_once() {
        let now = SystemTime::UNIX_EPOCH;
        let mut said = Said::default();
        let first = said.messages(Some(Arc::new(status())), now);
        // events of before are history
        assert_eq!(names(&first), ["availability", "health", "status"]);
        assert!(first.iter().all(|m| m.2));
        let health: Value = serde_json::from_str(&first[1].1).unwrap();
        assert_eq!(
            (&health["state"], &health["time"]),
            (&json!("active"), &json!("1970-01-01T00:00:00.000Z"))
        );
        assert_eq!(names(&said.messages(Some(Arc::new(status())), now)), ["status"]);
        let mut later = status();
        later.state = "faulted".into();
        later.events.insert(0, event("2026-11-24T10:00:01.000Z", "VC-4001"));
        later.events.insert(0, event("2026-11-24T10:00:02.000Z", "VC-2003"));
        let next = said.messages(Some(Arc::new(later.clone())), now);
        assert_eq!(names(&next), ["health", "event", "event", "status"]);
        assert!(next[1].1.contains("VC-4001") && next[2].1.contains("VC-2003") && !next[1].2);
        let gone = said.messages(None, now);
        assert_eq!(names(&gone), ["availability", "health"]);
        let health: Value = serde_json::from_str(&gone[1].1).unwrap();
        assert_eq!((&health["verdict"], &health["state"]), (&json!("unknown"), &Value::Null));
        assert!(said.messages(None, now).is_empty());
        assert_eq!(names(&said.messages(Some(Arc::new(later)), now)), ["availability", "health", "status"]);
    }

    #[test]
    fn a_new_connection_is_told_everything_again_but_no_old_event() {
        let now = SystemTime::UNIX_EPOCH;
        let mut said = Said::default();
        let _ = said.messages(Some(Arc::new(status())), now);
        said.forget();
        assert_eq!(
            names(&said.messages(Some(Arc::new(status())), now)),
            ["availability", "health", "status"]
        );
    }
}
