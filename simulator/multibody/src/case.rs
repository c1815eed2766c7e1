//! A case: effects scaled to their levels, measured on two days, with the truth beside it.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::dynamics::{Drives, run};
use crate::faults::{CATALOGUE, Entry, Fault};
use crate::heat::Heat;
use crate::instruments::{Nature, by_chance, noise_um, read};
use crate::machine::nominal_model;
use crate::program::{Program, program};
use crate::random::Stream;
use crate::{Failure, files};

/// An effect shows at least this per um of size, in units of the noise; below it is invisible.
const INVISIBLE: f64 = 0.015;
/// Size of the first try, um.
const FIRST_UM: f64 = 2.0;

/// One effect asked for.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wanted {
    /// Name.
    pub name: String,
    /// Subject, or empty.
    pub subject: String,
    /// +1 or -1.
    pub sign: f64,
    /// RMS over all readings in units of the noise, without the offsets of the setups.
    pub level: f64,
}

/// A request.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Effects of the machine.
    pub effects: Vec<Wanted>,
    /// Seed of the machine.
    pub seed: u64,
    /// Seeds of the day and of another day.
    pub days: [u64; 2],
    /// Heavy tails, waves and trends; effects that vary by 15 % over the volume.
    pub hard: bool,
}

/// An effect as it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Effect {
    /// `name:subject`.
    pub label: String,
    /// Size, um.
    pub size_um: f64,
    /// Level reached.
    pub level: f64,
    /// The program shows it.
    pub visible: bool,
}

/// The truth of a case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Truth {
    /// `volcomp-case-truth/1`.
    pub format: &'static str,
    /// Name of the generator.
    pub generator: &'static str,
    /// Seed of the machine.
    pub seed: u64,
    /// Effects.
    pub effects: Vec<Effect>,
    /// What each effect alone does, um along u: session file, label, row. Effects of chance have none.
    pub columns: BTreeMap<String, BTreeMap<String, Vec<f64>>>,
}

/// Program, heat and motions that were simulated already.
struct Bench {
    program: Program,
    heat: HashMap<u64, Heat>,
    motions: HashMap<String, Vec<Vector3<f64>>>,
}

impl Bench {
    fn drives(&mut self, faults: &[Fault]) -> Result<Vec<Vector3<f64>>, Failure> {
        let mut d = Drives::default();
        faults.iter().for_each(|f| f.on_drives(&mut d));
        let key = format!("{d:?}");
        if let Some(done) = self.motions.get(&key) {
            return Ok(done.clone());
        }
        let done = run(&self.program, &d).ok_or_else(|| Failure::of("the tree of bodies cannot be built"))?;
        self.motions.insert(key, done.clone());
        Ok(done)
    }

    fn heat(&mut self, day: u64) -> Heat {
        self.heat.entry(day).or_insert_with(|| Heat::new(&self.program, day)).clone()
    }

    /// What the effects do along u, um, without chance.
    fn effects(&mut self, faults: &[Fault], day: u64, varying: Option<u64>) -> Result<Vec<f64>, Failure> {
        let motions = self.drives(faults)?;
        let heat = self.heat(day);
        let still: Vec<&Fault> = faults.iter().filter(|f| !f.is_dynamic() && !f.is_random()).collect();
        let vary = |label: &str, q: [f64; 4]| {
            varying.map_or(1.0, |seed| {
                let mut c = Stream::new(seed, &format!("variation of {label}"));
                let [a, b, d] = [0, 1, 2].map(|_| c.uniform(0.0, std::f64::consts::TAU));
                let wave = (q[0] / 170.0 + a).sin() + (q[1] / 140.0 + b).sin() + (q[2] / 130.0 + d).sin();
                1.0 + 0.15 * wave * (2.0_f64 / 3.0).sqrt()
            })
        };
        let mut out = Vec::with_capacity(motions.len());
        let mut state = None;
        for (s, m) in self.program.samples.iter().zip(&motions) {
            if state.as_ref().is_none_or(|(t, _)| *t != s.t_s) {
                state = heat.at(s.t_s).map(|h| (s.t_s, h));
            }
            let tool = self.program.segments.get(s.segment).map_or(0.0, |g| g.tool_mm);
            let mut um =
                1e3 * m.dot(&s.u) * if varying.is_some() { vary("drives", s.command.q) } else { 1.0 };
            if let Some((_, heat)) = &state {
                for f in &still {
                    um += f.at(s, tool, heat).dot(&s.u) * vary(&f.label, s.command.q);
                }
            }
            out.push(um);
        }
        Ok(out)
    }

