//! Error motions as sums of physical shapes: a worn middle, a screw pitch, a guide joint, waves, measured samples.
//!
//! A curve works in the units of its file: coordinate in mm or deg, value in um or arcsec. It is referenced when it
//! is built: zero at the home position and, for the straightness of a linear axis, without the slope of its
//! end-point line (equations 1.8: that slope is squareness and stands there).

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One shape; `s` runs from 0 to 1 over the travel.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A straight line that rises by `rise` over the travel.
    Slope {
        /// Rise over the travel.
        rise: f64,
    },
    /// A parabola, zero at both ends, `height` in the middle.
    Bow {
        /// Value in the middle of the travel.
        height: f64,
    },
    /// A sine wave.
    Wave {
        /// Amplitude.
        amplitude: f64,
        /// Length of one wave.
        period: f64,
        /// Phase at coordinate 0, deg.
        phase_deg: f64,
    },
    /// Error within one turn of a screw or gear: first and second harmonic of the pitch.
    Pitch {
        /// Length of one turn.
        pitch: f64,
        /// Amplitude of the first harmonic.
        first: f64,
        /// Amplitude of the second harmonic.
        second: f64,
    },
    /// A local rise, Gaussian.
    Bump {
        /// Value at the top.
        height: f64,
        /// Coordinate of the top.
        at: f64,
        /// Standard deviation of the Gaussian.
        width: f64,
    },
    /// A smoothed step, as at a joint of two guideway pieces.
    Step {
        /// Total rise.
        height: f64,
        /// Coordinate of the middle.
        at: f64,
        /// Half the length over which three quarters of the step happen.
        width: f64,
    },
    /// Measured values, joined by cubic pieces, held outside; separate for either direction of travel.
    Samples {
        /// Coordinates, rising.
        at: Vec<f64>,
        /// Mean of both directions at each coordinate.
        mean: Vec<f64>,
        /// Half of forward minus reverse at each coordinate.
        half_difference: Vec<f64>,
    },
    /// Random smooth waviness, drawn once from a seed.
    Waviness {
        /// The waves it consists of: amplitude, angular frequency, phase.
        waves: Vec<[f64; 3]>,
    },
}

/// A referenced error curve over the travel of an axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curve {
    shapes: Vec<Shape>,
    range: [f64; 2],
    /// Value and slope that were taken away.
    removed: [f64; 2],
}

/// Whether the slope of the end-point line belongs to the curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// Zero at home.
    Home,
    /// Zero at home and no slope between the ends.
    HomeAndEndPointLine,
}

impl Shape {
    /// Draws a waviness of standard deviation `rms` with waves from `shortest` up to the length of `range`.
    #[must_use]
    pub fn waviness(rms: f64, shortest: f64, range: [f64; 2], seed: u64, stream: u64) -> Self {
        const WAVES: usize = 8;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        let longest = (range[1] - range[0]).max(shortest);
        let mut waves: Vec<[f64; 3]> = (0..WAVES)
            .map(|_| {
                // Log-uniform lengths; long waves are higher than short ones, as on real guideways.
                let length = shortest * (longest / shortest).powf(random.random::<f64>());
                [length / longest, TAU / length, TAU * random.random::<f64>()]
            })
            .collect();
        let drawn = (waves.iter().map(|w| w[0] * w[0]).sum::<f64>() / 2.0).sqrt();
        for wave in &mut waves {
            wave[0] *= rms / drawn;
        }
        Self::Waviness { waves }
    }

    /// Samples of one or both directions of travel.
    #[must_use]
    pub fn samples(at: Vec<f64>, forward: &[f64], reverse: &[f64]) -> Self {
        let join = |f: fn(f64, f64) -> f64| forward.iter().zip(reverse).map(|(a, b)| f(*a, *b)).collect();
        Self::Samples {
            at,
            mean: join(|forward, reverse| (forward + reverse) / 2.0),
            half_difference: join(|forward, reverse| (forward - reverse) / 2.0),
        }
    }

