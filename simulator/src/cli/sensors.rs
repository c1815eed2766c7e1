//! Sensors beside the simulated machine: `cncsim serve --sensors ADDRESS` with their options.

use core::net::SocketAddr;

use volcomp_units::axes::AxisName;
use volcomp_units::{mm_from_um, rad_from_arcsec};

use super::{EX_USAGE, Failure};
use crate::control::CycleRecord;
use crate::instruments::carriage::{Carriage, Mount};
use crate::instruments::fivedof::{FiveDofLaser, carriage_motion};
use crate::instruments::link::SensorLink;
use crate::instruments::live::{LiveLaser, LivePlan, LiveRawLaser, LiveTracker};
use crate::truth::TruthMachine;
use crate::truth::axis_drift::{AxisDrift, AxisDriftSize};
use crate::truth::drift::{DriftSize, RamDrift};

/// Sensors and what they have to find.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct SensorArgs {
    /// Send what a laser tracker sees of the tool, and 5-DOF lasers of the axes, to a daemon's `[sensors] listen`.
    #[arg(long, value_name = "IP:PORT")]
    sensors: Option<SocketAddr>,
    /// No tracker: only the lasers send.
    #[arg(long, requires = "sensors")]
    no_tracker: bool,
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
    #[command(flatten)]
    lasers: LaserArgs,
    /// The ram (the carriage of Z) is off from the beginning: positions, um; a tenth of it in arcsec.
    #[arg(long, value_name = "UM", default_value = "0")]
    ram_um: f64,
    /// And drifts: um in an hour; a tenth of it in arcsec.
    #[arg(long, value_name = "UM", default_value = "0")]
    ram_drift_um_per_h: f64,
    /// Straightness of the linear axes changes by this RMS, um; a fifth of it in arcsec for the angles.
    #[arg(long, value_name = "UM", default_value = "0")]
    axis_drift_um: f64,
    /// The change begins at this time, s.
    #[arg(long, value_name = "S", default_value = "0")]
    axis_drift_at_s: f64,
    /// Time constant of the change, s; 0 is a step.
    #[arg(long, value_name = "S", default_value = "30")]
    axis_drift_time_constant_s: f64,
}

/// 5-DOF lasers: on the carriage of an axis, the head on the body that the carriage moves on.
#[derive(Debug, Clone, clap::Args)]
struct LaserArgs {
    /// Name of a 5-DOF laser along X in the daemon's machine file; without it there is none.
    #[arg(long, value_name = "NAME", requires = "sensors")]
    laser_x: Option<String>,
    /// The same along Y.
    #[arg(long, value_name = "NAME", requires = "sensors")]
    laser_y: Option<String>,
    /// The same along Z.
    #[arg(long, value_name = "NAME", requires = "sensors")]
    laser_z: Option<String>,
    /// The lasers send their detectors instead of reduced readings, with the wander of their pointing.
    #[arg(long)]
    laser_raw: bool,
    /// Time between readings of a laser, ms.
    #[arg(long, value_name = "MS", default_value = "50")]
    laser_every_ms: f64,
    /// Wander of the pointing from reading to reading, arcsec.
    #[arg(long, value_name = "ARCSEC", default_value = "0.002")]
    laser_drift_arcsec: f64,
}

/// What a laser sends.
#[derive(Debug)]
enum Output {
    Reduced(Box<LiveLaser>),
    Raw(Box<LiveRawLaser>),
}

/// A laser on the carriage of one axis.
#[derive(Debug)]
struct AxisLaser {
    name: String,
    axis: AxisName,
    k: usize,
    /// Reference points of the machine's error motions, in M at home.
    reference_mm: [[f64; 3]; 3],
    output: Output,
    /// Last coordinate, and the direction in which it was reached.
    last: (f64, i8),
}

/// The sensors of a run.
pub(super) struct Sensors {
    link: SensorLink,
    tracker: Option<(String, LiveTracker)>,
    lasers: Vec<AxisLaser>,
}

