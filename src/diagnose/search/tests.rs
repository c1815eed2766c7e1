//! The search on columns made up here.

use nalgebra::DVector;

use super::super::library::{Kind, Label, Library, Shape, Variant};
use super::super::moment::Axis;
use super::{Problem, Selection};

const N: usize = 400;

fn wave(f: impl Fn(f64) -> f64) -> DVector<f64> {
    DVector::from_fn(N, |i, _| f(2.0 * i as f64 / (N - 1) as f64 - 1.0))
}

/// A table of three degrees, a worn place and a scale of X; the columns stand for what the shapes would give.
fn library() -> (Library, Vec<Vec<DVector<f64>>>) {
    let axis = Axis::ALL[0];
    let label = |effect| Label { effect, subject: "x".to_owned() };
    let shapes = [
        Shape::Polynomial { along: axis, over: axis, low: 2, high: 4, centre_mm: 0.0, half_mm: 1.0 },
        Shape::Wear { axis, centre_mm: 0.3, width_mm: 0.1 },
        Shape::Scale { axis },
    ];
    let variants = shapes.into_iter().enumerate().map(|(label, shape)| Variant { label, shape }).collect();
    let library = Library {
        labels: ["positioning", "wear", "scale"].map(label).to_vec(),
        kinds: vec![Kind::Machine; 3],
        variants,
        blind: Vec::new(),
    };
    let worn = wave(|x| (-((x - 0.3) / 0.1).powi(2) / 2.0).exp());
    let table = (2..=4).map(|n| wave(|x| x.powi(n) - x.powi(n - 2))).collect();
    (library, vec![table, vec![worn], vec![wave(|x| x)]])
}

fn chosen(y: impl Fn(f64) -> f64) -> Selection {
    let (library, columns) = library();
    // noise of about 1, the same on every run
    let noise = DVector::from_fn(N, |i, _| 1.4 * (1.3 * (i * i) as f64).sin());
    let mut problem = Problem::made_up(&columns, wave(y) + noise);
    let mut selection =
        Selection { chosen: Vec::new(), threshold: 10.0, grid: vec![1; 3], ..Selection::default() };
    selection.search(&mut problem, &library);
    selection.single_out(&mut problem, &library);
    selection
}

fn bump(x: f64) -> f64 {
    (-((x - 0.3) / 0.1).powi(2) / 2.0).exp()
}

#[test]
fn a_worn_place_beside_hardly_any_table_keeps_its_name() {
    let s = chosen(|x| 60.0 * bump(x) + 14.0 * (x * x * x - x));
    assert_eq!((s.chosen, s.one_curve), (vec![1], vec![(1, 0)]));
}

#[test]
fn a_table_takes_a_worn_place_in() {
    let s = chosen(|x| 15.0 * bump(x) + 60.0 * (x * x * x - x));
    assert_eq!((s.chosen, s.one_curve), (vec![0], vec![(0, 1)]));
}

#[test]
fn a_scale_is_its_own_cause_from_a_tenth_of_a_table_on() {
    let mut both = chosen(|x| 60.0 * (x * x * x - x) + 40.0 * x).chosen;
    both.sort_unstable();
    assert_eq!(both, [0, 2]);
    assert_eq!(chosen(|x| 60.0 * (x * x * x - x) + 5.0 * x).chosen, [0]);
}
