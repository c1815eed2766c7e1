//! One step: least squares of the motions of one axis, with what the steps before left uncertain.

use crate::prelude::*;

use super::effects::{self, Effects};
use super::{
    Chain, Consistency, Found, GrinderError, Measured, Motion, Request, Row, SetUp, Shares, Smoothed, Worst,
    write_into,
};
use volcomp_model::Pose;
use volcomp_model::statistics::SIGNIFICANT;

/// Condition number above which the motions of a position are refused (equations 5.1).
const CONDITION_LIMIT: f64 = 1e3;
/// Coordinates closer than this share of the range are one position.
const SAME_POSITION: f64 = 1e-9;
/// An axis that moves by more than this is not at rest, mm or rad.
const REST: f64 = 1e-9;
/// Share of a location's effect that must be left beside the set-up for it to be found.
const LOCATION_SHARE: f64 = 1e-2;
/// Squared share of a location's effect at the reference position, beside the set-up, above which it is seen there.
const SEEN_AT_REFERENCE: f64 = 1e-12;

/// A step with the model and the covariance after it.
pub(super) struct Solved {
    pub(super) found: Found,
    pub(super) spec: ModelSpec,
    pub(super) covariance: DMatrix<f64>,
    /// By what the uncertainties of each step before were enlarged.
    pub(super) enlarged: Vec<f64>,
}

/// One scalar reading: its row and direction in W.
#[derive(Clone, Copy)]
struct Scalar {
    row: usize,
    direction: usize,
}

/// The problem of a step, ready for solving.
struct Problem<'a> {
    measured: &'a Measured,
    spec: ModelSpec,
    positions: Vec<f64>,
    reference: usize,
    /// Position of each row.
    group: Vec<usize>,
    scalars: Vec<Scalar>,
    /// Effects of the motions, three rows per row of the data.
    motions: Vec<nalgebra::Matrix3xX<f64>>,
    /// Nominal tip in W of each row, about the mean of the reference position.
    tips: Vec<Vec3>,
    set_up: SetUp,
    /// What is left to explain, one per scalar.
    left: DVector<f64>,
}

