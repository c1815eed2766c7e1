//! Names that every file of the library needs.

pub(crate) use core::f64::consts::{PI, TAU};

pub(crate) use serde::{Deserialize, Serialize};

pub(crate) use crate::Subject;
pub(crate) use crate::addition::Entry;
pub(crate) use crate::data::{Data, Variants};
pub(crate) use crate::drawing::{Branch, Drawing, Over, Weight};
pub(crate) use crate::extend::{
    Becomes, Extended, Part, Sampling, Term, bending, displacements, rotation, shift, terms, turn,
};
pub(crate) use crate::frame::RotaryFrame;
pub(crate) use crate::lever::Lever;
pub(crate) use crate::machine_state::{Axis, MachineState, Source};
pub(crate) use crate::shape::{
    Form, REFERENCE_DEGC, Read, STILL, Shape, Span, Traits, UM_PER_ARCSEC_MM, WIDTH_MAX,
};
pub(crate) use crate::signal::Signal;
pub(crate) use volcomp_model::Law;
pub(crate) use volcomp_model::geometry::{Mat3, Vec3, unit};
pub(crate) use volcomp_units::{RAD_PER_ARCSEC, mm_from_um};

/// Names of parameters.
pub(crate) fn plain(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| (*n).to_owned()).collect()
}

/// Names and values of non-linear parameters.
pub(crate) fn named(fixed: &[(&str, f64)]) -> Vec<(String, f64)> {
    fixed.iter().map(|(name, v)| ((*name).to_owned(), *v)).collect()
}

/// A shape with a change.
pub(crate) fn with<F: Clone + Into<Shape>>(form: &F, change: impl FnOnce(&mut F)) -> Shape {
    let mut form = form.clone();
    change(&mut form);
    form.into()
}
