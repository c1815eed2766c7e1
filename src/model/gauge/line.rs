//! Curve arithmetic of the gauge: constants and straight lines taken out of any kind of curve, exactly.
//!
//! A constant fits into every kind. A line fits into series, polynomials and linear tables whose range covers the
//! one where the line is needed; beside the others it is written as a polynomial of degree one.

use super::super::curve::{Chebyshev, Curve, ErrorFunction, Fourier, HalfRange, Interpolation, Table};

/// `value + slope (x - at)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    pub(super) at: f64,
    pub(super) value: f64,
    pub(super) slope: f64,
}

impl Line {
    fn at(&self, x: f64) -> f64 {
        self.value + self.slope * (x - self.at)
    }

    /// Value in the middle of a range and half the rise over it: the coefficients of 1 and s.
    fn over(&self, [low, high]: [f64; 2]) -> (f64, f64) {
        (self.at(0.5 * (low + high)), 0.5 * self.slope * (high - low))
    }
}

/// Subtracts a line, exactly inside `span`; a line without slope everywhere.
pub(super) fn subtract(function: &mut ErrorFunction, line: &Line, span: Option<[f64; 2]>) {
    if line.slope == 0.0 {
        add_constant(function, -line.value);
        return;
    }
    let Some(span) = span else { return };
    for curve in &mut function.curves {
        let covers = curve.range().is_some_and(|[low, high]| low <= span[0] && high >= span[1]);
        if covers && let Some(changed) = less(curve, line) {
            *curve = changed;
            return;
        }
    }
    let (middle, rise) = line.over(span);
    if let Ok(straight) = Chebyshev::new(span[0], span[1], vec![-middle, -rise]) {
        function.curves.push(Curve::Chebyshev(straight));
    }
}

/// Adds a constant to a function: into its constant where it has one, else into its first curve.
pub(super) fn add_constant(function: &mut ErrorFunction, amount: f64) {
    let line = Line { at: 0.0, value: -amount, slope: 0.0 };
    let constant = function.curves.iter().position(|c| matches!(c, Curve::Constant(_)));
    if let Some(curve) = function.curves.get_mut(constant.unwrap_or(0))
        && let Some(changed) = less(curve, &line)
    {
        *curve = changed;
        return;
    }
    function.curves.push(Curve::Constant(amount));
}

/// The curve minus the line; `None` where its kind cannot hold it.
fn less(curve: &Curve, line: &Line) -> Option<Curve> {
    Some(match curve {
        Curve::Constant(v) if line.slope == 0.0 => Curve::Constant(v - line.value),
        Curve::Constant(_) => return None,
        Curve::Table(t) => {
            // slopes of a monotone cubic do not add up
            if line.slope != 0.0 && t.interpolation() == Interpolation::MonotoneCubic {
                return None;
            }
            let (x, forward, reverse) = t.columns();
            let less = |values: &[f64]| values.iter().zip(x).map(|(v, x)| v - line.at(*x)).collect();
            Curve::Table(Table::new(x.to_vec(), less(forward), reverse.map(less), t.interpolation()).ok()?)
        }
        Curve::Fourier(f) => {
            let (mean, linear) = f.mean_and_linear();
            let (middle, rise) = line.over(f.range());
            let (cos, sin): (Vec<f64>, Vec<f64>) = f.harmonics().iter().map(|[c, s]| (*c, *s)).unzip();
            let (mean, linear) = (mean - middle, linear - rise);
            Curve::Fourier(Fourier::new(f.range()[0], f.span(), f.period(), mean, linear, &cos, &sin).ok()?)
        }
        Curve::HalfRange(h) => {
            let [low, high] = h.range();
            let (mean, linear, sines) = h.coefficients();
            let (middle, rise) = line.over([low, high]);
            let sines: Vec<f64> = sines.collect();
            Curve::HalfRange(HalfRange::new(low, high, mean - middle, linear - rise, &sines).ok()?)
        }
        Curve::Chebyshev(c) => {
            let [low, high] = c.range();
            let (middle, rise) = line.over([low, high]);
            let mut coefficients = c.coefficients().to_vec();
            let needed = if rise == 0.0 { 1 } else { 2 };
            coefficients.resize(coefficients.len().max(needed), 0.0);
            coefficients[0] -= middle;
            if needed == 2 {
                coefficients[1] -= rise;
            }
            Curve::Chebyshev(Chebyshev::new(low, high, coefficients).ok()?)
        }
    })
}