pub(super) fn solve(chain: &Chain, measured: &Measured, request: &Request) -> Result<Solved, GrinderError> {
    check_axes(chain, measured, request)?;
    let symbols = effects::motions(measured.axis, &request.components);
    let mut problem = Problem::new(chain, measured, &symbols)?;
    let condition = problem.check_positions(symbols.len())?;
    let mut locations = problem.locate()?;
    let design = problem.design();
    let unknowns = symbols.len() * (problem.positions.len() - 1);
    let (q, r) = design.clone().qr().unpack();
    let inverse =
        r.clone().try_inverse().ok_or_else(|| problem.undetermined(problem.reference, 0, f64::INFINITY))?;
    let gain = &inverse * q.transpose();
    let solution = &gain * &problem.left;
    let residuals = &problem.left - &design * &solution;
    let dof = problem.scalars.len() - design.ncols();
    let gain = gain.rows(0, unknowns).into_owned();
    // what the steps before left uncertain, seen in the readings and in the solution
    let before = problem.before(chain)?;
    let sum = residuals.norm_squared();
    let visible = before.transpose() * (&before - &q * (q.transpose() * &before));
    // covariance of the residuals that the steps before bring in: its trace, and that of its square
    let inherited_part = &chain.covariance * &visible;
    let unexplained = inherited_part.trace();
    let rigid = problem.rigidity();
    let estimated = match rigid {
        Some((squares, free)) => Some((squares / free as f64).sqrt()),
        None => (dof > 0).then(|| {
            let own = (sum - unexplained) / dof as f64;
            (if own > 0.0 { own } else { sum / dof as f64 }).sqrt()
        }),
    };
    let sigma = request.sigma.or(estimated);
    let p_value =
        request.sigma.zip(rigid).map(|(s, (squares, free))| chi_square_upper(squares / (s * s), free));
    let readings = problem.scalars.len() as f64;
    let noise = Noise { sigma: request.sigma, rigid, estimated };
    let consistency = noise.consistency(sum, dof, &inherited_part);
    let enlarged = consistency.map_or(1.0, |c| c.enlarged);
    let steps_before = chain.steps.len();
    // tips that disagree within a pose accuse the readings, and no axis before
    let own_fault = p_value.is_some_and(|p| p < SIGNIFICANT);
    let moved = problem.moving(chain);
    let enlarged_before: Vec<f64> =
        (0..steps_before).map(|k| if moved[k] && !own_fault { enlarged } else { 1.0 }).collect();
    let worst = problem.worst(&residuals);
    let expected = sigma.map(|s| ((s * s * dof as f64 + unexplained) / readings).sqrt());
    let own = &gain * gain.transpose() * sigma.unwrap_or(0.0).powi(2);
    let through = -(&gain * &before);
    let cross = &through * &chain.covariance;
    let inherited = &cross * through.transpose();
    for location in &mut locations {
        location.2 *= sigma.unwrap_or(0.0) * enlarged;
    }
    // every step by its own factor
    let factors: Vec<f64> = chain
        .steps
        .iter()
        .zip(&enlarged_before)
        .flat_map(|(s, f)| vec![*f; s.motions.len() * (s.positions.len() - 1)])
        .collect();
    let factors = DVector::from_vec(factors);
    let old = chain.covariance.component_mul(&(&factors * factors.transpose()));
    let cross = DMatrix::from_fn(cross.nrows(), cross.ncols(), |i, j| cross[(i, j)] * enlarged * factors[j]);
    let [own, inherited] = [own, inherited].map(|m| m * enlarged.powi(2));
    let mut found = Found {
        axis: measured.axis,
        positions: problem.positions.clone(),
        reference: problem.reference,
        motions: Vec::new(),
        locations,
        set_up: problem.set_up,
        readings: problem.scalars.len(),
        dof,
        rms: (sum / readings).sqrt(),
        expected_rms: expected,
        sigma,
        p_value,
        consistency,
        worst,
        tip: Shares::default(),
        chain: 0.0,
        condition,
    };
    found.motions = motions(&symbols, &found, &solution, &own, &inherited);
    let covariance = joined(&old, &cross, &(&own + &inherited));
    found.tip = tip_shares(&problem.spec, &found, &symbols, &own, &inherited)?;
    let mut spec = problem.spec.clone();
    write_into(&mut spec, &mut found, request.curves)?;
    found.chain = chain_share(&spec, chain, &found, measured, &covariance)?;
    Ok(Solved { found, spec, covariance, enlarged: enlarged_before })
}

/// What is known of the noise of a reading.
struct Noise {
    /// Stated, mm.
    sigma: Option<f64>,
    /// Squares and degrees of freedom of the tips of a pose.
    rigid: Option<(f64, usize)>,
    /// From the readings, mm.
    estimated: Option<f64>,
}

impl Noise {
    /// Tests the squares `sum` of `dof` degrees of freedom. The squares expected come from noise and from the steps before,
    /// whose part has few degrees of freedom of its own: the effective ones by Welch and Satterthwaite.
    fn consistency(&self, sum: f64, dof: usize, inherited: &DMatrix<f64>) -> Option<Consistency> {
        let below = match (self.sigma, self.rigid) {
            (Some(_), _) => None,
            (None, Some((_, free))) => Some(free),
            // the noise was taken from these squares
            (None, None) => return None,
        };
        let variance = self.sigma.or(self.estimated)?.powi(2);
        let trace = inherited.trace();
        let expected = variance * dof as f64 + trace;
        let squares =
            variance * variance * dof as f64 + 2.0 * variance * trace + (inherited * inherited).trace();
        if dof == 0 || expected <= 0.0 || squares <= 0.0 {
            return None;
        }
        let effective = (expected * expected / squares).floor().max(1.0);
        let ratio = sum / expected;
        let p_value = match below {
            None => chi_square_upper(ratio * effective, effective as usize),
            Some(free) => f_upper(ratio, effective as usize, free),
        };
        let factor = ratio.sqrt();
        let enlarged = if p_value < SIGNIFICANT { factor.max(1.0) } else { 1.0 };
        Some(Consistency { p_value, factor, enlarged })
    }
}

