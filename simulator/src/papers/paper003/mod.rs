//! Paper 003: a gantry with a ram, two trackers, circle following, and parts that are cut while the ram drifts.

mod bench;
mod parts;
mod survey;
mod trackers;

use anyhow::Context;
use volcomp_cli::report_page::{Plot, Style};

use self::bench::{Correction, Cut};
use self::parts::{Cmm, Flank, Part, Rows, circle, cone_figures, figures};
use super::figure::{Limit, Row, Share, Truth};
use super::machine::{travels, used_drives, varied_text};
use super::{Experiment, Measured, Setting};
use crate::truth::conditions::{Acting, ConditionSizes, Conditions};
use crate::truth::drift::{DriftSize, RamDrift};
use crate::truth::{GANTRY_5AX, TruthMachine};
use crate::twin::Dice;

/// The ram since its survey and during the cut: an hour of warm-up, and the cooling unit of the spindle, which switches
/// every minute.
const DRIFT: DriftSize = DriftSize {
    from_survey: [0.010, 10e-6],
    per_h: [0.020, 20e-6],
    swing: [0.005, 5e-6],
    swing_s: 120.0,
    wave_mm: 4000.0,
};
/// Errors of the head in sizes of the shipped machine, so that the cone is as round as the paper's, and eccentricity of the
/// encoder of A in sizes of its wave, for a taper error like the paper's.
const HEAD: f64 = 2.0;
const ECCENTRIC: f64 = 30.0;
/// Heat of the hall since the survey, the workpiece, interaction of the axes and a month of wear.
const HALL: ConditionSizes = ConditionSizes {
    rise_k: 0.3,
    gradient_k: 0.1,
    column_arcsec: 0.5,
    interaction_arcsec: 0.1,
    load_share: 0.5,
    sag_um: 2.0,
    wear_um: 0.8,
    lost_um: 0.4,
};

const REDUCTION: [[&str; 3]; 2] = [
    [
        "flank of the S, largest deviation, reduction by the surveyed model",
        "flank of the S, mean deviation, reduction by the surveyed model",
        "flank of the S, standard deviation, reduction by the surveyed model",
    ],
    [
        "flank of the S, largest deviation, reduction with live estimation",
        "flank of the S, mean deviation, reduction with live estimation",
        "flank of the S, standard deviation, reduction with live estimation",
    ],
];
const S_UM: [[&str; 3]; 3] = [
    [
        "flank of the S, largest deviation, uncompensated",
        "flank of the S, mean deviation, uncompensated",
        "flank of the S, standard deviation, uncompensated",
    ],
    [
        "flank of the S, largest deviation, surveyed model",
        "flank of the S, mean deviation, surveyed model",
        "flank of the S, standard deviation, surveyed model",
    ],
    [
        "flank of the S, largest deviation, live estimation",
        "flank of the S, mean deviation, live estimation",
        "flank of the S, standard deviation, live estimation",
    ],
];
const GAIN: &str = "flank of the S, mean deviation, live estimation against the surveyed model";
const ROUNDNESS: [[&str; 2]; 3] = [
    ["roundness, diameter 86, uncompensated", "roundness, diameter 40, uncompensated"],
    ["roundness, diameter 86, surveyed model", "roundness, diameter 40, surveyed model"],
    ["roundness, diameter 86, live estimation", "roundness, diameter 40, live estimation"],
];
const ROUNDER: [&str; 2] = [
    "roundness, diameter 86, reduction with live estimation",
    "roundness, diameter 40, reduction with live estimation",
];
/// Repeatability of a roundness on the measuring machine: within it the cone is no worse.
const REPEATABILITY_UM: f64 = 0.5;
const NO_WORSE: &str = "roundness, worse circle, live estimation minus surveyed model";
const PLACE: [&str; 3] = [
    "centre of the cone, uncompensated",
    "centre of the cone, surveyed model",
    "centre of the cone, live estimation",
];
const TAPER: [&str; 3] =
    ["taper error, uncompensated", "taper error, surveyed model", "taper error, live estimation"];
const TAPER_LESS: &str = "taper error, reduction with live estimation";

