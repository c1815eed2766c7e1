//! The zero of the ball of an R-test: where the ball was centred, whatever the machine says there is fixed in the workpiece.

use std::collections::BTreeMap;

use super::super::moment::Moment;
use super::Session;
use volcomp_model::geometry::{Mat3, Vec3};

/// The reading at which each ball was centred, and the turn of the workpiece since.
#[derive(Debug, Clone, PartialEq)]
pub struct BallZero {
    /// Per reading: the row of its zero, and the rotation of the workpiece from there.
    rows: Vec<Option<(usize, Mat3)>>,
}

impl BallZero {
    /// The first reading of every set-up and target with the least turn of the table; `None` where no ball turns.
    #[must_use]
    pub fn of(session: &Session) -> Option<Self> {
        let machine = &session.machine;
        let turned = |m: &Moment| machine.table_axes().map(|a| m.position[a.slot()].abs()).sum::<f64>();
        let key = |i: usize| {
            let target = session.moments[i].target_mm;
            let known = target.iter().all(|v| v.is_finite()) && !session.moments[i].is_angular();
            known.then(|| (session.readings[i].setup, target.map(|v| (v * 1e3).round() as i64).into()))
        };
        let mut zero: BTreeMap<(usize, [i64; 3]), usize> = BTreeMap::new();
        for (i, m) in session.moments.iter().enumerate() {
            if let Some(key) = key(i) {
                let at = zero.entry(key).or_insert(i);
                if turned(m) < turned(&session.moments[*at]) {
                    *at = i;
                }
            }
        }
        let row = |i: usize| {
            let at = *zero.get(&key(i)?)?;
            Some((
                at,
                machine.table_turn(&session.moments[i])
                    * machine.table_turn(&session.moments[at]).transpose(),
            ))
        };
        let rows: Vec<Option<(usize, Mat3)>> = (0..session.moments.len()).map(row).collect();
        rows.iter().flatten().any(|(_, turn)| *turn != Mat3::identity()).then_some(Self { rows })
    }

    /// The row of the zero of a reading, and the rotation of the workpiece from there.
    #[must_use]
    pub fn at(&self, reading: usize) -> Option<(usize, Mat3)> {
        self.rows[reading]
    }

    /// A displacement at a reading, counted from the zero of its ball; `of` gives it at any row.
    pub(super) fn counted(&self, reading: usize, of: impl Fn(usize) -> Vec3) -> Vec3 {
        of(reading) - self.at(reading).map_or_else(Vec3::zeros, |(zero, turn)| turn * of(zero))
    }
}

impl Session {
    /// Counts all that the ball of an R-test shows from where it was centred; true where that is new and a ball turns.
    pub fn count_from_ball_zero(&mut self) -> bool {
        if self.ball_zero.is_some() {
            return false;
        }
        self.ball_zero = BallZero::of(self);
        self.ball_zero.is_some()
    }
}