fn check_axes(chain: &Chain, measured: &Measured, request: &Request) -> Result<(), GrinderError> {
    let axis = measured.axis;
    if chain.spec.chain.index_of(axis).is_none() {
        return Err(GrinderError::NotInChain { axis });
    }
    if chain.steps.iter().any(|s| s.axis == axis) {
        return Err(GrinderError::Twice { axis });
    }
    if request.components.is_empty() {
        return Err(GrinderError::NoComponent { axis });
    }
    for (k, other) in chain.spec.chain.axes().iter().enumerate() {
        let known = other.name == axis || chain.steps.iter().any(|s| s.axis == other.name);
        let at = measured.rows.iter().map(|r| r.position[k]);
        let by = at.clone().fold(f64::NEG_INFINITY, f64::max) - at.fold(f64::INFINITY, f64::min);
        if !known && by > REST {
            let (by, unit) = outside(other.name, by);
            return Err(GrinderError::MovesTooEarly { axis, moving: other.name, by, unit });
        }
    }
    Ok(())
}

/// A coordinate for a message.
fn outside(axis: AxisName, value: f64) -> (f64, &'static str) {
    (axis.kind().position_out(value), axis.kind().position_unit())
}

impl<'a> Problem<'a> {
    fn new(chain: &Chain, measured: &'a Measured, symbols: &[ErrorSymbol]) -> Result<Self, GrinderError> {
        let axis = measured.axis;
        let mut spec = chain.spec.clone();
        spec.errors.retain(|(s, _)| s.axis() != axis || matches!(s, ErrorSymbol::Squareness { .. }));
        let index = spec.chain.index_of(axis).ok_or(GrinderError::NotInChain { axis })?;
        let (positions, group) = grouped(measured, index);
        if positions.len() < 2 {
            return Err(GrinderError::TooFewPositions { axis, found: positions.len() });
        }
        let reference = nearest_to_zero(&positions);
        let scalars: Vec<Scalar> = measured
            .rows
            .iter()
            .enumerate()
            .flat_map(|(row, r)| {
                (0..3).filter(|i| r.deviation[*i].is_some()).map(move |direction| Scalar { row, direction })
            })
            .collect();
        let (model, corrected) = (Model::new(&spec)?, effects::of_corrections(&spec)?);
        let left = |s: &Scalar| {
            let row = &measured.rows[s.row];
            let pose = Pose { tool_tip: Some(row.tip), ..Pose::at(row.position) };
            let columns = corrected.at(row);
            let moved: f64 =
                (0..columns.ncols()).map(|k| columns[(s.direction, k)] * row.correction[k]).sum();
            row.deviation[s.direction].unwrap_or(0.0) - model.deviation(&pose).position[s.direction] - moved
        };
        let left = DVector::from_iterator(scalars.len(), scalars.iter().map(left));
        let of_motions = Effects::new(&spec, symbols)?;
        let motions = measured.rows.iter().map(|row| of_motions.at(row)).collect();
        let mut tips: Vec<Vec3> =
            measured.rows.iter().map(|r| effects::nominal_tip(&spec, &r.position, &r.tip)).collect();
        let at_reference: Vec<Vec3> =
            tips.iter().zip(&group).filter(|(_, g)| **g == reference).map(|(t, _)| *t).collect();
        let mean = at_reference.iter().sum::<Vec3>() / at_reference.len() as f64;
        for tip in &mut tips {
            *tip -= mean;
        }
        let mut problem = Self {
            measured,
            spec,
            positions,
            reference,
            group,
            scalars,
            motions,
            tips,
            set_up: SetUp::Rigid,
            left,
        };
        problem.choose_set_up()?;
        Ok(problem)
    }

