//! Random curves over the travel of an axis and fields over the volume.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::chance::Chance;
use super::machine::TRAVEL_MM;

/// How a curve is made.
#[derive(Debug, Clone, PartialEq)]
enum Form {
    /// Sines: amplitude, wave number (rad/mm), phase.
    Sines(Vec<[f64; 3]>),
    /// Through knots, straight between them.
    Broken(Vec<[f64; 2]>),
    /// Through knots, cubic between them (Catmull and Rom).
    Smooth(Vec<[f64; 2]>),
    /// Kinks of a guideway: size, place, width (mm).
    Kinks(Vec<[f64; 3]>),
}

/// A curve whose RMS over the travel is 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    form: Form,
    offset: f64,
    slope: f64,
    gain: f64,
}

/// Places at which curves are looked at.
const LOOKS: usize = 160;

impl Curve {
    fn raw(form: Form) -> Self {
        Self { form, offset: 0.0, slope: 0.0, gain: 1.0 }
    }

    /// Sines of random wavelengths between half the travel and one and a half times it.
    #[must_use]
    pub fn sines([low, high]: [f64; 2], chance: &mut Chance) -> Self {
        let span = high - low;
        let waves = (0..4)
            .map(|_| [chance.normal(), TAU / (span * chance.within(0.52, 1.5)), chance.angle()])
            .collect();
        Self::raw(Form::Sines(waves))
    }

    /// A broken line or a smooth one through `count` random knots.
    #[must_use]
    pub fn knots([low, high]: [f64; 2], count: usize, broken: bool, chance: &mut Chance) -> Self {
        let step = (high - low) / (count - 1) as f64;
        let knots = (0..count)
            .map(|k| {
                let inner = k > 0 && k + 1 < count;
                let shift = if inner { chance.within(-0.3, 0.3) * step } else { 0.0 };
                [low + step * k as f64 + shift, chance.normal()]
            })
            .collect();
        Self::raw(if broken { Form::Broken(knots) } else { Form::Smooth(knots) })
    }

    /// Two kinks, rounded.
    #[must_use]
    pub fn kinks([low, high]: [f64; 2], chance: &mut Chance) -> Self {
        let span = high - low;
        let kinks = (0..2)
            .map(|_| {
                [chance.normal() + 1.5 * chance.either(), low + span * chance.within(0.15, 0.85), 0.12 * span]
            })
            .collect();
        Self::raw(Form::Kinks(kinks))
    }

    /// Less its line of least squares over the travel.
    #[must_use]
    pub fn without_line(mut self, travel: [f64; 2]) -> Self {
        let n = LOOKS as f64;
        let all: Vec<(f64, f64)> = looks(travel).map(|x| (x, self.at(x))).collect();
        let (mx, my) = all.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
        let sxy: f64 = all.iter().map(|(x, y)| (x - mx) * (y - my)).sum();
        let sxx: f64 = all.iter().map(|(x, _)| (x - mx).powi(2)).sum();
        let slope = sxy / sxx.max(1e-12);
        self.slope += slope;
        self.offset += my - slope * mx;
        self
    }

    /// Zero at the zero of the axis.
    #[must_use]
    pub fn zero_at_home(mut self) -> Self {
        self.offset += self.at(0.0);
        self
    }

    /// With RMS 1 about its mean over the travel.
    #[must_use]
    pub fn normed(mut self, travel: [f64; 2]) -> Self {
        let n = LOOKS as f64;
        let all: Vec<f64> = looks(travel).map(|x| self.at(x)).collect();
        let mean = all.iter().sum::<f64>() / n;
        let rms = (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        self.gain /= rms.max(1e-9);
        self
    }

    /// The value at `x` mm.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        let value = match &self.form {
            Form::Sines(waves) => waves.iter().map(|[a, k, phase]| a * (k * x + phase).sin()).sum(),
            Form::Kinks(kinks) => {
                // the integral of a logistic step: a line that turns by `a` over the width
                kinks.iter().map(|[a, at, w]| a * softplus((x - at) / w)).sum()
            }
            Form::Broken(knots) => between(knots, x, false),
            Form::Smooth(knots) => between(knots, x, true),
        };
        self.gain * (value - self.offset - self.slope * x)
    }
}

fn looks([low, high]: [f64; 2]) -> impl Iterator<Item = f64> {
    (0..LOOKS).map(move |k| low + (high - low) * (k as f64 + 0.5) / LOOKS as f64)
}

/// `ln(1 + e^s)`.
fn softplus(s: f64) -> f64 {
    s.max(0.0) + (-s.abs()).exp().ln_1p()
}

