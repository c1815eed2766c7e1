//! What a scenario says: a few overrides of the defaults, and what happens when.

use anyhow::{Context, bail};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::fault::LinkFault;
use super::tracker::{SensorPart, TrackerFault};

/// The scenarios that are shipped.
pub const CATALOGUE: &str = include_str!("catalogue.toml");

/// All scenarios of a file, defaults filled in.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// In the order of their numbers.
    pub scenarios: Vec<Scenario>,
}

/// How cycles follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pacing {
    /// Every position waits for its answer: the same run every time.
    LockStep,
    /// At the cycle time.
    RealTime,
}

/// One scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Scenario {
    /// Its number; never used for another one.
    pub number: u32,
    /// What goes wrong.
    pub name: String,
    /// Turns of a circle of 20 mm.
    pub turns: usize,
    /// Feed on the circle.
    pub feed_mm_per_min: u32,
    /// How cycles follow each other.
    pub pacing: Pacing,
    /// Lock step: longest wait for an answer.
    pub answer_ms: f64,
    /// Seed of machine and link.
    pub seed: u64,
    /// True: frames pass the relay; false: straight to the control.
    pub relay: bool,
    /// True: a daemon is started before the first cycle.
    pub daemon: bool,
    /// True: homed and drives on at the start.
    pub ready: bool,
    /// Cycles from a position to the use of its correction.
    pub delay_cycles: u32,
    /// True: the daemon may take real-time priority and lock memory, where this process may.
    pub privileges: bool,
    /// Runs at most, until one holds: more than one where the computer's own time plays a part, which others share.
    pub tries: u32,
    /// Largest file that the daemon may write, in units of 1024 bytes: to it a longer one is a disk that is full.
    #[serde(default)]
    pub file_limit_kib: Option<u32>,
    /// True: certificates for TLS lie beside the machine file: ca, control and daemon of one authority, other-ca and
    /// other-daemon of another one.
    pub certificates: bool,
    /// What is different about the control.
    pub control: ControlPart,
    /// A ram that is no longer as it was surveyed, and a tracker that watches the tool; without it neither.
    #[serde(default)]
    pub sensors: Option<SensorPart>,
    /// Keys of the machine file that differ, as tables.
    pub machine: Table,
    /// Keys of the model file that differ, as tables.
    pub model: Table,
    /// What happens, in the order of the cycles.
    #[serde(rename = "do")]
    pub actions: Vec<Step>,
    /// What must hold.
    pub accept: Accept,
}

/// A control other than the usual one.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ControlPart {
    /// Its machine id.
    #[serde(default)]
    pub machine: Option<String>,
    /// Largest offset that it applies to a linear axis.
    #[serde(default)]
    pub limit_um: Option<f64>,
    /// Silence of the daemon after which it closes the link.
    #[serde(default)]
    pub silence_s: Option<f64>,
    /// True: it speaks TLS only, with the certificate of the scenario.
    #[serde(default)]
    pub tls: bool,
}

/// Something that happens at a cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Cycle, counted from the first.
    pub at: u64,
    /// What.
    #[serde(flatten)]
    pub action: Action,
}

/// What can happen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "what", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub enum Action {
    /// Another daemon is started and waited for.
    StartDaemon,
    /// The daemon is started and not waited for.
    SpawnDaemon,
    /// A daemon beside the first one.
    StartSecondDaemon {
        /// It has the status socket of the first one, too.
        #[serde(default)]
        same_socket: bool,
    },
    /// The daemon is killed.
    KillDaemon,
    /// The daemon gets SIGTERM.
    TermDaemon,
    /// The daemon stands still.
    SuspendDaemon,
    /// It goes on.
    ResumeDaemon,
    /// The daemon gets SIGHUP.
    HangupDaemon,
    /// Simulated time stands still until the daemon has ended by itself.
    WaitForExit,
    /// Simulated time stands still until the log of the daemons says this.
    WaitForLog {
        /// The words.
        words: String,
    },
    /// Simulated time stands still for so long.
    Pause {
        /// So long.
        ms: u64,
    },
    /// The daemon is suspended for so long, in real time.
    HangDaemon {
        /// So long.
        ms: u64,
    },
    /// Emergency stop.
    Estop,
    /// It is released.
    EstopRelease,
    /// Drives off.
    DrivesOff,
    /// Drives on.
    DrivesOn,
    /// Axes lose their reference.
    Unhome,
    /// They are homed.
    Home,
    /// Another tool.
    Tool {
        /// Its length below the tool tip of the model.
        longer_mm: f64,
    },
    /// A command for the daemon: `volcomp ARGS`.
    Volcomp {
        /// Verb and arguments; `--socket` is added.
        args: Vec<String>,
        /// Exit code that is expected.
        #[serde(default)]
        exit: i32,
    },
    /// The model file is written anew: every value times a factor.
    ScaleModel {
        /// The file, beside the machine file.
        file: String,
        /// The factor.
        by: f64,
    },
    /// A file in the daemon's folder gets this text.
    WriteFile {
        /// The file.
        file: String,
        /// Its text.
        text: String,
    },
    /// In the daemon's folder, a pipe that nobody reads stands where a file is to be: whoever opens it, waits.
    MakePipe {
        /// Its name.
        file: String,
    },
    /// Words in a file of the daemon's folder are replaced.
    ReplaceInFile {
        /// The file.
        file: String,
        /// The words.
        from: String,
        /// What stands in their place.
        to: String,
    },
    /// From now on the link does this.
    Link(LinkFault),
    /// From now on the tracker does this.
    Tracker(TrackerFault),
    /// All processors are busy for so long.
    BusyProcessors {
        /// So long.
        ms: u64,
    },
    /// The control restarts in order: a new one listens in its place, without offset.
    RestartControl,
    /// The control is gone without a word, as after a power cut.
    KillControl,
    /// A new control listens in the place of the one killed, without offset.
    StartControl,
    /// The control stands still for so long.
    HangControl {
        /// So long.
        ms: u64,
    },
    /// So many connections come and go.
    ConnectionStorm {
        /// Connections.
        count: u32,
    },
    /// So many connections to the status socket come at once, say something and go.
    CommandStorm {
        /// Connections.
        count: u32,
    },
    /// Simulated time stands still until a daemon is connected.
    WaitForDaemon,
    /// Nothing; moves the moment from which settling is counted.
    Mark,
}