    /// The artefact's turn is unknown where the readings at the reference position can show it.
    fn choose_set_up(&mut self) -> Result<(), GrinderError> {
        let at_reference = self.scalars_at(self.reference);
        let columns = DMatrix::from_fn(at_reference.len(), 6, |i, j| {
            let s = at_reference[i];
            effects::set_up(&self.tips[s.row])[(s.direction, j)]
        });
        let (rank, _) = rank_and_condition(&columns);
        if rank == 6 {
            return Ok(());
        }
        self.set_up = SetUp::ShiftOnly;
        let seen = |list: &[Scalar], i: usize| list.iter().any(|s| s.direction == i);
        for (i, missing) in ["dx is", "dy is", "dz is"].into_iter().enumerate() {
            if seen(&self.scalars, i) && !seen(&at_reference, i) {
                let (position, _) = outside(self.measured.axis, self.positions[self.reference]);
                return Err(GrinderError::NoReference { axis: self.measured.axis, missing, position });
            }
        }
        Ok(())
    }

    fn scalars_at(&self, position: usize) -> Vec<Scalar> {
        self.scalars.iter().filter(|s| self.group[s.row] == position).copied().collect()
    }

    /// Refuses positions whose readings do not determine the motions; the worst condition number of the others.
    fn check_positions(&self, unknowns: usize) -> Result<f64, GrinderError> {
        let mut worst = 1.0f64;
        for position in (0..self.positions.len()).filter(|p| *p != self.reference) {
            let scalars = self.scalars_at(position);
            let here: Vec<&Vec3> = scalars.iter().map(|s| &self.tips[s.row]).collect();
            let mean = here.iter().copied().sum::<Vec3>() / here.len().max(1) as f64;
            let columns = DMatrix::from_fn(scalars.len(), unknowns, |i, j| {
                let s = scalars[i];
                if unknowns == 6 {
                    // all six motions are any rigid motion: about the middle of the tips it shows its real rank
                    effects::set_up(&(self.tips[s.row] - mean))[(s.direction, j)]
                } else {
                    self.motions[s.row][(s.direction, j)]
                }
            });
            let (rank, condition) = rank_and_condition(&columns);
            if rank < unknowns {
                return Err(self.undetermined(position, rank, condition));
            }
            worst = worst.max(condition);
        }
        Ok(worst)
    }

    fn undetermined(&self, position: usize, rank: usize, condition: f64) -> GrinderError {
        let axis = self.measured.axis;
        let (position, _) = outside(axis, self.positions[position]);
        let unknowns = self.motions.first().map_or(0, nalgebra::Matrix3xX::ncols);
        GrinderError::Undetermined { axis, position, rank, unknowns, condition, limit: CONDITION_LIMIT }
    }

    fn set_up_columns(&self) -> Vec<usize> {
        match self.set_up {
            SetUp::Rigid => (0..6).collect(),
            SetUp::ShiftOnly => (0..3).filter(|i| self.scalars.iter().any(|s| s.direction == *i)).collect(),
        }
    }

    fn set_up_design(&self) -> DMatrix<f64> {
        let wanted = self.set_up_columns();
        DMatrix::from_fn(self.scalars.len(), wanted.len(), |i, j| {
            let s = self.scalars[i];
            effects::set_up(&self.tips[s.row])[(s.direction, wanted[j])]
        })
    }

