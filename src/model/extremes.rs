//! The largest deviations and corrections in the working volume of a model.

use crate::axes::{AxisName, Travel};
use crate::search::Volume;
use crate::{AxisCorrection, Deviation, ErrorFunction, Model, ModelSpec, Pose};

/// What is to be as large as possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Goal {
    Position,
    Rotation,
    /// The correction of one axis of the chain.
    Offset(usize),
}

/// A pose with what the model says there.
#[derive(Debug, Clone, Copy)]
pub struct Extreme {
    /// The pose.
    pub pose: Pose,
    /// Deviation of the tool there.
    pub deviation: Deviation,
    /// Correction of the axes there.
    pub correction: AxisCorrection,
}

/// What the search found.
#[derive(Debug)]
pub struct Found {
    /// Largest position error.
    pub position: Extreme,
    /// Largest error of orientation.
    pub rotation: Extreme,
    /// Largest correction of every axis of the chain; none for a spindle.
    pub offsets: Vec<Option<Extreme>>,
    /// Root mean square of the position error over the grid, mm.
    pub rms: f64,
    /// Poses evaluated.
    pub poses: u64,
}

/// Searches the volume; `progress` receives how many of how many steps are done.
#[must_use]
pub fn search(spec: &ModelSpec, model: &Model, mut progress: impl FnMut(u64, u64)) -> Found {
    let axes = spec.chain.axes();
    let mut goals = vec![Goal::Position, Goal::Rotation];
    goals.extend((0..axes.len()).filter(|&k| !axes[k].spindle).map(Goal::Offset));
    let (mut sum, mut count) = (0.0, 0u64);
    let found = Volume::of(spec).search(
        &goals,
        |pose| {
            let (deviation, correction) = model.correct(pose);
            Extreme { pose: *pose, deviation, correction }
        },
        Goal::of,
        |at, done, of| {
            sum += at.deviation.position.norm_squared();
            count = done;
            if done % 1024 == 0 {
                progress(done, of);
            }
        },
    );
    let of = |goal: Goal| goals.iter().position(|g| *g == goal).map(|i| found.best[i]);
    Found {
        position: found.best[0],
        rotation: found.best[1],
        offsets: (0..axes.len()).map(|k| of(Goal::Offset(k))).collect(),
        rms: (sum / count as f64).sqrt(),
        poses: found.poses,
    }
}

impl Goal {
    fn of(self, at: &Extreme) -> f64 {
        match self {
            Self::Position => at.deviation.position.norm(),
            Self::Rotation => at.deviation.rotation.norm(),
            Self::Offset(k) => at.correction.offset[k].abs(),
        }
    }
}

/// The axes that the search keeps at zero, because nothing says how far they go.
#[must_use]
pub fn kept_in_place(spec: &ModelSpec) -> Vec<AxisName> {
    let axes = spec.chain.axes().iter();
    axes.filter(|a| !a.spindle && spec.domain(a.name).is_none()).map(|a| a.name).collect()
}

/// Bounds of an error: curves sampled, extremes of grids and largest values of dynamic terms added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The range that its curves were made for; `None` where they hold everywhere.
    pub range: Option<[f64; 2]>,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
}

impl Bounds {
    const SAMPLES: u32 = 2000;

    /// The bounds of a function, over the travel of its axis where it holds everywhere.
    #[must_use]
    pub fn of(function: &ErrorFunction, travel: Option<[f64; 2]>) -> Self {
        let ranges = function.curves.iter().filter_map(|c| c.range());
        let range = ranges.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        let [start, end] = range.or(travel).unwrap_or([0.0, 0.0]);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..=Self::SAMPLES {
            let x = start + (end - start) * f64::from(i) / f64::from(Self::SAMPLES);
            for travel in [Travel::Forward, Travel::Reverse] {
                let v = function.value(x, travel);
                (low, high) = (low.min(v), high.max(v));
            }
        }
        // the extremes of a grid stand at its points
        for grid in &function.grids {
            low += grid.values().iter().copied().fold(f64::INFINITY, f64::min);
            high += grid.values().iter().copied().fold(f64::NEG_INFINITY, f64::max);
        }
        for term in &function.dynamics {
            let bound = term.bound([start, end]);
            low -= bound;
            high += bound;
        }
        Self { range, low, high }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{ErrorFunction, Fourier, Interpolation, Table};
    use crate::{AxisSpec, Chain, Curve, ErrorSymbol, Sense};

    fn spec() -> ModelSpec {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y t]").unwrap());
        for axis in [AxisName::X, AxisName::Y] {
            spec.axes.push(AxisSpec { travel: Some([0.0, 400.0]), ..AxisSpec::new(axis) });
        }
        spec
    }

