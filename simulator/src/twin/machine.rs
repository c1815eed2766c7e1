//! The twin: drives, heat and bodies along the exact chain.

use volcomp_units::axes::{AxisArray, MAX_AXES};

use super::bodies::{Bodies, State};
use super::drive::{Drive, SetPoint};
use super::file::{Effect, TwinError, TwinTruth};
use super::heat::Heat;
use super::random::{Dice, Field};
use crate::truth::TruthMachine;

/// Travels of X, Y, Z, mm.
pub const TRAVEL_MM: [[f64; 2]; 3] = [[0.0, 500.0], [0.0, 400.0], [0.0, 450.0]];
/// Where the table's axis stands, mm in the machine frame at home.
pub const TABLE_MM: [f64; 3] = [250.0, 200.0, 0.0];
/// The name of the machine.
pub const MACHINE: &str = "twin-4ax";
/// arcsec per rad.
const ARCSEC: f64 = 206_264.806_247;

/// What the control asks for: set points of X, Y, Z (mm), and of C (rad).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Command {
    /// X, Y, Z.
    pub linear: [SetPoint; 3],
    /// C: rad, rad/s, rad/s^2.
    pub table: SetPoint,
}

/// The machine as it really is.
#[derive(Debug, Clone)]
pub struct Twin {
    chain: TruthMachine,
    drives: [Drive; 3],
    bodies: Bodies,
    /// The heat.
    pub heat: Heat,
    /// Forces on the tool, N.
    pub force_n: [f64; 3],
    /// Delay of the control, s.
    pub latency_s: f64,
    /// Lean of the spindle about x and y, rad.
    lean: [f64; 2],
    /// Scale of the presetter, relative.
    presetter: f64,
    variation: Option<(f64, Field)>,
    /// Where the table's axis really stands: shift (mm) and lean (rad).
    table: [f64; 4],
    now: Command,
}

/// Effects of the instruments, which the machine does not have.
const INSTRUMENT: [&str; 7] =
    ["clock-skew", "dead-path", "tracker-scale", "vibration", "outliers", "quantisation", "range-noise"];

impl Twin {
    /// A machine from its truth; `day` draws the weather.
    ///
    /// # Errors
    /// An effect without physics.
    pub fn new(truth: &TwinTruth, day: u64) -> Result<Self, TwinError> {
        truth.check()?;
        let mut drives = TRAVEL_MM.map(Drive::new);
        let mut heat = Heat::new(&mut Dice::new(day, "weather"));
        let mut bodies = Bodies::default();
        let mut squareness = [0.0; 3];
        let mut location = [0.0; 4];
        let (mut latency_s, mut lean, mut presetter) = (0.0, [0.0; 2], 0.0);
        for (n, e) in truth.effects.iter().enumerate() {
            // the same effect has the same constants, whatever else the file holds
            let again = truth.effects.iter().take(n).filter(|o| o.label() == e.label()).count();
            let mut dice = Dice::new(truth.seed, &format!("{}#{again}", e.label()));
            let axis = axis_of(e);
            let mm = e.size_um * 1e-3;
            match e.name.as_str() {
                // 300 mm make the size
                "squareness" => match e.subject.as_str() {
                    "xy" => squareness[0] += mm / 300.0 * ARCSEC,
                    "zx" => squareness[1] += mm / 300.0 * ARCSEC,
                    _ => squareness[2] += mm / 300.0 * ARCSEC,
                },
                "rotary-location" => {
                    let direction = dice.between(0.0, std::f64::consts::TAU);
                    location[0] += e.size_um * direction.cos();
                    location[1] += e.size_um * direction.sin();
                    location[2] += mm / 200.0 * ARCSEC * dice.normal();
                    location[3] += mm / 200.0 * ARCSEC * dice.normal();
                }
                // 30 mm/s make the size
                "latency" => latency_s += mm / 30.0,
                // 100 mm of tool make the size
                "spindle-tilt" => {
                    let direction = dice.between(0.0, std::f64::consts::TAU);
                    lean[0] += mm / 100.0 * direction.cos();
                    lean[1] += mm / 100.0 * direction.sin();
                }
                "tool-length" => presetter += mm / 100.0,
                name if INSTRUMENT.contains(&name) => {}
                _ => {
                    let mine = axis.and_then(|k| drives.get_mut(k).map(|d| d.add(e, k, &mut dice)));
                    let done = mine == Some(true)
                        || heat.add(e, axis, &mut dice)
                        || bodies.add(e, axis, &TRAVEL_MM, &mut dice);
                    if !done {
                        let what = "the twin has no physics for it".to_owned();
                        return Err(TwinError::Effect { label: e.label(), what });
                    }
                }
            }
        }
        let chain = TruthMachine::from_toml(&chain_text(squareness, location))
            .map_err(|e| TwinError::Chain(e.to_string()))?;
        let variation = (truth.variation > 0.0)
            .then(|| (truth.variation, Field::new(&mut Dice::new(truth.seed, "variation"), 450.0)));
        Ok(Self {
            chain,
            drives,
            bodies,
            heat,
            force_n: [0.0; 3],
            latency_s,
            lean,
            presetter,
            variation,
            table: [location[0] * 1e-3, location[1] * 1e-3, location[2] / ARCSEC, location[3] / ARCSEC],
            now: Command::default(),
        })
    }

