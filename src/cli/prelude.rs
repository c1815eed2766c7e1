//! The vocabulary of the command line: what most of its files speak of, so that each names only what is its own.

pub(crate) use std::collections::{BTreeMap, BTreeSet};
pub(crate) use std::path::{Path, PathBuf};

pub(crate) use serde::{Deserialize, Serialize};
pub(crate) use serde_json::{Map, Value, json};

pub(crate) use crate::acceptance::{Acceptance, Assessed, Judged, Stated, file_name};
pub(crate) use crate::arg_parsers::{
    above_zero, axis_letter, linear_axis, not_negative, number, numbers, one_of, point,
};
pub(crate) use crate::files::{
    continue_text, from_toml, read_hashed_model_file, read_model, read_model_file, write_model, write_text,
};
pub(crate) use crate::input::{self, InputKind};
pub(crate) use crate::model_writer::{ModelWriter, Sources, data_error, default_chain};
pub(crate) use crate::numerals::{Joined, counted, figure, micro, plain, signed, small};
pub(crate) use crate::positioning_data::{format_failure, read_failure};
pub(crate) use crate::quantities::{
    error_out, error_unit, offset_out, offset_unit, position_out, position_unit, range_words, rounded,
};
pub(crate) use crate::report::{Cell, Page, Table};
pub(crate) use crate::table;
pub(crate) use crate::units::{Units, check_size, column, key, or_dash};
pub(crate) use crate::{EX_CONFIG, EX_DATAERR, EX_IOERR, EX_SOFTWARE, EX_USAGE, Failure, Result};
pub(crate) use volcomp_config::{self as config, MachineConfig, ModelFile, Provenance, SourceEntry};
pub(crate) use volcomp_identify::Reading;
pub(crate) use volcomp_model::geometry::Vec3;
pub(crate) use volcomp_model::statistics::{SIGNIFICANT, hull};
pub(crate) use volcomp_model::{
    AxisSpec, Chain, Component, Curve, ErrorFunction, ErrorSymbol, Model, ModelSpec, Sense, Side,
};
pub(crate) use volcomp_units::axes::{AxisKind, AxisName, Travel};
pub(crate) use volcomp_units::{
    arcsec_from_rad, deg_from_rad, mm_from_um, rad_from_arcsec, rad_from_deg, um_from_mm,
};