/// The experiment.
pub struct Paper003;

impl Experiment for Paper003 {
    fn number(&self) -> &'static str {
        "003"
    }

    fn title(&self) -> &'static str {
        "gantry with a ram, two trackers, S-shaped part and cone"
    }

    fn procedure(&self) -> &'static str {
        "Gantry [w b X Y Z C A (S) t], travels 3000, 2000, 1000 mm, C 360 deg either way, A 110 deg either way. Survey: X, Y, C and \
         A with their locations and squareness (0.7 µm, 0.3 arcsec; volcomp fit); for the ram two trackers (0.5 µm, 0.75 arcsec), \
         registered by five common balls, follow circles of a rod in six poses of the head at nine stops (volcomp identify circles, \
         identify ram, model assemble). The parts are five-axis programs with tool-centre-point motion (G43.4): the S-shaped \
         flank of ISO 10791-7 and the tilted cone of 86 and 40 mm, half angle 15 deg. Each is cut without compensation, with \
         the surveyed model, and with the model and what both trackers, on two reflectors of the spindle housing, teach \
         volcompd 50 times a second; while the cone is cut they are silent and the map is held, for roundness sees the noise of an \
         estimate, and of a drift only its change within the circle. Since the survey the ram has moved by 10 µm and 10 µrad; it warms up by 20 µm and 20 µrad \
         in an hour, and by 5 µm and 5 µrad to and fro every two minutes with the spindle's cooling unit (kind and hard truth, \
         standard deviation of each motion over the seeds). A coordinate measuring machine (0.3 µm a touch) touches the S at three heights and the cone \
         at both diameters; roundness has 15 undulations and repeats to 0.5 µm, within which the cone is no worse. Hard truth: heat of the hall, a workpiece, interaction of axes, a month of wear, used drives, \
         refraction, encoders and warm-up of the trackers, scales of the measuring machine."
    }

    fn rows(&self) -> &'static [Row] {
        const fn beats(name: &'static str, paper: f64) -> Row {
            Row::limited(name, "%", Some(paper), Limit::AtLeast(paper), 1)
        }
        const fn um(name: &'static str, paper: Option<f64>) -> Row {
            Row::reported(name, "um", paper, 2)
        }
        const ROWS: &[Row] = &[
            beats(REDUCTION[1][0], 68.0),
            beats(REDUCTION[1][1], 58.0),
            beats(REDUCTION[1][2], 76.0),
            Row::reported(REDUCTION[0][0], "%", None, 1),
            Row::reported(REDUCTION[0][1], "%", None, 1),
            Row::reported(REDUCTION[0][2], "%", None, 1),
            Row::reported(GAIN, "%", None, 1),
            um(S_UM[0][0], Some(44.86)),
            um(S_UM[0][1], Some(26.52)),
            um(S_UM[0][2], Some(10.19)),
            um(S_UM[1][0], None),
            um(S_UM[1][1], None),
            um(S_UM[1][2], None),
            um(S_UM[2][0], Some(14.3)),
            um(S_UM[2][1], Some(11.24)),
            um(S_UM[2][2], Some(2.4)),
            beats(ROUNDER[0], 48.0),
            beats(ROUNDER[1], 48.0),
            Row::limited(NO_WORSE, "um", None, Limit::AtMost(REPEATABILITY_UM), 2),
            um(ROUNDNESS[0][0], Some(27.7)),
            um(ROUNDNESS[0][1], Some(23.7)),
            um(ROUNDNESS[1][0], None),
            um(ROUNDNESS[1][1], None),
            um(ROUNDNESS[2][0], Some(14.6)),
            um(ROUNDNESS[2][1], Some(12.3)),
            um(PLACE[0], None),
            um(PLACE[1], None),
            um(PLACE[2], None),
            Row::reported(TAPER[0], "arcsec", Some(134.0), 1),
            Row::reported(TAPER[1], "arcsec", None, 1),
            Row::limited(TAPER[2], "arcsec", Some(54.0), Limit::AtMost(54.0), 1),
            Row::limited(TAPER_LESS, "%", Some(59.7), Limit::AtLeast(59.7), 1),
        ];
        ROWS
    }

    fn run(&self, setting: &Setting, progress: &mut dyn FnMut(&str)) -> anyhow::Result<Measured> {
        let world = World::new(setting)?;
        progress("survey, circle following with two trackers");
        survey::take(setting, &world)?;
        progress("S and cone: uncompensated, surveyed model, live estimation");
        let without = if setting.finds_shares() { worlds_without(&world) } else { Vec::new() };
        let (cuts, again) = all(setting, &world, &without)?;
        let mut measured = Measured::default();
        let mut found = Vec::new();
        for (i, cut) in cuts.iter().enumerate() {
            let s = world.cmm.measure(Part::S, &cut.s);
            let cone = world.cmm.measure(Part::Cone, &cut.cone);
            let (roundness, taper, place) = cone_figures(&cone);
            for (part, rows) in [("s", &s), ("cone", &cone)] {
                setting.write(&format!("{part}-{i}.csv"), &table(rows))?;
            }
            measured.values.extend(S_UM[i].into_iter().zip(figures(&s)));
            measured.values.extend(ROUNDNESS[i].into_iter().zip(roundness));
            measured.values.insert(TAPER[i], taper.abs());
            measured.values.insert(PLACE[i], place);
            found.push((s, cone));
        }
        compare(&mut measured);
        for (cut, cause) in
            cuts.iter().map(|c| (c, "")).chain(again.iter().zip(&without).map(|(c, w)| (c, w.cause)))
        {
            if cut.excluded > 0 {
                let run = if cause.is_empty() { String::new() } else { format!(", cut without {cause}") };
                measured.notes.push(format!(
                    "volcompd excluded the trackers, which disagreed with the map, {} times{run}.",
                    cut.excluded
                ));
            }
        }
        measured.plots = plots(&found);
        if let Some(live) = cuts.last()
            && setting.finds_shares()
        {
            measured.shares = shares(&world, live, &without, &again);
        }
        Ok(measured)
    }
}