    /// One step of the drives.
    pub fn step(&mut self, dt: f64, command: &Command) {
        self.now = *command;
        for (drive, set) in self.drives.iter_mut().zip(command.linear) {
            drive.step(dt, set);
        }
    }

    /// How long the machine takes to come to rest, s.
    #[must_use]
    pub fn settling_s(&self) -> f64 {
        if self.drives.iter().any(Drive::is_slow) { 1.5 } else { 0.0 }
    }

    /// Tool tip against workpiece, actual minus where `nominal` wants it, in machine axes, mm.
    #[must_use]
    pub fn deviation_mm(&self, nominal: &Command, tool_length_mm: f64) -> [f64; 3] {
        let position = |c: &Command| {
            let [x, y, z] = c.linear.map(|s| s.q);
            [x, y, z, c.table.q]
        };
        let (wanted, q) = (position(nominal), position(&self.now));
        let doing = self.bodies.doing(&State {
            q,
            v: self.now.linear.map(|s| s.v),
            force_n: self.force_n,
            heat: &self.heat,
        });
        let mut more = [[0.0; 6]; MAX_AXES];
        for (sum, body) in more.iter_mut().zip(doing.motion) {
            *sum = body;
        }
        let mut actual = wire(q);
        for (k, drive) in self.drives.iter().enumerate() {
            let set = q.get(k).copied().unwrap_or_default();
            if let (Some(at), Some(sum)) = (actual.get_mut(k), more.get_mut(k)) {
                *at += drive.along + self.heat.expansion_mm(k, set);
                sum.iter_mut().zip(drive.motion).for_each(|(s, m)| *s += m);
            }
        }
        // the spindle leans: the tool's tip is turned about the nose
        let [a, b] = self.lean;
        let length = tool_length_mm * (1.0 + self.presetter);
        let tip = [-length * b.sin() * a.cos(), length * a.sin(), -length * a.cos() * b.cos()];
        let really = self.chain.pose_with(&actual, &more, tip);
        let nominal_tip = [0.0, 0.0, -tool_length_mm];
        let ideal = perfect(&self.chain, &wire(wanted), nominal_tip);
        // the workpiece was aligned on the table as it stands at zero
        let [px, py, pz] = TABLE_MM;
        let [tx, ty, a, b] = self.table;
        let tip = really.tip_mm;
        let arm = [tip[0] - px, tip[1] - py, tip[2] - pz];
        let aligned = [tip[0] + tx + b * arm[2], tip[1] + ty - a * arm[2], tip[2] + a * arm[1] - b * arm[0]];
        // out of the turned workpiece into machine axes
        let (sin, cos) = ideal.1;
        let turned = |to: [f64; 3]| {
            let d: [f64; 3] = std::array::from_fn(|i| to[i] - ideal.0[i]);
            [cos * d[0] + sin * d[1], -sin * d[0] + cos * d[1], d[2]]
        };
        let heat = self.heat.shift_mm();
        let error = turned(aligned);
        let total: [f64; 3] = std::array::from_fn(|i| error[i] + doing.shift[i] + heat[i]);
        let Some((share, field)) = &self.variation else { return total };
        let more = share * field.at([q[0], q[1], q[2]]);
        // errors vary over the volume; what was commanded beside the nominal position is no error
        let commanded = turned(perfect(&self.chain, &wire(q), nominal_tip).0);
        std::array::from_fn(|i| total[i] + more * (total[i] - commanded[i]))
    }
}

