//! Instruments that measure lengths by light through air.

use crate::machine_state::Light;
use crate::prelude::*;
use crate::shape::line_of_sight;

/// Variants of `dead-path`.
pub(super) fn dead_path(data: &Data, _: &Subject) -> Variants {
    let both = data.lights.len() == Light::ALL.len();
    let lights = [None, Some(Light::Laser), Some(Light::Tracker)];
    let lights = &lights[..if both { lights.len() } else { 1 }];
    let shape = |(source, light): (&Source, &Option<Light>)| {
        let signal = Signal::of(source.clone(), 0.0);
        DeadPath { signal, light: *light, station: None }.into()
    };
    let shapes: Vec<Shape> = data.air().flat_map(|s| lights.iter().map(move |l| (s, l))).map(shape).collect();
    if !data.ranges || shapes.is_empty() {
        return Err("needs range_mm and the temperature of the air, both changing".into());
    }
    Ok(shapes)
}

/// Variants of `tracker-scale`.
pub(super) fn tracker_scale(data: &Data, _: &Subject) -> Variants {
    if !(data.ranges && data.stations) {
        return Err("needs station_x_mm .. of a tracker and ranges that change".into());
    }
    let plain = [false, true].map(|zero| TrackerScale { signal: None, zero });
    let warm =
        data.air().map(|source| TrackerScale { signal: Some(Signal::of(source.clone(), 0.0)), zero: false });
    Ok(plain.into_iter().chain(warm).map(Into::into).collect())
}

/// Along the beam: `c (T - 20) (range + q)`; of all instruments that measure by light, or only of one kind, or (additions
/// of before) only of those with (true) or without (false) a station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DeadPath {
    pub signal: Signal,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<Light>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub station: Option<bool>,
}

impl Form for DeadPath {
    fn parameters(&self) -> Vec<String> {
        plain(&["refraction_ppm_per_k", "dead_path_um_per_k"])
    }

    fn width(&self) -> usize {
        2
    }

    fn evaluate(&self, m: &MachineState, read: &Read<'_>, out: &mut [Vec3]) {
        let dt = read(&self.signal) - REFERENCE_DEGC;
        let own = line_of_sight(m);
        let counts = m.light.is_some_and(|own| self.light.is_none_or(|wanted| own == wanted))
            && self.station.is_none_or(|wanted| own.is_some() == wanted);
        let line = if counts { own.unwrap_or(m.u) } else { Vec3::zeros() };
        out[0] = line * (dt * m.range_mm * 1e-3);
        out[1] = line * dt;
    }

    fn drawing(&self) -> Drawing {
        Drawing::from(Over::Range).scaled(Weight::Warmth(self.signal.clone(), REFERENCE_DEGC))
    }

    fn signals(&self) -> Vec<&Signal> {
        vec![&self.signal]
    }
}

/// Along the line from station to target: `c range`, or `c range (T - 20)`; with a wrong zero of the range, too.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrackerScale {
    pub signal: Option<Signal>,
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub zero: bool,
}

impl Form for TrackerScale {
    fn parameters(&self) -> Vec<String> {
        match self.signal {
            Some(_) => plain(&["range_scale_ppm_per_k", "range_zero_um_per_k"][..self.width()]),
            None => plain(&["range_scale_ppm", "range_zero_um"][..self.width()]),
        }
    }

    fn width(&self) -> usize {
        1 + usize::from(self.zero)
    }

    fn evaluate(&self, m: &MachineState, read: &Read<'_>, out: &mut [Vec3]) {
        // a laser on a tripod has a station, too
        let r = line_of_sight(m).filter(|_| m.light != Some(Light::Laser)).unwrap_or_else(Vec3::zeros);
        let dt = self.signal.as_ref().map_or(1.0, |s| read(s) - REFERENCE_DEGC);
        out[0] = r * (m.range_mm * 1e-3 * dt);
        if self.zero {
            out[1] = r;
        }
    }

    fn drawing(&self) -> Drawing {
        let drawing = Drawing::from(Over::Range);
        match &self.signal {
            Some(signal) => drawing.scaled(Weight::Warmth(signal.clone(), REFERENCE_DEGC)),
            None => drawing,
        }
    }

    fn signals(&self) -> Vec<&Signal> {
        self.signal.iter().collect()
    }
}