    fn add(spec: &mut ModelSpec, symbol: &str, curve: Curve) {
        spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), ErrorFunction::single(curve)));
    }

    #[test]
    fn the_crest_of_a_short_wave_is_found() {
        let mut spec = spec();
        let wave = Fourier::new(0.0, 400.0, 37.0, 0.0, 0.001, &[], &[0.005]).unwrap();
        add(&mut spec, "exx", Curve::Fourier(wave.clone()));
        add(&mut spec, "ec0y", Curve::Constant(1e-5));
        let model = Model::new(&spec).unwrap();
        let found = search(&spec, &model, |_, _| {});
        // positive waves against -C0Y y, negative ones with it: the worst stands at y = 400
        let lowest = (0..=400_000).map(|i| wave.value(f64::from(i) * 1e-3)).fold(f64::INFINITY, f64::min);
        let expected = lowest - 1e-5 * 400.0;
        assert!((found.position.deviation.position.x - expected).abs() < 1e-9);
        assert!((found.position.pose.position[1] - 400.0).abs() < 1e-9);
        let x = found.offsets[0].unwrap();
        assert!((x.correction.offset[0] + expected).abs() < 1e-9);
        assert!(found.rms > 0.0 && found.rms < -expected);
    }

    #[test]
    fn both_directions_of_travel_are_searched() {
        let mut spec = spec();
        let table =
            Table::new(vec![0.0, 400.0], vec![0.001, 0.002], Some(vec![0.0, -0.009]), Interpolation::Linear);
        add(&mut spec, "exx", Curve::Table(table.unwrap()));
        let model = Model::new(&spec).unwrap();
        let worst = search(&spec, &model, |_, _| {}).position;
        assert_eq!(worst.pose.travel[0], Travel::Reverse);
        assert!((worst.deviation.position.x + 0.009).abs() < 1e-12);
    }

    #[test]
    fn without_travel_the_range_of_the_curves_is_searched() {
        let mut spec = ModelSpec::new("m", Chain::parse("[w X' b Y t]").unwrap());
        spec.axes.push(AxisSpec { sense: Sense::Carriage, ..AxisSpec::new(AxisName::X) });
        let table = Table::new(vec![0.0, 200.0, 300.0], vec![0.0, -0.02, 0.06], None, Interpolation::Linear);
        add(&mut spec, "exx", Curve::Table(table.unwrap()));
        let worst = search(&spec, &Model::new(&spec).unwrap(), |_, _| {}).position;
        assert!((worst.deviation.position.norm() - 0.06).abs() < 1e-12);
        // the carriage of a workpiece-side axis goes the other way
        assert_eq!((worst.pose.position[0], kept_in_place(&spec)), (-300.0, vec![AxisName::Y]));
    }

    #[test]
    fn a_model_without_travel_is_looked_at_where_it_stands() {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X C (S) t]").unwrap());
        add(&mut spec, "exx", Curve::Constant(0.003));
        let found = search(&spec, &Model::new(&spec).unwrap(), |_, _| {});
        assert!((found.position.deviation.position.x - 0.003).abs() < 1e-15);
        assert!(found.offsets[2].is_none());
        assert_eq!(kept_in_place(&spec), [AxisName::X, AxisName::C]);
    }
}
