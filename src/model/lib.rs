//! Axes, units, rigid geometry, and the error model: symbols, curves, kinematic chain, volumetric deviation and the
//! corrections that oppose it. Pure: no I/O, no clock.
//!
//! Conventions, signs and formulas: `docs/reference/equations.md`. Reading order: [`symbol`], [`curve`], [`chain`],
//! [`dynamics`] (what follows motion), [`spec`] (what a model is made of), [`volumetric`] (first order), [`exact`] (full rotations), [`correction`],
//! [`gauge`] (the normal form), [`search`] (the largest values in a volume), [`extremes`] (those of a model), [`compare`] (two models), [`wireframe`] (the distorted volume).

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod chain;
pub mod compare;
mod compiled_basis;
pub mod correction;
pub mod curve;
pub mod dynamics;
pub mod exact;
pub mod extremes;
pub mod gauge;
pub mod geometry;
pub mod search;
pub mod spec;
pub mod statistics;
pub mod symbol;
pub mod volumetric;
pub mod wireframe;

pub use volcomp_units as units;
pub use volcomp_units::axes;

pub use chain::{Chain, ChainAxis, Side};
pub use correction::AxisCorrection;
pub use curve::{Curve, ErrorFunction};
pub use dynamics::{AxisMotion, DYNAMIC_MAX, DynamicTerm, Law, ToolErrors};
pub use gauge::{Gauged, normalise};
pub use spec::{AxisSpec, ModelError, ModelSpec, ReferencePoint, SENSORS_MAX, Sense};
pub use symbol::{Component, ErrorSymbol};
pub use volumetric::{Deviation, Model, PointFlags, Pose};