fn axis_of(e: &Effect) -> Option<usize> {
    ["x", "y", "z"].iter().position(|a| *a == e.subject)
}

/// mm and degrees in wire order.
fn wire([x, y, z, c]: [f64; 4]) -> AxisArray {
    let mut q = [0.0; MAX_AXES];
    for (to, from) in q.iter_mut().zip([x, y, z, c.to_degrees()]) {
        *to = from;
    }
    q
}

/// Tip in the workpiece frame of the machine without errors, and sine and cosine of the turn of that frame.
fn perfect(chain: &TruthMachine, q: &AxisArray, tip: [f64; 3]) -> ([f64; 3], (f64, f64)) {
    let mut ideal = chain.clone();
    ideal.set_tool_tip_mm(tip);
    let pose = ideal.nominal(q);
    (pose.tip_mm, (pose.matrix[(1, 0)], pose.matrix[(0, 0)]))
}

/// The chain as a truth file of the geometry.
fn chain_text([xy, zx, yz]: [f64; 3], [x, y, a, b]: [f64; 4]) -> String {
    let mut text = format!(
        "format = \"volcomp-truth/1\"\nmachine = \"{MACHINE}\"\nchain = \"[w C' X' b Y Z t]\"\n\
         [frame]\ntool-tip-mm = [0.0, 0.0, -120.0]\n\
         [squareness]\nec0y-arcsec = {xy:?}\neb0z-arcsec = {zx:?}\nea0z-arcsec = {yz:?}\n\
         [location]\nex0c-um = {x:?}\ney0c-um = {y:?}\nea0c-arcsec = {a:?}\neb0c-arcsec = {b:?}\n"
    );
    for (letter, [low, high]) in ["X", "Y", "Z"].into_iter().zip(TRAVEL_MM) {
        text += &format!("[[axes]]\nname = \"{letter}\"\ntravel-mm = [{low:?}, {high:?}]\n");
    }
    let [px, py, pz] = TABLE_MM;
    text += &format!(
        "[[axes]]\nname = \"C\"\ntravel-deg = [-360.0, 360.0]\npoint-mm = [{px:?}, {py:?}, {pz:?}]\n"
    );
    text
}

