//! What the cycle evaluates: live values as a function of position, made beside the cycle and handed over whole.
//!
//! A table has a time to live: where its maker dies or hangs, the cycle stops telling values, and the engine fades to
//! the static model. It carries the hash of the model it was made for; for another one it says nothing. Where a new
//! table differs from the old one, the difference of the two at one and the same position is taken over smoothly: a
//! table that says the same changes nothing, however fast the axes move.

use std::sync::Arc;

use crate::NodeGrid;
use volcomp_model::SENSORS_MAX;
use volcomp_model::units::MonoTime;

/// Where a live value comes from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Source {
    /// From nowhere: the engine takes its part back.
    #[default]
    None,
    /// A number of a sensor, as it is; it counts from the arrival of the reading that it is from.
    Value {
        /// The number, mm or rad.
        value: f64,
        /// When that reading arrived.
        heard: MonoTime,
    },
    /// A number that changes slowly: where a new table has another one, it is taken over smoothly.
    Smooth(f64),
    /// A component of a map.
    Map {
        /// Index in [`LiveTable::maps`].
        map: usize,
        /// Its component.
        component: usize,
    },
}

/// Values on the nodes of a grid, components one after the other.
#[derive(Debug, Clone, PartialEq)]
pub struct TableMap {
    /// The nodes.
    pub grid: NodeGrid,
    /// The values, mm or rad.
    pub values: Vec<f64>,
}

/// Live values as a function of position.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveTable {
    /// BLAKE3 of the model it was made for.
    pub model: [u8; 32],
    /// When it was made.
    pub made: MonoTime,
    /// One per live value of the model.
    pub sources: [Source; SENSORS_MAX],
    /// The maps.
    pub maps: Vec<Arc<TableMap>>,
}

/// Tables older than this are not used, s.
pub const TABLE_LIFE_S: f64 = 2.0;
/// Time over which the difference between two tables is taken over, s.
const BLEND_S: f64 = 0.5;
/// Interval of evaluation, s: at 1 m/s the position changes by 10 mm, a map by nothing to speak of.
const INTERVAL_S: f64 = 0.01;

/// The cycle's end. Holds the table in use and gives the old one back, so that nothing is freed on the cycle.
#[derive(Debug, Clone, Default)]
pub struct LiveEvaluator {
    table: Option<Arc<LiveTable>>,
    /// What is left of the difference between the last table and this one.
    carry: [f64; SENSORS_MAX],
    /// Bit k: value k was sent last time, and differences are taken over smoothly.
    smooth: u32,
    next: Option<MonoTime>,
    since: MonoTime,
}

/// Values that were worked out: bit k of `told` for value k.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Told {
    /// Which.
    pub told: u32,
    /// The values, mm or rad.
    pub values: [f64; SENSORS_MAX],
    /// When the reading of each arrived; now for what maps and growths tell.
    pub heard: [MonoTime; SENSORS_MAX],
}

impl LiveEvaluator {
    /// A new table, with the axes at a position (X, Y, Z in mm); gives the old one back.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn swap(&mut self, table: Option<Arc<LiveTable>>, position: [f64; 3]) -> Option<Arc<LiveTable>> {
        self.next = None;
        let old = core::mem::replace(&mut self.table, table);
        match (old.as_deref(), self.table.as_deref()) {
            (Some(old), Some(new)) if old.model == new.model => {
                for (k, carry) in self.carry.iter_mut().enumerate().filter(|(k, _)| self.smooth >> k & 1 == 1)
                {
                    if let Some((before, now)) = old.smooth(k, position).zip(new.smooth(k, position)) {
                        *carry += before - now;
                    }
                }
            }
            _ => self.smooth = 0,
        }
        old
    }

    /// The values at a position (X, Y, Z in mm), where they are due; `model` is the hash of the model in use.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn evaluate(&mut self, now: MonoTime, model: &[u8; 32], position: [f64; 3]) -> Option<Told> {
        if self.next.is_some_and(|next| now < next) {
            return None;
        }
        let table = self.table.as_deref()?;
        self.next = Some(now.plus_seconds(INTERVAL_S));
        let dt = now.seconds_since(self.since).clamp(0.0, BLEND_S);
        self.since = now;
        if table.model != *model || now.seconds_since(table.made) > TABLE_LIFE_S {
            self.smooth = 0;
            return None;
        }
        let mut out = Told { told: 0, values: [0.0; SENSORS_MAX], heard: [now; SENSORS_MAX] };
        let mut smooth = 0;
        let keep = 1.0 - dt / BLEND_S;
        for (k, source) in table.sources.iter().enumerate() {
            let value = if let Source::Value { value, heard } = source {
                out.heard[k] = *heard;
                *value
            } else {
                let Some(value) = table.smooth(k, position) else { continue };
                let carry = if self.smooth >> k & 1 == 1 { self.carry[k] * keep } else { 0.0 };
                self.carry[k] = carry;
                smooth |= 1 << k;
                value + carry
            };
            if value.is_finite() {
                out.told |= 1 << k;
                out.values[k] = value;
            } else {
                smooth &= !(1 << k);
            }
        }
        self.smooth = smooth;
        Some(out)
    }
}

impl LiveTable {
    /// Value `k` where it is one that is taken over smoothly.
    fn smooth(&self, k: usize, position: [f64; 3]) -> Option<f64> {
        match self.sources.get(k)? {
            Source::None | Source::Value { .. } => None,
            Source::Smooth(value) => Some(*value),
            Source::Map { map, component } => Some(self.maps.get(*map)?.value(*component, position)),
        }
    }
}