    fn value(&self, x: f64, range: [f64; 2], direction: f64) -> f64 {
        let s = (x - range[0]) / (range[1] - range[0]);
        match self {
            Self::Slope { rise } => rise * s,
            Self::Bow { height } => height * 4.0 * s * (1.0 - s),
            Self::Wave { amplitude, period, phase_deg } => {
                amplitude * (TAU * x / period + phase_deg.to_radians()).sin()
            }
            Self::Pitch { pitch, first, second } => {
                first * (TAU * x / pitch).sin() + second * (2.0 * TAU * x / pitch).sin()
            }
            Self::Bump { height, at, width } => height * (-0.5 * ((x - at) / width).powi(2)).exp(),
            Self::Step { height, at, width } => height * 0.5 * (1.0 + ((x - at) / width).tanh()),
            Self::Samples { at, mean, half_difference } => {
                joined(at, mean, x) + direction * joined(at, half_difference, x)
            }
            Self::Waviness { waves } => waves.iter().map(|[a, w, phase]| a * (w * x + phase).cos()).sum(),
        }
    }
}

impl Curve {
    /// Adds up shapes over a travel and references the sum.
    #[must_use]
    pub fn new(shapes: Vec<Shape>, range: [f64; 2], reference: Reference) -> Self {
        let raw = Self { shapes, range, removed: [0.0, 0.0] };
        let slope = match reference {
            Reference::Home => 0.0,
            Reference::HomeAndEndPointLine => {
                (raw.value(range[1], 0.0) - raw.value(range[0], 0.0)) / (range[1] - range[0])
            }
        };
        Self { removed: [raw.value(0.0, 0.0), slope], ..raw }
    }

    /// The value at a coordinate; `direction` runs from -1 (travel towards minus) to +1, 0 is the mean of both.
    #[must_use]
    pub fn value(&self, x: f64, direction: f64) -> f64 {
        let sum: f64 = self.shapes.iter().map(|shape| shape.value(x, self.range, direction)).sum();
        sum - self.removed[0] - self.removed[1] * x
    }

    /// The largest magnitude over the travel, on a fine grid.
    #[must_use]
    pub fn largest(&self) -> f64 {
        const STEPS: usize = 500;
        (0..=STEPS)
            .flat_map(|i| {
                let x = self.range[0] + (self.range[1] - self.range[0]) * i as f64 / STEPS as f64;
                [self.value(x, 1.0).abs(), self.value(x, -1.0).abs()]
            })
            .fold(0.0, f64::max)
    }
}