    /// RMS of what a fault shows in units of the noise, without the offset of each setup.
    fn shown(&mut self, fault: &Fault, day: u64) -> Result<f64, Failure> {
        let mut um = self.effects(std::slice::from_ref(fault), day, None)?;
        let mut rare = Stream::new(day, "chance");
        for (s, um) in self.program.samples.iter().zip(&mut um) {
            *um += by_chance(s, std::slice::from_ref(fault), noise_um(s.instrument), &mut rare);
        }
        if let Some(digit) = fault.digit() {
            // rounding of a reading that is anywhere: uniform within a digit
            um.iter_mut().for_each(|v| *v = digit * (rare.uniform(0.0, 1.0) - 0.5));
        }
        let mut setups: BTreeMap<i64, Vec<(Vector3<f64>, f64)>> = BTreeMap::new();
        for (s, um) in self.program.samples.iter().zip(&um) {
            let sigma = noise_um(s.instrument);
            setups.entry(s.place[0]).or_default().push((s.u / sigma, um / sigma));
        }
        let (mut square, mut n) = (0.0, 0usize);
        for rows in setups.values() {
            let mut normal = Matrix3::identity() * 1e-9;
            let mut right = Vector3::zeros();
            for (u, d) in rows {
                normal += u * u.transpose();
                right += u * *d;
            }
            let offset = normal.try_inverse().map_or_else(Vector3::zeros, |i| i * right);
            square += rows.iter().map(|(u, d)| (d - u.dot(&offset)).powi(2)).sum::<f64>();
            n += rows.len();
        }
        Ok((square / n.max(1) as f64).sqrt())
    }

    /// A fault of such a size that it shows at a level.
    fn scaled(&mut self, wanted: &Wanted, request: &Request) -> Result<(Fault, Effect), Failure> {
        let entry = CATALOGUE
            .iter()
            .find(|e| e.name == wanted.name && e.subjects.contains(&wanted.subject.as_str()))
            .ok_or_else(|| Failure::of(format!("no effect `{}` of `{}`", wanted.name, wanted.subject)))?;
        let make = |um: f64| fault(entry, &wanted.subject, um, request.seed);
        let mut size = wanted.sign * FIRST_UM;
        let mut shown = self.shown(&make(size)?, request.days[0])?;
        let visible = shown / FIRST_UM >= INVISIBLE;
        if !visible {
            size = wanted.sign * 3.0 * wanted.level;
        }
        for _ in 0..3 {
            let factor = wanted.level / shown.max(1e-9);
            if !visible || (factor - 1.0).abs() < 0.08 {
                break;
            }
            size *= factor;
            shown = self.shown(&make(size)?, request.days[0])?;
        }
        let made = make(size)?;
        let effect = Effect {
            label: made.label.clone(),
            size_um: size,
            level: if visible { wanted.level } else { shown },
            visible,
        };
        Ok((made, effect))
    }
}

fn fault(entry: &'static Entry, subject: &str, um: f64, seed: u64) -> Result<Fault, Failure> {
    Fault::new(entry, subject, um, seed).ok_or_else(|| Failure::of("a beam without supports"))
}

/// Simulates a case: files of the day into `out`, of another day into `out/fresh`; returns the truth.
pub fn simulate(request: &Request, out: &Path) -> Result<Truth, Failure> {
    let mut bench = Bench { program: program(), heat: HashMap::new(), motions: HashMap::new() };
    let (mut faults, mut effects) = (Vec::new(), Vec::new());
    for wanted in &request.effects {
        let (fault, effect) = bench.scaled(wanted, request)?;
        faults.push(fault);
        effects.push(effect);
    }
    let mut chance = Stream::new(request.seed, "nature");
    let nature = Nature {
        drift: (chance.uniform(0.3, 1.0), chance.uniform(250.0, 1600.0)),
        hard: request.hard,
        lost: if chance.uniform(0.0, 1.0) > 0.7 { 0.02 } else { 0.0 },
    };
    let varying = request.hard.then_some(request.seed);
    let mut columns: BTreeMap<String, BTreeMap<String, Vec<f64>>> = BTreeMap::new();
    for (day, folder) in request.days.iter().zip([out.to_owned(), out.join("fresh")]) {
        let um = bench.effects(&faults, *day, varying)?;
        let readings = read(&bench.program, &um, &faults, nature, *day);
        let sessions = files::sessions(&bench.program, &readings);
        std::fs::create_dir_all(&folder).map_err(|e| Failure::at(&folder, &e))?;
        for (name, text, _) in &sessions {
            save(&folder.join(name), text)?;
        }
        save(&folder.join("history.csv"), &files::history(&bench.heat(*day)))?;
        save(&folder.join("model.toml"), &nominal_model())?;
        if *day == request.days[0] {
            for f in faults.iter().filter(|f| !f.is_random()) {
                let alone = bench.effects(std::slice::from_ref(f), *day, varying)?;
                for (name, _, rows) in &sessions {
                    let column = rows.iter().map(|k| alone.get(*k).copied().unwrap_or_default()).collect();
                    columns.entry(name.clone()).or_default().insert(f.label.clone(), column);
                }
            }
        }
    }
    Ok(Truth { format: "volcomp-case-truth/1", generator: "multibody", seed: request.seed, effects, columns })
}

fn save(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|e| Failure::at(path, &e))
}
