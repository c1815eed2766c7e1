//! Control, machine and daemon started from the daemon's machine file, in simulated time.
//!
//! The daemon shares nothing with one that runs already: [`private`].

use std::path::Path;

use anyhow::{Context, bail};
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
    /// Starts a control on a free port of loopback, and a daemon with the machine file as [`private`] makes it of this one:
    /// it shares nothing with a daemon that runs already and needs no right.
    ///
    /// # Errors
    /// `volcomp check` refuses the file, it does not enable by itself, or the daemon does not compensate; its log is `log`.
    #[expect(
        clippy::disallowed_methods,
        reason = "reads the machine file of the daemon and writes that of its own"
    )]
    pub fn start(
        machine: TruthMachine,
        programs: &Programs,
        machine_file: &Path,
        log: &Path,
    ) -> anyhow::Result<Self> {
        let see = || machine_file.display().to_string();
        let file: toml::Table =
            std::fs::read_to_string(machine_file).with_context(see)?.parse().with_context(see)?;
        // so that errors of the file name it, not the copy
        programs.volcomp(&["check", &see()])?;
        let key = |table: &str, key: &str| {
            file.get(table).and_then(|table| table.get(key)).and_then(toml::Value::as_str)
        };
        let start = key("engine", "start").unwrap_or("on-command");
        if start != "on-connect" {
            bail!(
                "{}: [engine] start is \"{start}\"; it must be \"on-connect\": nobody enables the compensation here",
                see()
            );
        }
        let axes = MachineAxes::of(&machine)?;
        let middle = axes.middle();
        let config = ControlConfig {
            cycle_s: CYCLE_S,
            listen: ([127, 0, 0, 1], 0).into(),
            pacing: Pacing::lock_step(),
            interface: if key("link", "interface") == Some("read-write") {
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
        let folder = tempfile::tempdir()?;
        let copy = folder.path().join("machine.toml");
        let seen_from = std::path::absolute(machine_file)?;
        let text = private(file, seen_from.parent().unwrap_or(Path::new("/")), &shop.address())?;
        std::fs::write(&copy, text).with_context(|| copy.display().to_string())?;
        let daemon = shop.start_daemon(programs, &copy, log)?;
        shop.dwell(SETTLE_S)?;
        Ok(Self { about, shop, _daemon: daemon })
    }
}

/// The machine file of a short-lived daemon: without status socket, HTTP service, TLS, state, recordings, sensors and
/// real-time rights, with its control at `address`, patient with a busy computer, and with paths that do not depend on where
/// the file is.
fn private(mut file: toml::Table, folder: &Path, address: &str) -> anyhow::Result<String> {
    for table in ["http", "state", "recording"] {
        file.remove(table);
    }
    let rebase = |value: &mut toml::Value| {
        if let Some(path) = value.as_str() {
            *value = folder.join(path).display().to_string().into();
        }
    };
    file.get_mut("model").map(rebase);
    file.get_mut("additions").and_then(toml::Value::as_array_mut).into_iter().flatten().for_each(rebase);
    let mut set = |name: &str, key: &str, value: toml::Value| {
        let table = file.entry(name).or_insert_with(|| toml::Table::new().into());
        if let Some(table) = table.as_table_mut() {
            table.remove("tls");
            table.insert(key.to_owned(), value);
        }
    };
    set("link", "address", address.into());
    set("status", "socket", "".into());
    set("sensors", "listen", "".into());
    set("log", "target", "stderr".into());
    set("realtime", "priority", 0.into());
    set("realtime", "lock-memory", false.into());
    // time is simulated: a pause of this computer is none of the machine's
    set("link", "silence-s", 600.0.into());
    set("engine", "stale-ms", 10_000.0.into());
    Ok(toml::to_string(&file)?)
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
