//! How live estimation goes, as plain data: for status, recordings and pictures.

use super::thermal_displacement::ThermalStatus;
use crate::SensorStatus;
use volcomp_model::ErrorSymbol;

/// Everything.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LiveHealth {
    /// The sensors.
    pub sensors: Vec<SensorHealth>,
    /// The maps.
    pub maps: Vec<MapHealth>,
    /// Thermal displacements.
    pub growths: Vec<ThermalHealth>,
}

/// A thermal displacement.
#[derive(Debug, Clone, PartialEq)]
pub struct ThermalHealth {
    /// Its name.
    pub name: String,
    /// True: a strain; false: a length.
    pub expansion: bool,
    /// How it stands.
    pub status: ThermalStatus,
    /// The input that this is about.
    pub input: Option<String>,
    /// What is used of it, mm or a strain.
    pub value: f64,
    /// Share that is used: below 1 outside of what the fit has seen, and where an input is lost.
    pub share: f64,
    /// Standard uncertainty of a forecast, where the fit has stated one, mm or a strain.
    pub std: Option<f64>,
}

/// A sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorHealth {
    /// Its name.
    pub name: String,
    /// What it measures.
    pub kind: &'static str,
    /// How it stands.
    pub status: SensorStatus,
    /// For how long, s.
    pub status_s: f64,
    /// Time since it was heard, s.
    pub age_s: Option<f64>,
    /// Its clock minus the daemon's, s.
    pub clock_offset_s: Option<f64>,
    /// What motion says about its delay, and the standard deviation of that, s.
    pub shift_s: Option<[f64; 2]>,
    /// Readings that came, were used, and were beyond the gate.
    pub readings: [u64; 3],
    /// Readings taken when nobody knew where the machine stood.
    pub without_position: u64,
    /// Readings left out for lack of time.
    pub skipped: u64,
    /// It contradicted its map on probation: time until it is looked at again, s.
    pub rests_s: Option<f64>,
    /// Still being looked at: readings so far, and wanted.
    pub initialisation: Option<(usize, usize)>,
    /// Standard deviation of its noise over the stated one: lengths, angles.
    pub noise_factor: Option<[f64; 2]>,
    /// Of the last reading: RMS innovation and its expected value, in learned standard deviations, and the largest
    /// `nu^2 / S`.
    pub innovation: Option<[f64; 3]>,
    /// Running mean of `nu^2 / S`: about 1 where everything is right.
    pub nis: Option<f64>,
    /// Share of the travel seen and whether the alignment is known (5-DOF).
    pub referenced: Option<(f64, bool)>,
    /// What it said last, in its own numbers.
    pub values: Vec<f64>,
}

/// A map.
#[derive(Debug, Clone, PartialEq)]
pub struct MapHealth {
    /// Its name.
    pub name: String,
    /// Its components.
    pub components: Vec<ErrorSymbol>,
    /// Readings used.
    pub updates: u64,
    /// A sensor contradicted it, and none agrees.
    pub alarm: bool,
    /// Given up for the static model.
    pub is_static: bool,
    /// A sensor teaches it; otherwise it holds what it has learned, which fades.
    pub taught: bool,
    /// What was learned is larger than its limit.
    pub limited: bool,
    /// Time since the last reading that was used, s.
    pub idle_s: f64,
    /// Time in which what was learned falls to 1/e where no sensor confirms it, s.
    pub memory_s: f64,
    /// Weight with which it is used, 0 to 1.
    pub weight: f64,
    /// Largest difference from the offline map that is used, per component.
    pub largest: Vec<f64>,
    /// The nodes.
    pub nodes: Vec<NodeHealth>,
}

/// A node.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeHealth {
    /// Where, mm.
    pub position: [f64; 3],
    /// Per component: difference from the offline map, its standard deviation, and what is used of it.
    pub components: Vec<[f64; 3]>,
}
