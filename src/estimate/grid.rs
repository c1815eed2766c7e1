//! A grid of hexahedral cells with trilinear shape functions in natural coordinates.
//!
//! `N_i = (1 + xi_i xi)(1 + eta_i eta)(1 + zeta_i zeta)/8` with the natural coordinates in [-1, 1] over the cell and
//! the nodes at +-1 (equations 5.8, 4.3). Node order: x fastest, then y, then z.

/// Most nodes of a grid: the covariance of one component has the square of this many numbers.
pub const NODES_MAX: usize = 4096;

/// Why a grid cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum GridError {
    /// A cell needs nodes on both sides.
    #[error("grid {axis}: {found} positions, a cell needs at least 2")]
    TooFewPositions {
        /// x, y or z.
        axis: char,
        /// Positions found.
        found: usize,
    },
    /// Positions must be finite and increase strictly.
    #[error("grid {axis}: position {value} mm (number {row}) is not above the one before it, or not finite")]
    NotIncreasing {
        /// x, y or z.
        axis: char,
        /// 1-based number of the position.
        row: usize,
        /// The position.
        value: f64,
    },
    /// More nodes than a covariance can be kept for.
    #[error("{found} nodes exceed the limit of {limit}; take fewer positions", limit = NODES_MAX)]
    TooManyNodes {
        /// Nodes of the grid.
        found: usize,
    },
}

/// The nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeGrid {
    positions: [Vec<f64>; 3],
}

/// A point among the nodes: the eight corners of its cell and their shape functions, which add up to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodePlace {
    /// Indices of the nodes.
    pub nodes: [usize; 8],
    /// Shape functions.
    pub shape: [f64; 8],
    /// True where the point was beyond the grid and is held at its edge.
    pub outside: bool,
}

impl NodeGrid {
    /// A grid over increasing coordinates, mm.
    ///
    /// # Errors
    /// Fewer than two positions on an axis, positions that do not increase, too many nodes.
    pub fn new(x: Vec<f64>, y: Vec<f64>, z: Vec<f64>) -> Result<Self, GridError> {
        let positions = [x, y, z];
        for (axis, list) in ['x', 'y', 'z'].into_iter().zip(&positions) {
            if list.len() < 2 {
                return Err(GridError::TooFewPositions { axis, found: list.len() });
            }
            for (i, value) in list.iter().enumerate() {
                if !value.is_finite() || i > 0 && *value <= list[i - 1] {
                    return Err(GridError::NotIncreasing { axis, row: i + 1, value: *value });
                }
            }
        }
        let found = positions.iter().fold(1usize, |n, p| n.saturating_mul(p.len()));
        if found > NODES_MAX {
            return Err(GridError::TooManyNodes { found });
        }
        Ok(Self { positions })
    }

    /// Number of nodes.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.positions.iter().map(Vec::len).product()
    }

    /// Coordinates of the nodes along x (0), y (1) or z (2), mm.
    #[must_use]
    pub fn positions(&self, axis: usize) -> &[f64] {
        &self.positions[axis]
    }

    /// The node with number `index`, mm.
    #[must_use]
    pub fn node(&self, index: usize) -> [f64; 3] {
        let [nx, ny, _] = self.positions.each_ref().map(Vec::len);
        [
            self.positions[0][index % nx],
            self.positions[1][index / nx % ny],
            self.positions[2][index / (nx * ny)],
        ]
    }

    /// Where a point (mm) lies; beyond the grid it is held at the edge.
    ///
    /// # Cycle   no allocation; the look-up grows with the logarithm of the number of positions
    #[must_use]
    pub fn place(&self, point: [f64; 3]) -> NodePlace {
        let mut first = [0; 3];
        let mut natural = [0.0; 3];
        let mut outside = false;
        for (i, list) in self.positions.iter().enumerate() {
            let last = list.len() - 1;
            let held = point[i].clamp(list[0], list[last]);
            outside |= held != point[i];
            let k = list.partition_point(|p| *p <= held).saturating_sub(1).min(last - 1);
            first[i] = k;
            natural[i] = 2.0 * (held - list[k]) / (list[k + 1] - list[k]) - 1.0;
        }
        let [nx, ny, _] = self.positions.each_ref().map(Vec::len);
        let mut place = NodePlace { nodes: [0; 8], shape: [0.0; 8], outside };
        for corner in 0..8 {
            let at = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let side = at.map(|a| if a == 1 { 1.0 } else { -1.0 });
            place.nodes[corner] = first[0] + at[0] + nx * (first[1] + at[1] + ny * (first[2] + at[2]));
            place.shape[corner] = (0..3).map(|i| 1.0 + side[i] * natural[i]).product::<f64>() / 8.0;
        }
        place
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid() -> NodeGrid {
        NodeGrid::new(vec![0.0, 400.0, 700.0], vec![-50.0, 300.0], vec![0.0, 10.0, 30.0, 250.0]).unwrap()
    }

    proptest! {
        #[test]
        fn trilinear_functions_are_exact_and_shapes_add_up_to_one(
            c in prop::array::uniform8(-1.0..1.0f64),
            x in -50.0..800.0f64, y in -80.0..350.0f64, z in -20.0..300.0f64,
        ) {
            let f = |[x, y, z]: [f64; 3]| {
                c[0] + c[1]*x + c[2]*y + c[3]*z + c[4]*x*y + c[5]*y*z + c[6]*x*z + c[7]*x*y*z*1e-3
            };
            let g = grid();
            let place = g.place([x, y, z]);
            let value: f64 = place.nodes.iter().zip(&place.shape).map(|(n, s)| s * f(g.node(*n))).sum();
            let held = [x.clamp(0.0, 700.0), y.clamp(-50.0, 300.0), z.clamp(0.0, 250.0)];
            prop_assert!((value - f(held)).abs() < 1e-8 * (1.0 + f(held).abs()));
            prop_assert!((place.shape.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            prop_assert_eq!(place.outside, held != [x, y, z]);
        }
    }

    #[test]
    fn nodes_run_along_x_first() {
        let g = grid();
        assert_eq!(g.nodes(), 24);
        assert_eq!(g.node(1), [400.0, -50.0, 0.0]);
        assert_eq!(g.node(3), [0.0, 300.0, 0.0]);
        assert_eq!(g.node(6), [0.0, -50.0, 10.0]);
        let place = g.place([400.0, 300.0, 30.0]);
        let at = place.shape.iter().position(|s| (s - 1.0).abs() < 1e-15).unwrap();
        assert_eq!(g.node(place.nodes[at]), [400.0, 300.0, 30.0]);
    }

    #[test]
    fn impossible_grids_are_refused() {
        let two = || vec![0.0, 1.0];
        assert_eq!(
            NodeGrid::new(two(), vec![0.0], two()),
            Err(GridError::TooFewPositions { axis: 'y', found: 1 })
        );
        assert_eq!(
            NodeGrid::new(two(), two(), vec![0.0, 0.0]),
            Err(GridError::NotIncreasing { axis: 'z', row: 2, value: 0.0 })
        );
        let many: Vec<f64> = (0..100).map(f64::from).collect();
        assert_eq!(NodeGrid::new(many.clone(), many, two()), Err(GridError::TooManyNodes { found: 20_000 }));
    }
}
