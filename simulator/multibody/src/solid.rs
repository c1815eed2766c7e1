//! Solids on grids: beams of Euler-Bernoulli elements and conduction in finite volumes.

use nalgebra::{DMatrix, DVector};

/// A plane beam of equal elements on elastic supports; two degrees of freedom per node: deflection and slope.
#[derive(Debug, Clone)]
pub struct Beam {
    /// Length of one element.
    step: f64,
    stiffness: DMatrix<f64>,
    load: DVector<f64>,
}

impl Beam {
    /// A beam without supports and loads: length (m), elements, bending stiffness (N m^2).
    pub fn new(length: f64, elements: usize, bending: f64) -> Self {
        let h = length / elements as f64;
        let n = 2 * (elements + 1);
        let mut stiffness = DMatrix::zeros(n, n);
        let k = bending / h.powi(3);
        let element = [
            [12.0, 6.0 * h, -12.0, 6.0 * h],
            [6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h],
            [-12.0, -6.0 * h, 12.0, -6.0 * h],
            [6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h],
        ];
        for e in 0..elements {
            for (i, row) in element.iter().enumerate() {
                for (j, v) in row.iter().enumerate() {
                    stiffness[(2 * e + i, 2 * e + j)] += k * v;
                }
            }
        }
        Self { step: h, stiffness, load: DVector::zeros(n) }
    }

    fn shape(&self, at: f64) -> (usize, [f64; 4]) {
        let elements = self.load.len() / 2 - 1;
        let e = ((at / self.step).max(0.0) as usize).min(elements - 1);
        let s = (at / self.step - e as f64).clamp(0.0, 1.0);
        let h = self.step;
        let n = [
            1.0 - 3.0 * s * s + 2.0 * s * s * s,
            h * s * (1.0 - s) * (1.0 - s),
            3.0 * s * s - 2.0 * s * s * s,
            h * s * s * (s - 1.0),
        ];
        (2 * e, n)
    }

    /// An elastic support, N/m.
    pub fn support(&mut self, at: f64, stiffness: f64) {
        let (e, n) = self.shape(at);
        for (i, a) in n.iter().enumerate() {
            for (j, b) in n.iter().enumerate() {
                self.stiffness[(e + i, e + j)] += stiffness * a * b;
            }
        }
    }

    /// A force, N.
    pub fn force(&mut self, at: f64, newton: f64) {
        let (e, n) = self.shape(at);
        for (i, a) in n.iter().enumerate() {
            self.load[e + i] += newton * a;
        }
    }

    /// A weight along the whole beam, N/m.
    pub fn weight(&mut self, newton_per_m: f64) {
        let (h, nodes) = (self.step, self.load.len() / 2);
        for e in 0..nodes - 1 {
            let per = [0.5, h / 12.0, 0.5, -h / 12.0];
            for (i, p) in per.iter().enumerate() {
                self.load[2 * e + i] += newton_per_m * h * p;
            }
        }
    }

    /// Deflection and slope along the beam; `None` where the supports do not hold it.
    pub fn solve(&self) -> Option<Deflection> {
        let solution = self.stiffness.clone().lu().solve(&self.load)?;
        Some(Deflection { beam: self.clone(), solution })
    }
}

/// A bent beam.
#[derive(Debug, Clone)]
pub struct Deflection {
    beam: Beam,
    solution: DVector<f64>,
}

impl Deflection {
    /// Deflection at a place, m.
    pub fn at(&self, at: f64) -> f64 {
        let (e, n) = self.beam.shape(at);
        (0..4).map(|i| n[i] * self.solution[e + i]).sum()
    }

    /// Slope at a place.
    pub fn slope(&self, at: f64) -> f64 {
        let d = 1e-3 * self.beam.step;
        (self.at(at + d) - self.at(at - d)) / (2.0 * d)
    }
}

/// A rod of equal cells: conduction along it, convection to the air, sources; temperatures above 20 degC.
#[derive(Debug, Clone, PartialEq)]
pub struct Rod {
    /// Temperature of the cells, K above 20 degC.
    pub cells: Vec<f64>,
    /// Conduction between cells, 1/s.
    exchange: f64,
    /// Loss to the air, 1/s.
    loss: f64,
}

impl Rod {
    /// Length (m), cells, diffusivity (m^2/s), time constant to the air (s), begin (K).
    pub fn new(length: f64, cells: usize, diffusivity: f64, air_s: f64, begin: f64) -> Self {
        let h = length / cells as f64;
        Self { cells: vec![begin; cells], exchange: diffusivity / (h * h), loss: 1.0 / air_s }
    }

    /// Explicit steps over a time with the air's temperature and heating rates (K/s) by cell.
    pub fn advance(&mut self, seconds: f64, air: f64, heating: impl Fn(usize) -> f64) {
        let fastest = 2.0 * self.exchange + self.loss;
        let n = (seconds * fastest / 0.4).ceil().max(1.0);
        let dt = seconds / n;
        let count = self.cells.len();
        for _ in 0..n as usize {
            let old = self.cells.clone();
            for (k, cell) in self.cells.iter_mut().enumerate() {
                let left = old[k.saturating_sub(1)];
                let right = old[(k + 1).min(count - 1)];
                *cell += dt
                    * (self.exchange * (left + right - 2.0 * old[k]) - self.loss * (old[k] - air)
                        + heating(k));
            }
        }
    }

    /// Mean temperature of the first share of the rod times that share.
    pub fn integral(&self, share: f64) -> f64 {
        let count = self.cells.len() as f64;
        let mut left = share.clamp(0.0, 1.0) * count;
        let mut sum = 0.0;
        for c in &self.cells {
            let part = left.clamp(0.0, 1.0);
            sum += part * c;
            left -= part;
        }
        sum / count
    }

    /// Mean temperature.
    pub fn mean(&self) -> f64 {
        self.integral(1.0)
    }

    /// First moment of the temperature over the thickness, as a linear gradient from face to face, K.
    pub fn gradient(&self) -> f64 {
        let n = self.cells.len() as f64;
        let moment: f64 =
            self.cells.iter().enumerate().map(|(k, t)| t * ((k as f64 + 0.5) / n - 0.5) / n).sum();
        12.0 * moment
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cantilever_bends_as_textbooks_say() {
        let mut beam = Beam::new(1.0, 20, 2000.0);
        // two stiff supports close together clamp one end
        beam.support(0.0, 1e12);
        beam.support(0.05, 1e12);
        beam.force(1.0, 10.0);
        let tip = beam.solve().unwrap().at(1.0);
        let textbook = 10.0 * 0.95_f64.powi(3) / (3.0 * 2000.0) + 10.0 * 0.95 * 0.05 * 0.95 / (3.0 * 2000.0);
        assert!((tip / textbook - 1.0).abs() < 0.01, "{tip} {textbook}");
    }

    #[test]
    fn a_rod_comes_to_the_temperature_of_the_air() {
        let mut rod = Rod::new(0.5, 10, 1.2e-5, 3000.0, 5.0);
        rod.advance(30_000.0, 1.0, |_| 0.0);
        assert!((rod.mean() - 1.0).abs() < 1e-3);
        assert!((rod.integral(0.5) - 0.5).abs() < 1e-3 && rod.gradient().abs() < 1e-9);
    }
}
