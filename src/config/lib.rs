//! Text to validated types: the machine file and the model file. Takes `&str`; the shell reads the files.
//!
//! Every mistake becomes a [`Diagnostic`] that names file, line, column, value, limit and remedy, and all of them
//! are reported at once: the files are read key by key through a small reader over the TOML document with its
//! places, because a derived deserialiser stops at the first mistake. Unknown keys are errors. What comes out is a
//! validated type; the rest of the program never sees the text.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod diagnostic;
mod key_names;
pub mod machine;
pub mod model;
mod prelude;
mod reader;
mod syntax;

pub use key_names::{suggestion, with_nearest};

pub use diagnostic::{ConfigErrors, Diagnostic, Place};
pub use machine::{
    AxisConfig, GuardConfig, HelloMismatch, Interface, LinkConfig, LogConfig, LogTarget, MachineConfig,
    ModelMismatch, Policy, RealtimeConfig, RecordingConfig, SensorsConfig, StartMode, StateConfig,
    StatusConfig, TlsConfig, WhenFull,
};
pub use machine::{HttpConfig, MqttConfig, MtconnectConfig};
pub use model::{Measured, ModelFile, Provenance, SourceEntry};

pub use reader::{Allowed, Key, Shape, place_of, text_at};
use reader::{Placed, Section};
use volcomp_protocol::Name;
use volcomp_units::axes::AxisName;

/// What a configuration file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// `volcomp-machine/1`.
    Machine,
    /// `volcomp-model/1`.
    Model,
}

/// What a file is, by its `format`.
///
/// # Errors
/// No TOML, no `format`, or one that is not known.
pub fn kind_of_file(file: &str, text: &str) -> Result<FileKind, ConfigErrors> {
    let (machine, model) = (machine::FORMAT, model::FORMAT);
    let remedy = format!("add format = \"{machine}\" or format = \"{model}\" as the first line");
    reader::read_file(file, text, |top, _| {
        top.require("format", &remedy)?;
        top.choice("format", &[(machine, FileKind::Machine), (model, FileKind::Model)])
    })
}

/// Checks `format`; false where the file is of another format, so that nothing else in it can be judged.
fn read_format(top: &Section<'_>, expected: &str) -> bool {
    top.require("format", &format!("add format = \"{expected}\" as the first line"));
    let Some(found) = top.text("format") else { return true };
    if found.value == expected {
        return true;
    }
    let remedy = match found.value {
        machine::FORMAT => "this is a machine file; the model file is the one it names".to_owned(),
        model::FORMAT => "this is a model file; the machine file is the one that names it".to_owned(),
        _ => format!("this program reads \"{expected}\""),
    };
    top.report_at(found.place, format!("format is \"{}\", not \"{expected}\"", found.value), remedy);
    false
}

/// The machine id, which must fit into the hello of the link.
fn read_machine_id<'r>(top: &Section<'r>) -> Option<Placed<&'r str>> {
    top.require("machine", "add machine = \"...\", the id that the control announces")?;
    let id = top.text("machine")?;
    let limit = Name::MAX;
    let wrong = match id.value {
        "" => "machine is empty".to_owned(),
        v if v.len() > limit => format!("machine has {} bytes", v.len()),
        v if v.chars().any(char::is_control) || v.trim() != v => {
            "machine has control characters or spaces around it".to_owned()
        }
        _ => return Some(id),
    };
    top.refuse(id.place, wrong, format!("write the id that the control announces, 1 to {limit} bytes"))
}

/// The axis of a key: one lower-case letter.
fn key_axis(key: &str) -> Option<AxisName> {
    let mut letters = key.chars();
    let axis = letters.next().filter(char::is_ascii_lowercase).and_then(AxisName::from_letter)?;
    letters.next().is_none().then_some(axis)
}

/// The axis of a key of `[axes]`, or a report of what is wrong with it.
fn axis_of_key(axes: &Section<'_>, name: &Placed<&str>) -> Option<AxisName> {
    let axis = key_axis(name.value);
    if axis.is_none() {
        let lower = name.value.to_ascii_lowercase();
        let remedy = if key_axis(&lower).is_some() {
            format!("axes are lower case in keys: write [axes.{lower}]")
        } else {
            "expected one of x y z u v w a b c s".to_owned()
        };
        axes.report_at(name.place.clone(), format!("unknown axis axes.{}", name.value), remedy);
    }
    axis
}
