//! The names that most readers start from.

pub(crate) use core::net::{IpAddr, SocketAddr};
pub(crate) use std::collections::BTreeMap;
pub(crate) use std::path::PathBuf;

pub(crate) use crate::diagnostic::{ConfigErrors, Diagnostic};
pub(crate) use crate::key_names::{suggestion, unit_of};
pub(crate) use crate::reader::{Allowed, Placed, Section};
pub(crate) use volcomp_model::{Chain, ErrorFunction, ErrorSymbol, ModelError, ModelSpec};
pub(crate) use volcomp_units::axes::{AxisKind, AxisName};
pub(crate) use volcomp_units::{arcsec_from_rad, mm_from_um, rad_from_arcsec, um_from_mm};
