//! All together: positions and readings in, a table for the cycle and a report of health out.
//!
//! A reading of the tool goes this way: when was it taken (clock, delay), where did the machine stand, what does it
//! differ from the static model by, can that be (plausibility), is the sensor known, does it agree (gate), and only
//! then: update. A sensor that disagrees [`super::MapSpec::rejections_to_alarm`] times on end is excluded and the map
//! raises an alarm instead of following; it holds what it learned for a while, then the static model takes over. The
//! sensor comes back when a whole initialisation agrees with the map as it stands.
//!
//! Readings of the tool go through [`tool`].

mod tool;

use std::sync::Arc;

use self::tool::SPEED_S;
use super::axis::{AxisLaser, LaserRules, sees};
use super::health::{LiveHealth, ThermalHealth};
use super::history::{MotionHistory, MotionSample};
use super::map::{Feeding, MapState, SavedMap, channels};
use super::reading::{Body, Reading};
use super::sensor::{SensorState, Stage};
use super::spec::{LiveError, LiveSpec, SensorKind, SensorSpec};
use super::table::{LiveTable, Source};
use super::thermal_displacement::{SavedThermalState, ThermalDisplacementState, ThermalStatus};
use crate::{Kind, SensorFault, SensorStatus, Thermal, VALUES_MAX};
use volcomp_model::axes::{AxisKind, AxisName, Travel};
use volcomp_model::units::MonoTime;
use volcomp_model::{ErrorSymbol, Model, ModelSpec, SENSORS_MAX};

/// The model in use, as live estimation sees it.
#[derive(Debug, Clone)]
pub struct LiveModel<'a> {
    /// What its file says.
    pub spec: &'a ModelSpec,
    /// Thermal displacements that it lists.
    pub thermal: &'a [Thermal],
    /// Compiled.
    pub model: Arc<Model>,
    /// BLAKE3 of its file.
    pub hash: [u8; 32],
}

/// How a map stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MapCondition {
    /// A sensor contradicts it.
    pub alarm: bool,
    /// Given up for the static model.
    pub is_static: bool,
    /// What was learned is larger than its limit.
    pub limited: bool,
}

/// The estimator of one model.
#[derive(Debug, Clone)]
pub struct LiveEstimator {
    model: Arc<Model>,
    hash: [u8; 32],
    /// Chain index of X, Y, Z.
    linear: [Option<usize>; 3],
    sensors: Vec<SensorState>,
    maps: Vec<MapState>,
    growths: Vec<ThermalDisplacementState>,
    history: MotionHistory,
}

impl LiveEstimator {
    /// An estimator for a model.
    ///
    /// # Errors
    /// Sensors, maps and model do not go together.
    pub fn new(live: &LiveSpec, of: LiveModel<'_>) -> Result<Self, LiveError> {
        let LiveModel { spec, thermal, model, hash } = of;
        let names: Vec<&str> = live
            .sensors
            .iter()
            .map(|s| s.name.as_str())
            .chain(live.maps.iter().map(|m| m.name.as_str()))
            .collect();
        if let Some(k) = (1..names.len()).find(|k| names[..*k].contains(&names[*k])) {
            return Err(LiveError::Twice { name: names[k].to_owned() });
        }
        let maps: Result<Vec<MapState>, _> = live.maps.iter().map(|map| MapState::new(map, &model)).collect();
        let sensors: Result<Vec<_>, _> =
            live.sensors.iter().map(|sensor| new_sensor(sensor, live, spec, &model)).collect();
        let (mut maps, mut sensors): (_, Vec<SensorState>) = (maps?, sensors?);
        for sensor in &mut sensors {
            if let SensorKind::Tool { map } = sensor.spec.kind {
                sensor.number = maps[map].map.add_sensor();
            }
        }
        let growths = new_growths(thermal, live, &model, &sensors, &maps)?;
        let index = |name| spec.chain.index_of(name);
        Ok(Self {
            linear: [AxisName::X, AxisName::Y, AxisName::Z].map(index),
            sensors,
            maps,
            growths,
            history: MotionHistory::default(),
            model,
            hash,
        })
    }

    /// Number of a sensor.
    #[must_use]
    pub fn sensor(&self, name: &str) -> Option<usize> {
        self.sensors.iter().position(|s| s.spec.name == name)
    }

    /// The machine stood here.
    pub fn on_motion(&mut self, sample: MotionSample) {
        self.history.push(sample);
    }

    /// The link is gone: nobody knows where the machine stands.
    pub fn on_link_down(&mut self) {
        self.history.clear();
    }