    /// The average line of a rotary axis: what of its deviations turns with it, beside the set-up. What cannot be
    /// distinguished from the set-up stays zero; the motions take what is left, so nothing is lost. Subtracts what it finds.
    fn locate(&mut self) -> Result<Vec<(ErrorSymbol, f64, f64)>, GrinderError> {
        let symbols = effects::locations(self.measured.axis);
        // with some motions taken for zero, what they do would be called location
        if symbols.is_empty() || self.motions.first().is_some_and(|m| m.ncols() < 6) {
            return Ok(Vec::new());
        }
        let effects = Effects::new(&self.spec, &symbols)?;
        let rows: Vec<_> = self.measured.rows.iter().map(|r| effects.at(r)).collect();
        let columns = DMatrix::from_fn(self.scalars.len(), symbols.len(), |i, j| {
            let s = self.scalars[i];
            rows[s.row][(s.direction, j)]
        });
        let norms: Vec<f64> = columns.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
        let unit = DMatrix::from_fn(columns.nrows(), columns.ncols(), |i, j| columns[(i, j)] / norms[j]);
        let free = self.free_at_reference(&unit);
        let (q, _) = self.set_up_design().qr().unpack();
        let beside = &unit * &free;
        let beside = &beside - &q * (q.transpose() * &beside);
        let wanted = &self.left - &q * (q.transpose() * &self.left);
        let svd = jacobi::svd(&beside);
        let mut scaled = DVector::zeros(symbols.len());
        let mut variance = DVector::<f64>::zeros(symbols.len());
        for (k, size) in svd.values.iter().enumerate().filter(|(_, s)| **s > LOCATION_SHARE) {
            let direction = &free * svd.v.column(k);
            scaled += &direction * (svd.u.column(k).dot(&wanted) / size);
            variance += direction.map(|v| (v / size).powi(2));
        }
        let values: Vec<f64> = scaled.iter().zip(&norms).map(|(v, n)| v / n).collect();
        self.left -= &columns * DVector::from_column_slice(&values);
        let std = variance.iter().zip(&norms).map(|(v, n)| v.sqrt() / n);
        let all = symbols.into_iter().zip(values).zip(std).map(|((s, v), d)| (s, v, d));
        Ok(all.filter(|(_, v, _)| *v != 0.0).collect())
    }

    /// Mixtures of columns that the readings at the reference position cannot tell from the set-up. Only these are
    /// free to choose: the others are what the steps before have already settled (a tool-side axis is tied to its
    /// location, so that its place is a constant).
    fn free_at_reference(&self, unit: &DMatrix<f64>) -> DMatrix<f64> {
        let here: Vec<usize> =
            (0..self.scalars.len()).filter(|i| self.group[self.scalars[*i].row] == self.reference).collect();
        let set_up = self.set_up_design().select_rows(&here);
        let (q, _) = set_up.qr().unpack();
        let columns = unit.select_rows(&here);
        let seen = &columns - &q * (q.transpose() * &columns);
        let svd = jacobi::svd(&seen);
        let free: Vec<usize> =
            (0..unit.ncols()).filter(|k| svd.values[*k].powi(2) < SEEN_AT_REFERENCE).collect();
        svd.v.select_columns(&free)
    }

    /// Motions at every position but the reference, then the set-up.
    fn design(&self) -> DMatrix<f64> {
        let components = self.motions.first().map_or(0, nalgebra::Matrix3xX::ncols);
        let unknowns = components * (self.positions.len() - 1);
        let set_up = self.set_up_design();
        DMatrix::from_fn(self.scalars.len(), unknowns + set_up.ncols(), |i, j| {
            let s = self.scalars[i];
            if j >= unknowns {
                return set_up[(i, j - unknowns)];
            }
            let before = j / components;
            let position = before + usize::from(before >= self.reference);
            if self.group[s.row] == position {
                self.motions[s.row][(s.direction, j % components)]
            } else {
                0.0
            }
        })
    }

