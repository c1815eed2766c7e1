//! The machine file and the model file of the daemon under test.
//!
//! The model is full: every one of the six error motions of every axis is a Fourier series of order 5, the
//! squarenesses are there, and the motions of the last axis carry a live value each, as a filter feeds them. Five
//! axes are those of a gantry with a fork head. Values are of the size of a real machine's.

use core::fmt::Write;
use core::net::SocketAddr;
use std::path::Path;

use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};

/// Harmonics of each error motion.
const ORDER: usize = 5;
/// Travel of a linear axis, mm, and of a rotary one, deg; both begin at 0.
const TRAVEL: f64 = 500.0;

/// Which machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axes {
    /// X Y Z, 18 error motions.
    Three,
    /// X Y Z C A, 30 error motions.
    Five,
}

/// Everything that the machine file says beyond its axes.
#[derive(Debug, Clone, PartialEq)]
pub struct DaemonSettings {
    /// Address of the control.
    pub address: SocketAddr,
    /// Control cycle, ms.
    pub cycle_ms: f64,
    /// SCHED_FIFO priority, 0 for none.
    pub priority: u8,
    /// Processor to run on.
    pub cpu: Option<u16>,
    /// Lock the memory.
    pub lock_memory: bool,
    /// Time to poll before and after the moment at which a frame is expected, us.
    pub busy_poll_us: f64,
    /// The link is TLS, with `ca.pem`, `daemon.pem` and `daemon.key` beside the machine file.
    pub tls: bool,
}

impl Axes {
    /// The name in arguments and figures.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Three => "three",
            Self::Five => "five",
        }
    }

    /// Machine id.
    #[must_use]
    pub const fn machine(self) -> &'static str {
        match self {
            Self::Three => "bench-three",
            Self::Five => "bench-five",
        }
    }

    /// The axes in wire order.
    #[must_use]
    pub const fn names(self) -> &'static [AxisName] {
        match self {
            Self::Three => &[AxisName::X, AxisName::Y, AxisName::Z],
            Self::Five => &[AxisName::X, AxisName::Y, AxisName::Z, AxisName::C, AxisName::A],
        }
    }

    /// Error motions of the model.
    #[must_use]
    pub const fn motions(self) -> usize {
        self.names().len() * 6
    }

    /// Where the axes are at a time: a slow tour through the whole travel, mm and deg.
    #[must_use]
    pub fn position(self, time_s: f64) -> AxisArray {
        let mut position = [0.0; MAX_AXES];
        for (k, place) in position.iter_mut().enumerate().take(self.names().len()) {
            let speed_rad_per_s = 1.0 / (1.0 + 0.37 * k as f64);
            *place = TRAVEL * (0.5 + 0.45 * (speed_rad_per_s * time_s).sin());
        }
        position
    }

    /// The machine file; `model.toml` and `volcompd.sock` stand beside it.
    #[must_use]
    pub fn machine_file(self, settings: &DaemonSettings, socket: &Path) -> String {
        let DaemonSettings { address, cycle_ms, priority, cpu, lock_memory, busy_poll_us, tls } = settings;
        let tls = match tls {
            true => "[link.tls]\nca = \"ca.pem\"\ncertificate = \"daemon.pem\"\nkey = \"daemon.key\"\n",
            false => "",
        };
        // while the echo has its turn the link is silent: that must be no reason to ramp out
        let mut text = format!(
            "format = \"volcomp-machine/1\"\nmachine = \"{}\"\nmodel = \"model.toml\"\n\
             [link]\naddress = \"{address}\"\ncycle-ms = {cycle_ms:?}\nsilence-s = 5.0\n\
             {tls}[engine]\nstart = \"on-connect\"\nramp-s = 0.1\nstale-ms = 3000.0\n\
             [realtime]\npriority = {priority}\nlock-memory = {lock_memory}\nbusy-poll-us = {busy_poll_us:?}\n",
            self.machine(),
        );
        // writing to a string cannot fail
        if let Some(cpu) = cpu {
            let _ = writeln!(text, "cpu = {cpu}");
        }
        let _ = writeln!(text, "[status]\nsocket = {:?}\n[log]\ntarget = \"stderr\"", socket.display());
        for axis in self.names() {
            let (letter, unit, jump) = match axis.kind() {
                AxisKind::Linear => (axis.lower(), "um", "jump-mm"),
                AxisKind::Rotary => (axis.lower(), "arcsec", "jump-deg"),
            };
            let _ = writeln!(
                text,
                "[axes.{letter}]\nlimit-{unit} = 1500.0\nrate-{unit}-per-s = 100000.0\n\
                 acceleration-{unit}-per-s2 = 10000000.0\n{jump} = 1000.0"
            );
        }
        text
    }

    /// The model file.
    #[must_use]
    pub fn model_file(self) -> String {
        let chain = match self {
            Self::Three => "[w b X Y Z t]",
            Self::Five => "[w b X Y Z C A t]",
        };
        let mut text = format!(
            "format = \"volcomp-model/1\"\nmachine = \"{}\"\nchain = \"{chain}\"\n\
             [frame]\ntool-tip-mm = [0, 0, -150]\n",
            self.machine()
        );
        for (k, axis) in self.names().iter().enumerate() {
            let letter = axis.lower();
            let (unit, point) = match axis.kind() {
                AxisKind::Linear => ("mm", ""),
                AxisKind::Rotary => ("deg", "point-mm = [0, 0, -50]\n"),
            };
            let _ = writeln!(text, "[axes.{letter}]\ntravel-{unit} = [0, {TRAVEL:?}]\n{point}");
            for (component, name) in ["ex", "ey", "ez", "ea", "eb", "ec"].iter().enumerate() {
                let symbol = format!("{name}{letter}");
                motion(&mut text, &symbol, unit, 7 * k + component);
                if k + 1 == self.names().len() {
                    let (unit, limit) = if component < 3 { ("um", 20.0) } else { ("arcsec", 5.0) };
                    let _ = writeln!(
                        text,
                        "[errors.{symbol}.live]\nsensor = \"{symbol}\"\nlimit-{unit} = {limit:?}"
                    );
                }
            }
        }
        for (symbol, value) in [("ec0y", 4.1), ("eb0z", -6.2), ("ea0z", 2.1)] {
            let _ = writeln!(text, "[errors.{symbol}.constant]\nvalue-arcsec = {value:?}");
        }
        text
    }
}

/// One error motion as a Fourier series.
fn motion(text: &mut String, symbol: &str, unit: &str, seed: usize) {
    let (value, size) = if symbol[1..].starts_with(['x', 'y', 'z']) { ("um", 5.0) } else { ("arcsec", 3.0) };
    let series = |part: usize| -> Vec<f64> {
        (0..ORDER).map(|n| size * ((seed * 13 + n * 3 + part) as f64).sin() / (n + 1) as f64).collect()
    };
    let _ = writeln!(
        text,
        "[errors.{symbol}.fourier]\nspan-{unit} = {TRAVEL:?}\nperiod-{unit} = {:?}\ncos-{value} = {:?}\nsin-{value} = {:?}",
        2.0 * TRAVEL,
        series(0),
        series(1),
    );
}
