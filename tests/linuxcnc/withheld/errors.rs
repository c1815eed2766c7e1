//! The errors of the machine, drawn from a seed and withheld until the judgement.

use std::fmt::Write as _;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const AXES: [&str; 3] = ["x", "y", "z"];
/// Pairs of axes and the parameter of `withheld_machine` that has their squareness error.
const PAIRS: [(&str, &str); 3] = [("xy", "lean-xy"), ("yz", "lean-yz"), ("zx", "lean-zx")];
const KNOTS: usize = 11;
/// Ranges of the sizes. Each effect alone is at least three times the noise of a reading (RMS along its line).
const BACKLASH_UM: [f64; 2] = [4.0, 10.0];
const SCALE_UM_PER_M: [f64; 2] = [20.0, 60.0];
const SQUARENESS_UM_PER_M: [f64; 2] = [20.0, 80.0];
const POSITIONING_UM: f64 = 4.0;

enum Error {
    Backlash { axis: usize, um: f64 },
    Scale { axis: usize, um_per_m: f64 },
    Squareness { pair: usize, um_per_m: f64 },
    Positioning { axis: usize, knots_um: [f64; KNOTS] },
}

/// What the machine has and nobody knows.
pub(super) struct Withheld {
    errors: Vec<Error>,
    /// The axis with a linear scale: that of the backlash.
    scale_on: usize,
}

/// An error as it is judged.
pub(super) struct Truth {
    /// `effect:subject`, as in the report of a diagnosis.
    pub(super) label: String,
    pub(super) size: String,
}

impl Withheld {
    /// Four errors: backlash of any axis, scale and positioning of two different axes, squareness of any pair.
    pub(super) fn draw(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let backlash_axis = random.random_range(0..3);
        let scale_axis = random.random_range(0..3);
        let positioning_axis = (scale_axis + random.random_range(1..3)) % 3;
        let pair = random.random_range(0..3);
        let mut within = |[low, high]: [f64; 2]| low + (high - low) * random.random::<f64>();
        let (um, scale, squareness) =
            (within(BACKLASH_UM), within(SCALE_UM_PER_M), within(SQUARENESS_UM_PER_M));
        let mut signed = |size: f64| if random.random::<bool>() { size } else { -size };
        let (scale, squareness) = (signed(scale), signed(squareness));
        let knots_um = core::array::from_fn(|_| {
            let normal: f64 = StandardNormal.sample(&mut random);
            POSITIONING_UM * normal
        });
        Self {
            errors: vec![
                Error::Backlash { axis: backlash_axis, um },
                Error::Scale { axis: scale_axis, um_per_m: scale },
                Error::Squareness { pair, um_per_m: squareness },
                Error::Positioning { axis: positioning_axis, knots_um },
            ],
            scale_on: backlash_axis,
        }
    }

    /// Lines of HAL that give the machine its errors.
    pub(super) fn hal(&self) -> String {
        let mut lines = format!("setp withheld-machine.scale-on {}\n", self.scale_on);
        let mut set = |parameter: String, value: f64| {
            writeln!(lines, "setp withheld-machine.{parameter} {value:.12}").expect("text");
        };
        for error in &self.errors {
            match error {
                Error::Backlash { axis, um } => set(format!("play-{axis}"), um * 1e-3),
                Error::Scale { axis, um_per_m } => set(format!("slope-{axis}"), um_per_m * 1e-6),
                Error::Squareness { pair, um_per_m } => set(PAIRS[*pair].1.to_owned(), um_per_m * 1e-6),
                Error::Positioning { knots_um, .. } => {
                    for (k, um) in knots_um.iter().enumerate() {
                        set(format!("knot-{k:02}"), um * 1e-3);
                    }
                }
            }
        }
        for error in &self.errors {
            if let Error::Positioning { axis, .. } = error {
                writeln!(lines, "setp withheld-machine.curve-on {axis}").expect("text");
            }
        }
        lines
    }

    /// Opened for the judgement.
    pub(super) fn open(&self) -> Vec<Truth> {
        let truth = |error: &Error| match error {
            Error::Backlash { axis, um } => {
                Truth { label: format!("backlash:{}", AXES[*axis]), size: format!("{um:.2} um") }
            }
            Error::Scale { axis, um_per_m } => {
                Truth { label: format!("scale:{}", AXES[*axis]), size: format!("{um_per_m:.2} um/m") }
            }
            Error::Squareness { pair, um_per_m } => {
                Truth { label: format!("squareness:{}", PAIRS[*pair].0), size: format!("{um_per_m:.2} um/m") }
            }
            Error::Positioning { axis, knots_um } => {
                let (low, high) = knots_um[1..KNOTS - 1]
                    .iter()
                    .fold((f64::MAX, f64::MIN), |(low, high), um| (low.min(*um), high.max(*um)));
                Truth {
                    label: format!("positioning:{}", AXES[*axis]),
                    size: format!("{low:.1} to {high:.1} um"),
                }
            }
        };
        self.errors.iter().map(truth).collect()
    }

    /// Axis with a linear scale behind its lost motion, and that lost motion, um.
    pub(super) fn backlash_at_scale(&self) -> (usize, f64) {
        let of = |error: &Error| match error {
            Error::Backlash { axis, um } if *axis == self.scale_on => Some(*um),
            _ => None,
        };
        (self.scale_on, self.errors.iter().find_map(of).unwrap_or(0.0))
    }
}
