//! A smooth blend from one offset to another: position, rate and acceleration start and end at zero.

/// Progress of a blend over a fixed duration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ramp {
    duration_s: f64,
    elapsed_s: f64,
}

impl Ramp {
    /// A ramp at its start.
    pub(super) const fn start(duration_s: f64) -> Self {
        Self { duration_s, elapsed_s: 0.0 }
    }

    /// Moves on by `dt` seconds.
    pub(super) fn advance(&mut self, dt: f64) {
        self.elapsed_s += dt;
    }

    /// True at the end.
    pub(super) fn is_done(&self) -> bool {
        self.elapsed_s >= self.duration_s
    }

    /// Share of the new value, 0 to 1: `6u^5 - 15u^4 + 10u^3`.
    pub(super) fn share(&self) -> f64 {
        let u = (self.elapsed_s / self.duration_s).clamp(0.0, 1.0);
        u * u * u * (u * (6.0 * u - 15.0) + 10.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rises_from_zero_to_one_without_a_step() {
        let mut ramp = Ramp::start(1.0);
        let mut last = 0.0;
        assert_eq!(ramp.share(), 0.0);
        for _ in 0..1000 {
            ramp.advance(1e-3);
            let share = ramp.share();
            // the steepest slope of the quintic is 1.875
            assert!(share >= last && share - last <= 1.876e-3);
            last = share;
        }
        assert!((ramp.share() - 1.0).abs() < 1e-9 && ramp.is_done() | (ramp.share() < 1.0));
    }
}
