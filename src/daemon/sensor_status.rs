//! Health of sensors and maps as the status tells it.

use serde::{Deserialize, Serialize};

use volcomp_engine::fault;
use volcomp_estimate::live::{
    LiveHealth, LiveSpec, MapHealth, MapSpec, SensorHealth, SensorSpec, ThermalHealth, ThermalStatus,
};
use volcomp_estimate::{self as estimate, SensorFault};
use volcomp_units::{arcsec_from_rad, um_from_mm};

/// A sensor.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorStatus {
    /// Its name.
    pub name: String,
    /// `tool five-dof value temperature speed`.
    pub kind: String,
    /// `waiting good excluded`; `unused` where there is no live estimation with the model in use.
    pub state: String,
    /// Why it is excluded: `silent late frozen jump range rate clock quality disagrees reversed kind`.
    pub cause: Option<String>,
    /// Number of that cause, e.g. `VC-8002`.
    pub code: Option<String>,
    /// For how long it has been in this state, s.
    pub state_s: f64,
    /// Time since it was heard, s.
    pub age_s: Option<f64>,
    /// Its clock minus the daemon's, s.
    pub clock_offset_s: Option<f64>,
    /// Delay learned from motion, ms, beyond the stated one.
    pub delay_ms: Option<f64>,
    /// Standard deviation of it, ms.
    pub delay_std_ms: Option<f64>,
    /// Readings that came.
    pub readings: u64,
    /// Of these: used.
    pub used: u64,
    /// Of these: beyond the gate.
    pub rejected: u64,
    /// Of these: taken when nobody knew where the machine stood.
    pub without_position: u64,
    /// Of these: left out, for there was no time for them.
    #[serde(default)]
    pub skipped: u64,
    /// Time until a sensor that contradicted its map on probation is looked at again, s.
    #[serde(default)]
    pub rests_s: Option<f64>,
    /// Readings still to be looked at before any is used.
    pub acquaintance_left: Option<usize>,
    /// Standard deviation of the noise of its lengths over the stated one.
    pub noise_factor: Option<f64>,
    /// The same of its angles.
    #[serde(default)]
    pub noise_factor_angles: Option<f64>,
    /// RMS innovation of the last reading, in learned standard deviations.
    pub innovation: Option<f64>,
    /// Its expected value.
    pub innovation_expected: Option<f64>,
    /// Largest squared innovation over its variance in the last reading.
    pub ratio: Option<f64>,
    /// Running mean of squared innovation over variance: about 1 where everything is right.
    pub nis: Option<f64>,
    /// Share of the travel that a laser has seen.
    pub coverage: Option<f64>,
    /// Whether its alignment is known.
    pub referenced: Option<bool>,
    /// What it said last: mm, rad, degrees Celsius or 1/min.
    pub values: Vec<f64>,
}

/// A map; um for lengths, arcsec for angles.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MapStatus {
    /// Its name.
    pub name: String,
    /// `learning`; `held` (no sensor teaches it: what it has learned is used and fades); `alarm` (a sensor contradicts
    /// it); `static` (given up for the static model); `unused` (no live estimation with the model in use).
    pub state: String,
    /// What was learned is larger than its limit.
    #[serde(default)]
    pub limited: bool,
    /// Time since the last reading that was used, s.
    #[serde(default)]
    pub idle_s: f64,
    /// Time in which what was learned falls to 1/e where no sensor confirms it, s; none: never.
    #[serde(default)]
    pub memory_s: Option<f64>,
    /// Readings used.
    pub updates: u64,
    /// Its components, lower case.
    pub components: Vec<String>,
    /// Their unit: `um` or `arcsec`.
    pub units: Vec<String>,
    /// Weight with which it is used, 0 to 1: near 0 where it is no more than noise.
    pub weight: f64,
    /// Largest difference from the offline map that is used, per component.
    pub largest: Vec<f64>,
    /// The nodes; only where asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nodes: Vec<NodeStatus>,
}

/// A node.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeStatus {
    /// X, Y, Z.
    pub position_mm: [f64; 3],
    /// Difference from the offline map, per component.
    pub value: Vec<f64>,
    /// Its standard deviation.
    pub std: Vec<f64>,
    /// What is used of it.
    pub used: Vec<f64>,
}

