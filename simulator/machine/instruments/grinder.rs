//! An artefact on the workpiece side and several styli on the tool side: where each tip is relative to the workpiece.
//!
//! The artefact lies shifted and turned by an unknown amount, as after every clamping. Corrections are added to the
//! commanded positions as they stand in the plan: whoever made the plan knows why.

use nalgebra::Vector3;
use volcomp_units::axes::{AxisArray, MAX_AXES};
use volcomp_units::{mm_from_um, rad_from_arcsec, um_from_mm};

use super::Noise;
use crate::truth::TruthMachine;

/// The artefact and the noise of touching it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Artefact {
    /// Standard deviation of a reading.
    pub noise_um: f64,
    /// Standard deviation of the shift with which it lies.
    pub lies_um: f64,
    /// Standard deviation of the turn with which it lies.
    pub lies_arcsec: f64,
    /// Seed of all of it.
    pub seed: u64,
}

/// One pose to measure at; mm and deg in wire order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArtefactPose {
    /// Programmed coordinates.
    pub position: AxisArray,
    /// What is added to them.
    pub correction: AxisArray,
    /// Tip of the stylus in the machine frame at home.
    pub tip_mm: [f64; 3],
}

impl Artefact {
    /// Actual minus nominal position of the tip relative to the workpiece, um, at every pose.
    #[must_use]
    pub fn measure(&self, machine: &TruthMachine, poses: &[ArtefactPose]) -> Vec<[f64; 3]> {
        let mut noise = Noise::new(self.seed);
        let shift = Vector3::from_fn(|_, _| mm_from_um(noise.draw(self.lies_um)));
        let turn = Vector3::from_fn(|_, _| rad_from_arcsec(noise.draw(self.lies_arcsec)));
        let turned = nalgebra::Rotation3::new(turn);
        let mut machine = machine.clone();
        let one = |pose: &ArtefactPose| {
            machine.set_tool_tip_mm(pose.tip_mm);
            let mut there = pose.position;
            for (value, added) in there.iter_mut().zip(&pose.correction) {
                *value += added;
            }
            let nominal = Vector3::from(machine.nominal(&pose.position).tip_mm);
            let actual = Vector3::from(machine.pose(&there, &[0; MAX_AXES]).tip_mm);
            let seen = turned * actual + shift - nominal;
            [0, 1, 2].map(|i| um_from_mm(seen[i]) + noise.draw(self.noise_um))
        };
        poses.iter().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::{GRINDER_AB, TruthMachine};

    #[test]
    fn a_perfect_touch_sees_the_deviation_of_the_machine_and_the_correction() {
        let machine = TruthMachine::from_toml(GRINDER_AB).unwrap();
        let artefact = Artefact { noise_um: 0.0, lies_um: 0.0, lies_arcsec: 0.0, seed: 1 };
        let x = machine.index_of(volcomp_units::axes::AxisName::X).unwrap();
        let mut pose = ArtefactPose {
            position: AxisArray::default(),
            correction: AxisArray::default(),
            tip_mm: machine.tool_tip_mm(),
        };
        pose.position[x] = 200.0;
        let bare = artefact.measure(&machine, &[pose])[0];
        let truth = machine.deviation(&pose.position, &[0; MAX_AXES]).tip_mm;
        assert!((0..3).all(|i| (bare[i] - um_from_mm(truth[i])).abs() < 1e-6));
        pose.correction[x] = 0.005;
        let corrected = artefact.measure(&machine, &[pose])[0];
        assert!((corrected[0] - bare[0] - 5.0).abs() < 0.01, "{bare:?} {corrected:?}");
        let askew = Artefact { lies_um: 10.0, ..artefact };
        let home = ArtefactPose { position: AxisArray::default(), ..pose };
        assert!(askew.measure(&machine, &[home])[0].iter().any(|v| v.abs() > 1.0));
    }
}
