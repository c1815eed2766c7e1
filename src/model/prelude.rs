//! The names that most of the model starts from.

pub(crate) use crate::axes::{AxisArray, AxisKind, AxisName, MAX_AXES, Travel};
pub(crate) use crate::chain_notation::Side;
pub(crate) use crate::curve::{Curve, ErrorFunction};
pub(crate) use crate::dynamics::{DynamicTerm, ToolErrors};
pub(crate) use crate::geometry::{Mat3, Vec3, rotation_about, unit};
pub(crate) use crate::kinematics::{Model, Pose};
pub(crate) use crate::spec::{ModelError, ModelSpec, ReferenceBody};
pub(crate) use crate::symbol::{Component, ErrorSymbol};
