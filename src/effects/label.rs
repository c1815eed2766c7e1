//! Effects by name, with the axis, pair or symbol that has them.

use core::fmt;

use serde::{Deserialize, Serialize};

use super::pages::{Page, page};

/// Who is to blame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The machine: simulator and compensator.
    Machine,
    /// The measurement: never the compensator.
    Instrument,
    /// Not repeatable: simulator only.
    Stochastic,
}

/// An effect by name, with the axis, pair or symbol that has it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Label {
    /// Its name (`docs/reference/session-files.md` 4.1).
    pub effect: &'static str,
    /// Axis, axis pair, error symbol, or empty.
    pub subject: String,
}

impl Label {
    /// A label.
    #[must_use]
    pub fn new(effect: &'static str, subject: impl fmt::Display) -> Self {
        Self { effect, subject: subject.to_string() }
    }

    /// The label of a text `effect` or `effect:subject`. Synonyms count, and either order of a pair.
    ///
    /// # Errors
    /// An effect that is not in the library, or a subject that it cannot have.
    pub fn parse(text: &str) -> Result<(&'static str, Option<String>), LabelError> {
        let (effect, subject) =
            text.split_once(':').map_or((text, None), |(e, s)| (e, Some(s.to_ascii_lowercase())));
        let page = page(&effect.to_ascii_lowercase())
            .ok_or_else(|| LabelError::Effect { effect: effect.to_owned() })?;
        let Some(subject) = subject.filter(|s| !s.is_empty()) else { return Ok((page.effect, None)) };
        // a pair is named in one order only
        let turned: String = subject.chars().rev().collect();
        let known = subjects(page);
        let found = known.iter().find(|k| **k == subject || (page.subject == PAIR && **k == turned));
        let Some(found) = found else {
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            return Err(LabelError::Subject { effect: page.effect, subject, known });
        };
        Ok((page.effect, Some(found.clone())))
    }
}

/// A text that is no label.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LabelError {
    /// No such effect.
    #[error("'{effect}' is no effect; volcomp diagnose --list-effects lists them")]
    Effect {
        /// What stands before the colon.
        effect: String,
    },
    /// The effect has no such subject.
    #[error("{effect} has no subject '{subject}'; its subjects are: {known}")]
    Subject {
        /// The effect.
        effect: &'static str,
        /// What stands behind the colon.
        subject: String,
        /// What may stand there.
        known: String,
    },
}

/// What [`Page::subject`] says of effects of two axes.
const PAIR: &str = "axis pair";

/// Every subject that an effect can have.
fn subjects(page: &Page) -> Vec<String> {
    let of = |axes: &[char]| axes.iter().map(ToString::to_string).collect::<Vec<_>>();
    let (linear, rotary) = (['x', 'y', 'z'], ['a', 'b', 'c']);
    // straightness is across the axis, an angular error about any of the three
    let symbols = |letters: [char; 3], straight: bool| {
        linear
            .iter()
            .flat_map(|axis| letters.iter().map(move |l| (*l, *axis)))
            .filter(|(l, axis)| !(straight && l == axis))
            .map(|(l, axis)| format!("e{l}{axis}"))
            .collect()
    };
    match (page.subject, page.effect) {
        ("", _) => Vec::new(),
        (PAIR, _) => ["xy", "yz", "zx"].map(str::to_owned).into(),
        ("rotary axis", _) => of(&rotary),
        ("error symbol", "angular") => symbols(rotary, false),
        ("error symbol", _) => symbols(linear, true),
        (_, "backlash") => of(&[linear, rotary].concat()),
        _ => of(&linear),
    }
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.subject.is_empty() {
            write!(f, "{}", self.effect)
        } else {
            write!(f, "{}:{}", self.effect, self.subject)
        }
    }
}

/// An effect taken out of the library.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Without {
    /// The effect.
    pub effect: &'static str,
    /// Its subject; all of them where there is none.
    pub subject: Option<String>,
}