fn between(knots: &[[f64; 2]], x: f64, smooth: bool) -> f64 {
    let last = knots.len().saturating_sub(2);
    let i = knots.iter().skip(1).position(|k| x <= k[0]).unwrap_or(last).min(last);
    let get = |k: usize| knots.get(k.min(knots.len() - 1)).copied().unwrap_or_default();
    let ([x0, y0], [x1, y1]) = (get(i), get(i + 1));
    let h = (x1 - x0).max(1e-9);
    let s = (x - x0) / h;
    if !smooth {
        return y0 + (y1 - y0) * s;
    }
    let slope = |a: [f64; 2], b: [f64; 2]| if b[0] > a[0] { (b[1] - a[1]) / (b[0] - a[0]) } else { 0.0 };
    let before = if i == 0 { slope(get(0), get(1)) } else { slope(get(i - 1), get(i + 1)) };
    let after = if i >= last { slope(get(i), get(i + 1)) } else { slope(get(i), get(i + 2)) };
    let s = s.clamp(0.0, 1.0);
    let (s2, s3) = (s * s, s * s * s);
    y0 * (1.0 - 3.0 * s2 + 2.0 * s3)
        + y1 * (3.0 * s2 - 2.0 * s3)
        + h * (before * (s - 2.0 * s2 + s3) + after * (s3 - s2))
}

/// A smooth field over the volume: products of cosines, mean 0 and RMS 1 over the travels.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    terms: Vec<(Vector3<f64>, Vector3<f64>, f64)>,
    mean: f64,
    gain: f64,
}

impl Field {
    /// A field of two products.
    #[must_use]
    pub fn new(chance: &mut Chance) -> Self {
        let terms = (0..2)
            .map(|_| {
                let wave = TRAVEL_MM.map(|[low, high]| TAU / ((high - low) * chance.within(1.0, 2.4)));
                (
                    Vector3::from(wave),
                    Vector3::new(chance.angle(), chance.angle(), chance.angle()),
                    chance.normal(),
                )
            })
            .collect();
        let mut field = Self { terms, mean: 0.0, gain: 1.0 };
        let (mut sum, mut square, mut n) = (0.0, 0.0, 0.0);
        for x in looks(TRAVEL_MM[0]).step_by(20) {
            for y in looks(TRAVEL_MM[1]).step_by(20) {
                for z in looks(TRAVEL_MM[2]).step_by(20) {
                    let v = field.at(&Vector3::new(x, y, z));
                    (sum, square, n) = (sum + v, square + v * v, n + 1.0);
                }
            }
        }
        field.mean = sum / n;
        field.gain = 1.0 / (square / n - field.mean * field.mean).max(1e-9).sqrt();
        field
    }

    /// The value at a point, mm.
    #[must_use]
    pub fn at(&self, p: &Vector3<f64>) -> f64 {
        let value: f64 = self
            .terms
            .iter()
            .map(|(wave, phase, size)| {
                size * (0..3).map(|i| (wave[i] * p[i] + phase[i]).cos()).product::<f64>()
            })
            .sum();
        self.gain * (value - self.mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straightness_has_no_line_and_an_angle_is_zero_at_home() {
        let travel = [-300.0, 380.0];
        let mut chance = Chance::new(2, "curves");
        for curve in [
            Curve::sines(travel, &mut chance),
            Curve::knots(travel, 7, true, &mut chance),
            Curve::knots(travel, 7, false, &mut chance),
            Curve::kinks(travel, &mut chance),
        ] {
            let straight = curve.clone().without_line(travel).normed(travel);
            let slope: f64 = looks(travel).map(|x| (x - 40.0) * straight.at(x)).sum();
            let rms = (looks(travel).map(|x| straight.at(x).powi(2)).sum::<f64>() / LOOKS as f64).sqrt();
            assert!(slope.abs() < 1e-6 && (rms - 1.0).abs() < 1e-9, "{slope} {rms}");
            assert!(curve.zero_at_home().normed(travel).at(0.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_field_has_no_mean_over_the_volume() {
        let field = Field::new(&mut Chance::new(9, "field"));
        let all: Vec<f64> = looks(TRAVEL_MM[0])
            .step_by(10)
            .flat_map(|x| looks(TRAVEL_MM[1]).step_by(10).map(move |y| (x, y)))
            .flat_map(|(x, y)| looks(TRAVEL_MM[2]).step_by(10).map(move |z| Vector3::new(x, y, z)))
            .map(|p| field.at(&p))
            .collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        assert!(mean.abs() < 0.2, "{mean}");
    }
}
