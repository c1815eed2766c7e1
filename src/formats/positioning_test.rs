//! A positioning test as its file gives it: readings in the order measured, the line of each, and times where there are any.

use crate::prelude::*;

/// A positioning test, in the order in which it was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct PositioningTest {
    /// Linear (mm) or rotary (rad), from the unit of the file.
    pub kind: AxisKind,
    /// In the order measured, as far as the file tells ([`order`](Self::order)); `value` is the deviation.
    pub readings: Vec<Reading>,
    /// Line of each reading in its file, from 1.
    pub lines: Vec<u64>,
    /// Time of each reading, s; empty where the file has none.
    pub times_s: Vec<f64>,
    /// Source of the order.
    pub order: Order,
}

/// Source of the order of the readings of a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// The rows of the file.
    Rows,
    /// The file is sorted by target or direction: the standard test cycle of ISO 230-2 is assumed, cycle by cycle to the far
    /// end and back.
    StandardCycle,
}

impl PositioningTest {
    /// A test whose rows stand in the order measured.
    #[must_use]
    pub const fn new(kind: AxisKind, readings: Vec<Reading>, lines: Vec<u64>) -> Self {
        Self { kind, readings, lines, times_s: Vec::new(), order: Order::Rows }
    }

    /// Puts the readings into the order of the standard test cycle of ISO 230-2: cycle by cycle, the direction of the first
    /// reading first, each direction along its travel.
    #[must_use]
    pub fn in_standard_cycle(mut self) -> Self {
        let first = self.readings.first().map_or(Travel::Forward, |r| r.travel);
        let along = |r: &Reading| if r.travel == Travel::Reverse { -r.position } else { r.position };
        let mut order: Vec<usize> = (0..self.readings.len()).collect();
        order.sort_by(|a, b| {
            let (a, b) = (&self.readings[*a], &self.readings[*b]);
            (a.cycle, a.travel != first)
                .cmp(&(b.cycle, b.travel != first))
                .then(along(a).total_cmp(&along(b)))
        });
        if order.windows(2).all(|w| w[0] < w[1]) {
            return self;
        }
        fn moved<T: Copy>(values: &[T], order: &[usize]) -> Vec<T> {
            order.iter().filter_map(|i| values.get(*i).copied()).collect()
        }
        self.readings = moved(&self.readings, &order);
        self.lines = moved(&self.lines, &order);
        self.times_s = moved(&self.times_s, &order);
        self.order = Order::StandardCycle;
        self
    }

    /// The rows of a table: kept where their cycles never go back and each direction of a cycle is one pass, else put into the
    /// standard cycle, because rows sorted by target are in no order that a machine can run.
    #[must_use]
    pub fn of_rows(self) -> Self {
        // a table with times says itself in which order it was measured
        if self.times_s.is_empty() && self.is_regrouped() { self.in_standard_cycle() } else { self }
    }

    fn is_regrouped(&self) -> bool {
        let mut passes: BTreeSet<(u32, bool)> = BTreeSet::new();
        let mut last = None;
        let again = self.readings.iter().any(|r| {
            let pass = (r.cycle, r.travel == Travel::Reverse);
            let begins = last != Some(pass);
            last = Some(pass);
            begins && !passes.insert(pass)
        });
        again || self.readings.windows(2).any(|w| w[1].cycle < w[0].cycle)
    }

    /// Line of a reading in its file; 0 where it is not known.
    #[must_use]
    pub fn line(&self, reading: usize) -> u64 {
        self.lines.get(reading).copied().unwrap_or(0)
    }

    /// Keeps some of the readings.
    pub fn retain(&mut self, keep: impl Fn(&Reading) -> bool) {
        let kept: Vec<bool> = self.readings.iter().map(keep).collect();
        fn filter<T>(values: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            values.retain(|_| kept.next().is_some_and(|k| *k));
        }
        filter(&mut self.readings, &kept);
        filter(&mut self.lines, &kept);
        filter(&mut self.times_s, &kept);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn test(rows: &[(u32, Travel, f64)]) -> PositioningTest {
        let readings = rows
            .iter()
            .map(|(cycle, travel, position)| Reading {
                cycle: *cycle,
                travel: *travel,
                position: *position,
                value: 0.0,
            })
            .collect();
        PositioningTest::new(AxisKind::Linear, readings, (1..=rows.len() as u64).collect())
    }

    const F: Travel = Travel::Forward;
    const R: Travel = Travel::Reverse;

    #[test]
    fn rows_in_the_order_measured_stay() {
        let measured = [(1, F, 0.0), (1, F, 10.0), (1, R, 10.0), (1, R, 0.0), (2, F, 0.0), (2, F, 10.0)];
        let t = test(&measured).of_rows();
        assert_eq!((t.order, t.lines), (Order::Rows, vec![1, 2, 3, 4, 5, 6]));
        // a program that measures the far end first is no reason to sort
        let other = [(1, R, 10.0), (1, R, 0.0), (1, F, 0.0), (1, F, 10.0)];
        assert_eq!(test(&other).of_rows().lines, [1, 2, 3, 4]);
    }

    #[test]
    fn rows_sorted_by_target_are_put_into_the_standard_cycle() {
        let by_target = [
            (1, F, 0.0),
            (2, F, 0.0),
            (1, R, 0.0),
            (2, R, 0.0),
            (1, F, 10.0),
            (2, F, 10.0),
            (1, R, 10.0),
            (2, R, 10.0),
        ];
        let t = test(&by_target).of_rows();
        assert_eq!(t.order, Order::StandardCycle);
        assert_eq!(t.lines, [1, 5, 7, 3, 2, 6, 8, 4]);
        let timed = PositioningTest { times_s: (0..8).map(f64::from).collect(), ..test(&by_target) };
        assert_eq!(timed.of_rows().order, Order::Rows);
    }

    #[test]
    fn lines_follow_their_readings() {
        let mut t = test(&[(1, F, 0.0), (2, F, 0.0), (3, F, 0.0)]);
        t.retain(|r| r.cycle != 2);
        assert_eq!((t.lines.as_slice(), t.line(1), t.line(9)), (&[1, 3][..], 3, 0));
    }
}