    /// Squares and degrees of freedom of what no rigid motion explains, pose by pose: errors of axes are rigid, so this
    /// is noise (or tips that are not where they are said to be) and nothing of the steps before. `None` without any.
    fn rigidity(&self) -> Option<(f64, usize)> {
        let rows = &self.measured.rows;
        let (mut squares, mut free, mut start) = (0.0, 0, 0);
        while start < self.scalars.len() {
            let at = rows[self.scalars[start].row].position;
            let count = self.scalars[start..].iter().take_while(|s| rows[s.row].position == at).count();
            let here = &self.scalars[start..start + count];
            let mean = here.iter().map(|s| self.tips[s.row]).sum::<Vec3>() / count as f64;
            let columns = DMatrix::from_fn(count, 6, |i, j| {
                effects::set_up(&(self.tips[here[i].row] - mean))[(here[i].direction, j)]
            });
            let left = DVector::from_fn(count, |i, _| self.left[start + i]);
            let svd = jacobi::svd(&columns);
            let limit = svd.values[0] / CONDITION_LIMIT;
            let kept: Vec<usize> = (0..6).filter(|k| svd.values[*k] > limit).collect();
            let explained: f64 = kept.iter().map(|k| svd.u.column(*k).dot(&left).powi(2)).sum();
            squares += left.norm_squared() - explained;
            free += count - kept.len();
            start += count;
        }
        (free > 0).then_some((squares.max(0.0), free))
    }

    /// Which axes of the steps before moved in this one.
    fn moving(&self, chain: &Chain) -> Vec<bool> {
        let moves = |found: &Found| {
            let Some(k) = self.spec.chain.index_of(found.axis) else { return false };
            let mut at = self.measured.rows.iter().map(|r| r.position[k]);
            let first = at.next().unwrap_or(0.0);
            at.any(|q| (q - first).abs() > REST)
        };
        chain.steps.iter().map(moves).collect()
    }

    /// The reading with the largest residual.
    fn worst(&self, residuals: &DVector<f64>) -> Worst {
        let at = residuals.iamax();
        let Scalar { row, direction } = self.scalars[at];
        Worst { row, direction, residual: residuals[at] }
    }

    /// Effect of all motions found before on the readings.
    fn before(&self, chain: &Chain) -> Result<DMatrix<f64>, GrinderError> {
        let effects = effects_of(&self.spec, &chain.steps)?;
        let rows: Vec<DMatrix<f64>> = self
            .measured
            .rows
            .iter()
            .map(|r| effects::of_found(&self.spec, &chain.steps, &effects, r))
            .collect();
        Ok(DMatrix::from_fn(self.scalars.len(), chain.covariance.ncols(), |i, j| {
            let s = self.scalars[i];
            rows[s.row][(s.direction, j)]
        }))
    }
}

fn effects_of(spec: &ModelSpec, steps: &[Found]) -> Result<Vec<Effects>, GrinderError> {
    let one = |found: &Found| {
        let symbols: Vec<ErrorSymbol> = found.motions.iter().map(|m| m.symbol).collect();
        Ok(Effects::new(spec, &symbols)?)
    };
    steps.iter().map(one).collect()
}

/// The distinct coordinates of an axis, increasing, and the one of each row.
fn grouped(measured: &Measured, index: usize) -> (Vec<f64>, Vec<usize>) {
    let mut all: Vec<f64> = measured.rows.iter().map(|r| r.position[index]).collect();
    all.sort_by(f64::total_cmp);
    let span = all.last().zip(all.first()).map_or(0.0, |(b, a)| b - a);
    let same = SAME_POSITION * span;
    all.dedup_by(|b, a| *b - *a <= same);
    let place = |r: &Row| all.partition_point(|p| *p < r.position[index] - same).min(all.len() - 1);
    let group = measured.rows.iter().map(place).collect();
    (all, group)
}

fn nearest_to_zero(positions: &[f64]) -> usize {
    let nearest = positions.iter().enumerate().min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    nearest.map_or(0, |(i, _)| i)
}