    /// Time has passed.
    pub fn tick(&mut self, now: MonoTime) {
        for sensor in &mut self.sensors {
            sensor.supervisor.tick(now);
        }
        for growth in &mut self.growths {
            growth.tick(now, &self.sensors);
        }
        for (k, map) in self.maps.iter_mut().enumerate() {
            let mut feeding = Feeding::default();
            for sensor in self.sensors.iter().filter(|s| s.spec.kind == SensorKind::Tool { map: k }) {
                let status = sensor.supervisor.status();
                feeding.agrees |= sensor.stage == Stage::Used && status == SensorStatus::Good;
                feeding.disagrees |= status == SensorStatus::Excluded(SensorFault::Disagrees);
            }
            map.tick(now, &feeding);
        }
    }

    /// A reading came that there is no time for: its sensor is heard, and nothing else.
    pub fn skip(&mut self, now: MonoTime, sensor: usize) {
        let Some(state) = self.sensors.get_mut(sensor) else { return };
        state.readings[0] += 1;
        state.skipped += 1;
        state.supervisor.hear(now);
    }

    /// What each sensor of kind value is to tell, a length or an angle.
    pub fn units(&self) -> impl Iterator<Item = (&str, Kind)> + '_ {
        let values = self.sensors.iter().filter(|s| s.spec.kind == SensorKind::Value);
        values.map(|s| (s.spec.name.as_str(), s.unit))
    }

    /// A reading of sensor number `sensor`, which arrived at `now`.
    pub fn on_reading(&mut self, now: MonoTime, sensor: usize, reading: &Reading) {
        let Some(state) = self.sensors.get_mut(sensor) else { return };
        state.readings[0] += 1;
        let stamped = state.clock.stamp(now, reading.stamp_ns);
        let when = (stamped.at, stamped.stepped);
        match (state.spec.kind, &reading.body) {
            (SensorKind::Tool { map }, Body::Tool(_) | Body::Points(_) | Body::Deviation { .. }) => {
                self.on_tool(now, sensor, map, when, reading);
            }
            (SensorKind::FiveDof { .. }, Body::FiveDof(_) | Body::FiveDofRaw(_)) => {
                self.on_laser(now, sensor, when, reading);
            }
            (SensorKind::Value, Body::Value { value, unit })
                if unit.is_none_or(|unit| unit == state.unit) =>
            {
                // the limits of the model bound it, range bounds the rest
                let mut values = [0.0; VALUES_MAX];
                values[state.unit.index() * VALUES_MAX / 2] = *value;
                state.value = state.judge(now, when, reading, &values).then_some(*value);
                state.told = now;
                state.readings[1] += u64::from(state.value.is_some());
            }
            (SensorKind::Temperature, Body::Temperatures(list)) => state.believe(now, when, reading, list),
            (SensorKind::Speed, Body::Speed(speed)) => state.believe(now, when, reading, &[*speed]),
            // a sensor that says something of another kind says nothing
            _ => state.refuse(now, SensorFault::Kind),
        }
    }

    fn on_laser(&mut self, now: MonoTime, sensor: usize, when: (MonoTime, bool), reading: &Reading) {
        let Some(state) = self.sensors.get_mut(sensor) else { return };
        let motion = match (&reading.body, state.spec.kind) {
            (Body::FiveDof(motion), _) => *motion,
            (Body::FiveDofRaw(readings), SensorKind::FiveDof { head: Some(head), .. }) => {
                head.reduce(readings).motion
            }
            _ => {
                state.refuse(now, SensorFault::Kind);
                return;
            }
        };
        let believed = state.judge(now, when, reading, &motion);
        let Some(sample) = self.history.at(when.0) else {
            state.without_position += 1;
            return;
        };
        let dt = state.last_at.map_or(0.0, |before| when.0.seconds_since(before));
        state.last_at = Some(when.0);
        if let Some(laser) = state.laser.as_mut().filter(|_| believed) {
            let q = sample.commanded[laser.index()];
            let before =
                self.history.at(when.0.plus_seconds(-SPEED_S)).map_or(q, |m| m.commanded[laser.index()]);
            let travel = if q < before { Travel::Reverse } else { Travel::Forward };
            laser.take(q, travel, motion, dt);
            state.told = now;
            state.readings[1] += 1;
        }
    }

    /// Live values that do not come from maps.
    fn live_values(&self) -> [f64; SENSORS_MAX] {
        let mut live = [0.0; SENSORS_MAX];
        let direct = self.direct().map(|(channel, value, _)| (channel, value));
        for (channel, value) in direct.chain(self.grown()) {
            live[channel] = value;
        }
        live
    }

    /// Live values that sensors tell by themselves, as far as these can be believed, and when their readings arrived.
    fn direct(&self) -> impl Iterator<Item = (usize, f64, MonoTime)> + '_ {
        let good = |s: &&SensorState| s.supervisor.status() == SensorStatus::Good;
        self.sensors.iter().filter(good).flat_map(|s| {
            let own = s.channel.zip(s.value);
            let all = own.into_iter().chain(s.laser.iter().flat_map(AxisLaser::values));
            all.map(|(channel, value)| (channel, value, s.told))
        })
    }

    /// Live values that thermal displacements tell.
    fn grown(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.growths.iter().filter_map(|g| Some((g.channel, g.value()?)))
    }

    /// What the cycle evaluates from now on.
    pub fn table(&mut self, now: MonoTime) -> LiveTable {
        let mut sources = [Source::None; SENSORS_MAX];
        for (channel, value, heard) in self.direct() {
            sources[channel] = Source::Value { value, heard };
        }
        for (channel, value) in self.grown() {
            sources[channel] = Source::Smooth(value);
        }
        let mut maps = Vec::with_capacity(self.maps.len());
        for (k, map) in self.maps.iter_mut().enumerate() {
            maps.push(map.table());
            for (component, channel) in map.channels.iter().enumerate().filter(|_| !map.is_static) {
                sources[*channel] = Source::Map { map: k, component };
            }
        }
        LiveTable { model: self.hash, made: now, sources, maps }
    }

    /// How it goes.
    #[must_use]
    pub fn health(&self, now: MonoTime) -> LiveHealth {
        LiveHealth {
            sensors: self.sensors.iter().map(|s| s.health(now, self.delay_of(s))).collect(),
            maps: self.maps.iter().map(MapState::health).collect(),
            growths: self.growths.iter().map(growth_health).collect(),
        }
    }

    /// What is known about the delay of a sensor.
    fn delay_of(&self, sensor: &SensorState) -> Option<[f64; 2]> {
        let SensorKind::Tool { map } = sensor.spec.kind else { return None };
        Some(self.maps.get(map)?.map.delay(sensor.number))
    }

    /// How each sensor stands, by name, as it is reported.
    pub fn sensor_statuses(&self) -> impl Iterator<Item = (&str, SensorStatus)> + '_ {
        self.sensors.iter().map(|s| (s.spec.name.as_str(), s.supervisor.reported().0))
    }

    /// How each map stands.
    pub fn map_states(&self) -> impl Iterator<Item = (&str, MapCondition)> + '_ {
        self.maps.iter().map(|m| {
            let status =
                MapCondition { alarm: m.alarm.is_some(), is_static: m.is_static, limited: m.limited };
            (m.spec.name.as_str(), status)
        })
    }

    /// How each thermal displacement stands: name, standing, the input that this is about.
    pub fn thermal_statuses(&self) -> impl Iterator<Item = (&str, ThermalStatus, Option<&str>)> + '_ {
        self.growths.iter().map(|g| (g.spec.name.as_str(), g.status(), g.input()))
    }

    /// True where there is something that is to outlive the daemon.
    #[must_use]
    pub const fn learns(&self) -> bool {
        !self.maps.is_empty() || !self.growths.is_empty()
    }

    /// What is to be kept of thermal displacements.
    #[must_use]
    pub fn saved_thermal(&self) -> Vec<SavedThermalState> {
        self.growths.iter().filter_map(ThermalDisplacementState::kept).collect()
    }

    /// Puts back lags that were kept `age_s` ago; gives a sentence for every thermal displacement that begins anew because what was
    /// kept cannot be.
    pub fn restore_thermal(&mut self, kept: &[SavedThermalState], age_s: f64) -> Vec<String> {
        let mut problems = Vec::new();
        for growth in &mut self.growths {
            let Some(found) = kept.iter().find(|k| k.name == growth.spec.name) else { continue };
            if !growth.restore(found, age_s) {
                problems
                    .push(format!("thermal {}: its lags are not numbers or beyond all bounds", found.name));
            }
        }
        problems
    }

    /// What is to be kept.
    #[must_use]
    pub fn kept(&self) -> Vec<SavedMap> {
        self.maps.iter().map(MapState::kept).collect()
    }

    /// Puts back what was kept `age_s` ago; gives a sentence for every map that starts from the offline map instead.
    pub fn restore(&mut self, kept: &[SavedMap], age_s: f64) -> Vec<String> {
        let mut problems = Vec::new();
        for map in &mut self.maps {
            let name = &map.spec.name;
            let Some(found) = kept.iter().find(|k| k.name == *name) else {
                problems.push(format!("map {name}: nothing was kept"));
                continue;
            };
            let name = name.clone();
            if let Err(why) = map.restore(found, age_s) {
                problems.push(format!("map {name}: {why}"));
            }
        }
        problems
    }

    /// A map goes back to the offline map and its sensors are initialised again; false where there is none of the name.
    pub fn forget(&mut self, name: &str) -> bool {
        let Some(k) = self.maps.iter().position(|m| m.spec.name == name) else { return false };
        self.maps[k].forget();
        for sensor in self.sensors.iter_mut().filter(|s| s.spec.kind == SensorKind::Tool { map: k }) {
            sensor.get_to_know();
        }
        true
    }

    /// Estimate of component `c` of map `map` where the axes stand at X, Y, Z (mm): difference from the offline map, its
    /// standard deviation, and what is used of it.
    #[must_use]
    pub fn estimate(&self, map: usize, c: usize, position: [f64; 3]) -> Option<[f64; 3]> {
        let map = &self.maps.get(map)?.map;
        if c >= map.rules().components.len() {
            return None;
        }
        let place = map.place(position);
        let (value, std) = map.estimate(c, &place);
        Some([value, std, map.output(c, &place)])
    }
}

