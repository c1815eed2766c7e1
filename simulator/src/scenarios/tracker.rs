//! A tracker on the tool in a scenario, and what goes wrong with it.

#![expect(clippy::disallowed_methods, reason = "a port that is free is found by taking it")]

use core::net::SocketAddr;
use std::collections::VecDeque;
use std::net::TcpListener;

use serde::{Deserialize, Serialize};
use volcomp_units::{mm_from_um, rad_from_arcsec};

use crate::control::CycleRecord;
use crate::instruments::link::SensorLink;
use crate::instruments::live::{LivePlan, LiveTracker};
use crate::truth::drift::{DriftSize, RamDrift};
use crate::truth::{TruthMachine, VMC_850};

/// Its name in the machine file.
const NAME: &str = "tracker";
/// Arcsec per um of what the ram is off by.
const ANGLE_SHARE: f64 = 0.1;

/// A ram that is no longer as it was surveyed, and the tracker that sees it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", default, deny_unknown_fields)]
pub struct SensorPart {
    /// The ram is off by about so much in each direction, and by a tenth of it in arcsec about each.
    pub ram_um: f64,
    /// Time between readings.
    pub every_ms: f64,
    /// Noise of the tip.
    pub noise_um: f64,
    /// Noise of the direction.
    pub noise_arcsec: f64,
}

impl Default for SensorPart {
    fn default() -> Self {
        Self { ram_um: 20.0, every_ms: 10.0, noise_um: 3.0, noise_arcsec: 2.0 }
    }
}

impl SensorPart {
    /// What the ram is off by.
    #[must_use]
    pub fn ram(&self, seed: u64) -> RamDrift {
        let from_survey = [mm_from_um(self.ram_um), rad_from_arcsec(ANGLE_SHARE * self.ram_um)];
        RamDrift::new(DriftSize { from_survey, ..DriftSize::default() }, seed)
    }
}

/// What goes wrong with a tracker, from the moment it is set.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "fault", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub enum TrackerFault {
    /// Nothing any more.
    None,
    /// It says nothing.
    Silent,
    /// It says the same again and again, with new stamps.
    Frozen,
    /// Everything is off by so much in x.
    Step {
        /// By so much.
        um: f64,
    },
    /// Everything wanders away in x.
    Creep {
        /// Pace.
        um_per_s: f64,
    },
    /// X and Y are exchanged.
    SwappedAxes,
    /// What the tool deviates by in X and in Y is exchanged; where it is supposed to be is right.
    SwappedDeviations,
    /// Its clock is off by so much more.
    ClockStep {
        /// By so much.
        ms: f64,
    },
    /// Its readings arrive so much later.
    Late {
        /// By so much.
        ms: f64,
    },
    /// It connects anew for every reading.
    Reconnects,
    /// It says nonsense between its readings.
    Nonsense,
}

/// The tracker.
#[derive(Debug)]
pub(super) struct Tracker {
    link: SensorLink,
    plan: LivePlan,
    instrument: LiveTracker,
    /// The machine as it should be.
    machine: TruthMachine,
    fault: TrackerFault,
    /// When the fault began, s; set by the first cycle after it.
    since_s: Option<f64>,
    /// What a frozen one says, behind its stamp.
    frozen: Option<String>,
    /// Readings on their way: when they arrive.
    late: VecDeque<(f64, String)>,
}

impl Tracker {
    /// A tracker that will connect to a port that is free now.
    pub(super) fn new(part: SensorPart, seed: u64) -> anyhow::Result<Self> {
        let plan = LivePlan {
            every_s: part.every_ms * 1e-3,
            noise_um: part.noise_um,
            noise_arcsec: part.noise_arcsec,
            ..LivePlan::default()
        };
        let address = TcpListener::bind("127.0.0.1:0")?.local_addr()?;
        Ok(Self {
            link: SensorLink::new(address),
            plan,
            instrument: LiveTracker::new(plan, seed),
            machine: TruthMachine::from_toml(VMC_850)?,
            fault: TrackerFault::None,
            since_s: None,
            frozen: None,
            late: VecDeque::new(),
        })
    }

    /// Where the daemon has to listen.
    pub(super) const fn address(&self) -> SocketAddr {
        self.link.address()
    }

    /// From now on it does this.
    pub(super) fn begin(&mut self, fault: TrackerFault) {
        (self.fault, self.since_s, self.frozen) = (fault, None, None);
    }

    /// What it sees in a cycle goes out.
    pub(super) fn look(&mut self, record: &CycleRecord) {
        let t = record.time_s;
        let since = *self.since_s.get_or_insert(t);
        self.plan.skew = match self.fault {
            TrackerFault::ClockStep { ms } => Some([since, ms * 1e-3]),
            _ => None,
        };
        self.plan.bias = match self.fault {
            TrackerFault::Step { um } => Some([since, um]),
            TrackerFault::Creep { um_per_s } => Some([since, um_per_s * (t - since)]),
            _ => None,
        };
        self.instrument.set_plan(self.plan);
        let (mut tip, mut direction) = (record.sample.tip_mm, record.sample.direction);
        if self.fault == TrackerFault::SwappedAxes {
            tip.swap(0, 1);
            direction.swap(0, 1);
        }
        if self.fault == TrackerFault::SwappedDeviations {
            // where it is supposed to be, without the offset: that it sees, too
            let q = core::array::from_fn(|k| record.sample.encoder[k] - record.applied[k]);
            let nominal = self.machine.nominal(&q).tip_mm;
            let off: [f64; 3] = core::array::from_fn(|i| tip[i] - nominal[i]);
            tip = [nominal[0] + off[1], nominal[1] + off[0], tip[2]];
        }
        if let Some(line) = self.instrument.line(NAME, t, tip, direction) {
            self.say(t, line);
        }
        while self.late.front().is_some_and(|(at, _)| *at <= t) {
            if let Some((_, line)) = self.late.pop_front() {
                self.link.send(line.as_bytes());
            }
        }
    }

    fn say(&mut self, t: f64, line: String) {
        match self.fault {
            TrackerFault::Silent => {}
            TrackerFault::Frozen => {
                let (stamp, pose) = line.split_at(line.find("\"pose\"").unwrap_or(line.len()));
                let pose = self.frozen.get_or_insert_with(|| pose.to_owned());
                self.link.send(format!("{stamp}{pose}").as_bytes());
            }
            TrackerFault::Late { ms } => self.late.push_back((t + ms * 1e-3, line)),
            TrackerFault::Reconnects => {
                self.link.hang_up();
                self.link.send(line.as_bytes());
            }
            TrackerFault::Nonsense => {
                let nonsense =
                    "{\"sensor\": \"tracker\", \"t_s\": 1e999, \"pose\": {}}\nPOSE 1 2 3\n{\"sensor\"\n";
                self.link.send(format!("{nonsense}{line}").as_bytes());
            }
            TrackerFault::None
            | TrackerFault::Step { .. }
            | TrackerFault::Creep { .. }
            | TrackerFault::SwappedAxes
            | TrackerFault::SwappedDeviations
            | TrackerFault::ClockStep { .. } => self.link.send(line.as_bytes()),
        }
    }
}
