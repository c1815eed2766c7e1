//! Axes, units, rigid geometry, and the error model: symbols, curves, kinematic chain, volumetric deviation and the
//! corrections that oppose it. Pure: no I/O, no clock.
//!
//! Conventions, signs and formulas: `docs/reference/equations.md`. Reading order: [`symbol`], [`curve`], [`chain_notation`],
//! [`dynamics`] (what follows motion), [`spec`] (what a model is made of), [`kinematics`] (first order), [`exact_kinematics`] (full rotations), [`correction`],
//! [`gauge`] (the normal form), [`search`] (the largest values in a volume), [`extremes`] (those of a model), [`compare`] (two models), [`wireframe`] (the distorted volume).

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod chain_notation;
pub mod compare;
mod compiled_basis;
pub mod correction;
pub mod curve;
pub mod dynamics;
pub mod exact_kinematics;
pub mod extremes;
pub mod gauge;
pub mod geometry;
pub mod kinematics;
mod prelude;
pub mod random;
pub mod search;
pub mod spec;
pub mod statistics;
pub mod symbol;
pub mod wireframe;

pub use volcomp_units as units;
pub use volcomp_units::axes;

pub use chain_notation::{Chain, ChainAxis, Side};
pub use correction::AxisCorrection;
pub use curve::{Curve, ErrorFunction};
pub use dynamics::{AxisMotion, DYNAMIC_MAX, DynamicTerm, Law, ToolErrors};
pub use gauge::{Gauged, normalise};
pub use kinematics::{Deviation, Model, PointFlags, Pose};
pub use spec::{AxisSpec, ModelError, ModelSpec, ReferencePoint, SENSORS_MAX, Sense};
pub use symbol::{Component, ErrorSymbol};