/// Both parts with every correction, and the S with live estimation on machines without single causes, side by side: most of
/// the time of a cycle is waiting.
fn all(setting: &Setting, world: &World, without: &[Without]) -> anyhow::Result<(Vec<Cut>, Vec<Cut>)> {
    for Without { prefix, .. } in without {
        std::fs::copy(setting.path("model.toml"), setting.path(&format!("{prefix}model.toml")))?;
    }
    let corrections = [Correction::None, Correction::Survey, Correction::Live];
    std::thread::scope(|scope| {
        let own: Vec<_> = corrections
            .into_iter()
            .map(|correction| {
                scope.spawn(move || {
                    bench::cut(setting, world, correction, "", true)
                        .with_context(|| format!("parts, {}", correction.name()))
                })
            })
            .collect();
        let again: Vec<_> = without
            .iter()
            .map(|w| {
                scope.spawn(move || {
                    bench::cut(setting, &w.world, Correction::Live, w.prefix, false)
                        .with_context(|| format!("S without {}", w.cause))
                })
            })
            .collect();
        let join = |list: Vec<std::thread::ScopedJoinHandle<'_, anyhow::Result<Cut>>>| {
            let of = |h: std::thread::ScopedJoinHandle<'_, anyhow::Result<Cut>>| {
                h.join().unwrap_or_else(|_| Err(anyhow::anyhow!("the control panicked")))
            };
            list.into_iter().map(of).collect::<anyhow::Result<Vec<Cut>>>()
        };
        Ok((join(own)?, join(again)?))
    })
}

/// Measured points as a table: height, share of the way, deviation.
fn table(rows: &[Vec<(f64, f64)>]) -> String {
    let mut text = String::from("height,share,deviation_um\n");
    for (n, row) in rows.iter().enumerate() {
        for (u, deviation) in row {
            text += &format!("{n},{u:.6},{deviation:.4}\n");
        }
    }
    text
}

