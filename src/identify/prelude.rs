//! The names that most methods start from.

pub(crate) use core::f64::consts::TAU;
pub(crate) use nalgebra::{DMatrix, DVector, Matrix6, Vector6};
pub(crate) use std::collections::BTreeMap;

pub(crate) use crate::primitives::jacobi;
pub(crate) use crate::reading::{Reading, group_by_position};
pub(crate) use volcomp_model::curve::{Interpolation, Table};
pub(crate) use volcomp_model::geometry::{Mat3, Vec3, largest_gap, unit};
pub(crate) use volcomp_model::statistics::{chi_square_upper, f_upper, hull, median, student_95};
pub(crate) use volcomp_model::{Component, Curve, ErrorFunction, ErrorSymbol, Model, ModelSpec};
pub(crate) use volcomp_units::axes::{AxisKind, AxisName, Travel};