/// A sensor with what it needs of the model.
fn new_sensor(
    sensor: &SensorSpec,
    live: &LiveSpec,
    spec: &ModelSpec,
    model: &Model,
) -> Result<SensorState, LiveError> {
    let name = || sensor.name.clone();
    let mut laser = None;
    let mut channel = None;
    let is_angle =
        spec.errors.iter().any(|(s, f)| s.is_angle() && f.live.iter().any(|l| l.sensor == sensor.name));
    let unit = if is_angle { Kind::Angle } else { Kind::Length };
    match sensor.kind {
        SensorKind::Tool { map } if map >= live.maps.len() => {
            return Err(LiveError::NoMap { sensor: name() });
        }
        SensorKind::Tool { .. } | SensorKind::Temperature | SensorKind::Speed => {}
        SensorKind::Value => {
            channel = model.sensors().iter().position(|s| *s == sensor.name);
            if channel.is_none() {
                return Err(LiveError::NoChannel { map: name() });
            }
        }
        SensorKind::FiveDof { axis, head, smooth_s, rest_smooth_s, reference_share, alignment } => {
            if let Some(head) = head {
                head.check().map_err(|source| LiveError::Head { sensor: name(), source })?;
            }
            let found: Vec<(usize, ErrorSymbol)> =
                channels(model, &sensor.name)?.into_iter().filter(|(_, s)| sees(axis, *s)).collect();
            if found.is_empty() {
                return Err(LiveError::NoChannel { map: name() });
            }
            let is_raw = head.is_some();
            let rules = LaserRules { smooth_s, rest_smooth_s, reference_share, alignment, is_raw };
            laser = AxisLaser::new(spec, axis, &found, rules);
            if laser.is_none() || axis.kind() != AxisKind::Linear {
                return Err(LiveError::NoAxis { sensor: name(), axis });
            }
        }
    }
    let mut state = SensorState::new(sensor, laser, channel);
    state.unit = unit;
    Ok(state)
}

/// The thermal displacements that an error of the model names.
fn new_growths(
    thermal: &[Thermal],
    live: &LiveSpec,
    model: &Model,
    sensors: &[SensorState],
    maps: &[MapState],
) -> Result<Vec<ThermalDisplacementState>, LiveError> {
    let mut growths = Vec::new();
    for growth in thermal {
        let Some(channel) = model.sensors().iter().position(|s| *s == growth.name) else { continue };
        let told = sensors.iter().any(|s| s.channel == Some(channel))
            || maps.iter().any(|m| m.channels.contains(&channel));
        if told {
            return Err(LiveError::TwoSources { channel: growth.name.clone() });
        }
        growths.push(ThermalDisplacementState::new(growth, channel, live)?);
    }
    Ok(growths)
}

fn growth_health(growth: &ThermalDisplacementState) -> ThermalHealth {
    ThermalHealth {
        name: growth.spec.name.clone(),
        expansion: growth.spec.expansion,
        status: growth.status(),
        input: growth.input().map(str::to_owned),
        value: growth.value().unwrap_or(0.0),
        share: growth.share(),
        std: growth.spec.std,
    }
}

#[cfg(test)]
mod tests;