/// Figures that follow from others.
fn compare(measured: &mut Measured) {
    let values = measured.values.clone();
    let of = |name: &str| values.get(name).copied().unwrap_or(f64::NAN);
    let reduction = |before: &str, after: &str| 100.0 * (1.0 - of(after) / of(before));
    for (i, names) in REDUCTION.into_iter().enumerate() {
        for (k, name) in names.into_iter().enumerate() {
            measured.values.insert(name, reduction(S_UM[0][k], S_UM[i + 1][k]));
        }
    }
    measured.values.insert(GAIN, reduction(S_UM[1][1], S_UM[2][1]));
    for (k, name) in ROUNDER.into_iter().enumerate() {
        measured.values.insert(name, reduction(ROUNDNESS[0][k], ROUNDNESS[2][k]));
    }
    let worse = |i: usize| of(ROUNDNESS[i][0]).max(of(ROUNDNESS[i][1]));
    measured.values.insert(NO_WORSE, worse(2) - worse(1));
    measured.values.insert(TAPER_LESS, reduction(TAPER[0], TAPER[2]));
}

/// The machine at survey and cut, its instruments.
struct World {
    survey: TruthMachine,
    test: TruthMachine,
    /// The machine of the cut without lost motion, friction and wander.
    quiet: TruthMachine,
    /// Conditions of the cut; none with the kind truth.
    conditions: Option<Conditions>,
    tracker_errors: bool,
    cmm: Cmm,
    seed: u64,
}

impl World {
    fn new(setting: &Setting) -> anyhow::Result<Self> {
        let hard = setting.truth == Truth::Hard;
        let text = varied_text(GANTRY_5AX, setting.seed, |file, _| {
            change(file);
            if hard {
                used_drives(file, setting.seed, true);
            }
        })?;
        setting.write("truth.toml", &text)?;
        let mut survey = TruthMachine::from_toml(&text)?;
        let mut test = survey.clone();
        let mut conditions = None;
        if hard {
            let of = |acting| Conditions::new(&HALL, travels(&survey), acting, setting.seed);
            let (at_survey, at_test) = (of(Acting::SURVEY), of(Acting::TEST));
            survey.set_conditions(Some(at_survey));
            test.set_conditions(Some(at_test.clone()));
            conditions = Some(at_test);
        }
        test.set_ram_drift(Some(RamDrift::new(DRIFT, setting.seed)));
        let quiet = test.clone().with_ideal_drives();
        let mut dice = Dice::new(setting.seed, "measuring machine of paper 003");
        let scale_um_per_m = [0; 3].map(|_| if hard { dice.normal() } else { 0.0 });
        let cmm = Cmm { noise_um: 0.3, scale_um_per_m, seed: setting.seed };
        Ok(Self { survey, test, quiet, conditions, tracker_errors: hard, cmm, seed: setting.seed })
    }

    fn with_test(&self, test: TruthMachine) -> Self {
        Self { survey: self.survey.clone(), test, quiet: self.quiet.clone(), conditions: None, ..*self }
    }
}

/// Travel of C as in the paper; a head with errors that make roundness and taper of the paper's size.
fn change(file: &mut toml::Table) {
    let number = toml::Value::Float;
    let entries = file.get_mut("axes").and_then(toml::Value::as_array_mut).into_iter().flatten();
    for entry in entries.filter_map(toml::Value::as_table_mut) {
        if entry.get("name").and_then(toml::Value::as_str) == Some("C") {
            let travel = [-360.0, 360.0].map(number).to_vec();
            entry.insert("travel-deg".into(), toml::Value::Array(travel));
        }
    }
    for (_, value) in file.get_mut("location").and_then(toml::Value::as_table_mut).into_iter().flatten() {
        let size = value.as_float().or_else(|| value.as_integer().map(|i| i as f64));
        *value = number(HEAD * size.unwrap_or(0.0));
    }
    let errors = file.get_mut("errors").and_then(toml::Value::as_table_mut).into_iter().flatten();
    for (_, shapes) in errors.filter(|(symbol, _)| symbol.ends_with(['a', 'c'])) {
        let shapes = shapes.as_array_mut().into_iter().flatten().filter_map(toml::Value::as_table_mut);
        for (_, shape) in shapes.flatten() {
            for (key, value) in shape.as_table_mut().into_iter().flatten() {
                if key.starts_with("amplitude-") {
                    *value = number(HEAD * value.as_float().unwrap_or(0.0));
                }
            }
        }
    }
    let shapes = file
        .get_mut("errors")
        .and_then(toml::Value::as_table_mut)
        .and_then(|e| e.get_mut("eaa"))
        .and_then(toml::Value::as_array_mut);
    if let Some(shapes) = shapes {
        for wave in shapes.iter_mut().filter_map(|s| s.get_mut("wave")).filter_map(toml::Value::as_table_mut)
        {
            let amplitude = wave.get("amplitude-arcsec").and_then(toml::Value::as_float).unwrap_or(5.0);
            wave.insert("amplitude-arcsec".into(), number(ECCENTRIC / HEAD * amplitude));
            wave.insert("period-deg".into(), number(360.0));
            wave.insert("phase-deg".into(), number(0.0));
        }
    }
}