/// A thermal displacement.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ThermalDisplacementStatus {
    /// Its name.
    pub name: String,
    /// `waiting` (an input has not spoken), `used`, `outside` (an input is outside of what the fit has seen: it fades),
    /// `lost` (an input is lost: held, then taken back).
    pub state: String,
    /// The input that this is about.
    pub input: Option<String>,
    /// Number of that warning, e.g. `VC-8014`.
    pub code: Option<String>,
    /// Unit of what follows: `um`, or `um/m` of an expansion.
    pub unit: String,
    /// What is used of it.
    pub value: f64,
    /// Share that is used, 0 to 1.
    pub share: f64,
    /// Standard uncertainty of its forecast (k = 1), where stated.
    pub std: Option<f64>,
}

/// Everything about live estimation.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FilterStatus {
    /// The sensors.
    pub sensors: Vec<SensorStatus>,
    /// The maps.
    pub maps: Vec<MapStatus>,
    /// Thermal displacements.
    #[serde(default)]
    pub growths: Vec<ThermalDisplacementStatus>,
    /// What should be known: what was put back at the start, what could not be kept.
    pub notes: Vec<String>,
    /// Readings that found the estimator's queue full.
    pub dropped: u64,
    /// Messages that were answered with an error.
    #[serde(default)]
    pub refused: u64,
    /// What is wrong for as long as it lasts, by number; the notes have it, too.
    #[serde(skip)]
    pub lasting: Vec<(fault::Code, String)>,
}

/// Number of a trouble in the catalogue of faults.
pub(crate) const fn code_of(sensor_fault: SensorFault) -> fault::Code {
    fault::Code(match sensor_fault {
        SensorFault::Silent => 8002,
        SensorFault::Late => 8003,
        SensorFault::Frozen => 8004,
        SensorFault::Jump => 8005,
        SensorFault::Range => 8006,
        SensorFault::Rate => 8007,
        SensorFault::Clock => 8008,
        SensorFault::Quality => 8009,
        SensorFault::Disagrees => 8010,
        SensorFault::Reversed => 8016,
        SensorFault::Kind => 8017,
    })
}

/// Number of what is wrong with a thermal displacement, in the catalogue of faults.
pub(crate) const fn growth_code(status: ThermalStatus) -> Option<fault::Code> {
    match status {
        ThermalStatus::Waiting(_) | ThermalStatus::Used => None,
        ThermalStatus::Outside(_) => Some(fault::Code(8014)),
        ThermalStatus::Lost(_) => Some(fault::Code(8015)),
    }
}

impl ThermalDisplacementStatus {
    fn new(h: &ThermalHealth) -> Self {
        // um of mm, or um/m of a strain
        let scale = if h.expansion { 1e6 } else { um_from_mm(1.0) };
        let state = match h.status {
            ThermalStatus::Waiting(_) => "waiting",
            ThermalStatus::Used => "used",
            ThermalStatus::Outside(_) => "outside",
            ThermalStatus::Lost(_) => "lost",
        };
        Self {
            name: h.name.clone(),
            state: state.to_owned(),
            input: h.input.clone(),
            code: growth_code(h.status).map(|code| code.to_string()),
            unit: if h.expansion { "um/m" } else { "um" }.to_owned(),
            value: scale * h.value,
            share: h.share,
            std: h.std.map(|std| scale * std),
        }
    }
}

