//! The six error motions of one axis, compiled so that what they share is computed once.
//!
//! Curves with the same basis (same origin, span and period; same range; same positions) form a group. A group
//! evaluates its basis once and weights it into six lanes, EX EY EZ EA EB EC. The cost is one sine/cosine pair,
//! one polynomial recurrence or one look-up per group, whatever the number of motions in it.

use core::f64::consts::PI;

use wide::f64x2;

use super::curve::{Curve, ErrorFunction, Table};
use crate::axes::Travel;

/// EX EY EZ EA EB EC, mm and rad, two to a register: between joints they never pass through memory in parts.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lanes([f64x2; 3]);

impl Lanes {
    /// `self += weights a`
    #[inline(always)]
    fn add_weighted(&mut self, weights: &Self, a: f64) {
        let a = f64x2::splat(a);
        for (sum, w) in self.0.iter_mut().zip(weights.0) {
            *sum += w * a;
        }
    }

    /// `self += cosines c + sines s`
    #[inline(always)]
    fn add_harmonic(&mut self, [cosines, sines]: &[Self; 2], c: f64, s: f64) {
        let (c, s) = (f64x2::splat(c), f64x2::splat(s));
        for (sum, (a, b)) in self.0.iter_mut().zip(cosines.0.into_iter().zip(sines.0)) {
            *sum += a * c + b * s;
        }
    }

    /// Adds to one lane. Not for an inner loop.
    pub(super) fn add_to_lane(&mut self, lane: usize, value: f64) {
        let mut pair = self.0[lane / 2].to_array();
        pair[lane % 2] += value;
        self.0[lane / 2] = f64x2::new(pair);
    }

    /// The six values.
    #[inline(always)]
    pub(super) fn to_array(self) -> [f64; 6] {
        let [[a, b], [c, d], [e, f]] = self.0.map(f64x2::to_array);
        [a, b, c, d, e, f]
    }
}

impl From<[f64; 6]> for Lanes {
    #[inline(always)]
    fn from([a, b, c, d, e, f]: [f64; 6]) -> Self {
        Self([f64x2::new([a, b]), f64x2::new([c, d]), f64x2::new([e, f])])
    }
}

/// The compiled motions of an axis.
#[derive(Debug, Clone, Default)]
pub(super) struct CompiledBasis {
    constant: Lanes,
    series: Vec<SeriesGroup>,
    polynomials: Vec<PolynomialGroup>,
    tables: Vec<TableGroup>,
    /// Range that all curves cover.
    range: Option<[f64; 2]>,
}

/// `linear s + SUM cos_n cos(n w d) + sin_n sin(n w d)` in every lane; the mean is part of the constant.
#[derive(Debug, Clone)]
struct SeriesGroup {
    origin: f64,
    span: f64,
    omega: f64,
    linear: Lanes,
    /// False where every linear part is zero.
    is_linear: bool,
    /// cos and sin weights of harmonic 1, 2, ..
    harmonics: Vec<[Lanes; 2]>,
}

/// `SUM c_k T_k(s)` in every lane.
#[derive(Debug, Clone)]
struct PolynomialGroup {
    low: f64,
    high: f64,
    coefficients: Vec<Lanes>,
}

/// Tables over the same positions with the same rule; one look-up gives the weights of at most four values.
#[derive(Debug, Clone)]
struct TableGroup {
    lanes: Vec<(usize, Table)>,
}

impl CompiledBasis {
    /// Compiles the six functions of an axis.
    pub(super) fn new(functions: &[ErrorFunction; 6]) -> Self {
        let mut basis = Self::default();
        for (lane, function) in functions.iter().enumerate() {
            for curve in &function.curves {
                basis.add(lane, curve);
            }
            if let Some([low, high]) = function.range() {
                let [a, b] = basis.range.unwrap_or([low, high]);
                basis.range = Some([a.max(low), b.min(high)]);
            }
        }
        basis
    }

    fn add(&mut self, lane: usize, curve: &Curve) {
        match curve {
            Curve::Constant(value) => self.constant.add_to_lane(lane, *value),
            Curve::Fourier(f) => {
                let [low, high] = f.range();
                let (mean, linear) = f.mean_and_linear();
                self.constant.add_to_lane(lane, mean);
                let group = self.series_group(low, high - low, 2.0 * PI / f.period());
                group.add(lane, linear, f.harmonics().iter().copied());
            }
            Curve::HalfRange(h) => {
                let [low, high] = h.range();
                let (mean, linear, sines) = h.coefficients();
                self.constant.add_to_lane(lane, mean);
                let group = self.series_group(low, high - low, PI / (high - low));
                group.add(lane, linear, sines.map(|sin| [0.0, sin]));
            }
            Curve::Chebyshev(c) => {
                let [low, high] = c.range();
                let at = self.polynomials.iter().position(|g| (g.low, g.high) == (low, high));
                let at = at.unwrap_or_else(|| {
                    self.polynomials.push(PolynomialGroup { low, high, coefficients: Vec::new() });
                    self.polynomials.len() - 1
                });
                let group = &mut self.polynomials[at];
                for (k, c) in c.coefficients().iter().enumerate() {
                    if group.coefficients.len() <= k {
                        group.coefficients.push(Lanes::default());
                    }
                    group.coefficients[k].add_to_lane(lane, *c);
                }
            }
            Curve::Table(t) => {
                let same = |g: &TableGroup| g.lanes[0].1.shares_look_up(t);
                match self.tables.iter_mut().find(|g| same(g)) {
                    Some(group) => group.lanes.push((lane, t.clone())),
                    None => self.tables.push(TableGroup { lanes: vec![(lane, t.clone())] }),
                }
            }
        }
    }

