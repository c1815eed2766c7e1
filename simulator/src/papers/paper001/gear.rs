//! The sample gear of 001, its true flanks, the inspection program, and the readings of a probe.
//!
//! The ball's centre moves along the base tangent at the height of the base radius; A and Y roll together, X stands
//! (profile), or X moves at the reference diameter (lead). A flank of the side `+1` faces +Y, one of `-1` faces -Y. All
//! lengths mm, angles rad, in W about the gear's axis.

use std::fmt::Write as _;

use crate::twin::Dice;

/// Teeth, module, face width, tip and control diameter of table 3 of the paper; 114 is the root diameter.
pub(super) const TEETH: u32 = 31;
pub(super) const MODULE_MM: f64 = 4.0;
pub(super) const FACE_MM: f64 = 30.0;
pub(super) const TIP_MM: f64 = 132.0;
pub(super) const CONTROL_MM: f64 = 118.4;
/// Effective radius of the ball of the paper.
pub(super) const BALL_MM: f64 = 1.4935;
/// Arm about B, B at the height of the A axis, Y over it.
pub(super) const ARM_MM: f64 = 173.7135;
pub(super) const B_ZERO_DEG: f64 = -39.025;
pub(super) const Y_ZERO_MM: f64 = 168.8053;
/// X at which the ball stands in the datum face.
pub(super) const X_FACE_MM: f64 = 20.0;
/// Base angle of the first left flank, as A where it would be touched on the base circle.
pub(super) const FIRST_DEG: f64 = -170.0;
/// Measured teeth, counted from the first; the right flanks belong to teeth three further on.
const MEASURED: [u32; 4] = [0, 8, 16, 23];
const RIGHT_AHEAD: u32 = 3;
/// Feeds of profile and lead.
const FEEDS: [f64; 2] = [300.0, 450.0];
/// Width of a cell in which the readings of a pass are averaged: profile, lead.
const CELLS_MM: [f64; 2] = [0.25, 0.4];

pub(super) fn base_mm() -> f64 {
    0.5 * f64::from(TEETH) * MODULE_MM * 20f64.to_radians().cos()
}

fn roll_mm(diameter_mm: f64) -> f64 {
    (0.25 * diameter_mm * diameter_mm - base_mm().powi(2)).sqrt()
}

/// A trace to be measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Trace {
    pub(super) is_profile: bool,
    /// +1 left, -1 right.
    pub(super) side: f64,
    pub(super) tooth: u32,
}

/// Everything that is measured in a pass, in order.
pub(super) fn traces() -> Vec<Trace> {
    let mut all = Vec::new();
    for is_profile in [true, false] {
        for side in [1.0, -1.0] {
            for k in MEASURED {
                let tooth = if side > 0.0 { k } else { (k + RIGHT_AHEAD) % TEETH };
                all.push(Trace { is_profile, side, tooth });
            }
        }
    }
    all
}

impl Trace {
    /// A (deg) where the flank begins on the base circle.
    pub(super) fn base_deg(&self) -> f64 {
        let pitch = 360.0 / f64::from(TEETH);
        let pressure = 20f64.to_radians();
        let thickness = 0.5 * pitch + 2.0 * (pressure.tan() - pressure).to_degrees();
        let own = FIRST_DEG + pitch * f64::from(self.tooth);
        if self.side > 0.0 { own } else { own + thickness }
    }

    /// A (deg) at a roll length.
    fn a_deg(&self, roll_mm: f64) -> f64 {
        self.base_deg() + self.side * (roll_mm / base_mm()).to_degrees()
    }

    /// Roll lengths between which the ball moves, or positions along the face.
    fn range(&self) -> [f64; 2] {
        if self.is_profile {
            [roll_mm(CONTROL_MM) - 0.5, roll_mm(TIP_MM) + 0.3]
        } else {
            [-0.5, FACE_MM + 0.5]
        }
    }

    /// Axis words at a position of the trace, for a ball of this radius.
    fn words(&self, at: f64, ball_mm: f64) -> String {
        let (roll, face) =
            if self.is_profile { (at, 0.5 * FACE_MM) } else { (roll_mm(f64::from(TEETH) * MODULE_MM), at) };
        let b = B_ZERO_DEG + (base_mm() / ARM_MM).asin().to_degrees();
        // the arm turns towards X as it rises
        let x = X_FACE_MM + face + ARM_MM * (b - B_ZERO_DEG).to_radians().cos()
            - ARM_MM * B_ZERO_DEG.to_radians().cos();
        format!("X{x:.6} Y{:.6} A{:.7} B{b:.7}", Y_ZERO_MM + self.side * (roll + ball_mm), self.a_deg(roll))
    }
}

