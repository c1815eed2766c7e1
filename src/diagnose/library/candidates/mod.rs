//! The grids: every effect that the columns allow, with the values of what is not linear.

mod geometry;
mod heat;
mod motion;
mod rotary;

use super::super::moment::{Axis, Moment, Signal};
use super::super::session::{Session, is_encoder};
use super::{Kind, Label, Without};
use volcomp_effects::Lever;
use volcomp_effects::{STILL, Shape};

/// One way in which an effect may show.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// Its effect, as an index into [`Library::labels`].
    pub label: usize,
    /// Its formula.
    pub shape: Shape,
}

/// An effect that these data cannot show, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Blind {
    /// `effect:subject`.
    pub label: String,
    /// Why.
    pub because: String,
}

/// An angular error whose lever never changes: what it does is a displacement along these directions, a function of the
/// position of the same axis (Abbe), and no data of this session tell the two apart.
#[derive(Debug, Clone, PartialEq)]
pub struct OneLever {
    /// The angular error.
    pub label: Label,
    /// Its axis.
    pub over: Axis,
    /// The directions in which it displaces.
    pub along: [bool; 3],
}

/// All candidates for a session.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Library {
    /// The effects.
    pub labels: Vec<Label>,
    /// Who is to blame for each.
    pub kinds: Vec<Kind>,
    /// Their variants; those of one effect stand together.
    pub variants: Vec<Variant>,
    /// Effects that these data cannot show.
    pub blind: Vec<Blind>,
    /// Angular errors that act in these data, but always with one lever.
    pub one_lever: Vec<OneLever>,
    /// Linear axes of which these data show no more than a part of the travel.
    pub partly: [bool; 3],
}

/// Share of the travel below which an axis is seen in part only.
const WHOLE: f64 = 0.75;

/// Effects of the structure, which the encoders of the axes do not see.
const BEYOND_ENCODERS: [&str; 14] = [
    "squareness",
    "straightness",
    "angular",
    "sag",
    "inertial-cross",
    "lateral-play",
    "spindle-tilt",
    "tool-length",
    "thermal-expansion",
    "ambient-drift",
    "spindle-growth",
    "scale",
    "positioning",
    "wear",
];

/// What a session holds.
struct Facts {
    range: [Option<[f64; 2]>; 6],
    moves: [bool; 6],
    accelerates: [bool; 6],
    reverses: [bool; 6],
    tools: bool,
    /// A tool length is stated.
    lengths: bool,
    /// A rotary axis turns the tool.
    head: bool,
    ranges: bool,
    forces: [bool; 3],
}

impl Facts {
    fn of(s: &Session) -> Self {
        let mut f = Self {
            range: [None; 6],
            moves: [false; 6],
            accelerates: [false; 6],
            reverses: [false; 6],
            tools: false,
            lengths: false,
            head: false,
            ranges: false,
            forces: [false; 3],
        };
        for axis in &s.axes {
            let i = axis.slot();
            let span = spread(s, |m| m.position[i]);
            f.range[i] = span.filter(|[l, h]| h - l > 1e-6);
            f.moves[i] = s.moments.iter().any(|m| m.velocity[i].abs() > STILL);
            f.accelerates[i] = spread(s, |m| m.acceleration[i]).is_some_and(|[l, h]| h - l > 1e-3);
            let signs = spread(s, |m| m.direction[i]);
            f.reverses[i] = signs.is_some_and(|[l, h]| l < 0.0 && h > 0.0);
        }
        let lengths = spread(s, |m| m.tool_length_mm);
        f.lengths = lengths.is_some();
        f.tools = lengths.is_some_and(|[l, h]| h - l > 1.0);
        f.head = s.machine.head_axes().any(|a| f.range[a.axis.slot()].is_some());
        f.ranges = spread(s, |m| m.range_mm).is_some_and(|[l, h]| h - l > 1.0);
        for (i, known) in f.forces.iter_mut().enumerate() {
            *known = spread(s, |m| m.force_n[i]).is_some_and(|[l, h]| h - l > 1e-6);
        }
        f
    }
}

fn spread(s: &Session, of: impl Fn(&Moment) -> f64) -> Option<[f64; 2]> {
    s.moments
        .iter()
        .map(of)
        .filter(|v| v.is_finite())
        .fold(None, |r: Option<[f64; 2]>, v| Some(r.map_or([v, v], |[l, h]| [l.min(v), h.max(v)])))
}

impl Library {
    /// Every effect that the session's columns allow, without those taken out.
    #[must_use]
    pub fn new(session: &Session, without: &[Without]) -> Self {
        let mut library = Self::default();
        let facts = Facts::of(session);
        for axis in Axis::LINEAR {
            let travel = session.machine.axis(axis).and_then(|a| a.travel);
            let seen = facts.range[axis.slot()];
            library.partly[axis.direction()] =
                travel.zip(seen).is_some_and(|([l, h], [a, b])| b - a < WHOLE * (h - l));
        }
        let mut b = Builder { library: &mut library, session, facts: &facts, without };
        b.geometry();
        b.reversals();
        b.dynamics();
        b.heat();
        b.instruments();
        b.rotary();
        library
    }