impl SensorArgs {
    /// Lets ram and axes be as they were asked for.
    pub(super) fn disturb(&self, machine: &mut TruthMachine, seed: u64) {
        if self.axis_drift_um != 0.0 {
            let size = AxisDriftSize {
                rms: [mm_from_um(self.axis_drift_um), rad_from_arcsec(0.2 * self.axis_drift_um)],
                positioning_mm: 0.0,
                start_s: self.axis_drift_at_s,
                time_constant_s: self.axis_drift_time_constant_s,
            };
            machine.set_axis_drift(Some(AxisDrift::new(size, seed)));
        }
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
    ///
    /// # Errors
    /// The machine has no such axis.
    pub(super) fn open(&self, machine: &TruthMachine, seed: u64) -> Result<Option<Sensors>, Failure> {
        let Some(address) = self.sensors else { return Ok(None) };
        let plan = LivePlan {
            every_s: self.tracker_every_ms * 1e-3,
            noise_um: self.tracker_noise_um,
            noise_arcsec: self.tracker_noise_arcsec,
            outliers: self.tracker_outliers,
            dropouts: self.tracker_dropouts,
            bias: self.tracker_bias_at_s.zip(self.tracker_bias_um).map(|(at, size)| [at, size]),
            ..LivePlan::default()
        };
        let tracker = (!self.no_tracker).then(|| (self.tracker.clone(), LiveTracker::new(plan, seed)));
        Ok(Some(Sensors {
            link: SensorLink::new(address),
            tracker,
            lasers: self.lasers.open(machine, seed)?,
        }))
    }
}

impl LaserArgs {
    fn open(&self, machine: &TruthMachine, seed: u64) -> Result<Vec<AxisLaser>, Failure> {
        let mut lasers = Vec::new();
        for (name, axis) in
            [(&self.laser_x, AxisName::X), (&self.laser_y, AxisName::Y), (&self.laser_z, AxisName::Z)]
        {
            let Some(name) = name else { continue };
            let missing = || {
                let message = format_args!(
                    "--laser-{}: machine {} has no axis {axis}",
                    axis.lower(),
                    machine.machine()
                );
                Failure::new(EX_USAGE, message)
            };
            let k = machine.index_of(axis).ok_or_else(missing)?;
            let reference_mm = machine.drawing(k).ok_or_else(missing)?.reference_mm;
            let every_s = self.laser_every_ms * 1e-3;
            let own_seed = seed.wrapping_add(axis as u64);
            let output = if self.laser_raw {
                // one instrument has one point: that of the first straightness
                let point = reference_mm[(axis.direction() + 1) % 3];
                let laser = FiveDofLaser {
                    drift_arcsec: self.laser_drift_arcsec,
                    ..FiveDofLaser::built_in(point, own_seed)
                };
                Output::Raw(Box::new(LiveRawLaser::new(laser, axis, machine.travel(k)[0], every_s)))
            } else {
                Output::Reduced(Box::new(LiveLaser::new(every_s, 0.3, 0.1, own_seed)))
            };
            let last = (f64::NAN, 0);
            lasers.push(AxisLaser { name: name.clone(), axis, k, reference_mm, output, last });
        }
        Ok(lasers)
    }
}

impl AxisLaser {
    /// The line about this cycle, if it has one.
    fn line(&mut self, record: &CycleRecord, machine: &TruthMachine) -> Option<String> {
        let at = &record.sample.axis;
        let q = at[self.k];
        let (before, direction) = self.last;
        let direction = if q > before {
            1
        } else if q < before {
            -1
        } else {
            direction
        };
        self.last = (q, direction);
        let carriage = Carriage::new(machine, self.axis, Mount::Carriage).ok()?;
        let t = record.time_s;
        match &mut self.output {
            Output::Reduced(laser) => laser.line_of(&self.name, t, q, || {
                carriage_motion(self.axis, &carriage.at_position(at, direction), &self.reference_mm)
            }),
            Output::Raw(laser) => laser.line(&self.name, t, q, || carriage.at_position(at, direction)),
        }
    }
}

impl Sensors {
    /// What is seen in this cycle goes out; a daemon that is not there costs readings and nothing else. `machine` is
    /// the machine at this time, as the lasers on its carriages see it.
    pub(super) fn look(&mut self, record: &CycleRecord, machine: &TruthMachine) {
        let sample = &record.sample;
        let mut text = self
            .tracker
            .as_mut()
            .and_then(|(name, t)| t.line(name, record.time_s, sample.tip_mm, sample.direction))
            .unwrap_or_default();
        for laser in &mut self.lasers {
            text += &laser.line(record, machine).unwrap_or_default();
        }
        if !text.is_empty() {
            self.link.send(text.as_bytes());
        }
    }
}