    fn series_group(&mut self, origin: f64, span: f64, omega: f64) -> &mut SeriesGroup {
        let same = |g: &SeriesGroup| (g.origin, g.span, g.omega) == (origin, span, omega);
        let at = self.series.iter().position(same).unwrap_or_else(|| {
            self.series.push(SeriesGroup {
                origin,
                span,
                omega,
                linear: Lanes::default(),
                is_linear: false,
                harmonics: Vec::new(),
            });
            self.series.len() - 1
        });
        &mut self.series[at]
    }

    /// True where `x` lies outside the range of a curve (its end value is held).
    pub(super) fn is_outside(&self, x: f64) -> bool {
        self.range.is_some_and(|[low, high]| !(low..=high).contains(&x))
    }

    /// Wavelength of the shortest harmonic, mm or rad; infinite without any.
    pub(super) fn shortest_wave(&self) -> f64 {
        self.series.iter().map(SeriesGroup::shortest_wave).fold(f64::INFINITY, f64::min)
    }

    /// The six values at `x`, where `x` may be off by `spread` (same unit): each harmonic has the weight that serves
    /// best at that distance, `cos(2 pi spread / wavelength)`, and none from a quarter wave on.
    ///
    /// With a shift `d` a harmonic of amplitude A that is corrected in full leaves `2 A sin(pi d / w)`, more than
    /// nothing corrected from d = w/6 on; weighted by the cosine it leaves `A sin(2 pi d / w)`, never more than A.
    ///
    /// # Cycle   no allocation
    #[inline(always)]
    pub(super) fn values(&self, x: f64, travel: Travel, spread: f64) -> Lanes {
        let mut out = self.constant;
        for group in &self.series {
            out = group.added_to(out, x, spread);
        }
        for group in &self.polynomials {
            out = group.added_to(out, x);
        }
        if self.tables.is_empty() { out } else { self.with_tables(out, x, travel) }
    }

    #[inline(never)]
    fn with_tables(&self, sum: Lanes, x: f64, travel: Travel) -> Lanes {
        let mut out = sum.to_array();
        for group in &self.tables {
            let place = group.lanes[0].1.place(x);
            for (lane, table) in &group.lanes {
                out[*lane] += table.value_at(&place, travel);
            }
        }
        out.into()
    }
}

impl SeriesGroup {
    fn add(&mut self, lane: usize, linear: f64, harmonics: impl Iterator<Item = [f64; 2]>) {
        self.linear.add_to_lane(lane, linear);
        self.is_linear |= linear != 0.0;
        for (n, [cos, sin]) in harmonics.enumerate() {
            if self.harmonics.len() <= n {
                self.harmonics.push([Lanes::default(); 2]);
            }
            self.harmonics[n][0].add_to_lane(lane, cos);
            self.harmonics[n][1].add_to_lane(lane, sin);
        }
    }

    fn shortest_wave(&self) -> f64 {
        if self.harmonics.is_empty() {
            f64::INFINITY
        } else {
            2.0 * PI / self.omega / self.harmonics.len() as f64
        }
    }

    #[inline(always)]
    fn added_to(&self, mut sum: Lanes, x: f64, spread: f64) -> Lanes {
        let d = (x - self.origin).max(0.0).min(self.span);
        if self.is_linear {
            sum.add_weighted(&self.linear, (2.0 * d - self.span) / self.span);
        }
        if self.harmonics.is_empty() {
            return sum;
        }
        if spread > 0.0 {
            return self.with_faded_harmonics(sum, d, spread);
        }
        let (s1, c1) = (self.omega * d).sin_cos();
        let (mut sin, mut cos) = (s1, c1);
        for harmonic in &self.harmonics {
            sum.add_harmonic(harmonic, cos, sin);
            (sin, cos) = (sin * c1 + cos * s1, cos * c1 - sin * s1);
        }
        sum
    }

