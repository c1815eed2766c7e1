//! The largest deviations and corrections in the working volume of a model.

use crate::quantities::position_unit;
use volcomp_model::search::Volume;
use volcomp_model::{AxisCorrection, Deviation, Model, ModelSpec, Pose};

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
pub(super) struct Extreme {
    pub(super) pose: Pose,
    pub(super) deviation: Deviation,
    pub(super) correction: AxisCorrection,
}

/// What the search found.
#[derive(Debug)]
pub(super) struct Found {
    /// Largest position error.
    pub(super) position: Extreme,
    /// Largest error of orientation.
    pub(super) rotation: Extreme,
    /// Largest correction of every axis of the chain; none for a spindle.
    pub(super) offsets: Vec<Option<Extreme>>,
    /// Root mean square of the position error over the grid, mm.
    pub(super) rms: f64,
    /// Poses evaluated.
    pub(super) poses: u64,
}

/// Searches the volume; `progress` receives how many of how many steps are done.
pub(super) fn search(spec: &ModelSpec, model: &Model, mut progress: impl FnMut(u64, u64)) -> Found {
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

/// The axes that the search keeps in place, because nothing says how far they go.
pub(super) fn kept_in_place(spec: &ModelSpec) -> Vec<String> {
    let axes = spec.chain.axes().iter();
    axes.filter(|a| !a.spindle && spec.domain(a.name).is_none())
        .map(|a| format!("{} at 0 {}", a.name, position_unit(a.name)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::curve::{ErrorFunction, Fourier, Interpolation, Table};
    use volcomp_model::{AxisSpec, Chain, Curve, ErrorSymbol, Sense};
    use volcomp_units::axes::{AxisName, Travel};

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
        assert_eq!((worst.pose.position[0], kept_in_place(&spec)), (-300.0, vec!["Y at 0 mm".to_owned()]));
    }

    #[test]
    fn a_model_without_travel_is_looked_at_where_it_stands() {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X C (S) t]").unwrap());
        add(&mut spec, "exx", Curve::Constant(0.003));
        let found = search(&spec, &Model::new(&spec).unwrap(), |_, _| {});
        assert!((found.position.deviation.position.x - 0.003).abs() < 1e-15);
        assert!(found.offsets[2].is_none());
        assert_eq!(kept_in_place(&spec), ["X at 0 mm", "C at 0 deg"]);
    }
}