/// Cubic pieces through the samples with the slope of the neighbours' chord at each; the end value is held.
fn joined(at: &[f64], value: &[f64], x: f64) -> f64 {
    let count = at.len().min(value.len());
    let Some(last) = count.checked_sub(1) else { return 0.0 };
    if x <= at[0] {
        return value[0];
    }
    if x >= at[last] {
        return value[last];
    }
    let right = at.partition_point(|a| *a <= x).clamp(1, last);
    let left = right - 1;
    let slope = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(last));
        (value[after] - value[before]) / (at[after] - at[before])
    };
    let width = at[right] - at[left];
    let t = (x - at[left]) / width;
    let (from_left, from_right) = (t * t * (3.0 - 2.0 * t), t * (1.0 - t));
    value[left] * (1.0 - from_left)
        + value[right] * from_left
        + width * from_right * ((1.0 - t) * slope(left) - t * slope(right))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: [f64; 2] = [-100.0, 400.0];

    fn every_shape() -> Vec<Shape> {
        vec![
            Shape::Slope { rise: 7.0 },
            Shape::Bow { height: -3.0 },
            Shape::Wave { amplitude: 5.0, period: 180.0, phase_deg: 40.0 },
            Shape::Pitch { pitch: 10.0, first: 0.4, second: 0.1 },
            Shape::Bump { height: 2.0, at: 120.0, width: 30.0 },
            Shape::Step { height: 1.5, at: 200.0, width: 10.0 },
            Shape::samples(vec![-100.0, 50.0, 400.0], &[1.0, 4.0, 2.0], &[0.0, 3.0, 1.0]),
            Shape::waviness(1.0, 60.0, RANGE, 1, 2),
        ]
    }

    #[test]
    fn a_curve_is_zero_at_home_and_has_no_end_point_slope() {
        let curve = Curve::new(every_shape(), RANGE, Reference::HomeAndEndPointLine);
        assert!(curve.value(0.0, 0.0).abs() < 1e-12);
        assert!((curve.value(RANGE[0], 0.0) - curve.value(RANGE[1], 0.0)).abs() < 1e-12);
        assert!(curve.largest() > 5.0);
        let with_slope = Curve::new(vec![Shape::Slope { rise: 5.0 }], RANGE, Reference::Home);
        assert!((with_slope.value(400.0, 0.0) - 4.0).abs() < 1e-12);
        assert!((with_slope.value(-100.0, 0.0) + 1.0).abs() < 1e-12);
    }

    #[test]
    fn shapes_have_the_size_they_say() {
        let at = |shape: Shape, x: f64| shape.value(x, RANGE, 0.0);
        assert!((at(Shape::Bow { height: -3.0 }, 150.0) + 3.0).abs() < 1e-12);
        assert!(at(Shape::Bow { height: -3.0 }, 400.0).abs() < 1e-12);
        assert!(
            (at(Shape::Wave { amplitude: 5.0, period: 180.0, phase_deg: 90.0 }, 180.0) - 5.0).abs() < 1e-12
        );
        assert!((at(Shape::Bump { height: 2.0, at: 120.0, width: 30.0 }, 120.0) - 2.0).abs() < 1e-12);
        assert!((at(Shape::Step { height: 1.5, at: 200.0, width: 10.0 }, 400.0) - 1.5).abs() < 1e-12);
    }

    #[test]
    fn samples_pass_through_their_points_in_either_direction() {
        let shape =
            Shape::samples(vec![0.0, 10.0, 25.0, 40.0], &[0.0, 3.0, -1.0, 2.0], &[1.0, 5.0, 0.0, 2.0]);
        for (x, forward, reverse) in [(0.0, 0.0, 1.0), (10.0, 3.0, 5.0), (25.0, -1.0, 0.0), (40.0, 2.0, 2.0)]
        {
            assert!((shape.value(x, RANGE, 1.0) - forward).abs() < 1e-12);
            assert!((shape.value(x, RANGE, -1.0) - reverse).abs() < 1e-12);
        }
        assert_eq!(shape.value(99.0, RANGE, 1.0), 2.0);
        assert_eq!(shape.value(-99.0, RANGE, 1.0), 0.0);
    }

    #[test]
    fn samples_of_a_line_are_a_line() {
        let shape =
            Shape::samples(vec![0.0, 7.0, 20.0, 41.0], &[0.0, 7.0, 20.0, 41.0], &[0.0, 7.0, 20.0, 41.0]);
        for x in [0.5, 6.0, 13.3, 33.0] {
            assert!((shape.value(x, RANGE, 1.0) - x).abs() < 1e-12);
        }
    }

    #[test]
    fn waviness_repeats_with_its_seed_only() {
        let draw = |seed, stream| Shape::waviness(1.0, 60.0, RANGE, seed, stream);
        assert_eq!(draw(5, 1), draw(5, 1));
        assert_ne!(draw(5, 1), draw(5, 2));
        assert_ne!(draw(5, 1), draw(6, 1));
        let Shape::Waviness { waves } = draw(5, 1) else { panic!("a waviness") };
        let power: f64 = waves.iter().map(|w| w[0] * w[0] / 2.0).sum();
        assert!((power - 1.0).abs() < 1e-12);
    }
}
