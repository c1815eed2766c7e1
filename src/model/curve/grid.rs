//! An error over the coordinates of two or three axes: sag of a ram that depends on its reach and on the cross
//! slide, cross-talk of a moving mass. Linear in each coordinate between support points (bilinear, trilinear).

use super::{CurveError, all_finite};
use crate::axes::AxisName;

/// Most support points of a grid in all.
pub const GRID_POINTS_MAX: usize = 1_000_000;

/// Values on a rectangular grid; beyond its edges the edge value is held.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    edges: Vec<Edge>,
    /// First axis slowest, last axis fastest.
    values: Vec<f64>,
}

/// The support points along one axis.
#[derive(Debug, Clone, PartialEq)]
struct Edge {
    axis: AxisName,
    positions: Vec<f64>,
    /// Distance in `values` from one position to the next.
    stride: usize,
}

impl Grid {
    /// A grid over the given axes; `values` has the first axis slowest and the last fastest.
    ///
    /// # Errors
    /// Not two or three axes, an axis twice, positions that do not increase, a wrong number of values.
    pub fn new(axes: Vec<(AxisName, Vec<f64>)>, values: Vec<f64>) -> Result<Self, CurveError> {
        if !(2..=3).contains(&axes.len()) {
            return Err(CurveError::GridAxes { found: axes.len() });
        }
        let mut expected = 1usize;
        for (i, (axis, positions)) in axes.iter().enumerate() {
            if axes[..i].iter().any(|(a, _)| a == axis) {
                return Err(CurveError::GridAxisTwice { axis: *axis });
            }
            if positions.len() < 2 {
                return Err(CurveError::TooFewPoints { needed: 2, found: positions.len() });
            }
            all_finite(positions)?;
            for (row, pair) in positions.windows(2).enumerate() {
                if pair[1] <= pair[0] {
                    return Err(CurveError::NotIncreasing {
                        row: row + 2,
                        value: pair[1],
                        previous: pair[0],
                    });
                }
            }
            expected = expected.saturating_mul(positions.len());
        }
        if expected > GRID_POINTS_MAX {
            return Err(CurveError::TooManyTerms { found: expected, limit: GRID_POINTS_MAX });
        }
        if values.len() != expected {
            return Err(CurveError::LengthMismatch { expected, found: values.len() });
        }
        all_finite(&values)?;
        let mut stride = expected;
        let edges = axes
            .into_iter()
            .map(|(axis, positions)| {
                stride /= positions.len();
                Edge { axis, positions, stride }
            })
            .collect();
        Ok(Self { edges, values })
    }

    /// The axes, slowest first.
    pub fn axes(&self) -> impl ExactSizeIterator<Item = AxisName> + '_ {
        self.edges.iter().map(|e| e.axis)
    }

    /// Support points along axis `i` of [`Grid::axes`].
    #[must_use]
    pub fn positions(&self, i: usize) -> &[f64] {
        &self.edges[i].positions
    }

    /// Lowest and highest position of an axis of the grid; `None` where it has no such axis.
    #[must_use]
    pub fn range(&self, axis: AxisName) -> Option<[f64; 2]> {
        let positions = self.positions(self.axes().position(|a| a == axis)?);
        positions.first().zip(positions.last()).map(|(low, high)| [*low, *high])
    }

    /// All values, first axis slowest.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The value at coordinates given in the order of [`Grid::axes`]; and whether one of them was beyond the grid.
    ///
    /// # Cycle   no allocation; the look-up grows with the logarithm of the number of positions
    #[must_use]
    pub fn value(&self, at: &[f64]) -> (f64, bool) {
        let mut base = 0;
        let mut shares = [0.0; 3];
        let mut outside = false;
        for (i, (edge, &x)) in self.edges.iter().zip(at).enumerate() {
            let last = edge.positions.len() - 1;
            let held = x.clamp(edge.positions[0], edge.positions[last]);
            outside |= held != x;
            let k = edge.positions.partition_point(|&p| p <= held).saturating_sub(1).min(last - 1);
            shares[i] = (held - edge.positions[k]) / (edge.positions[k + 1] - edge.positions[k]);
            base += k * edge.stride;
        }
        let n = self.edges.len();
        let mut sum = 0.0;
        for corner in 0..1usize << n {
            let (mut weight, mut index) = (1.0, base);
            for (i, edge) in self.edges.iter().enumerate() {
                if corner >> i & 1 == 1 {
                    weight *= shares[i];
                    index += edge.stride;
                } else {
                    weight *= 1.0 - shares[i];
                }
            }
            sum += weight * self.values[index];
        }
        (sum, outside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn axis(name: AxisName, points: &[f64]) -> (AxisName, Vec<f64>) {
        (name, points.to_vec())
    }

    proptest! {
        /// A trilinear function is reproduced exactly inside, and held outside.
        #[test]
        fn trilinear_functions_are_exact(c in prop::array::uniform8(-1.0..1.0f64), x in -20.0..120.0f64, y in -20.0..70.0f64, z in -90.0..10.0f64) {
            let f = |x: f64, y: f64, z: f64| c[0] + c[1]*x + c[2]*y + c[3]*z + c[4]*x*y + c[5]*y*z + c[6]*x*z + c[7]*x*y*z;
            let (px, py, pz) = ([0.0, 30.0, 100.0], [0.0, 50.0], [-80.0, -20.0, -5.0, 0.0]);
            let mut values = Vec::new();
            for x in px { for y in py { for z in pz { values.push(f(x, y, z)); } } }
            let g = Grid::new(vec![axis(AxisName::X, &px), axis(AxisName::Y, &py), axis(AxisName::Z, &pz)], values).unwrap();
            let (v, outside) = g.value(&[x, y, z]);
            let held = f(x.clamp(0.0, 100.0), y.clamp(0.0, 50.0), z.clamp(-80.0, 0.0));
            prop_assert!((v - held).abs() < 1e-9 * (1.0 + held.abs()));
            prop_assert_eq!(outside, !((0.0..=100.0).contains(&x) && (0.0..=50.0).contains(&y) && (-80.0..=0.0).contains(&z)));
        }
    }

    #[test]
    fn impossible_grids_are_refused() {
        let x = || axis(AxisName::X, &[0.0, 1.0]);
        assert_eq!(Grid::new(vec![x()], vec![0.0; 2]), Err(CurveError::GridAxes { found: 1 }));
        assert_eq!(
            Grid::new(vec![x(), x()], vec![0.0; 4]),
            Err(CurveError::GridAxisTwice { axis: AxisName::X })
        );
        let y = axis(AxisName::Y, &[0.0, 1.0]);
        assert_eq!(
            Grid::new(vec![x(), y.clone()], vec![0.0; 3]),
            Err(CurveError::LengthMismatch { expected: 4, found: 3 })
        );
        assert_eq!(
            Grid::new(vec![x(), y], vec![0.0, 0.0, f64::NAN, 0.0]),
            Err(CurveError::NotFinite { row: 3 })
        );
    }
}