impl SensorStatus {
    fn new(h: &SensorHealth) -> Self {
        let (state, sensor_fault) = match h.status {
            estimate::SensorStatus::Waiting => ("waiting", None),
            estimate::SensorStatus::Good => ("good", None),
            estimate::SensorStatus::Excluded(sensor_fault) => ("excluded", Some(sensor_fault)),
        };
        Self {
            name: h.name.clone(),
            kind: h.kind.to_owned(),
            state: state.to_owned(),
            cause: sensor_fault.map(|t| t.name().to_owned()),
            code: sensor_fault.map(|t| code_of(t).to_string()),
            state_s: h.status_s,
            age_s: h.age_s,
            clock_offset_s: h.clock_offset_s,
            delay_ms: h.shift_s.map(|[value, _]| value * 1e3),
            delay_std_ms: h.shift_s.map(|[_, std]| std * 1e3),
            readings: h.readings[0],
            used: h.readings[1],
            rejected: h.readings[2],
            without_position: h.without_position,
            skipped: h.skipped,
            rests_s: h.rests_s,
            acquaintance_left: h.initialisation.map(|(seen, wanted)| wanted.saturating_sub(seen)),
            noise_factor: h.noise_factor.map(|[lengths, _]| lengths),
            noise_factor_angles: h.noise_factor.map(|[_, angles]| angles),
            innovation: h.innovation.map(|i| i[0]),
            innovation_expected: h.innovation.map(|i| i[1]),
            ratio: h.innovation.map(|i| i[2]),
            nis: h.nis,
            coverage: h.referenced.map(|(share, _)| share),
            referenced: h.referenced.map(|(_, known)| known),
            values: h.values.clone(),
        }
    }
}

impl MapStatus {
    fn new(h: &MapHealth) -> Self {
        let unit = |c: usize| -> fn(f64) -> f64 {
            if h.components[c].is_angle() { arcsec_from_rad } else { um_from_mm }
        };
        let state = match (h.is_static, h.alarm) {
            (true, _) => "static",
            (false, true) => "alarm",
            (false, false) if h.taught => "learning",
            (false, false) => "held",
        };
        let of = |node: &volcomp_estimate::live::NodeHealth, k: usize| {
            node.components.iter().enumerate().map(|(c, v)| unit(c)(v[k])).collect()
        };
        Self {
            name: h.name.clone(),
            state: state.to_owned(),
            limited: h.limited,
            idle_s: h.idle_s,
            memory_s: Some(h.memory_s).filter(|s| s.is_finite()),
            updates: h.updates,
            components: h.components.iter().map(|s| s.to_string().to_lowercase()).collect(),
            units: h
                .components
                .iter()
                .map(|s| if s.is_angle() { "arcsec" } else { "um" }.to_owned())
                .collect(),
            weight: h.weight,
            largest: h.largest.iter().enumerate().map(|(c, v)| unit(c)(*v)).collect(),
            nodes: h
                .nodes
                .iter()
                .map(|n| NodeStatus {
                    position_mm: n.position,
                    value: of(n, 0),
                    std: of(n, 1),
                    used: of(n, 2),
                })
                .collect(),
        }
    }

    /// Numbers of what is wrong with it now, the more serious first.
    pub(crate) fn codes(&self) -> impl Iterator<Item = fault::Code> {
        let contradicted = match self.state.as_str() {
            "static" => Some(fault::Code::MAP_STATIC),
            "alarm" => Some(fault::Code::MAP_ALARM),
            _ => None,
        };
        contradicted.into_iter().chain(self.limited.then_some(fault::Code::MAP_LIMITED))
    }

    /// Without the nodes, for the status.
    pub(crate) fn brief(&self) -> Self {
        Self { nodes: Vec::new(), ..self.clone() }
    }
}

impl FilterStatus {
    /// Sensors and maps that are listed and cannot be used with the model.
    pub(crate) fn unused(spec: &LiveSpec) -> Self {
        let code = Some(fault::Code(8020).to_string());
        let sensor = |s: &SensorSpec| SensorStatus {
            name: s.name.clone(),
            kind: s.kind.name().to_owned(),
            state: "unused".to_owned(),
            code: code.clone(),
            ..SensorStatus::default()
        };
        let map = |m: &MapSpec| MapStatus {
            name: m.name.clone(),
            state: "unused".to_owned(),
            ..MapStatus::default()
        };
        Self {
            sensors: spec.sensors.iter().map(sensor).collect(),
            maps: spec.maps.iter().map(map).collect(),
            ..Self::default()
        }
    }

    pub(crate) fn new(health: &LiveHealth) -> Self {
        Self {
            sensors: health.sensors.iter().map(SensorStatus::new).collect(),
            maps: health.maps.iter().map(MapStatus::new).collect(),
            growths: health.growths.iter().map(ThermalDisplacementStatus::new).collect(),
            ..Self::default()
        }
    }
}
