//! Heat: the hall, the scales, spindle bearing and head, the column; first-order bodies one behind the other,
//! integrated in time.

use super::file::Effect;
use super::random::Dice;

/// Longest step, s.
const STEP_S: f64 = 5.0;
/// Reference temperature of lengths, degC.
const REFERENCE: f64 = 20.0;

/// The hall's weather on a day.
#[derive(Debug, Clone, PartialEq)]
struct Hall {
    mean: f64,
    swings: [(f64, f64, f64); 2],
}

impl Hall {
    fn at(&self, t: f64) -> f64 {
        self.mean
            + self
                .swings
                .iter()
                .map(|(amplitude, period, phase)| {
                    amplitude * (std::f64::consts::TAU * t / period + phase).sin()
                })
                .sum::<f64>()
    }
}

/// All bodies that have a temperature.
#[derive(Debug, Clone, PartialEq)]
pub struct Heat {
    hall: Hall,
    t: f64,
    /// Temperatures: scales of X, Y, Z, bearing, head, column; degC.
    scale: [f64; 3],
    bearing: f64,
    head: f64,
    column: f64,
    column_s: f64,
    bearing_s: f64,
    head_s: f64,
    scale_s: [f64; 3],
    column_first: f64,
    /// Relative growth per K of each scale.
    expansion: [f64; 3],
    /// mm per K of bearing and head in x, y, z.
    growth: [[f64; 3]; 2],
    /// mm per K of the column.
    bend: [f64; 3],
    /// Speed of the spindle, rpm.
    pub spindle_rpm: f64,
    /// The drives of the axes are busy and warm the scales.
    pub busy: bool,
}

impl Heat {
    /// Bodies in equilibrium with the hall at time 0; `day` draws the weather.
    #[must_use]
    pub fn new(day: &mut Dice) -> Self {
        let turn = std::f64::consts::TAU;
        let hall = Hall {
            mean: REFERENCE + day.between(-0.6, 0.8),
            swings: [
                (day.between(0.8, 1.6), day.between(7000.0, 16_000.0), day.between(0.0, turn)),
                (day.between(0.1, 0.4), day.between(1500.0, 3500.0), day.between(0.0, turn)),
            ],
        };
        let now = hall.at(0.0);
        Self {
            hall,
            t: 0.0,
            scale: [now; 3],
            bearing: now,
            head: now,
            column: now,
            column_s: 3000.0,
            bearing_s: 400.0,
            head_s: 2400.0,
            scale_s: [2400.0, 2900.0, 3300.0],
            column_first: now,
            expansion: [0.0; 3],
            growth: [[0.0; 3]; 2],
            bend: [0.0; 3],
            spindle_rpm: 0.0,
            busy: false,
        }
    }

    /// Adds an effect; true where it is one of heat.
    pub fn add(&mut self, e: &Effect, axis: Option<usize>, dice: &mut Dice) -> bool {
        let mm = e.size_um * 1e-3;
        match (e.name.as_str(), axis) {
            // 3 K over 150 mm make the size
            ("thermal-expansion", Some(k)) => {
                if let Some(a) = self.expansion.get_mut(k) {
                    *a += mm / (3.0 * 150.0);
                }
            }
            ("spindle-growth", _) => {
                self.bearing_s = e.constant("bearing-s", dice.between(200.0, 700.0)).max(10.0);
                self.head_s = e.constant("head-s", dice.between(1500.0, 4500.0)).max(10.0);
                let drawn = if dice.between(0.0, 1.0) > 0.5 { dice.between(0.2, 0.5) } else { 0.0 };
                let y = e.constant("y-share", drawn);
                let head = dice.between(0.3, 0.9);
                self.growth =
                    [[0.0, -y * mm / 6.0, -mm / 6.0], [0.0, -head * y * mm / 6.0, -head * mm / 6.0]];
            }
            ("ambient-drift", _) => {
                self.column_s = e.constant("column-s", dice.between(900.0, 5000.0)).max(10.0);
                self.bend = [(); 3].map(|()| mm * dice.normal());
            }
            _ => return false,
        }
        true
    }

