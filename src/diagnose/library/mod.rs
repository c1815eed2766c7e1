//! The effects that are searched for in a session: those of `volcomp-effects` that its data can show.

mod facts;
#[cfg(test)]
mod tests;

use super::constants::WHOLE;
use super::moment::{Axis, Signal};
use super::session::Session;

pub use volcomp_effects::{
    EFFECTS, Effect, Kind, Label, LabelError, Lever, Measurement, PROCEDURES, Procedure, REFERENCE_DEGC,
    RotaryFrame, STILL, Shape, WIDTH_MAX, Without, forms, legendre, line_of_sight,
};

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
    /// It may be at work in these data: they do not record the quantity on which it depends.
    pub is_unrecorded: bool,
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

impl Library {
    /// Every effect that the session's columns allow, without those taken out.
    #[must_use]
    pub fn new(session: &Session, without: &[Without]) -> Self {
        let mut library = Self::default();
        let data = facts::data(session);
        for axis in Axis::LINEAR {
            let travel = session.machine.axis(axis).and_then(|a| a.travel);
            let seen = data.range[axis.slot()];
            library.partly[axis.direction()] =
                travel.zip(seen).is_some_and(|([l, h], [a, b])| b - a < WHOLE * (h - l));
        }
        for effect in EFFECTS {
            for subject in effect.subjects.all() {
                let label = Label::new(effect.name, &subject.name);
                if without.iter().any(|w| w.covers(&label)) {
                    continue;
                }
                match (effect.variants)(&data, &subject) {
                    Ok(shapes) if shapes.is_empty() => {}
                    Ok(shapes) => library.add(effect.kind, label, shapes),
                    Err(hidden) => {
                        let (over, along) = (subject.axis, hidden.one_lever);
                        library.blind.push(Blind {
                            label: label.to_string(),
                            because: hidden.because,
                            is_unrecorded: hidden.is_unrecorded,
                        });
                        if along.contains(&true) {
                            library.one_lever.push(OneLever { label, over, along });
                        }
                    }
                }
            }
        }
        library
    }

    fn add(&mut self, kind: Kind, label: Label, shapes: Vec<Shape>) {
        let at = self.labels.len();
        self.labels.push(label);
        self.kinds.push(kind);
        self.variants.extend(shapes.into_iter().map(|shape| Variant { label: at, shape }));
    }

    /// Number of columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.variants.iter().map(|v| v.shape.width()).sum()
    }

    /// First column and number of columns of each variant.
    #[must_use]
    pub fn spans(&self) -> Vec<(usize, usize)> {
        let spans = self.variants.iter().scan(0, |at, v| {
            let (first, k) = (*at, v.shape.width());
            *at += k;
            Some((first, k))
        });
        spans.collect()
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

    /// Angular errors with one lever that a displacement of this shape is confounded with.
    pub fn behind(&self, shape: &Shape) -> impl Iterator<Item = &Label> {
        let pair = match shape {
            // a squareness is an angle about either axis
            Shape::Squareness(forms::Squareness { along, over }) => Some([(*along, *over), (*over, *along)]),
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
            Shape::Squareness(forms::Squareness { along, over }) => {
                self.partly[along.direction()] || self.partly[over.direction()]
            }
            Shape::Scale(forms::Scale { axis }) => self.partly[axis.direction()],
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