impl Without {
    /// True where it takes out `label`.
    #[must_use]
    pub fn covers(&self, label: &Label) -> bool {
        self.effect == label.effect && self.subject.as_ref().is_none_or(|s| *s == label.subject)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_state::{Axis, Light, MachineState, Signal, Source};
    use crate::{Lever, RotaryFrame, Shape};
    use volcomp_model::geometry::Vec3;

    #[test]
    fn a_label_has_an_effect_and_a_subject_that_it_can_have() {
        let known = |text: &str| Label::parse(text).map(|(e, s)| format!("{e}:{}", s.unwrap_or_default()));
        for (text, label) in [
            ("backlash", "backlash:"),
            ("lost-motion:X", "backlash:x"),
            ("backlash:c", "backlash:c"),
            ("squareness:yx", "squareness:xy"),
            ("squareness:xz", "squareness:zx"),
            ("straightness:ezx", "straightness:ezx"),
            ("angular:ebx", "angular:ebx"),
            ("rotary-location:a", "rotary-location:a"),
        ] {
            assert_eq!(known(text).as_deref(), Ok(label));
        }
        for (text, said) in [
            ("nope:x", "'nope' is no effect"),
            ("backlash:q", "its subjects are: x, y, z, a, b, c"),
            ("squareness:xx", "its subjects are: xy, yz, zx"),
            ("spindle-growth:x", "its subjects are: none"),
            ("straightness:exx", "its subjects are: eyx, ezx, exy, ezy, exz, eyz"),
            ("rotary-motion:x", "its subjects are: a, b, c"),
        ] {
            let message = known(text).unwrap_err().to_string();
            assert!(message.contains(said), "{text}: {message}");
        }
    }

    fn evaluated(shape: &Shape, m: &MachineState) -> Vec<Vec3> {
        let mut out = vec![Vec3::zeros(); shape.width()];
        shape.evaluate_with(m, &|_| None, &mut out);
        out
    }

    #[test]
    fn the_run_of_a_table_on_a_swivel_turns_with_the_swivel() {
        let frame = RotaryFrame {
            axis: Axis::C,
            workpiece_side: true,
            point_mm: [0.0; 3],
            outer: vec![Axis::A],
            outer_points_mm: vec![[0.0; 3]],
            inner: vec![],
            inner_points_mm: vec![],
            tip_mm: [0.0; 3],
            nose_mm: None,
        };
        let runs =
            |frame| Shape::RotaryMotion { axis: Axis::C, along: vec![Axis::Z], low: 2, high: 2, frame };
        let quarter = core::f64::consts::FRAC_PI_2;
        let m = MachineState { position: [0.0, 0.0, 0.0, quarter, 0.0, quarter], ..MachineState::default() };
        // a table turns against its coordinate: what pointed up points along plus y
        let turned = evaluated(&runs(Some(frame)), &m)[0];
        assert!((turned - Vec3::new(0.0, -2.0, 0.0)).norm() < 1e-12, "{turned}");
        assert!((evaluated(&runs(None), &m)[0] - Vec3::new(0.0, 0.0, -2.0)).norm() < 1e-12);
    }

    #[test]
    fn each_kind_of_light_has_its_own_air_and_a_laser_no_scale_of_a_tracker() {
        let at = |light| MachineState {
            light: Some(light),
            range_mm: 2000.0,
            station_mm: Vec3::new(-2000.0, 0.0, 0.0),
            reflector_mm: Vec3::zeros(),
            u: Vec3::x(),
            ..MachineState::default()
        };
        let scale = Shape::TrackerScale { signal: None, zero: true };
        assert_eq!(evaluated(&scale, &at(Light::Tracker)), [Vec3::new(2.0, 0.0, 0.0), Vec3::x()]);
        assert_eq!(evaluated(&scale, &at(Light::Laser)), [Vec3::zeros(); 2]);
        let signal = Signal { source: Source::Temperature("air".to_owned()), tau_s: 0.0 };
        for (own, other) in [(Light::Laser, Light::Tracker), (Light::Tracker, Light::Laser)] {
            let path = Shape::DeadPath { signal: signal.clone(), light: Some(own), station: None };
            let mut out = [Vec3::zeros(); 2];
            let seen = |light, out: &mut [Vec3]| {
                let m = MachineState { signals: vec![21.0], ..at(light) };
                path.evaluate_with(&m, &|_| Some(0), out);
            };
            seen(own, &mut out);
            assert_eq!(out[1], Vec3::x());
            out.fill(Vec3::zeros());
            seen(other, &mut out);
            assert_eq!(out, [Vec3::zeros(); 2]);
        }
    }

    #[test]
    fn a_moment_bends_a_ram_with_the_square_of_its_reach() {
        let lever = Lever { axes: [false; 3], home_mm: [0.0; 3], tool: false };
        let ram =
            Shape::Ram { axis: Axis::Y, start_mm: 0.0, reach_mm: 100.0, lever, moment: true, beam: false };
        let mut m = MachineState::default();
        m.position[1] = 50.0;
        let drops: Vec<f64> = evaluated(&ram, &m).iter().map(|d| d.z).collect();
        assert_eq!(drops, [-0.125, -0.0625, -0.25]);
    }
}
