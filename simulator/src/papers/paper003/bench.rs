//! The gantry under its control, the trackers on its head, and the parts cut with nothing, with the surveyed model and with
//! live estimation.
//!
//! The control waits for each answer, and the daemon for its estimator, which keeps the control's time: nothing depends on
//! how fast the computer is.

use std::fmt::Write as _;

use anyhow::Context;
use toml::Value;

use super::super::{Setting, shop};
use super::World;
use super::parts::{Flank, Part};
use super::trackers::Watchers;
use crate::control::{CycleRecord, Flow, Interface};
use crate::demo::programs::Daemon;
use crate::demo::shop::Shop;
use crate::instruments::link::SensorLink;
use crate::motion::MachineAxes;
use crate::truth::TruthMachine;

/// Control cycle, s.
const CYCLE_S: f64 = 0.01;
/// Time between readings of the trackers, s.
const READ_S: f64 = 0.02;
/// Fastest feed at which the trackers read, mm/min; they do not read while it changes.
const READ_FEED: f64 = 1200.0;
/// When the tour begins, s of the control.
const TOUR_S: f64 = 6.0;
/// When the S and the cone are begun.
const S_S: f64 = 60.0;
const CONE_S: f64 = 118.0;
/// Live values of the model: the motions of the ram.
const SYMBOLS: [&str; 6] = ["exz", "eyz", "ezz", "eaz", "ebz", "ecz"];

/// Who corrects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Correction {
    /// Nobody.
    None,
    /// The surveyed model.
    Survey,
    /// The surveyed model and what the trackers teach.
    Live,
}

impl Correction {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::None => "uncompensated",
            Self::Survey => "surveyed model",
            Self::Live => "live estimation",
        }
    }
}

/// Cut parts.
pub(super) struct Cut {
    pub(super) s: Flank,
    pub(super) cone: Flank,
    /// Cycles of the S.
    pub(super) cycles: Vec<CycleRecord>,
    /// How often the daemon excluded the trackers.
    pub(super) excluded: usize,
}

struct Bench {
    shop: Shop,
    watchers: Option<(Watchers, SensorLink)>,
    now_s: f64,
    /// The trackers are silent while it is cut: the map is held.
    hold: bool,
}

impl Bench {
    fn observe(
        r: &CycleRecord,
        watchers: &mut Option<(Watchers, SensorLink)>,
        hold: bool,
        now_s: &mut f64,
    ) -> std::io::Result<Flow> {
        *now_s = r.time_s;
        let Some((watchers, link)) = watchers else { return Ok(Flow::GoOn) };
        let steady = watchers.is_steady(r.feed_mm_per_min);
        if steady
            && r.feed_mm_per_min <= READ_FEED
            && !(hold && r.scored)
            && let Some(line) = watchers.line("trackers", r)
        {
            link.send_and_wait(line.as_bytes())?;
        }
        Ok(Flow::GoOn)
    }

    fn run(&mut self, program: &str) -> anyhow::Result<Vec<CycleRecord>> {
        let mut motion = self.shop.trajectory(program)?;
        let Self { shop, watchers, now_s, hold } = self;
        let mut cycles = Vec::new();
        shop.watch(&mut motion, &mut |r: &CycleRecord| {
            if r.scored {
                cycles.push(*r);
            }
            Self::observe(r, watchers, *hold, now_s)
        })?;
        Ok(cycles)
    }

    /// Stands still until a time of the control.
    fn rest_until(&mut self, time_s: f64) -> anyhow::Result<()> {
        let left_s = time_s - self.now_s;
        anyhow::ensure!(left_s > 0.0, "the program took {:.1} s longer than planned", -left_s);
        let Self { shop, watchers, now_s, hold } = self;
        shop.watch_standing(left_s, &mut |r: &CycleRecord| Self::observe(r, watchers, *hold, now_s))?;
        Ok(())
    }
}

/// Cuts both parts, or the S alone; files of the run begin with `prefix`.
pub(super) fn cut(
    setting: &Setting,
    world: &World,
    correction: Correction,
    prefix: &str,
    cone: bool,
) -> anyhow::Result<Cut> {
    let machine = world.test.clone();
    let shop = shop(&machine, setting.seed, CYCLE_S, Interface::Frames, MachineAxes::middle)?;
    let mut bench = Bench { shop, watchers: None, now_s: 0.0, hold: false };
    let daemon = match correction {
        Correction::None => None,
        Correction::Survey | Correction::Live => {
            Some(start_daemon(setting, world, &mut bench, correction, prefix)?)
        }
    };
    bench.rest_until(TOUR_S)?;
    bench.run(&tour())?;
    bench.rest_until(S_S)?;
    let cycles = bench.run(&Part::S.program())?;
    let mut round = Vec::new();
    if cone {
        bench.rest_until(CONE_S)?;
        bench.hold = true;
        round = bench.run(&Part::Cone.program())?;
    }
    bench.shop.control().close();
    drop(daemon);
    let mut excluded = 0;
    if correction == Correction::Live {
        let log = std::fs::read_to_string(setting.path(&format!("{prefix}volcompd-live.log")))?;
        excluded = log.matches("cause=\"disagrees\"").count();
    }
    let origin = machine.nominal(&[0.0; 8]).tip_mm;
    let [s, cone] = [Flank::of(Part::S, &cycles, origin), Flank::of(Part::Cone, &round, origin)];
    Ok(Cut { s, cone, cycles, excluded })
}