/// Takes out curves that are zero, unless an uncertainty is stated for them.
pub(super) fn tidy(function: &mut ErrorFunction, zero: f64) {
    if function.std.is_none() {
        function.curves.retain(|c| !vanishes(c, zero));
    }
}

/// True where every number of a curve is zero.
fn vanishes(curve: &Curve, zero: f64) -> bool {
    let small = |v: &f64| v.abs() <= zero;
    match curve {
        Curve::Constant(v) => small(v),
        Curve::Table(t) => {
            let (_, forward, reverse) = t.columns();
            forward.iter().chain(reverse.unwrap_or(&[])).all(small)
        }
        Curve::Fourier(f) => {
            let (mean, linear) = f.mean_and_linear();
            small(&mean) && small(&linear) && f.harmonics().as_flattened().iter().all(small)
        }
        Curve::HalfRange(h) => {
            let (mean, linear, mut sines) = h.coefficients();
            small(&mean) && small(&linear) && sines.all(|v| small(&v))
        }
        Curve::Chebyshev(c) => c.coefficients().iter().all(small),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::axes::Travel;

    fn curve() -> impl Strategy<Value = Curve> {
        let list = || prop::collection::vec(-0.01..0.01f64, 0..5);
        let rule = prop_oneof![Just(Interpolation::Linear), Just(Interpolation::MonotoneCubic)];
        let range = || prop_oneof![Just([0.0, 500.0]), Just([-50.0, 700.0]), Just([30.0, 400.0])];
        prop_oneof![
            (-0.01..0.01f64).prop_map(Curve::Constant),
            (list(), list(), range()).prop_map(|(a, b, [l, h])| Curve::Fourier(
                Fourier::new(l, h - l, 333.0, 0.001, 0.002, &a, &b).unwrap()
            )),
            (list(), range())
                .prop_map(|(b, [l, h])| Curve::HalfRange(HalfRange::new(l, h, 0.001, -0.002, &b).unwrap())),
            (list(), range()).prop_map(|(c, [l, h])| Curve::Chebyshev(Chebyshev::new(l, h, c).unwrap())),
            (prop::collection::vec(-0.01..0.01f64, 4), any::<bool>(), rule, range()).prop_map(
                |(v, reverse, rule, [l, h])| {
                    let back = reverse.then(|| v.iter().map(|v| v + 0.001).collect());
                    let x = vec![l, l + 20.0, 0.5 * (l + h), h];
                    Curve::Table(Table::new(x, v, back, rule).unwrap())
                }
            ),
        ]
    }

    proptest! {
        #[test]
        fn a_line_is_subtracted_exactly_from_any_sum_of_curves(
            curves in prop::collection::vec(curve(), 0..4), value in -0.01..0.01f64, slope in -1e-4..1e-4f64,
            at in -100.0..600.0f64, x in 0.0..500.0f64, back in any::<bool>(),
        ) {
            let travel = if back { Travel::Reverse } else { Travel::Forward };
            let before = ErrorFunction { curves, ..Default::default() };
            for line in [Line { at, value, slope }, Line { at, value, slope: 0.0 }] {
                let mut after = before.clone();
                subtract(&mut after, &line, Some([0.0, 500.0]));
                let expected = before.value(x, travel) - line.at(x);
                prop_assert!((after.value(x, travel) - expected).abs() < 1e-15);
                prop_assert!(after.curves.len() <= before.curves.len() + 1);
            }
        }

        #[test]
        fn a_constant_holds_beyond_the_range_too(curves in prop::collection::vec(curve(), 0..4), x in -1e3..2e3f64) {
            let before = ErrorFunction { curves, ..Default::default() };
            let mut after = before.clone();
            add_constant(&mut after, 0.005);
            let change = after.value(x, Travel::Forward) - before.value(x, Travel::Forward);
            prop_assert!((change - 0.005).abs() < 1e-15);
        }
    }

    #[test]
    fn only_what_is_zero_is_taken_out() {
        let zero = Curve::Chebyshev(Chebyshev::new(0.0, 1.0, vec![0.0, 1e-16]).unwrap());
        let mut function = ErrorFunction { curves: vec![zero, Curve::Constant(1e-3)], ..Default::default() };
        tidy(&mut function, 1e-12);
        assert_eq!(function.curves, [Curve::Constant(1e-3)]);
        let mut stated = ErrorFunction { std: Some(1e-4), ..ErrorFunction::single(Curve::Constant(0.0)) };
        tidy(&mut stated, 1e-12);
        assert_eq!(stated.curves.len(), 1);
    }
}