impl TableMap {
    fn value(&self, component: usize, position: [f64; 3]) -> f64 {
        let place = self.grid.place(position);
        let first = component * self.grid.nodes();
        let node = |(n, s): (&usize, &f64)| self.values.get(first + n).map_or(0.0, |v| s * v);
        place.nodes.iter().zip(&place.shape).map(node).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL: [u8; 32] = [7; 32];

    fn table(made_ms: i64, level: f64) -> Option<Arc<LiveTable>> {
        let grid = NodeGrid::new(vec![0.0, 100.0], vec![0.0, 100.0], vec![0.0, 100.0]).unwrap();
        // grows with x
        let values = (0..8).map(|n| level + grid.node(n)[0] * 1e-5).collect();
        let mut sources = [Source::None; SENSORS_MAX];
        sources[2] = Source::Map { map: 0, component: 0 };
        sources[4] = Source::Value { value: level, heard: at(made_ms - 30) };
        let maps = vec![Arc::new(TableMap { grid, values })];
        Some(Arc::new(LiveTable { model: MODEL, made: at(made_ms), sources, maps }))
    }

    fn at(ms: i64) -> MonoTime {
        MonoTime::from_ns(ms * 1_000_000)
    }

    #[test]
    fn values_follow_the_position_and_a_new_map_comes_smoothly() {
        let mut evaluator = LiveEvaluator::default();
        assert_eq!(evaluator.evaluate(at(0), &MODEL, [0.0; 3]), None);
        assert!(evaluator.swap(table(0, 1e-3), [0.0; 3]).is_none());
        let first = evaluator.evaluate(at(0), &MODEL, [50.0; 3]).unwrap();
        assert_eq!(first.told, 1 << 2 | 1 << 4);
        assert!((first.values[2] - 1.5e-3).abs() < 1e-15 && first.values[4] == 1e-3);
        assert_eq!((first.heard[2], first.heard[4]), (at(0), at(-30)), "a value is as old as its reading");
        assert_eq!(evaluator.evaluate(at(5), &MODEL, [50.0; 3]), None, "not due");
        assert!(evaluator.swap(table(10, 2e-3), [50.0; 3]).is_some(), "the old one comes back");
        let mut last = first.values[2];
        for ms in 10..2000 {
            let Some(told) = evaluator.evaluate(at(ms), &MODEL, [50.0; 3]) else { continue };
            assert!((told.values[2] - last).abs() < 1e-3 * 0.03, "{ms}: {} {last}", told.values[2]);
            last = told.values[2];
        }
        assert!((last - 2.5e-3).abs() < 3e-5, "{last}");
    }

    #[test]
    fn tables_that_say_the_same_change_nothing_while_the_axes_move() {
        let mut evaluator = LiveEvaluator::default();
        let mut worst = 0.0f64;
        for ms in 0..2000 {
            // 100 mm/s along the slope of the map, a new table every 50 ms
            let x = 100.0 * (1.0 - (ms as f64 * 1e-3 - 1.0).abs());
            let position = [x, 50.0, 50.0];
            if ms % 50 == 0 {
                evaluator.swap(table(ms, 1e-3), position);
            }
            let Some(told) = evaluator.evaluate(at(ms), &MODEL, position) else { continue };
            worst = worst.max((told.values[2] - (1e-3 + x * 1e-5)).abs());
        }
        assert!(worst < 1e-15, "{worst:e} mm");
    }

    #[test]
    fn several_tables_between_two_evaluations_come_as_one() {
        let mut evaluator = LiveEvaluator::default();
        evaluator.swap(table(0, 1e-3), [0.0; 3]);
        let before = evaluator.evaluate(at(0), &MODEL, [0.0; 3]).unwrap().values[2];
        for level in [5e-3, -4e-3, 2e-3] {
            evaluator.swap(table(10, level), [0.0; 3]);
        }
        let after = evaluator.evaluate(at(10), &MODEL, [0.0; 3]).unwrap().values[2];
        assert!((after - before).abs() < 1e-3 * 0.03, "{before} {after}");
    }

    #[test]
    fn a_growth_that_steps_comes_smoothly() {
        let mut evaluator = LiveEvaluator::default();
        let growth = |ms: i64, value: f64| {
            let mut table = table(ms, 0.0).map(|t| (*t).clone()).unwrap();
            table.sources[4] = Source::Smooth(value);
            Some(Arc::new(table))
        };
        evaluator.swap(growth(0, 1e-3), [0.0; 3]);
        assert!((evaluator.evaluate(at(0), &MODEL, [0.0; 3]).unwrap().values[4] - 1e-3).abs() < 1e-15);
        evaluator.swap(growth(10, 3e-3), [0.0; 3]);
        let mut last = 1e-3;
        for ms in (10..1990).step_by(10) {
            let value = evaluator.evaluate(at(ms), &MODEL, [0.0; 3]).unwrap().values[4];
            assert!(value >= last && value - last < 1e-4, "{ms}: {value} {last}");
            last = value;
        }
        assert!((last - 3e-3).abs() < 5e-5, "{last}");
    }

    #[test]
    fn a_table_that_is_old_or_of_another_model_says_nothing() {
        let mut evaluator = LiveEvaluator::default();
        evaluator.swap(table(0, 1e-3), [0.0; 3]);
        assert!(evaluator.evaluate(at(1990), &MODEL, [0.0; 3]).is_some());
        assert_eq!(evaluator.evaluate(at(2010), &MODEL, [0.0; 3]), None);
        evaluator.swap(table(2020, 1e-3), [0.0; 3]);
        assert_eq!(evaluator.evaluate(at(2020), &[8; 32], [0.0; 3]), None);
        assert!(evaluator.evaluate(at(2031), &MODEL, [0.0; 3]).is_some());
        assert!(evaluator.swap(None, [0.0; 3]).is_some());
        assert_eq!(evaluator.evaluate(at(2050), &MODEL, [0.0; 3]), None);
    }
}
