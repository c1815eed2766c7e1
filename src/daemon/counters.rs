//! Counting for the status and for `counters.json` ([`volcomp_state::counters`]), which the [`super::state_writer`]
//! saves.

use volcomp_state::counters::{Counters, Recalled, RetainedState};

use super::channels::CycleRecord;
use super::status::Lifetime;
use volcomp_engine::fault::Code;
use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};
use volcomp_units::{arcsec_from_rad, um_from_mm};

/// Counts for the status and the file.
#[derive(Debug)]
pub(super) struct Tally {
    /// What was there before this daemon, and the rare things since.
    base: Counters,
    file: Option<String>,
    note: Option<String>,
    axes: Vec<AxisName>,
    limited_cycles: [u64; MAX_AXES],
    largest: AxisArray,
    cycle_s: f64,
}

impl Tally {
    /// Counts on from what the run before has left; `file` is where it is kept.
    pub(super) fn open(
        recalled: Option<&Recalled>,
        file: Option<String>,
        machine: &str,
        cycle_s: f64,
    ) -> Self {
        let (mut base, note) = match recalled {
            None => {
                (Counters::new(machine), Some("no state directory: counted since the start only".to_owned()))
            }
            Some(Recalled::First) => (Counters::new(machine), None),
            Some(Recalled::Known(found)) => (Counters::clone(found), None),
            Some(Recalled::Unknown(why)) => {
                let mut base = Counters::new(machine);
                base.retained.hold = Some(unknown(why));
                let code = Code::COUNTERS_DAMAGED;
                (base, Some(format!("{code}: {why}; counters restart at zero")))
            }
        };
        base.starts = base.starts.saturating_add(1);
        let (limited_cycles, largest) = ([0; MAX_AXES], [0.0; MAX_AXES]);
        Self { base, file, note, axes: Vec::new(), limited_cycles, largest, cycle_s }
    }

    /// What a restart must not undo.
    pub(super) const fn retained(&self) -> &RetainedState {
        &self.base.retained
    }

    /// The same, to change it.
    pub(super) const fn retained_mut(&mut self) -> &mut RetainedState {
        &mut self.base.retained
    }

    /// What was wrong with the file.
    pub(super) fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// The axes of the records that follow.
    pub(super) fn set_axes(&mut self, axes: Vec<AxisName>) {
        if axes != self.axes {
            self.settle();
            self.axes = axes;
        }
    }

    pub(super) fn record(&mut self, record: &CycleRecord) {
        for k in 0..self.axes.len().min(MAX_AXES) {
            self.limited_cycles[k] += u64::from(record.limited >> k & 1);
            self.largest[k] = self.largest[k].max(record.offset[k].abs());
        }
    }

    pub(super) fn enabled(&mut self) {
        self.base.enables = self.base.enables.saturating_add(1);
    }

    /// Counts a fault under its number or name.
    pub(super) fn fault(&mut self, name: &str) {
        let count = self.base.faults.entry(name.to_owned()).or_default();
        *count = count.saturating_add(1);
    }

    /// Moves what was counted by wire index to the names of the axes.
    fn settle(&mut self) {
        for (k, axis) in self.axes.iter().enumerate().take(MAX_AXES) {
            let letter = axis.lower().to_string();
            let limited = std::mem::take(&mut self.limited_cycles[k]);
            if limited > 0 {
                *self.base.limited_s.entry(letter.clone()).or_default() += limited as f64 * self.cycle_s;
            }
            let largest = std::mem::take(&mut self.largest[k]);
            let (map, value) = match axis.kind() {
                AxisKind::Linear => (&mut self.base.largest_um, um_from_mm(largest)),
                AxisKind::Rotary => (&mut self.base.largest_arcsec, arcsec_from_rad(largest)),
            };
            let known = map.entry(letter).or_default();
            *known = known.max(value);
        }
    }

    /// Everything counted; `cycles` and `late` are those of this daemon.
    pub(super) fn counters(&mut self, cycles: u64, late: u64) -> Counters {
        self.settle();
        let mut counters = self.base.clone();
        counters.cycles = counters.cycles.saturating_add(cycles);
        counters.late_cycles = counters.late_cycles.saturating_add(late);
        counters
    }

    /// The same for the status.
    pub(super) fn lifetime(&mut self, cycles: u64, late: u64) -> Lifetime {
        let Counters {
            since,
            starts,
            cycles,
            late_cycles,
            enables,
            faults,
            limited_s,
            largest_um,
            largest_arcsec,
            ..
        } = self.counters(cycles, late);
        Lifetime {
            since,
            starts,
            cycles,
            late_cycles,
            enables,
            faults,
            limited_s,
            largest_um,
            largest_arcsec,
            audit_lines_lost: 0,
            file: self.file.clone(),
            note: self.note.clone(),
        }
    }
}

/// Words for an unknown state.
pub(super) fn unknown(why: &str) -> String {
    format!("state unknown: {why}; enable compensation to lift this")
}

#[cfg(test)]
mod tests {
    use volcomp_state::counters::recall;
    use volcomp_state::disk::real;

    use super::*;
    use volcomp_engine::State;

    fn record(limited: u8, x_mm: f64) -> CycleRecord {
        let mut offset = [0.0; MAX_AXES];
        offset[0] = x_mm;
        CycleRecord {
            answered: true,
            state: State::Active,
            limited,
            offset,
            wanted: offset,
            applied: offset,
            ..CycleRecord::default()
        }
    }

    #[test]
    fn what_was_counted_is_counted_on_after_a_restart() {
        let dir = tempfile::tempdir().expect("directory");
        let open = || Tally::open(Some(&recall(&*real(), dir.path(), "m")), None, "m", 1e-3);
        let mut first = open();
        assert_eq!(first.note(), None);
        first.set_axes(vec![AxisName::X, AxisName::C]);
        first.record(&record(0b11, -0.012));
        first.record(&record(0b01, 0.003));
        first.enabled();
        first.fault("read-back");
        first.counters(100, 3).save(&*real(), dir.path()).expect("saved");

        let mut second = open();
        second.set_axes(vec![AxisName::C, AxisName::X]);
        second.record(&record(0b10, 0.0));
        second.fault("read-back");
        let all = second.lifetime(50, 1);
        assert_eq!((all.starts, all.cycles, all.late_cycles, all.enables), (2, 150, 4, 1));
        assert_eq!(all.faults["read-back"], 2);
        assert!((all.limited_s["x"] - 3e-3).abs() < 1e-12 && (all.limited_s["c"] - 1e-3).abs() < 1e-12);
        assert!((all.largest_um["x"] - 12.0).abs() < 1e-9 && all.largest_arcsec["c"] == 0.0);
        assert_eq!(second.lifetime(50, 1), all, "asking changes nothing");
    }

    #[test]
    fn an_unknown_state_is_told_and_held() {
        let unknown = Recalled::Unknown("counters.json: EOF".to_owned());
        let tally = Tally::open(Some(&unknown), None, "m", 1e-3);
        assert!(tally.note().expect("told").starts_with("VC-7003: counters.json: EOF"));
        let objection = tally.retained().objection().expect("held");
        assert!(objection.starts_with("state unknown: counters.json: EOF"), "{objection}");
    }
}
