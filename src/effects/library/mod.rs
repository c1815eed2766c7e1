//! The effects: what is known of each in `effects.toml`, and a file for each family with their variants for the search and
//! the formulas of these.
//!
//! The list of formulas below and `effects.toml` are the only ones.

#![expect(missing_docs, reason = "the fields of a formula are its symbols, which its first line explains")]

mod air;
mod angular;
mod backlash;
mod ballbar;
mod beam;
mod curves;
mod cyclic;
mod displacement;
mod expansion;
mod friction;
mod inertia;
mod lag;
mod load;
mod pitch_table;
mod rotary;
mod scale;
mod squareness;
#[cfg(test)]
mod tests;
mod tool;
mod wear;

use serde::{Deserialize, Serialize};

use crate::data::no_formula;
use crate::shape::Form;
use crate::{Effect, Kind, Measurement, Procedure, Subjects};

/// The formulas as one type, tagged by their names in additions.
macro_rules! shapes {
    ($($file:ident::$form:ident),* $(,)?) => {
        /// A formula with its non-linear parameters.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "form", rename_all = "kebab-case")]
        pub enum Shape {
            $($form($file::$form),)*
        }

        impl Shape {
            /// What the formula says.
            pub(crate) fn form(&self) -> &dyn Form {
                match self {
                    $(Self::$form(form) => form,)*
                }
            }
        }

        $(impl From<$file::$form> for Shape {
            fn from(form: $file::$form) -> Self {
                Self::$form(form)
            }
        })*

        /// The formulas, each with its symbols.
        pub mod forms {
            $(pub use super::$file::$form;)*
        }
    };
}

pub use displacement::SPINDLE_S;
pub use squareness::symbol as squareness_symbol;

shapes! {
    squareness::Squareness,
    scale::Scale,
    scale::RotaryScale,
    curves::Polynomial,
    curves::RoughCurve,
    curves::Reverse,
    curves::PositionTable,
    pitch_table::PitchTable,
    pitch_table::RotaryTable,
    pitch_table::AngularTable,
    angular::Angular,
    expansion::Thermal,
    displacement::Growth,
    backlash::Backlash,
    backlash::RotaryBacklash,
    friction::Spike,
    friction::Friction,
    cyclic::Cyclic,
    cyclic::RotaryCyclic,
    lag::Lag,
    lag::RotaryLag,
    lag::ClockSkew,
    inertia::Inertial,
    inertia::InertialTilt,
    beam::Sag,
    beam::Ram,
    tool::SpindleTilt,
    tool::ToolLength,
    air::DeadPath,
    air::TrackerScale,
    ballbar::BallbarLength,
    rotary::RotaryLocation,
    rotary::RotaryMotion,
    rotary::RotaryEccentricity,
    load::Load,
    wear::Wear,
}

// `EFFECTS` and `PROCEDURES`, made from effects.toml by build.rs
include!(concat!(env!("OUT_DIR"), "/effects.rs"));