/// The inspection program for a ball of this radius.
pub(super) fn program(ball_mm: f64) -> String {
    let mut text = "%\n(profile and lead of the sample gear)\nG21 G90\n".to_owned();
    for trace in traces() {
        let [from, to] = trace.range();
        let name = if trace.is_profile { "profile" } else { "lead" };
        let feed = FEEDS[usize::from(!trace.is_profile)];
        // writing into a string cannot fail
        let _ = write!(
            text,
            "({name} of tooth {})\nG0 {}\nG4 P0.2\n(SCORE ON)\nG1 {} F{feed}\n(SCORE OFF)\nG4 P0.1\n",
            trace.tooth + 1,
            trace.words(from, ball_mm),
            trace.words(to, ball_mm)
        );
    }
    text + "M30\n"
}

/// The gear as it is and as it is clamped.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Gear {
    /// Slope of the true flanks over the roll length and over the face, um, by side.
    slopes_um: [[f64; 2]; 2],
    wave_um: f64,
    /// Shift of the gear's axis and its tilt over the face, mm.
    off_mm: [f64; 2],
    tilt_mm: [f64; 2],
}

impl Gear {
    pub(super) const PERFECT: Self =
        Self { slopes_um: [[0.0; 2]; 2], wave_um: 0.0, off_mm: [0.0; 2], tilt_mm: [0.0; 2] };

    /// A sample gear of class 1 to 2.
    pub(super) fn real(seed: u64) -> Self {
        let mut dice = Dice::new(seed, "sample gear of paper 001");
        let mut slope = || 0.6 * dice.normal();
        let slopes_um = [[slope(), slope()], [slope(), slope()]];
        Self { slopes_um, wave_um: 0.4, ..Self::PERFECT }
    }

    /// The same gear clamped off centre: some um, as set up with a dial.
    pub(super) fn clamped(mut self, seed: u64, salt: &str) -> Self {
        let mut dice = Dice::new(seed, salt);
        self.off_mm = [0, 1].map(|_| 3e-3 * dice.normal());
        self.tilt_mm = [0, 1].map(|_| 1e-3 * dice.normal());
        self
    }

    /// How far the surface is above the involute, um.
    fn form_um(&self, side: f64, roll: f64, face: f64) -> f64 {
        let [profile, lead] = self.slopes_um[usize::from(side < 0.0)];
        let share = (roll - roll_mm(CONTROL_MM)) / (roll_mm(TIP_MM) - roll_mm(CONTROL_MM));
        let wave = self.wave_um * (std::f64::consts::TAU * 2.5 * share).sin();
        profile * (share - 0.5) + lead * (face / FACE_MM - 0.5) + wave
    }

    /// Deflection of the probe, um: how far the flank reaches into the ball. `centre` is the ball's in W, from the A axis.
    pub(super) fn pressed_um(&self, trace: &Trace, centre: [f64; 3], ball_mm: f64) -> f64 {
        let face = centre[0];
        let share = face / FACE_MM - 0.5;
        let y = centre[1] - self.off_mm[0] - share * self.tilt_mm[0];
        let z = centre[2] - self.off_mm[1] - share * self.tilt_mm[1];
        let base = base_mm();
        let string = (y * y + z * z - base * base).max(0.0).sqrt();
        // the angle at which the string through the ball's centre touches the base circle
        let touches = z.atan2(y) + trace.side * (string / base).atan();
        let begins = (90.0 + trace.base_deg()).to_radians();
        let turned = (trace.side * (touches - begins)).rem_euclid(std::f64::consts::TAU);
        let roll = base * turned;
        1e3 * (ball_mm - (string - roll)) + self.form_um(trace.side, roll, face)
    }
}

/// Readings of traces as the table of `volcomp evaluate gear`.
#[derive(Debug, Clone, Default)]
pub(super) struct Readings {
    text: String,
}

impl Readings {
    pub(super) fn new() -> Self {
        Self { text: "direction,flank,tooth,pass,position_mm,deviation_um\n".to_owned() }
    }

    /// A pass of a trace: positions (mm) and deviations (um), averaged in cells over the functional length.
    pub(super) fn add(&mut self, trace: &Trace, pass: u32, readings: &[(f64, f64)]) {
        let [low, high] =
            if trace.is_profile { [roll_mm(CONTROL_MM), roll_mm(TIP_MM)] } else { [0.0, FACE_MM] };
        let count = ((high - low) / CELLS_MM[usize::from(!trace.is_profile)]).floor();
        let width = (high - low) / count;
        let mut cells = vec![(0.0, 0.0f64); count as usize];
        for (at, value) in readings.iter().filter(|r| (low..high).contains(&r.0)) {
            if let Some(cell) = cells.get_mut(((at - low) / width) as usize) {
                cell.0 += value;
                cell.1 += 1.0;
            }
        }
        let name = if trace.is_profile { "profile" } else { "lead" };
        let flank = if trace.side > 0.0 { "left" } else { "right" };
        for (i, (sum, n)) in cells.iter().enumerate().filter(|(_, c)| c.1 > 0.0) {
            let at = low + (i as f64 + 0.5) * width;
            // writing into a string cannot fail
            let _ = writeln!(self.text, "{name},{flank},{},{pass},{at:.6},{:.5}", trace.tooth + 1, sum / n);
        }
    }