    /// Number of columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.variants.iter().map(|v| v.shape.width()).sum()
    }

    /// The variants of each label.
    #[must_use]
    pub fn by_label(&self) -> Vec<Vec<usize>> {
        let mut all = vec![Vec::new(); self.labels.len()];
        for (i, v) in self.variants.iter().enumerate() {
            all[v.label].push(i);
        }
        all
    }

    /// Angular errors with one lever that a displacement of this shape cannot be told from.
    pub fn behind(&self, shape: &Shape) -> impl Iterator<Item = &Label> {
        let pair = match shape {
            // a squareness is an angle about either axis
            Shape::Squareness { along, over } => Some([(*along, *over), (*over, *along)]),
            _ => shape.acts_along().zip(shape.over()).map(|p| [p; 2]),
        };
        self.one_lever
            .iter()
            .filter(move |o| {
                pair.is_some_and(|p| p.iter().any(|(d, q)| *q == o.over && o.along[d.direction()]))
            })
            .map(|o| &o.label)
    }

    /// True for a straight line over a part of the travel: it may be the slope that a curve has there.
    #[must_use]
    pub fn may_be_a_slope(&self, shape: &Shape) -> bool {
        match shape {
            // a squareness may be seen from either axis
            Shape::Squareness { along, over } => {
                self.partly[along.direction()] || self.partly[over.direction()]
            }
            Shape::Scale { axis } => self.partly[axis.direction()],
            _ => false,
        }
    }

    /// The lagged signals that its variants read.
    #[must_use]
    pub fn signals(&self) -> Vec<Signal> {
        let mut all: Vec<Signal> = Vec::new();
        for s in self.variants.iter().flat_map(|v| v.shape.signals()) {
            if !all.contains(s) {
                all.push(s.clone());
            }
        }
        all
    }
}

struct Builder<'a> {
    library: &'a mut Library,
    session: &'a Session,
    facts: &'a Facts,
    without: &'a [Without],
}

impl Builder<'_> {
    fn add(&mut self, kind: Kind, label: Label, shapes: Vec<Shape>) {
        if shapes.is_empty() || self.without.iter().any(|w| w.covers(&label)) {
            return;
        }
        let structural = BEYOND_ENCODERS.contains(&label.effect)
            && !shapes.iter().any(|s| matches!(s, Shape::RotaryScale { .. }));
        if structural && self.session.instruments.iter().all(|n| is_encoder(n)) {
            self.blind(&label, "the control's own encoders do not see the structure; measure at the tool");
            return;
        }
        self.library.labels.push(label);
        self.library.kinds.push(kind);
        let at = self.library.labels.len() - 1;
        self.library.variants.extend(shapes.into_iter().map(|shape| Variant { label: at, shape }));
    }

    fn blind(&mut self, label: &Label, because: &str) {
        if !self.without.iter().any(|w| w.covers(label)) {
            self.library.blind.push(Blind { label: label.to_string(), because: because.to_owned() });
        }
    }

    fn one_lever(&mut self, label: &Label, over: Axis, along: [bool; 3]) {
        if along.contains(&true) && !self.without.iter().any(|w| w.covers(label)) {
            self.library.one_lever.push(OneLever { label: label.clone(), over, along });
        }
    }

    /// Linear axes with more than one position.
    fn linear(&self) -> Vec<(Axis, [f64; 2])> {
        Axis::LINEAR.into_iter().filter_map(|a| Some((a, self.facts.range[a.slot()]?))).collect()
    }

    fn lever(&self, axis: Axis) -> Lever {
        let machine = &self.session.machine;
        let home = match (self.facts.tools, machine.gauge_point_mm) {
            (true, Some(g)) => g,
            _ => machine.tool_tip_mm,
        };
        Lever { axes: machine.levers_of(axis), home_mm: home.into(), tool: self.facts.tools }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_with_one_lever_stands_behind_the_displacements_that_it_makes() {
        let behind = Label::new("angular", "eaz");
        let one_lever = vec![OneLever { label: behind.clone(), over: Axis::Z, along: [false, true, false] }];
        let library = Library { one_lever, ..Library::default() };
        let curve =
            |along, over| Shape::Polynomial { along, over, low: 2, high: 5, centre_mm: 0.0, half_mm: 1.0 };
        let square = |along, over| Shape::Squareness { along, over };
        for (shape, is_behind) in [
            (curve(Axis::Y, Axis::Z), true),
            (curve(Axis::X, Axis::Z), false),
            (curve(Axis::Y, Axis::X), false),
            (square(Axis::Y, Axis::Z), true),
            (square(Axis::Z, Axis::Y), true),
            (square(Axis::X, Axis::Z), false),
            (Shape::Scale { axis: Axis::Y }, false),
        ] {
            assert_eq!(library.behind(&shape).eq([&behind]), is_behind, "{shape:?}");
        }
    }

    #[test]
    fn a_straight_line_over_a_part_of_the_travel_may_be_the_slope_of_a_curve() {
        let library = Library { partly: [false, false, true], ..Library::default() };
        let square = |along, over| Shape::Squareness { along, over };
        for (shape, may) in [
            (square(Axis::Y, Axis::Z), true),
            (square(Axis::X, Axis::Y), false),
            (Shape::Scale { axis: Axis::Z }, true),
            (Shape::Scale { axis: Axis::X }, false),
            (Shape::ToolLength, false),
        ] {
            assert_eq!(library.may_be_a_slope(&shape), may, "{shape:?}");
        }
    }
}
