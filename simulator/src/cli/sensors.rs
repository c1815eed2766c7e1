//! Sensors beside the simulated machine: `cncsim serve --sensors ADDRESS` with their options.

use core::net::SocketAddr;

use volcomp_units::axes::AxisName;

use crate::control::CycleRecord;
use crate::instruments::link::SensorLink;
use crate::instruments::live::{LiveLaser, LivePlan, LiveTracker};
use crate::truth::TruthMachine;
use crate::truth::drift::{DriftSize, RamDrift};

/// Sensors and what they have to find.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct SensorArgs {
    /// Send what a laser tracker sees of the tool to a daemon's `[sensors] listen`.
    #[arg(long, value_name = "IP:PORT")]
    sensors: Option<SocketAddr>,
    /// Name of the tracker in the daemon's machine file.
    #[arg(long, value_name = "NAME", default_value = "tracker")]
    tracker: String,
    /// Time between its readings, ms.
    #[arg(long, value_name = "MS", default_value = "20")]
    tracker_every_ms: f64,
    /// Noise of the tip, um.
    #[arg(long, value_name = "UM", default_value = "5")]
    tracker_noise_um: f64,
    /// Noise of the direction of the tool, arcsec.
    #[arg(long, value_name = "ARCSEC", default_value = "4")]
    tracker_noise_arcsec: f64,
    /// Share of readings that are far off, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value = "0")]
    tracker_outliers: f64,
    /// Share of readings after which two seconds are missing, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value = "0")]
    tracker_dropouts: f64,
    /// From this time on the tracker is off in x, by --tracker-bias-um; s.
    #[arg(long, value_name = "S", requires = "tracker_bias_um")]
    tracker_bias_at_s: Option<f64>,
    /// By how much, um.
    #[arg(long, value_name = "UM", requires = "tracker_bias_at_s", allow_negative_numbers = true)]
    tracker_bias_um: Option<f64>,
    /// Name of a 5-DOF laser along X in the daemon's machine file; without it there is none.
    #[arg(long, value_name = "NAME")]
    laser_x: Option<String>,
    /// The ram (the carriage of Z) is off from the beginning: positions, um; a tenth of it in arcsec.
    #[arg(long, value_name = "UM", default_value = "0")]
    ram_um: f64,
    /// And drifts: um in an hour; a tenth of it in arcsec.
    #[arg(long, value_name = "UM", default_value = "0")]
    ram_drift_um_per_h: f64,
}

/// The sensors of a run.
pub(super) struct Sensors {
    link: SensorLink,
    tracker: (String, LiveTracker),
    laser: Option<(String, LiveLaser)>,
    /// Wire index of X.
    x: Option<usize>,
}

impl SensorArgs {
    /// Lets the ram be as it was asked for.
    pub(super) fn disturb(&self, machine: &mut TruthMachine, seed: u64) {
        if self.ram_um == 0.0 && self.ram_drift_um_per_h == 0.0 {
            return;
        }
        let pair = |um: f64| [um * 1e-3, 0.1 * um / 206_264.806];
        let size = DriftSize {
            from_survey: pair(self.ram_um),
            per_h: pair(self.ram_drift_um_per_h),
            ..DriftSize::default()
        };
        machine.set_ram_drift(Some(RamDrift::new(size, seed)));
    }

    /// The sensors, where there are any.
    pub(super) fn open(&self, machine: &TruthMachine, seed: u64) -> Option<Sensors> {
        let address = self.sensors?;
        let plan = LivePlan {
            every_s: self.tracker_every_ms * 1e-3,
            noise_um: self.tracker_noise_um,
            noise_arcsec: self.tracker_noise_arcsec,
            outliers: self.tracker_outliers,
            dropouts: self.tracker_dropouts,
            bias: self.tracker_bias_at_s.zip(self.tracker_bias_um).map(|(at, size)| [at, size]),
            ..LivePlan::default()
        };
        Some(Sensors {
            link: SensorLink::new(address),
            tracker: (self.tracker.clone(), LiveTracker::new(plan, seed)),
            laser: self.laser_x.clone().map(|name| (name, LiveLaser::new(0.05, 0.3, 0.1, seed))),
            x: machine.index_of(AxisName::X),
        })
    }
}

impl Sensors {
    /// What is seen in this cycle goes out; a daemon that is not there costs readings and nothing else.
    pub(super) fn look(&mut self, record: &CycleRecord, machine: impl FnOnce(usize) -> [f64; 6]) {
        let t = record.time_s;
        let (name, tracker) = &mut self.tracker;
        let mut text =
            tracker.line(name, t, record.sample.tip_mm, record.sample.direction).unwrap_or_default();
        if let (Some((name, laser)), Some(x)) = (&mut self.laser, self.x) {
            let [_, ey, ez, ea, eb, ec] = machine(x);
            text += &laser.line(name, t, record.commanded[x], [ey, ez, ea, eb, ec]).unwrap_or_default();
        }
        if !text.is_empty() {
            self.link.send(text.as_bytes());
        }
    }
}