/// The nominal model of the machine, `volcomp-model/1`: the drawing, no errors.
#[must_use]
pub fn nominal_model() -> String {
    let mut text = format!(
        "# The drawing of the machine: no errors at all.\nformat = \"volcomp-model/1\"\nmachine = \"{MACHINE}\"\n\
         chain = \"[w C' X' b Y Z t]\"\n\n[frame]\nworkpiece-origin-mm = [0, 0, 0]\ntool-tip-mm = [0, 0, -120]\n\
         gauge-point-mm = [0, 0, 0]\n"
    );
    for (letter, [low, high]) in ["x", "y", "z"].into_iter().zip(TRAVEL_MM) {
        text += &format!("\n[axes.{letter}]\ntravel-mm = [{low}, {high}]\n");
    }
    let [px, py, pz] = TABLE_MM;
    text += &format!("\n[axes.c]\ntravel-deg = [-360, 360]\npoint-mm = [{px}, {py}, {pz}]\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, y: f64, z: f64, c: f64) -> Command {
        let s = |q| SetPoint { q, v: 0.0, a: 0.0 };
        Command { linear: [s(x), s(y), s(z)], table: s(c) }
    }

    fn deviation(effects: &[Effect], c: &Command, tool: f64) -> [f64; 3] {
        let truth = TwinTruth { effects: effects.to_vec(), ..TwinTruth::perfect(4) };
        let mut twin = Twin::new(&truth, 1).unwrap();
        twin.step(1e-3, c);
        twin.step(1e-3, c);
        twin.deviation_mm(c, tool)
    }

    #[test]
    fn a_machine_without_effects_has_no_deviation() {
        let d = deviation(&[], &at(300.0, 200.0, 100.0, 1.0), 120.0);
        assert!(d.iter().all(|v| v.abs() < 1e-10), "{d:?}");
    }

    #[test]
    fn a_longer_grating_shows_along_its_axis_also_with_the_table_turned() {
        let d = deviation(&[Effect::new("scale", "x", 15.0)], &at(300.0, 200.0, 100.0, 1.2), 120.0);
        assert!((d[0] - 0.03).abs() < 1e-6 && d[1].abs() < 1e-9 && d[2].abs() < 1e-9, "{d:?}");
    }

    #[test]
    fn an_error_varies_over_the_volume_and_a_commanded_offset_does_not() {
        let truth = TwinTruth {
            effects: vec![Effect::new("scale", "x", 15.0)],
            variation: 0.3,
            ..TwinTruth::perfect(4)
        };
        let mut twin = Twin::new(&truth, 1).unwrap();
        let corrected = at(299.97, 200.0, 100.0, 0.0);
        twin.step(1e-3, &corrected);
        twin.step(1e-3, &corrected);
        let error = twin.deviation_mm(&corrected, 120.0)[0];
        let left = twin.deviation_mm(&at(300.0, 200.0, 100.0, 0.0), 120.0)[0];
        assert!((error - 0.03).abs() > 1e-3, "it varies: {error}");
        assert!((left - (error - 0.03)).abs() < 1e-5, "{error} mm, {left} mm left");
    }

    #[test]
    fn a_leaning_spindle_shows_with_the_length_of_the_tool() {
        let e = [Effect::new("spindle-tilt", "", 10.0)];
        let (short, long) =
            (deviation(&e, &at(0.0, 0.0, 0.0, 0.0), 100.0), deviation(&e, &at(0.0, 0.0, 0.0, 0.0), 200.0));
        let size = |d: [f64; 3]| d[0].hypot(d[1]);
        assert!((size(short) - 0.01).abs() < 1e-6 && (size(long) / size(short) - 2.0).abs() < 1e-4);
    }

    #[test]
    fn a_table_that_stands_elsewhere_shows_only_when_it_turns() {
        let e = [Effect::new("rotary-location", "c", 8.0)];
        let still = deviation(&e, &at(300.0, 200.0, 200.0, 0.0), 120.0);
        assert!(still.iter().all(|v| v.abs() < 1e-5), "{still:?}");
        let half = deviation(&e, &at(300.0, 200.0, 200.0, std::f64::consts::PI), 120.0);
        assert!(half[0].hypot(half[1]) > 0.003, "{half:?}");
    }

    #[test]
    fn every_effect_of_the_catalogue_has_physics() {
        for entry in crate::twin::catalogue::CATALOGUE {
            for subject in entry.subjects.list() {
                let truth = TwinTruth {
                    effects: vec![Effect::new(entry.name, subject, 1.0)],
                    ..TwinTruth::perfect(1)
                };
                assert!(Twin::new(&truth, 1).is_ok(), "{}:{subject}", entry.name);
            }
        }
    }
}
