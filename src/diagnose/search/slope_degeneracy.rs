//! The line from which a curve is counted is a choice: what is only the slope of a curve is no second cause.

use super::super::constants::HALF;
use super::super::library::{Library, Shape, forms};
use super::problem::Problem;
use super::select::Selection;

impl Selection {
    /// A squareness that is no more than the slope of a straightness: the line from which a straightness is counted is a
    /// choice (its ends, least squares), and the slope against it is no second cause. Nor is an angular error that
    /// says less than a straightness with its slope.
    pub fn absorb(&mut self, problem: &mut Problem, library: &Library) {
        while let Some((place, slope, whole)) = self.slope(problem, library) {
            self.chosen[place] = whole;
            self.chosen.remove(slope);
            problem.prepare(&[whole]);
        }
        for place in 0..self.chosen.len() {
            if let Some(whole) = self.straightness_rather(problem, library, place) {
                self.chosen[place] = whole;
                problem.prepare(&[whole]);
            }
        }
    }

    /// A straightness with its slope that says more than an angular error over the same axis, which has a slope anyhow.
    fn straightness_rather(&self, problem: &mut Problem, library: &Library, place: usize) -> Option<usize> {
        let variant = &library.variants[self.chosen[place]];
        let Shape::Angular(forms::Angular { over: axis, .. }) = variant.shape else { return None };
        let others = self.without(&[place]);
        let given = Self::given(problem, &others);
        let own = self.found(problem, library, &given, self.chosen[place]).evidence;
        let crosses = |shape: &Shape| shape.over() == Some(axis) && shape.acts_along() != Some(axis);
        let variants = library.variants.iter().enumerate();
        let best = variants
            .filter(|(_, v)| v.shape.has_slope() && crosses(&v.shape) && !self.has(library, v.label))
            .map(|(v, _)| self.found(problem, library, &given, v))
            .max_by(|a, b| a.evidence.total_cmp(&b.evidence))?;
        let (whole, best) = (best.variant, best.evidence);
        let beside: Vec<usize> = others.into_iter().chain([whole]).collect();
        let terms = Self::terms(problem, &beside, whole);
        (best > own && (Self::is_small(&terms) || Self::is_from_its_ends(&terms))).then_some(whole)
    }

    /// Takes straightnesses and their slopes apart: what stands beside them may have changed since they were one.
    pub fn take_apart(&mut self, problem: &mut Problem, library: &Library) {
        for place in 0..self.chosen.len() {
            let Shape::Polynomial(forms::Polynomial { along, over, .. }) =
                library.variants[self.chosen[place]].shape
            else {
                continue;
            };
            let whole = &library.variants[self.chosen[place]].shape;
            let line = if along == over {
                Shape::Scale(forms::Scale { axis: along })
            } else {
                Shape::Squareness(forms::Squareness { along, over })
            };
            let find = |shape: &Shape| library.variants.iter().position(|v| v.shape == *shape);
            let (true, Some(curve), Some(line)) =
                (whole.has_slope(), find(&whole.with_line(false)), find(&line))
            else {
                continue;
            };
            self.chosen[place] = curve;
            if !self.has(library, library.variants[line].label) {
                self.chosen.push(line);
            }
            problem.prepare(&self.chosen);
        }
    }

    fn has(&self, library: &Library, label: usize) -> bool {
        self.chosen.iter().any(|v| library.variants[*v].label == label)
    }

    /// A straightness, what beside it may be its slope, and the variant that says both.
    fn slope(&self, problem: &mut Problem, library: &Library) -> Option<(usize, usize, usize)> {
        let shape = |place: usize| &library.variants[self.chosen[place]].shape;
        let of = |problem: &mut Problem, p: usize, beside: &[usize]| {
            let given = Self::given(problem, beside);
            problem.gain(&given, self.chosen[p]).0
        };
        for line in 0..self.chosen.len() {
            for place in 0..self.chosen.len() {
                let Shape::Polynomial(forms::Polynomial { along: a, over: o, low: 2, .. }) = *shape(place)
                else {
                    continue;
                };
                let (along, over, share) = match *shape(line) {
                    Shape::Squareness(forms::Squareness { along, over }) => (along, over, HALF),
                    // beside a larger table a scale is the slope of the same curve
                    Shape::Scale(forms::Scale { axis }) => (axis, axis, 1.0),
                    _ => continue,
                };
                if !(a == along && o == over || a == over && o == along) {
                    continue;
                }
                let wanted = shape(place).with_line(true);
                let Some(whole) = library.variants.iter().position(|v| v.shape == wanted) else { continue };
                let small = of(problem, line, &self.without(&[line]))
                    <= share * of(problem, place, &self.without(&[place]));
                let beside: Vec<usize> = self.without(&[place, line]).into_iter().chain([whole]).collect();
                if small || Self::is_from_its_ends(&Self::terms(problem, &beside, whole)) {
                    return Some((place, line, whole));
                }
            }
        }
        None
    }

    /// Coefficients of a straightness beside others, from the first degree on, um.
    fn terms(problem: &mut Problem, chosen: &[usize], whole: usize) -> Vec<f64> {
        let given = Self::given(problem, chosen);
        let beta = problem.fit(&given);
        let (at, k) = problem.span[whole];
        let value = |c: usize| {
            let own = given.columns.iter().position(|g| *g == c).map_or(0.0, |j| beta[j]);
            if problem.norm[c] > 0.0 { own / problem.norm[c] } else { 0.0 }
        };
        (at..at + k).map(value).collect()
    }

    /// True where the slope of a straightness is small against the rest of it.
    fn is_small(terms: &[f64]) -> bool {
        let square = |c: &f64, n: i32| c * c / f64::from(2 * n + 1);
        let rest: f64 = terms.iter().zip(1..).skip(1).map(|(c, n)| square(c, n)).sum();
        terms.first().is_some_and(|slope| square(slope, 1) < HALF * rest)
    }

    /// True where a straightness with its slope is nearly as high at one end as at the other: it is then counted from the
    /// line through its ends.
    fn is_from_its_ends(terms: &[f64]) -> bool {
        // Legendre polynomials from the first degree on: at both ends 1, or -1 and 1
        let ends: f64 = 2.0 * terms.iter().step_by(2).sum::<f64>();
        let size = terms.iter().zip(1..).map(|(c, n)| c * c / f64::from(2 * n + 1)).sum::<f64>().sqrt();
        ends.abs() < HALF * size
    }
}
