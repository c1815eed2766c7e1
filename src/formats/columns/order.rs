//! Direction and cycle of a positioning test from the order of its positions.
//!
//! A position is approached from the one before it. Two rows begin a new pass, whose direction is that of its next
//! row: one at the same position as the row before (an end target read twice, with an overrun between), and one behind
//! a jump back that is longer than the next step (a return without readings). Cycles count the passes that go the
//! way of the first.

use volcomp_units::axes::Travel;

/// A reading with its direction and cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// The position.
    pub position: f64,
    /// The value.
    pub value: f64,
    /// From 1 up.
    pub cycle: u32,
    /// How the position was approached.
    pub travel: Travel,
    /// False where nothing tells the direction: the position is that of the row before, and the rows do not turn back here.
    pub is_certain: bool,
}

/// Steps behind a jump are shorter than the jump by at least this factor.
const JUMP: f64 = 1.5;

/// A row whose direction waits for the next one.
#[derive(Debug, Clone, Copy)]
struct Pending {
    position: f64,
    value: f64,
    cycle: Option<u32>,
    travel: Option<Travel>,
}

/// Finds directions and cycles with one row of delay.
#[derive(Debug, Default)]
pub struct Runs {
    before: Option<f64>,
    pending: Option<Pending>,
    first: Option<Travel>,
    last: Option<Travel>,
    /// The row before was the first.
    is_at_start: bool,
    cycle: u32,
}

impl Runs {
    /// Takes a row whose cycle or direction is known.
    pub fn push(
        &mut self,
        position: f64,
        value: f64,
        cycle: Option<u32>,
        travel: Option<Travel>,
    ) -> Option<Placed> {
        let placed = self.pending.map(|p| self.place(&p, Some(position)));
        if let Some(p) = self.pending.replace(Pending { position, value, cycle, travel }) {
            self.before = Some(p.position);
        }
        placed
    }

    /// Gives the last row.
    pub fn finish(&mut self) -> Option<Placed> {
        let pending = self.pending.take()?;
        Some(self.place(&pending, None))
    }

    fn place(&mut self, row: &Pending, next: Option<f64>) -> Placed {
        let Pending { position, value, .. } = *row;
        let came = self.before.map_or(0.0, |b| position - b);
        let goes = next.map_or(0.0, |n| n - position);
        let jump = came * goes < 0.0 && came.abs() > JUMP * goes.abs();
        let begins = came == 0.0 || jump;
        let step = if begins && goes != 0.0 { goes } else { came };
        let derived = match step {
            s if s > 0.0 => Travel::Forward,
            s if s < 0.0 => Travel::Reverse,
            // the same position over and over: nothing says how it was approached
            _ => self.last.unwrap_or_default(),
        };
        let travel = row.travel.unwrap_or(derived);
        // an end target is read twice where the rows turn back behind it; more readings of a position, or two on the way, were
        // approached from where the rows do not say (step cycle)
        let turns = goes != 0.0 && self.last.is_none_or(|last| last != derived || self.is_at_start);
        let is_certain =
            row.travel.is_some() || came != 0.0 || self.before.is_none() || turns || next.is_none();
        self.is_at_start = self.before.is_none();
        let first = *self.first.get_or_insert(travel);
        if travel == first && (self.last != Some(travel) || jump) {
            self.cycle += 1;
        }
        self.last = Some(travel);
        Placed { position, value, cycle: row.cycle.unwrap_or(self.cycle), travel, is_certain }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(positions: &[f64]) -> Vec<(u32, i8)> {
        let mut runs = Runs::default();
        let mut found: Vec<Placed> =
            positions.iter().filter_map(|p| runs.push(*p, 0.0, None, None)).collect();
        found.extend(runs.finish());
        assert!(found.iter().map(|p| p.position).eq(positions.iter().copied()));
        found.iter().map(|p| (p.cycle, if p.travel == Travel::Forward { 1 } else { -1 })).collect()
    }

    #[test]
    fn the_linear_cycle_of_the_standard() {
        let found = runs(&[0.0, 10.0, 20.0, 20.0, 10.0, 0.0, 0.0, 10.0, 20.0, 20.0, 10.0, 0.0]);
        let expected = [[(1, 1); 3], [(1, -1); 3], [(2, 1); 3], [(2, -1); 3]].concat();
        assert_eq!(found, expected);
    }

    #[test]
    fn passes_in_one_direction() {
        assert_eq!(runs(&[0.0, 10.0, 20.0, 0.0, 10.0, 20.0]), [[(1, 1); 3], [(2, 1); 3]].concat());
        assert_eq!(runs(&[20.0, 10.0, 0.0, 20.0, 10.0, 0.0]), [[(1, -1); 3], [(2, -1); 3]].concat());
    }

    #[test]
    fn a_step_cycle_does_not_tell_its_directions() {
        let uncertain = |positions: &[f64]| -> Vec<usize> {
            let mut runs = Runs::default();
            let mut found: Vec<Placed> =
                positions.iter().filter_map(|p| runs.push(*p, 0.0, None, None)).collect();
            found.extend(runs.finish());
            (0..found.len()).filter(|i| !found[*i].is_certain).collect()
        };
        assert_eq!(uncertain(&[0.0, 0.0, 0.0, 0.0, 10.0, 10.0, 10.0, 10.0]), [1, 2, 3, 5, 6]);
        assert_eq!(uncertain(&[0.0, 0.0, 10.0, 10.0, 20.0, 20.0]), [3]);
        // linear cycles, the ends read once or twice, and passes in one direction
        assert!(uncertain(&[0.0, 10.0, 20.0, 20.0, 10.0, 0.0, 0.0, 10.0, 20.0, 20.0, 10.0, 0.0]).is_empty());
        assert!(uncertain(&[0.0, 10.0, 20.0, 10.0, 0.0, 10.0, 20.0]).is_empty());
        assert!(uncertain(&[0.0, 10.0, 20.0, 0.0, 10.0, 20.0]).is_empty());
        assert!(uncertain(&[20.0, 10.0, 0.0, 0.0, 10.0, 20.0]).is_empty());
    }

    #[test]
    fn end_targets_read_once() {
        assert_eq!(runs(&[0.0, 10.0, 20.0, 10.0, 0.0]), [(1, 1), (1, 1), (1, 1), (1, -1), (1, -1)]);
        assert_eq!(runs(&[5.0]), [(1, 1)]);
        assert!(runs(&[]).is_empty());
    }
}