    /// The harmonics, each with its weight.
    #[inline(never)]
    fn with_faded_harmonics(&self, mut sum: Lanes, d: f64, spread: f64) -> Lanes {
        let (s1, c1) = (self.omega * d).sin_cos();
        let (mut sin, mut cos) = (s1, c1);
        let quarter = PI / 2.0;
        for (n, harmonic) in self.harmonics.iter().enumerate() {
            let phase = self.omega * spread * (n + 1) as f64;
            if phase >= quarter {
                break;
            }
            let weight = phase.cos();
            sum.add_harmonic(harmonic, weight * cos, weight * sin);
            (sin, cos) = (sin * c1 + cos * s1, cos * c1 - sin * s1);
        }
        sum
    }
}

impl PolynomialGroup {
    #[inline(always)]
    fn added_to(&self, mut sum: Lanes, x: f64) -> Lanes {
        let s = (2.0 * x.clamp(self.low, self.high) - self.low - self.high) / (self.high - self.low);
        let (mut t, mut next) = (1.0, s);
        for c in &self.coefficients {
            sum.add_weighted(c, t);
            (t, next) = (next, 2.0 * s * next - t);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::curve::{Chebyshev, Fourier, HalfRange, Interpolation};

    fn curve() -> impl Strategy<Value = Curve> {
        let list = || prop::collection::vec(-0.01..0.01f64, 0..7);
        let rule = prop_oneof![Just(Interpolation::Linear), Just(Interpolation::MonotoneCubic)];
        let table = (prop::collection::vec(-0.01..0.01f64, 5), any::<bool>(), any::<bool>(), rule);
        prop_oneof![
            (-0.01..0.01f64).prop_map(Curve::Constant),
            (list(), list(), prop_oneof![Just(500.0), Just(700.0)]).prop_map(|(a, b, p)| Curve::Fourier(
                Fourier::new(0.0, 500.0, p, 0.001, 0.002, &a, &b).unwrap()
            )),
            list().prop_map(|b| Curve::HalfRange(HalfRange::new(0.0, 500.0, 0.001, -0.002, &b).unwrap())),
            (list(), prop_oneof![Just(0.0), Just(-50.0)])
                .prop_map(|(c, low)| Curve::Chebyshev(Chebyshev::new(low, 500.0, c).unwrap())),
            table.prop_map(|(v, equal, reverse, rule)| {
                let positions = if equal {
                    vec![0.0, 100.0, 200.0, 300.0, 400.0]
                } else {
                    vec![0.0, 10.0, 200.0, 300.0, 450.0]
                };
                let back = reverse.then(|| v.iter().map(|v| v + 0.001).collect());
                Curve::Table(Table::new(positions, v, back, rule).unwrap())
            }),
        ]
    }

    proptest! {
        #[test]
        fn the_bank_equals_the_sum_of_its_curves(
            curves in prop::collection::vec((0..6usize, curve()), 0..12), x in -100.0..600.0f64, back in any::<bool>(),
        ) {
            let mut functions: [ErrorFunction; 6] = Default::default();
            for (lane, curve) in curves {
                functions[lane].curves.push(curve);
            }
            let travel = if back { Travel::Reverse } else { Travel::Forward };
            let basis = CompiledBasis::new(&functions);
            let values = basis.values(x, travel, 0.0).to_array();
            for (value, function) in values.iter().zip(&functions) {
                prop_assert!((value - function.value(x, travel)).abs() < 1e-14);
            }
            let outside = functions.iter().filter_map(ErrorFunction::range).any(|[l, h]| x < l || x > h);
            prop_assert_eq!(basis.is_outside(x), outside);
        }

        #[test]
        fn a_look_up_that_is_off_by_the_spread_never_leaves_more_than_no_correction(
            amplitude in 0.001..0.01f64, n in 1..8usize, x in 100.0..400.0f64, share in 0.0..0.6f64,
        ) {
            let wave = 500.0 / n as f64;
            let mut sines = vec![0.0; n];
            sines[n - 1] = amplitude;
            let mut functions: [ErrorFunction; 6] = Default::default();
            functions[0] = ErrorFunction::single(Curve::Fourier(
                Fourier::new(0.0, 500.0, 500.0, 0.0, 0.0, &[], &sines).unwrap(),
            ));
            let basis = CompiledBasis::new(&functions);
            prop_assert!((basis.shortest_wave() - wave).abs() < 1e-9);
            let shift = share * wave;
            let phase = core::f64::consts::TAU * share;
            // the largest residual over a wave; the value is looked up behind by the shift
            let largest = (0..64).map(|i| {
                let at = x.min(500.0 - wave) * 0.5 + wave * f64::from(i) / 64.0;
                let truth = amplitude * (core::f64::consts::TAU * (at + shift) / wave).sin();
                (truth - basis.values(at, Travel::Forward, shift).to_array()[0]).abs()
            }).fold(0.0, f64::max);
            prop_assert!(largest <= amplitude * (1.0 + 1e-9), "{largest} of {amplitude}");
            if share < 0.25 {
                prop_assert!(largest <= amplitude * (phase.sin() + 1e-9));
            }
        }
    }
}
