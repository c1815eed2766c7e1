//! A map of the machine: its components in the model, its alarm, what is kept of it.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::health::{MapHealth, NodeHealth};
use super::spec::{LiveError, MapSpec};
use super::table::TableMap;
use crate::filter::COMPONENTS_MAX;
use crate::{Checkpoint, ComponentRules, LiveMap, MapRules, NodeGrid};
use volcomp_model::units::MonoTime;
use volcomp_model::{ErrorSymbol, Model};

/// Seconds in an hour.
const HOUR_S: f64 = 3600.0;
/// Interval in which a map without readings moves on, s.
const TICK_S: f64 = 0.1;
/// Time between two checkpoints as a share of the time for which the sensor was right, and its largest, s: what a sensor
/// taught is believed up to a while before it was found to be wrong, the shorter the less is known of it.
const CHECKPOINT_SHARE: f64 = 1.0 / 3.0;
const CHECKPOINT_MAX_S: f64 = 30.0;
/// A map counts as limited until it is below this share of its limit.
const LIMITED_UNTIL: f64 = 0.9;

/// A live value of the model with its symbol, where its name is `prefix.SYMBOL`.
pub(super) fn channels(model: &Model, prefix: &str) -> Result<Vec<(usize, ErrorSymbol)>, LiveError> {
    let mut found = Vec::new();
    for (k, channel) in model.sensors().iter().enumerate() {
        let Some((name, symbol)) = channel.rsplit_once('.').filter(|(name, _)| *name == prefix) else {
            continue;
        };
        let symbol = ErrorSymbol::parse(symbol).ok_or_else(|| LiveError::BadChannel {
            channel: channel.clone(),
            name: name.to_owned(),
            found: symbol.to_owned(),
        })?;
        found.push((k, symbol));
    }
    Ok(found)
}

/// What is kept of a map.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SavedMap {
    /// Its name.
    pub name: String,
    /// Its components.
    pub components: Vec<String>,
    /// Coordinates of its nodes along X, Y, Z.
    #[serde(rename = "nodes_mm")]
    pub nodes: [Vec<f64>; 3],
    /// Difference from the offline map and its standard deviation: components one after the other; mm or rad.
    pub values: Vec<(f64, f64)>,
    /// How much more than noise it was.
    pub evidence: f64,
}

/// How the sensors of a map stand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Feeding {
    /// One at least is used and believed.
    pub(super) agrees: bool,
    /// One at least is excluded because it contradicts the map.
    pub(super) disagrees: bool,
}

/// A map and how it stands.
#[derive(Debug, Clone)]
pub(super) struct MapState {
    pub(super) spec: MapSpec,
    pub(super) map: LiveMap,
    /// Live values of the model that are its components.
    pub(super) channels: Vec<usize>,
    symbols: Vec<ErrorSymbol>,
    predicted: Option<MonoTime>,
    ticked: Option<MonoTime>,
    pub(super) alarm: Option<MonoTime>,
    pub(super) is_static: bool,
    /// A sensor teaches it at present.
    pub(super) taught: bool,
    /// What was learned is larger than its limit.
    pub(super) limited: bool,
    pub(super) updates: u64,
    /// When it seemed right, and what it knew: what it goes back to, and what takes its place after that.
    checkpoints: [Option<(MonoTime, Checkpoint)>; 2],
    made: Option<Arc<TableMap>>,
}

impl MapState {
    pub(super) fn new(spec: &MapSpec, model: &Model) -> Result<Self, LiveError> {
        let map = spec.name.clone();
        let found = channels(model, &spec.name)?;
        if found.is_empty() {
            return Err(LiveError::NoChannel { map });
        }
        if found.len() > COMPONENTS_MAX {
            return Err(LiveError::TooManyChannels { map, found: found.len() });
        }
        let [x, y, z] = spec.nodes.clone();
        let grid = NodeGrid::new(x, y, z).map_err(|source| LiveError::Grid { map: map.clone(), source })?;
        let components = found
            .iter()
            .map(|(_, symbol)| {
                let unit = usize::from(symbol.is_angle());
                ComponentRules {
                    std: spec.std[unit],
                    variance_per_s: spec.drift_per_h[unit].powi(2) / HOUR_S,
                    limit: spec.limit[unit],
                }
            })
            .collect();
        let rules = MapRules {
            grid,
            components,
            correlation_mm: spec.correlation_mm,
            tau_s: spec.return_s,
            gate: spec.gate,
        };
        let (channels, symbols) = found.into_iter().unzip();
        Ok(Self {
            spec: spec.clone(),
            map: LiveMap::new(rules).map_err(|source| LiveError::Map { map, source })?,
            channels,
            symbols,
            predicted: None,
            ticked: None,
            alarm: None,
            is_static: false,
            taught: false,
            limited: false,
            updates: 0,
            checkpoints: [None, None],
            made: None,
        })
    }