/// Rank (singular values above the largest over the limit) and condition number of columns brought to equal length.
fn rank_and_condition(columns: &DMatrix<f64>) -> (usize, f64) {
    if columns.nrows() == 0 {
        return (0, f64::INFINITY);
    }
    let mut scaled = columns.clone();
    for mut column in scaled.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    let svd = jacobi::svd(&scaled);
    let limit = svd.values[0] / CONDITION_LIMIT;
    let rank = svd.values.iter().filter(|v| **v > limit).count();
    (rank, if columns.nrows() >= columns.ncols() { svd.condition() } else { f64::INFINITY })
}

/// The values at every position with their uncertainty.
fn motions(
    symbols: &[ErrorSymbol],
    found: &Found,
    solution: &DVector<f64>,
    own: &DMatrix<f64>,
    inherited: &DMatrix<f64>,
) -> Vec<Motion> {
    let width = symbols.len();
    let one = |c: usize, symbol: &ErrorSymbol| {
        let at =
            |p: usize| (p != found.reference).then(|| (p - usize::from(p > found.reference)) * width + c);
        let values = (0..found.positions.len()).map(|p| at(p).map_or(0.0, |j| solution[j])).collect();
        let share = |p: usize| {
            at(p).map_or(Shares::default(), |j| Shares {
                own: own[(j, j)].max(0.0).sqrt(),
                inherited: inherited[(j, j)].max(0.0).sqrt(),
            })
        };
        let std = (0..found.positions.len()).map(share).collect();
        Motion { symbol: *symbol, values, std, smoothing: Smoothed::NONE }
    };
    symbols.iter().enumerate().map(|(c, s)| one(c, s)).collect()
}

/// Uncertainty of the model's own tip while only this axis moves: root mean square over its positions.
fn tip_shares(
    spec: &ModelSpec,
    found: &Found,
    symbols: &[ErrorSymbol],
    own: &DMatrix<f64>,
    inherited: &DMatrix<f64>,
) -> Result<Shares, GrinderError> {
    let effects = Effects::new(spec, symbols)?;
    let index = spec.chain.index_of(found.axis).unwrap_or(0);
    let mut sums = [0.0; 2];
    for (p, q) in found.positions.iter().enumerate() {
        let Some(start) = found.column_of(p) else { continue };
        let mut row =
            Row { position: [0.0; 8], correction: [0.0; 8], tip: spec.tool_tip, deviation: [None; 3] };
        row.position[index] = *q;
        let columns = effects.at(&row);
        for (sum, covariance) in sums.iter_mut().zip([own, inherited]) {
            let block = covariance.view((start, start), (symbols.len(), symbols.len()));
            *sum += (&columns * block * columns.transpose()).trace().max(0.0);
        }
    }
    let count = (found.positions.len() - 1) as f64;
    Ok(Shares { own: (sums[0] / count).sqrt(), inherited: (sums[1] / count).sqrt() })
}

/// Uncertainty of the tip from everything found so far, over the poses of the step.
fn chain_share(
    spec: &ModelSpec,
    chain: &Chain,
    found: &Found,
    measured: &Measured,
    covariance: &DMatrix<f64>,
) -> Result<f64, GrinderError> {
    let mut steps = chain.steps.clone();
    steps.push(found.clone());
    let effects = effects_of(spec, &steps)?;
    let sum: f64 = measured
        .rows
        .iter()
        .map(|row| {
            let columns = effects::of_found(spec, &steps, &effects, row);
            (&columns * covariance * columns.transpose()).trace().max(0.0)
        })
        .sum();
    Ok((sum / measured.rows.len() as f64).sqrt())
}

/// The covariance with one more step.
fn joined(before: &DMatrix<f64>, cross: &DMatrix<f64>, own: &DMatrix<f64>) -> DMatrix<f64> {
    let (m, n) = (before.nrows(), own.nrows());
    let mut all = DMatrix::zeros(m + n, m + n);
    all.view_mut((0, 0), (m, m)).copy_from(before);
    all.view_mut((m, m), (n, n)).copy_from(own);
    all.view_mut((m, 0), (n, m)).copy_from(cross);
    all.view_mut((0, m), (m, n)).copy_from(&cross.transpose());
    all
}
