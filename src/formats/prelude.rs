//! The names that most formats start from.

pub(crate) use std::collections::{BTreeMap, BTreeSet};

pub(crate) use crate::axis_table::positioning;
pub(crate) use crate::error::{FormatError, FormatErrorKind, short};
pub(crate) use crate::sample::{AxisTable, ExportError, Limits, Motions, Sampling, sample_axis};
pub(crate) use crate::text::{DECIMALS_MAX, Word, lines, rounded, words};
pub(crate) use volcomp_identify::Reading;
pub(crate) use volcomp_model::curve::{Curve, Interpolation};
pub(crate) use volcomp_model::{Component, ErrorFunction, ErrorSymbol, ModelSpec};
pub(crate) use volcomp_units::axes::{AxisKind, AxisName, Travel};
pub(crate) use volcomp_units::{deg_from_rad, rad_from_deg, um_from_mm};