/// What must hold at the end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Accept {
    /// Largest radial deviation over the last second of motion.
    pub largest_um: f64,
    /// RMS of the same.
    pub rms_um: f64,
    /// Largest change of an offset from one cycle to the next, over the whole run.
    pub step_um: f64,
    /// Control time from the last thing that happened until the daemon is in its final state for good.
    pub settle_s: f64,
    /// Cycles without an answer or with a late one.
    pub unanswered: u64,
    /// State at the end: a correction state, `none` without a daemon, `any` where it is not judged.
    pub state: String,
    /// Largest offset of any axis over the whole run.
    pub offset_um: f64,
    /// True: more answers than `limited_cycles` must say that an axis is limited; false: that many may at most.
    pub limited: bool,
    /// Answers that may say so in passing: a plan that changes in the middle of a move is braked by the limit of the
    /// acceleration.
    pub limited_cycles: usize,
    /// Words that the daemon's log, or what `volcomp` said, must hold, such as the numbers of `volcomp explain`.
    pub log: Vec<String>,
    /// Lines that the log may have at most: whatever a peer does, it must not flood the log.
    pub lines: usize,
    /// Exit code of a daemon that ends by itself.
    pub exit: Option<i32>,
    /// Exit code of the second daemon, where it ends by itself.
    pub second_exit: Option<i32>,
}

impl Plan {
    /// Reads a file of scenarios.
    ///
    /// # Errors
    /// It is no such file; the message names the scenario.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let file: Table = text.parse()?;
        let Some(Value::Table(defaults)) = file.get("defaults") else { bail!("[defaults] is missing") };
        let Some(Value::Array(list)) = file.get("scenario") else { bail!("there is no [[scenario]]") };
        let mut scenarios = Vec::with_capacity(list.len());
        for entry in list {
            let Value::Table(entry) = entry else { bail!("a scenario is a table") };
            let mut full = defaults.clone();
            let mut entry = entry.clone();
            if let Some(kind) = entry.remove("like") {
                let known = file.get("kinds").zip(kind.as_str()).and_then(|(kinds, kind)| kinds.get(kind));
                let Some(Value::Table(kind)) = known else { bail!("there is no [kinds.{kind}]") };
                merge(&mut full, kind);
            }
            merge(&mut full, &entry);
            let name = entry.get("number").map_or_else(|| "without number".to_owned(), Value::to_string);
            let scenario: Scenario = full.try_into().with_context(|| format!("scenario {name}"))?;
            scenarios.push(scenario);
        }
        scenarios.sort_by_key(|s| s.number);
        if let Some(twice) = scenarios.windows(2).find(|p| p[0].number == p[1].number) {
            bail!("scenario {} occurs twice", twice[0].number);
        }
        Ok(Self { scenarios })
    }

    /// The shipped ones.
    ///
    /// # Errors
    /// Never in a tested build.
    pub fn shipped() -> anyhow::Result<Self> {
        Self::parse(CATALOGUE)
    }
}

/// Puts `over` over `base`; tables are merged key by key.
pub(super) fn merge(base: &mut Table, over: &Table) {
    for (key, value) in over {
        match (base.get_mut(key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => merge(below, above),
            _ => {
                base.insert(key.clone(), value.clone());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_scenarios_are_many_and_right() {
        let plan = Plan::shipped().unwrap();
        assert!(plan.scenarios.len() >= 110, "{}", plan.scenarios.len());
        for s in &plan.scenarios {
            assert!(s.actions.windows(2).all(|p| p[0].at <= p[1].at), "{}: actions out of order", s.number);
        }
    }

    #[test]
    fn a_mistake_names_its_scenario() {
        let text = "[defaults]\n[[scenario]]\nnumber = 7\nname = \"x\"\n";
        assert!(format!("{:#}", Plan::parse(text).unwrap_err()).contains("scenario 7"));
        let text = "[defaults]\n[[scenario]]\nnumber = 7\nlike = \"x\"\n";
        assert!(format!("{:#}", Plan::parse(text).unwrap_err()).contains("no [kinds.\"x\"]"));
    }
}