/// The S of recorded set points on another machine.
pub(super) fn replayed(cut: &Cut, machine: &TruthMachine, seed: u64) -> Flank {
    let mut machine = machine.clone();
    let set_point = |r: &CycleRecord| {
        let mut set = r.commanded;
        set.iter_mut().zip(r.applied).for_each(|(q, offset)| *q += offset);
        set
    };
    let origin = machine.nominal(&[0.0; 8]).tip_mm;
    let Some(first) = cut.cycles.first() else { return Flank::default() };
    machine.reset(seed, &set_point(first));
    machine.set_time_s(first.time_s);
    let samples: Vec<_> = cut.cycles.iter().map(|r| machine.step(CYCLE_S, &set_point(r))).collect();
    Flank::cut(Part::S, samples.iter().map(|s| (s.tip_mm, s.direction)), origin)
}

fn start_daemon(
    setting: &Setting,
    world: &World,
    bench: &mut Bench,
    correction: Correction,
    prefix: &str,
) -> anyhow::Result<Daemon> {
    let live = correction == Correction::Live;
    let sensors = std::net::TcpListener::bind("127.0.0.1:0")?.local_addr()?;
    let model = if live { format!("{prefix}model-live.toml") } else { format!("{prefix}model.toml") };
    if live {
        let plain = std::fs::read_to_string(setting.path(&format!("{prefix}model.toml")))?;
        setting.write(&model, &with_live_values(&plain)?)?;
    }
    let mut text = format!(
        "format = \"volcomp-machine/1\"\nmachine = \"{}\"\nmodel = \"{model}\"\n[link]\naddress = \"{}\"\n\
         cycle-ms = {}\nsilence-s = 60.0\n[engine]\nstart = \"on-connect\"\nramp-s = 0.5\nstale-ms = 10000.0\nlive-max-age-ms = 15000.0\n\
         [realtime]\npriority = 0\nlock-memory = false\n[status]\nsocket = \"\"\n[log]\ntarget = \"stderr\"\n",
        world.test.machine(),
        bench.shop.address(),
        CYCLE_S * 1e3
    );
    if live {
        let _ = write!(
            text,
            "[sensors]\nlisten = \"{sensors}\"\ntime = \"control\"\n[[map]]\nname = \"ram\"\nx-mm = [1250, 1600, 1950]\ny-mm = [750, 1250]\n\
             z-mm = [-750, -250]\nstd-um = 15\nstd-arcsec = 4\ncorrelation-mm = 4000\n{}limit-um = 80\nlimit-arcsec = 20\n\
             [[sensor]]\nname = \"trackers\"\nkind = \"tool\"\nage-limit-ms = 15000\nrange-um = 5000\njump-um = 1000\n\
             jump-arcsec = 200\n",
            DRIFT
        );
    }
    for axis in world.test.axes() {
        let (unit, limit, rate) = match axis.kind() {
            volcomp_units::axes::AxisKind::Linear => ("um", 1000, 5000),
            volcomp_units::axes::AxisKind::Rotary => ("arcsec", 1000, 3000),
        };
        let _ = write!(
            text,
            "[axes.{}]\nlimit-{unit} = {limit}\nrate-{unit}-per-s = {rate}\nacceleration-{unit}-per-s2 = 100000\n",
            axis.lower()
        );
    }
    let name = format!("{prefix}machine-{}.toml", if live { "live" } else { "survey" });
    setting.write(&name, &text)?;
    let log = format!("{prefix}volcompd-{}.log", if live { "live" } else { "survey" });
    setting.write(&log, "")?;
    if live {
        let watchers = Watchers::new(world, &world.test, READ_S)?;
        bench.watchers = Some((watchers, SensorLink::new(sensors)));
    }
    let daemon = bench.shop.start_daemon(&setting.programs, &setting.path(&name), &setting.path(&log))?;
    // the ramp ended at a time that the control did not tell
    bench.shop.watch_standing(CYCLE_S, &mut |r: &CycleRecord| {
        bench.now_s = r.time_s;
        Ok(Flow::GoOn)
    })?;
    Ok(daemon)
}

/// What the map may drift by: a random walk that follows a swing of some um and an arcsec in two minutes.
const DRIFT: &str = "drift-um-per-h = 25\ndrift-arcsec-per-h = 5\n";

/// The surveyed model with live values of the ram.
fn with_live_values(model: &str) -> anyhow::Result<String> {
    let mut file: toml::Table = model.parse()?;
    let errors = file.get_mut("errors").and_then(Value::as_table_mut).context("errors")?;
    for symbol in SYMBOLS {
        let mut live = toml::Table::new();
        live.insert("sensor".into(), format!("ram.{symbol}").into());
        if "abc".contains(symbol.chars().nth(1).unwrap_or(' ')) {
            live.insert("limit-arcsec".into(), 20.0.into());
        } else {
            live.insert("limit-um".into(), 80.0.into());
        }
        let of = errors.entry(symbol).or_insert_with(|| toml::Table::new().into());
        if let Some(table) = of.as_table_mut() {
            table.insert("live".into(), live.into());
        }
    }
    Ok(toml::to_string(&file)?)
}

/// A tour about the parts with the head in several poses.
fn tour() -> String {
    let mut text = "G21 G90 G94\nF6000\nG43.4 H1\n".to_owned();
    for [x, y, z, a, c] in [
        [1450.0, 950.0, -500.0, -15.0, 0.0],
        [1350.0, 900.0, -560.0, -25.0, 90.0],
        [1600.0, 1050.0, -480.0, -10.0, 180.0],
        [1750.0, 1050.0, -560.0, -25.0, 90.0],
        [1800.0, 1100.0, -500.0, -20.0, -90.0],
        [1700.0, 1000.0, -560.0, -15.0, 0.0],
        [1450.0, 950.0, -560.0, -20.0, 0.0],
    ] {
        let _ = writeln!(text, "G1 X{x} Y{y} Z{z} A{a} C{c}\nG4 P3");
    }
    text + "G49\nM30\n"
}