    pub(super) fn csv(&self) -> &str {
        &self.text
    }
}

/// Position along a trace of a commanded A (deg) and X (mm).
pub(super) fn position(trace: &Trace, a_deg: f64, face_mm: f64) -> f64 {
    if trace.is_profile { trace.side * (a_deg - trace.base_deg()).to_radians() * base_mm() } else { face_mm }
}

/// A gear tester with its own noise (um) and its own systematic errors: slopes of some tenths of um, a clamping of its own.
pub(super) fn tester(gear: &Gear, seed: u64, systematic: bool) -> Readings {
    let mut dice = Dice::new(seed, "gear tester of paper 001");
    let off: Vec<f64> = (0..4).map(|_| if systematic { 0.4 * dice.normal() } else { 0.0 }).collect();
    let gear = if systematic { gear.clone().clamped(seed, "clamping on the tester") } else { gear.clone() };
    let mut readings = Readings::new();
    for pass in 1..=3 {
        for trace in traces() {
            let [from, to] = trace.range();
            let own = off[2 * usize::from(trace.side < 0.0) + usize::from(!trace.is_profile)];
            let list: Vec<(f64, f64)> = (0..=400)
                .map(|i| {
                    let share = f64::from(i) / 400.0;
                    let at = from + share * (to - from);
                    let (roll, face) =
                        if trace.is_profile { (at, 0.5 * FACE_MM) } else { (roll_mm(124.0), at) };
                    let turn = trace.a_deg(roll).to_radians();
                    let (y, z) = (trace.side * (roll + BALL_MM), base_mm());
                    let centre = [face, y * turn.cos() - z * turn.sin(), y * turn.sin() + z * turn.cos()];
                    let seen = gear.pressed_um(&trace, centre, BALL_MM);
                    (at, seen + own * (share - 0.5) + 0.2 * dice.normal())
                })
                .collect();
            readings.add(&trace, pass, &list);
        }
    }
    readings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_perfect_gear_presses_nowhere_and_a_form_error_shows_as_it_is() {
        let gear = Gear { slopes_um: [[2.0, 0.0]; 2], ..Gear::PERFECT };
        for trace in traces() {
            for i in 0..=10 {
                let [from, to] = trace.range();
                let at = from + 0.1 * f64::from(i) * (to - from);
                let roll = if trace.is_profile { at } else { roll_mm(124.0) };
                let turn = trace.a_deg(roll).to_radians();
                let (y, z) = (trace.side * (roll + BALL_MM), base_mm());
                let centre = [5.0, y * turn.cos() - z * turn.sin(), y * turn.sin() + z * turn.cos()];
                let clean = Gear::PERFECT.pressed_um(&trace, centre, BALL_MM);
                assert!(clean.abs() < 1e-6, "{trace:?} {at}: {clean}");
                let slope = gear.pressed_um(&trace, centre, BALL_MM);
                let share = (roll - roll_mm(CONTROL_MM)) / (roll_mm(TIP_MM) - roll_mm(CONTROL_MM));
                assert!((slope - 2.0 * (share - 0.5)).abs() < 1e-6);
                assert!(trace.a_deg(at).abs() < 180.0 || !trace.is_profile);
            }
        }
    }

    #[test]
    fn a_shifted_gear_turns_the_slopes_of_opposite_teeth_the_other_way() {
        let off = Gear { off_mm: [5e-3, 0.0], ..Gear::PERFECT };
        let slope = |tooth: u32| {
            let trace = Trace { is_profile: true, side: 1.0, tooth };
            let seen = |roll: f64| {
                let turn = trace.a_deg(roll).to_radians();
                let (y, z) = (roll + BALL_MM, base_mm());
                let centre = [5.0, y * turn.cos() - z * turn.sin(), y * turn.sin() + z * turn.cos()];
                off.pressed_um(&trace, centre, BALL_MM)
            };
            seen(30.0) - seen(12.0)
        };
        let sum: f64 = MEASURED.map(slope).iter().sum();
        // a slope is that of a sine over the turn of the gear: its amplitude, and that of the sum over the measured teeth
        let amplitude = 5.0 * 2.0 * (0.5 * (30.0 - 12.0) / base_mm()).sin();
        let turn = |tooth: u32| (360.0 / f64::from(TEETH) * f64::from(tooth)).to_radians();
        let [across, along] = [f64::cos, f64::sin].map(|f| MEASURED.map(|k| f(turn(k))).iter().sum::<f64>());
        let largest = amplitude * across.hypot(along);
        assert!(largest < 0.15 * amplitude && sum.abs() < largest + 0.02, "{sum}, at most {largest}");
        assert!(slope(0).hypot(slope(8)) > 0.9 * amplitude, "{amplitude}");
    }
}
