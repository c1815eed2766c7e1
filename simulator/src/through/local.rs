//! Control, machine and daemon started from the daemon's machine file, in simulated time.

use std::path::Path;

use anyhow::Context;
use volcomp_protocol::Tool;

use super::{About, Measured, Point, Selection, Want};
use crate::control::{ControlConfig, Flow, Interface, Pacing};
use crate::demo::programs::{Daemon, Programs};
use crate::demo::shop::Shop;
use crate::motion::MachineAxes;
use crate::truth::TruthMachine;

/// Control cycle, s.
const CYCLE_S: f64 = 0.001;
/// Standstill before the first run: the servo settles, s.
const SETTLE_S: f64 = 0.5;

/// A pair of control and daemon of one's own.
pub struct Local {
    about: About,
    shop: Shop,
    /// Ended with the measurement.
    _daemon: Daemon,
}

impl Local {
    /// Starts a control on the address in `[link]` of the daemon's machine file, and the daemon with this file.
    ///
    /// # Errors
    /// The file has no address, the address is not free, or the daemon does not compensate; its log is `log`.
    #[expect(clippy::disallowed_methods, reason = "reads the machine file of the daemon")]
    pub fn start(
        machine: TruthMachine,
        programs: &Programs,
        machine_file: &Path,
        log: &Path,
    ) -> anyhow::Result<Self> {
        let see = || machine_file.display().to_string();
        let text = std::fs::read_to_string(machine_file).with_context(see)?;
        let table: toml::Table = text.parse().with_context(see)?;
        let link = |key: &str| table.get("link").and_then(|link| link.get(key)).and_then(toml::Value::as_str);
        let address = link("address").with_context(|| format!("{}: [link] address is missing", see()))?;
        let listen = address.parse().with_context(|| format!("{}: [link] address \"{address}\"", see()))?;
        let axes = MachineAxes::of(&machine)?;
        let middle = axes.middle();
        let config = ControlConfig {
            cycle_s: CYCLE_S,
            listen,
            pacing: Pacing::lock_step(),
            interface: if link("interface") == Some("read-write") {
                Interface::CALLS
            } else {
                Interface::Frames
            },
            tool: Some(Tool { number: 1, tip: machine.tool_tip_mm() }),
            ..ControlConfig::new(machine.machine(), axes)
        };
        let about = About::of(&machine, CYCLE_S);
        let seed = machine.seed();
        let mut shop = Shop::with_control(machine, seed, config, &middle)?;
        let daemon = shop.start_daemon(programs, machine_file, log).with_context(|| {
            format!(
                "{} must have start = \"on-connect\" in [engine]: nobody enables the compensation here",
                see()
            )
        })?;
        shop.dwell(SETTLE_S)?;
        Ok(Self { about, shop, _daemon: daemon })
    }
}

impl Measured for Local {
    fn about(&self) -> &About {
        &self.about
    }

    fn run(&mut self, program: &str, want: Want) -> anyhow::Result<Vec<Point>> {
        let mut motion = self.shop.trajectory(program)?;
        let truth = self.shop.machine().clone();
        let mut selection = Selection::new(want);
        self.shop.watch(&mut motion, &mut |r| {
            selection.see(&truth, r);
            Ok(Flow::GoOn)
        })?;
        Ok(selection.finish(&truth))
    }
}
