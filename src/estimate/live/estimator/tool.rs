//! A reading of the tool: when it was taken, where the machine stood, what it differs by, whether it is believed.

use super::super::map::MapState;
use super::super::reading::Reading;
use super::super::rows::Expected;
use super::super::sensor::{SensorState, Stage, judged};
use super::super::spec::SensorKind;
use super::LiveEstimator;
use crate::{NodePlace, Row, SensorFault, Window, whiten};
use volcomp_model::Pose;
use volcomp_model::units::MonoTime;

/// Half of the time over which the speed at a reading is taken, s.
pub(super) const SPEED_S: f64 = 5e-3;

/// Where rows belong.
type Placed<'a> = (&'a NodePlace, &'a [Row]);

impl LiveEstimator {
    /// True where no other sensor that feeds the map is on probation.
    fn others_have_proven(&self, now: MonoTime, sensor: usize, map: usize) -> bool {
        let mut others = self.sensors.iter().enumerate().filter(|(k, s)| {
            *k != sensor && s.spec.kind == SensorKind::Tool { map } && s.stage == Stage::Used
        });
        others.all(|(_, s)| s.probation.has_proven(now))
    }

    pub(super) fn on_tool(
        &mut self,
        now: MonoTime,
        sensor: usize,
        map: usize,
        when: (MonoTime, bool),
        reading: &Reading,
    ) {
        let live = self.live_values();
        let proven = self.others_have_proven(now, sensor, map);
        let (Some(state), Some(map)) = (self.sensors.get_mut(sensor), self.maps.get_mut(map)) else { return };
        let [delay, _] = map.map.delay(state.number);
        let at = when.0.plus_seconds(delay);
        let Some(sample) = self.history.at(at) else {
            state.without_position += 1;
            state.supervisor.hear(now);
            return;
        };
        let tool = |seconds: f64| {
            let sample = self.history.at(at.plus_seconds(seconds))?;
            let nominal =
                |position| self.model.nominal_tool(&Pose { tool_tip: sample.tool_tip, ..Pose::at(position) });
            Some((sample.at, [nominal(sample.actual), nominal(sample.commanded)]))
        };
        let mut expected = Expected::new(&self.model, &sample, &live, &map.channels);
        if let Some((from, to)) = tool(-SPEED_S).zip(tool(SPEED_S)) {
            expected = expected.moving(&from.1, &to.1, to.0.seconds_since(from.0));
        }
        let gap = expected.gap(&reading.body, state.std());
        if gap.reversed {
            state.refuse(now, SensorFault::Reversed);
            return;
        }
        if !state.judge(now, when, reading, &judged(&gap)) {
            return;
        }
        map.predict(at);
        let linear = self.linear.map(|k| k.map_or(0.0, |k| sample.commanded[k]));
        let place = map.map.place(linear);
        // while it is only looked at, what is stated is all that is known about its noise
        let used = state.stage == Stage::Used;
        let row = |row: &Row| {
            let share = if used { 1.0 / state.noise_factor(row.kind) } else { 1.0 };
            Row {
                weights: row.weights.map(|w| w * share),
                // the gap was taken at the delay known so far, which the filter estimates as a whole
                value: (row.value + row.delay * delay) * share,
                delay: row.delay * share,
                kind: row.kind,
            }
        };
        let rows: Vec<Row> = gap.rows.iter().map(row).collect();
        let Some(rows) = whiten(&rows, &gap.covariance) else {
            state.refuse(now, SensorFault::Range);
            return;
        };
        use_rows(now, state, map, proven, (&place, &rows));
    }
}

/// Rows of a plausible reading: looked at, or used where they agree. `proven` is true where every other sensor of the map
/// has proven itself.
fn use_rows(
    now: MonoTime,
    state: &mut SensorState,
    map: &mut MapState,
    proven: bool,
    (place, rows): Placed<'_>,
) {
    let gate = map.spec.gate;
    let samples = map.map.innovations(state.number, place, rows);
    if let Stage::Initialising(initialisation) = &mut state.stage {
        if state.probation.rests_s(now).is_some() {
            return;
        }
        let Some(assessment) = initialisation.add(&samples) else { return };
        if state.meet(now, &assessment, gate) {
            state.supervisor.reinstate(now);
            // what it is going to teach can be taken back
            if proven || !map.has_checkpoint() {
                map.begin_probation(now);
            }
        } else {
            state.supervisor.exclude(now, SensorFault::Disagrees);
            map.alarm.get_or_insert(now);
        }
        return;
    }
    let mut noise = state.relative_noise();
    let batch = map.map.judge(state.number, place, rows, &noise);
    state.note(&batch);
    if batch.rows == 0 {
        return;
    }
    if !map.map.is_inside_gate(&batch) {
        state.readings[2] += 1;
        state.rejections += 1;
        if state.rejections >= map.spec.rejections_to_alarm {
            contradict(now, state, map, false);
        }
        return;
    }
    state.rejections = 0;
    let used = map.map.update(state.number, place, rows, &mut noise);
    let before = state.noise();
    state.learn_noise(&noise);
    state.note_used(&used);
    map.touched();
    match state.probation.used(now, &samples, before) {
        Window::Contradicts => contradict(now, state, map, true),
        Window::Quiet if proven => {
            if let Some(for_s) = state.probation.right_for_s(now) {
                map.seems_right(now, for_s);
            }
        }
        Window::Open | Window::Quiet | Window::Suspicious => {}
    }
}

/// A sensor in use contradicts its map.
fn contradict(now: MonoTime, state: &mut SensorState, map: &mut MapState, persists: bool) {
    // of one that has proven itself nothing was learned that was beyond the gate
    let taught_wrong = persists || !state.probation.has_proven(now);
    state.probation.contradicts(now, persists);
    state.supervisor.exclude(now, SensorFault::Disagrees);
    state.get_to_know();
    if taught_wrong {
        map.take_back(now);
    }
    map.alarm.get_or_insert(now);
}