    /// Time, s.
    #[must_use]
    pub const fn time_s(&self) -> f64 {
        self.t
    }

    /// Lets time pass.
    pub fn pass(&mut self, seconds: f64) {
        let steps = (seconds / STEP_S).ceil().max(1.0);
        let dt = seconds / steps;
        for _ in 0..steps as usize {
            self.t += dt;
            let hall = self.hall.at(self.t);
            let drive = if self.busy { 5.5 } else { 0.0 };
            for (k, (scale, tau)) in self.scale.iter_mut().zip(self.scale_s).enumerate() {
                *scale += (hall + drive * (1.0 - 0.15 * k as f64) - *scale) * dt / tau;
            }
            // losses of a bearing grow a little faster than its speed
            let power = 12.0 * (self.spindle_rpm / 9000.0).powf(1.15);
            self.bearing += (power + self.head - self.bearing) * dt / self.bearing_s;
            self.head += (hall + 0.5 * (self.bearing - self.head) - self.head) * dt / self.head_s;
            self.column += (hall - self.column) * dt / self.column_s;
        }
    }

    /// What the sensors see: `x`, `y`, `z`, `spindle`, `ambient`; degC.
    #[must_use]
    pub fn sensors(&self) -> [(&'static str, f64); 5] {
        let [x, y, z] = self.scale;
        [("x", x), ("y", y), ("z", z), ("spindle", self.bearing), ("ambient", self.hall.at(self.t))]
    }

    /// Temperature of the air, degC.
    #[must_use]
    pub fn air(&self) -> f64 {
        self.hall.at(self.t)
    }

    /// Scale of X against the hall, K.
    #[must_use]
    pub fn gradient(&self) -> f64 {
        self.scale[0] - self.hall.at(self.t)
    }

    /// Growth of axis `k` at `q` mm, mm.
    #[must_use]
    pub fn expansion_mm(&self, k: usize, q: f64) -> f64 {
        match (self.expansion.get(k), self.scale.get(k)) {
            (Some(a), Some(t)) => a * (t - REFERENCE) * q,
            _ => 0.0,
        }
    }

    /// Shift of the tool by spindle and column, mm, in the machine frame.
    #[must_use]
    pub fn shift_mm(&self) -> [f64; 3] {
        let cold = self.column_first;
        std::array::from_fn(|i| {
            let [bearing, head] = self.growth.map(|g| g.get(i).copied().unwrap_or_default());
            let bend = self.bend.get(i).copied().unwrap_or_default();
            bearing * (self.bearing - self.head) + head * (self.head - cold) + bend * (self.column - cold)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spindle_grows_behind_its_speed_and_shrinks_again() {
        let mut heat = Heat::new(&mut Dice::new(3, "day"));
        assert!(heat.add(&Effect::new("spindle-growth", "", 10.0), None, &mut Dice::new(3, "part")));
        heat.pass(8000.0);
        let cold = heat.shift_mm()[2];
        heat.spindle_rpm = 9000.0;
        heat.pass(60.0);
        let first = heat.shift_mm()[2] - cold;
        heat.pass(5000.0);
        let warm = heat.shift_mm()[2] - cold;
        heat.spindle_rpm = 0.0;
        heat.pass(30_000.0);
        let again = heat.shift_mm()[2] - cold;
        assert!(
            warm < -0.008 && first > 0.4 * warm && again.abs() < 0.4 * warm.abs(),
            "{first} {warm} {again}"
        );
    }

    #[test]
    fn scales_warm_up_when_the_drives_are_busy() {
        let mut heat = Heat::new(&mut Dice::new(3, "day"));
        heat.pass(3600.0);
        let before = heat.sensors()[0].1;
        heat.busy = true;
        heat.pass(7200.0);
        assert!(heat.sensors()[0].1 - before > 3.0);
    }
}
