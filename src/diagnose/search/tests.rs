//! The search on columns made up here.

use nalgebra::DVector;

use super::super::library::{Kind, Label, Lever, Library, Shape, Variant, forms};
use super::super::machine_state::Machine;
use super::super::moment::Axis;
use super::super::noise::{ClassNoise, Filter};
use super::super::session::{History, Raw, Session};
use super::{Problem, Selection, one_of_two};

const N: usize = 400;

fn wave(f: impl Fn(f64) -> f64) -> DVector<f64> {
    DVector::from_fn(N, |i, _| f(2.0 * i as f64 / (N - 1) as f64 - 1.0))
}

/// A table of three degrees, a worn place and a scale of X; the columns stand for what the shapes would give.
fn library() -> (Library, Vec<Vec<DVector<f64>>>) {
    let axis = Axis::ALL[0];
    let label = |effect| Label { effect, subject: "x".to_owned() };
    let shapes = [
        Shape::Polynomial(forms::Polynomial {
            along: axis,
            over: axis,
            low: 2,
            high: 4,
            centre_mm: 0.0,
            half_mm: 1.0,
        }),
        Shape::Wear(forms::Wear { axis, centre_mm: 0.3, width_mm: 0.1, power: 2.0, order: None }),
        Shape::Scale(forms::Scale { axis }),
    ];
    let variants = shapes.into_iter().enumerate().map(|(label, shape)| Variant { label, shape }).collect();
    let library = Library {
        labels: ["positioning", "wear", "scale"].map(label).to_vec(),
        kinds: vec![Kind::Machine; 3],
        variants,
        ..Library::default()
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

/// A straightness without and with its slope, the squareness that is this slope, and an angular error: the same slope and a
/// bend through two levers by turns.
fn lines() -> (Library, Vec<Vec<DVector<f64>>>) {
    let (along, over) = (Axis::X, Axis::Z);
    let lever = Lever { axes: [false; 3], home_mm: [0.0; 3], tool: true };
    let curve = |low| {
        Shape::Polynomial(forms::Polynomial { along, over, low, high: 4, centre_mm: 0.0, half_mm: 1.0 })
    };
    let angle = Shape::Angular(forms::Angular {
        about: Axis::Y,
        over,
        degree: 2,
        half_mm: 1.0,
        centre_mm: None,
        lever,
    });
    let shapes =
        [(0, curve(2)), (0, curve(1)), (1, Shape::Squareness(forms::Squareness { along, over })), (2, angle)];
    let labels = [("straightness", "exz"), ("squareness", "zx"), ("angular", "ebz")];
    let library = Library {
        labels: labels.map(|(effect, subject)| Label { effect, subject: subject.to_owned() }).to_vec(),
        kinds: vec![Kind::Machine; 3],
        variants: shapes.map(|(label, shape)| Variant { label, shape }).to_vec(),
        ..Library::default()
    };
    let legendre: [fn(f64) -> f64; 4] = [
        |x| x,
        |x| 1.5 * x * x - 0.5,
        |x| 2.5 * x * x * x - 1.5 * x,
        |x| 4.375 * x.powi(4) - 3.75 * x * x + 0.375,
    ];
    let whole: Vec<_> = legendre.into_iter().map(wave).collect();
    let turns = |f: fn(f64) -> f64| DVector::from_fn(N, |i, _| wave(f)[i] * [1.4, 0.6][i % 2]);
    let columns = vec![
        whole[1..].to_vec(),
        whole.clone(),
        vec![whole[0].clone()],
        vec![turns(|x| x), turns(|x| x * x)],
    ];
    (library, columns)
}

fn by_lines(
    from: &[usize],
    y: impl Fn(usize, f64) -> f64,
    act: fn(&mut Selection, &mut Problem, &Library),
) -> Vec<usize> {
    let (library, columns) = lines();
    let at = wave(|x| x);
    let y = DVector::from_fn(N, |i, _| y(i, at[i]) + 1.4 * (1.3 * (i * i) as f64).sin());
    let mut problem = Problem::made_up(&columns, y);
    let mut selection =
        Selection { chosen: from.to_vec(), threshold: 10.0, grid: vec![2, 1, 1], ..Selection::default() };
    act(&mut selection, &mut problem, &library);
    selection.chosen
}

#[test]
fn an_angle_that_says_only_the_slope_of_a_straightness_is_that_slope() {
    let bow = |x: f64| 60.0 * (2.5 * x * x * x - 1.5 * x);
    assert_eq!(by_lines(&[3], |_, x| bow(x) - 60.0 * x, Selection::absorb), [1]);
    // one that acts through both levers stays, and so does a squareness larger than the straightness
    let lever = |i: usize, x: f64| bow(x) + 15.0 * x * [1.4, 0.6][i % 2];
    assert_eq!(by_lines(&[0, 3], lever, Selection::absorb), [0, 3]);
    let angle = |i: usize, x: f64| (60.0 * x * x - 50.0 * x) * [1.4, 0.6][i % 2];
    assert_eq!(by_lines(&[3], angle, Selection::absorb), [3]);
    assert_eq!(by_lines(&[0, 2], |_, x| bow(x) + 90.0 * x, Selection::absorb), [0, 2]);
}

#[test]
fn a_straightness_with_its_slope_is_weighed_again_in_two_parts() {
    assert_eq!(by_lines(&[1], |_, x| 60.0 * x, Selection::take_apart), [0, 2]);
    assert_eq!(by_lines(&[2, 1], |_, x| 60.0 * x, Selection::take_apart), [2, 0]);
}

/// What two shapes with these columns leave chosen, from the first on.
fn kept(
    shapes: Vec<(&'static str, Shape)>,
    columns: Vec<Vec<DVector<f64>>>,
    y: DVector<f64>,
    act: fn(&mut Selection, &mut Problem, &Library),
) -> Vec<&'static str> {
    let names: Vec<&'static str> = shapes.iter().map(|(name, _)| *name).collect();
    let library = Library {
        labels: names.iter().map(|effect| Label { effect, subject: String::new() }).collect(),
        kinds: vec![Kind::Machine; shapes.len()],
        variants: shapes
            .into_iter()
            .enumerate()
            .map(|(label, (_, shape))| Variant { label, shape })
            .collect(),
        ..Library::default()
    };
    let grid = vec![1; names.len()];
    let mut selection = Selection { chosen: vec![0], threshold: 10.0, grid, ..Selection::default() };
    let mut problem = Problem::made_up(&columns, y);
    act(&mut selection, &mut problem, &library);
    selection.chosen.iter().map(|v| names[*v]).collect()
}

#[test]
fn a_beam_that_turns_its_end_and_does_not_drop_is_no_beam() {
    let beam = Shape::Sag(forms::Sag {
        axis: Axis::Y,
        up: Axis::Z,
        start_mm: 0.0,
        length_mm: 500.0,
        tool: true,
        lever: None,
    });
    let said = |drop: f64| {
        let noise = DVector::from_fn(N, |i, _| 1.4 * (1.3 * (i * i) as f64).sin());
        let y = wave(|x| x * x) * drop + wave(|x| x) * 30.0 + noise;
        let columns = vec![vec![wave(|x| x * x), wave(|x| x)]];
        kept(vec![("sag", beam.clone())], columns, y, |s, p, l| s.expel(p, l))
    };
    assert_eq!(said(20.0), ["sag"]);
    assert!(said(0.0).is_empty());
}

/// A laser along X, four times there, with this deviation in um.
fn laser(deviation_um: impl Fn(f64) -> f64) -> Session {
    let names = ["t_s", "setup", "run", "repeat", "x_mm", "u_x", "u_y", "u_z", "deviation_um"];
    let mut raw = Raw::made_up("laser", &names);
    for k in 0..400_u32 {
        let (run, x_mm) = (f64::from(k / 100), 10.0 * f64::from(k % 100));
        let noise_um = 0.3 * (1.3 * f64::from(k * k)).sin();
        let t_s = 10.0 * f64::from(k) + f64::from(k % 7);
        let row = [t_s, 1.0, run, run, x_mm, 1.0, 0.0, 0.0, deviation_um(x_mm) + noise_um];
        raw.push("laser", u64::from(k) + 2, &row);
    }
    Session::build(&[raw], History::default(), Machine::plain()).expect("a session")
}

#[test]
fn two_that_take_back_each_other_are_one_where_it_explains_as_much() {
    let worn = |centre_mm| {
        Shape::Wear(forms::Wear { axis: Axis::X, centre_mm, width_mm: 60.0, power: 2.0, order: None })
    };
    let mut library = Library {
        labels: ["one", "other"].map(|effect| Label { effect, subject: "x".to_owned() }).to_vec(),
        kinds: vec![Kind::Machine; 2],
        variants: [300.0, 330.0]
            .into_iter()
            .enumerate()
            .map(|(label, c)| Variant { label, shape: worn(c) })
            .collect(),
        ..Library::default()
    };
    // where neither stands: the difference of both is nearly at it
    let session = laser(|x| 8.0 * (-((x - 270.0) / 60.0_f64).powi(2) / 2.0).exp());
    let noise = [ClassNoise { white_um: 0.21, drift_um: 0.0, drift_s: 1.0 }];
    let filter = Filter::new(&session, &noise, &vec![true; session.readings.len()]);
    let mut problem = Problem::new(&session, &library, &filter, &session.gap(), &[0.21]);
    let mut selection =
        Selection { chosen: vec![0, 1], threshold: 10.0, grid: vec![1; 2], ..Selection::default() };
    let both = Selection::given(&mut problem, &selection.chosen);
    assert!(problem.cosine(&both, [0, 1]) < -0.5);
    one_of_two(&mut problem, &session, &filter, &mut library, &mut selection);
    let [own] = selection.chosen[..] else { panic!("{:?}", selection.chosen) };
    let Shape::Wear(found) = &library.variants[own].shape else { panic!("a worn place") };
    assert!((found.centre_mm - 270.0).abs() < 3.0, "{found:?}");
}