/// A machine and instruments without one cause.
struct Without {
    cause: &'static str,
    prefix: &'static str,
    world: World,
}

/// Machines and instruments without single causes.
fn worlds_without(world: &World) -> Vec<Without> {
    let mut list = Vec::new();
    let mut machine = world.test.clone();
    let constant = DriftSize { per_h: [0.0; 2], swing: [0.0; 2], ..DRIFT };
    machine.set_ram_drift(Some(RamDrift::new(constant, world.seed)));
    list.push(Without {
        cause: "drift of the ram within the part",
        prefix: "without-drift-",
        world: world.with_test(machine),
    });
    if let Some(conditions) = &world.conditions {
        let mut machine = world.test.clone();
        machine.set_conditions(Some(conditions.clone().with(Acting::SURVEY)));
        list.push(Without {
            cause: "heat, load and wear since the survey",
            prefix: "without-conditions-",
            world: world.with_test(machine),
        });
    }
    list.push(Without {
        cause: "systematic errors of the trackers",
        prefix: "without-tracker-errors-",
        world: World { tracker_errors: false, ..world.with_test(world.test.clone()) },
    });
    list
}

/// Which share of the mean square of the S with live estimation each cause explains: the S is cut again without it; for the
/// drives the set points are replayed.
fn shares(world: &World, live: &Cut, without: &[Without], again: &[Cut]) -> Vec<Share> {
    let square = |flank: &Flank| {
        let rows = world.cmm.measure(Part::S, flank);
        let all: Vec<f64> = rows.iter().flatten().map(|(_, d)| d * d).collect();
        all.iter().sum::<f64>() / all.len().max(1) as f64
    };
    let whole = square(&live.s);
    let share = |cause: &str, rest: f64| Share { cause: cause.to_owned(), share: 1.0 - rest / whole };
    let drives = square(&bench::replayed(live, &world.quiet, world.seed));
    let mut shares = vec![share("lost motion, friction and wander of the drives", drives)];
    shares.extend(without.iter().zip(again).map(|(w, cut)| share(w.cause, square(&cut.s))));
    shares
}

/// Figures 10 and 11 of the paper as deviations.
fn plots(found: &[(Rows, Rows)]) -> Vec<Plot> {
    let names = ["uncompensated", "surveyed model", "live estimation"];
    let mut plots = Vec::new();
    for (n, height) in Part::S.heights().into_iter().enumerate() {
        let mut plot = Plot::new(
            format!("S-shaped part, {height} mm above the tip"),
            "share of the way",
            "deviation of the flank, µm",
        );
        for (name, (s, _)) in names.into_iter().zip(found) {
            plot = plot.with(Style::Line, name, s.get(n).cloned().unwrap_or_default());
        }
        plots.push(plot);
    }
    for (n, diameter) in [86, 40].into_iter().enumerate() {
        let mut plot =
            Plot::new(format!("Cone, diameter {diameter} mm"), "angle, deg", "deviation from the circle, µm");
        for (name, (_, cone)) in names.into_iter().zip(found) {
            plot = plot.with(Style::Line, name, cone.get(n).map(|row| circle(row).0).unwrap_or_default());
        }
        plots.push(plot);
    }
    plots
}