    /// Time has passed. A covariance is large: between readings it moves on in steps.
    pub(super) fn tick(&mut self, now: MonoTime, status: &Feeding) {
        if self.ticked.is_none_or(|before| now.seconds_since(before) >= TICK_S) {
            self.ticked = Some(now);
            self.predict(now);
            let share = self.map.largest_share();
            self.limited = share > if self.limited { LIMITED_UNTIL } else { 1.0 };
        }
        self.taught = status.agrees;
        if status.agrees {
            self.is_static = false;
            // another sensor may still contradict it: that is told as long as it does
            self.alarm = self.alarm.filter(|_| status.disagrees);
        } else if self.alarm.is_some_and(|since| now.seconds_since(since) > self.spec.alarm_hold_s) {
            self.is_static = true;
        }
    }

    /// Lets time pass until `at`.
    pub(super) fn predict(&mut self, at: MonoTime) {
        let since = self.predicted.map_or(0.0, |before| at.seconds_since(before));
        if self.predicted.is_none() || since > 0.0 {
            self.map.predict(since);
            self.predicted = Some(at);
            self.made = None;
        }
    }

    /// It has changed: the next table holds it anew.
    pub(super) fn touched(&mut self) {
        self.updates += 1;
        self.made = None;
    }

    /// The map for the cycle.
    pub(super) fn table(&mut self) -> Arc<TableMap> {
        let map = &self.map;
        let make = || Arc::new(TableMap { grid: map.rules().grid.clone(), values: map.outputs().collect() });
        Arc::clone(self.made.get_or_insert_with(make))
    }

    /// A sensor begins to teach it: what it knows now is what it goes back to.
    pub(super) fn begin_probation(&mut self, now: MonoTime) {
        for slot in &mut self.checkpoints {
            let (at, checkpoint) = slot.get_or_insert_with(|| (now, Checkpoint::default()));
            *at = now;
            self.map.save_to(checkpoint);
        }
    }

    /// It seems right, and has for so long. What a sensor does wrong takes a while to show: it goes back to what it knew
    /// before that.
    pub(super) fn seems_right(&mut self, now: MonoTime, for_s: f64) {
        let [older, newer] = &mut self.checkpoints;
        let spacing_s = (for_s * CHECKPOINT_SHARE).min(CHECKPOINT_MAX_S);
        if newer.as_ref().is_none_or(|(at, _)| now.seconds_since(*at) >= spacing_s) {
            core::mem::swap(older, newer);
            let (at, checkpoint) = newer.get_or_insert_with(|| (now, Checkpoint::default()));
            *at = now;
            self.map.save_to(checkpoint);
        }
    }

    pub(super) const fn has_checkpoint(&self) -> bool {
        self.checkpoints[0].is_some()
    }

    /// What was learned since it seemed right is taken back.
    pub(super) fn take_back(&mut self, now: MonoTime) {
        if let Some((at, checkpoint)) = &self.checkpoints[0] {
            self.map.load(checkpoint, now.seconds_since(*at));
            (self.predicted, self.made) = (Some(now), None);
        }
    }

    pub(super) fn forget(&mut self) {
        self.checkpoints = [None, None];
        self.map.forget();
        (self.alarm, self.is_static, self.limited, self.made) = (None, false, false, None);
    }

    pub(super) fn kept(&self) -> SavedMap {
        SavedMap {
            name: self.spec.name.clone(),
            components: self.symbols.iter().map(|s| s.to_string().to_lowercase()).collect(),
            nodes: self.spec.nodes.clone(),
            values: self.map.nodes().collect(),
            evidence: self.map.evidence(),
        }
    }

    /// Puts back what was kept `age_s` ago; in words why not.
    pub(super) fn restore(&mut self, kept: &SavedMap, age_s: f64) -> Result<(), String> {
        let own = self.kept();
        if kept.components != own.components {
            return Err(format!(
                "components are {}, the model's are {}",
                kept.components.join(" "),
                own.components.join(" ")
            ));
        }
        if kept.nodes != own.nodes {
            return Err("its nodes are others than those of the machine file".to_owned());
        }
        if !self.map.restore(&kept.values, kept.evidence) {
            return Err("it has values that are not numbers or beyond the limits".to_owned());
        }
        self.map.predict(age_s.max(0.0));
        (self.checkpoints, self.made) = ([None, None], None);
        Ok(())
    }

    pub(super) fn health(&self) -> MapHealth {
        let grid = &self.map.rules().grid;
        let per = grid.nodes();
        let values: Vec<(f64, f64)> = self.map.nodes().collect();
        let used: Vec<f64> = self.map.outputs().collect();
        let components = self.symbols.len();
        let node = |n: usize| NodeHealth {
            position: grid.node(n),
            components: (0..components)
                .map(|c| [values[c * per + n].0, values[c * per + n].1, used[c * per + n]])
                .collect(),
        };
        MapHealth {
            name: self.spec.name.clone(),
            components: self.symbols.clone(),
            updates: self.updates,
            alarm: self.alarm.is_some(),
            is_static: self.is_static,
            taught: self.taught,
            limited: self.limited,
            idle_s: self.map.idle_s(),
            memory_s: self.map.memory_s(),
            weight: self.map.weight(),
            largest: used.chunks(per).map(|of| of.iter().fold(0.0, |m: f64, v| m.max(v.abs()))).collect(),
            nodes: (0..per).map(node).collect(),
        }
    }
}
