//! The model file, `volcomp-model/1`: reading and writing.
//!
//! Lengths are mm and angles rad inside; in the file every key ends in its unit. What the file says about the
//! origin of its numbers is kept in a [`Provenance`]; the rest is a [`ModelSpec`].

mod axes;
mod dynamics;
mod errors;
mod keys;
mod number;
mod provenance;
mod thermal;
mod write;

use self::keys::{PositionKeys, grid_key};
use crate::prelude::*;
pub use dynamics::section_of;
pub use provenance::{Measured, Provenance, SourceEntry};
pub use write::{kind_of, write_file};

use super::reader::{self, Key};
use volcomp_estimate::Thermal;
use volcomp_model::chain_notation::ChainError;
use volcomp_model::geometry::Vec3;
use volcomp_protocol::Name;

/// The `format` of a model file.
pub const FORMAT: &str = "volcomp-model/1";
/// The axis that points up.
const VERTICAL: [(&str, AxisName); 3] = [("x", AxisName::X), ("y", AxisName::Y), ("z", AxisName::Z)];

/// A model with what its file says about where the numbers come from.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// The model.
    pub spec: ModelSpec,
    /// Origin of the file as a whole, `[provenance]`.
    pub provenance: Provenance,
    /// Origin of single errors, where stated.
    pub of_errors: Vec<(ErrorSymbol, Provenance)>,
    /// Thermal displacements, `[thermal.NAME]`: each feeds the errors whose live value names it.
    pub thermal: Vec<Thermal>,
}

impl ModelFile {
    /// A model whose origin is not stated.
    #[must_use]
    pub fn new(spec: ModelSpec) -> Self {
        Self { spec, provenance: Provenance::default(), of_errors: Vec::new(), thermal: Vec::new() }
    }

    /// Puts an error in its place, with where it came from.
    pub fn put(&mut self, symbol: ErrorSymbol, function: ErrorFunction, from: Provenance) {
        self.of_errors.retain(|(s, _)| *s != symbol);
        if !from.is_empty() {
            self.of_errors.push((symbol, from));
        }
        match self.spec.errors.iter_mut().find(|(s, _)| *s == symbol) {
            Some((_, old)) => *old = function,
            None => self.spec.errors.push((symbol, function)),
        }
        self.spec.errors.sort_by_key(|(symbol, _)| *symbol);
    }

    /// What is stated about the origin of an error alone.
    #[must_use]
    pub fn origin_of(&self, symbol: ErrorSymbol) -> Option<&Provenance> {
        self.of_errors.iter().find(|(s, _)| *s == symbol).map(|(_, origin)| origin)
    }

    /// The thermal displacements that some error names.
    pub fn growths_in_use(&self) -> impl Iterator<Item = &Thermal> {
        self.thermal.iter().filter(|t| self.spec.sensors().contains(&t.name.as_str()))
    }

    /// The last day on which all of its numbers may be used, where one is stated.
    #[must_use]
    pub fn earliest_expiry(&self) -> Option<&str> {
        let parts = self.of_errors.iter().map(|(_, origin)| &origin.expiry);
        core::iter::once(&self.provenance.expiry).chain(parts).flatten().map(String::as_str).min()
    }

    /// When and with which instruments it was measured: the newest date and every instrument that is stated.
    #[must_use]
    pub fn measured(&self) -> Measured {
        let parts = core::iter::once(&self.provenance).chain(self.of_errors.iter().map(|(_, origin)| origin));
        let mut measured = Measured::default();
        for part in parts {
            let sources = part.sources.iter().map(|source| (&source.date, &source.instrument));
            for (date, instrument) in sources.chain([(&part.date, &part.instrument)]) {
                measured.date = measured.date.max(date.clone());
                if let Some(name) = instrument.as_ref().filter(|name| !measured.instruments.contains(*name)) {
                    measured.instruments.push(name.clone());
                }
            }
        }
        measured
    }
}

/// Reads a model file.
///
/// # Errors
/// Every mistake found, each with its place.
pub fn parse(file: &str, text: &str) -> Result<ModelSpec, ConfigErrors> {
    parse_file(file, text).map(|f| f.spec)
}

/// Reads a model file with its provenance.
///
/// # Errors
/// Every mistake found, each with its place.
pub fn parse_file(file: &str, text: &str) -> Result<ModelFile, ConfigErrors> {
    reader::read_file(file, text, read)
}

/// The key table of model files, by `section.key`; `x`, `c`, `exx`, `eac` .. stand for any axis and error of the class.
#[must_use]
pub fn known_keys() -> BTreeMap<String, Key> {
    // empty tables show what is required; written keys, the values of those that are not read without
    const EMPTY: &str = "constant = {}, table = {}, fourier = {}, half-range = {}, chebyshev = {}, grid = {}, live = {}, \
        reversal = {}, friction-peak = {}, friction = {}, velocity = {}, acceleration = {}, sources = {}";
    const WRITTEN: &str = "constant = {value-V = 1}, table = {position-P = [0], value-V = [0], reverse-V = [0], \
        interpolation = \"linear\"}, fourier = {origin-P = 0, span-P = 1, period-P = 1, mean-V = 0, linear-V = 0, \
        cos-V = [0], sin-V = [0]}, half-range = {range-P = [0, 1], mean-V = 0, linear-V = 0, sin-V = [0]}, \
        chebyshev = {range-P = [0, 1], coefficients-V = [0]}, grid = {axes = [\"x\", \"y\"], value-V = [0]}";
    // one error of each class: length or angle, over a linear or a rotary axis, or constant
    const CLASSES: [(&str, &str, &str); 4] =
        [("exx", "um", "mm"), ("eax", "arcsec", "mm"), ("exc", "um", "deg"), ("eac", "arcsec", "deg")];
    let empty = CLASSES.map(|(symbol, ..)| format!("{symbol} = {{{EMPTY}}}\n")).concat();
    let written = CLASSES.map(|(symbol, value, position)| {
        let kinds = WRITTEN.replace("-V", &format!("-{value}")).replace("-P", &format!("-{position}"));
        format!("{symbol} = {{{kinds}}}\n")
    });
    let samples = [
        format!(
            "axes = {{x = {{}}, c = {{}}}}\nprovenance = {{sources = {{}}}}\n[errors]\n{empty}\
             ec0y = {{constant = {{}}, sources = {{}}}}\nex0c = {{constant = {{}}, sources = {{}}}}\n[thermal]\ngrowth = {{input = {{}}}}\nexpansion = {{kind = \"expansion\", input = {{}}}}\n\
             growth-by-speed = {{input = {{range-rpm = [0, 1]}}}}\n\
             expansion-by-speed = {{kind = \"expansion\", input = {{range-rpm = [0, 1]}}}}\n"
        ),
        format!(
            "machine = \"m\"\n[errors]\n{}ec0y = {{constant = {{value-arcsec = 1}}}}\n\
             ex0c = {{constant = {{value-um = 1}}}}\n",
            written.concat()
        ),
    ];
    reader::keys_of(&samples.each_ref().map(String::as_str), read)
}

fn read(top: &Section<'_>, text: &str) -> Option<ModelFile> {
    if !super::read_format(top, FORMAT) {
        return None;
    }
    let machine = super::read_machine_id(top);
    let chain = read_chain(top, text);
    let mut spec = ModelSpec::new(
        machine.as_ref().map_or("", |m| m.value),
        // without a chain nothing below can be checked against it
        chain.as_ref().map(|c| c.value.clone()).or_else(|| Chain::parse("[w b X t]").ok())?,
    );
    let known_chain = chain.as_ref().map(|c| &c.value);
    top.read("frame", |frame| read_frame(frame, &mut spec));
    spec.tool = top.read("tool", dynamics::read_tool);
    axes::read(&top.section("axes"), chain.as_ref(), &mut spec);
    let (provenance, std) =
        top.read("provenance", |section| (provenance::read(section), errors::DefaultStd::read(section)));
    let of_errors = errors::read(&top.section("errors"), known_chain, &std, &mut spec);
    let thermal = thermal::read(&top.section("thermal"), &spec);
    top.finish();
    whole_model(top, &spec, chain.is_some());
    Some(ModelFile { spec, provenance, of_errors, thermal })
}

/// A last look with the rules of the model itself; everything it can find has been reported at its place before.
fn whole_model(top: &Section<'_>, spec: &ModelSpec, has_chain: bool) {
    if has_chain
        && top.is_clean()
        && let Err(e) = spec.validate()
    {
        top.report(Diagnostic::of_file(e.to_string(), remedy(&e, spec.chain.to_string().as_str())));
    }
}

fn read_frame(frame: &Section<'_>, spec: &mut ModelSpec) {
    spec.workpiece_origin = point(frame, "workpiece-origin-mm").unwrap_or(spec.workpiece_origin);
    spec.tool_tip = point(frame, "tool-tip-mm").unwrap_or(spec.tool_tip);
    spec.gauge_point = point(frame, "gauge-point-mm");
    spec.vertical = frame.choice("vertical", &VERTICAL);
    frame.read("datum", |datum| read_datum(datum, spec));
}

/// Where the workpiece datum was touched: one coordinate per axis of the chain, such as `x-mm = 100`.
fn read_datum(section: &Section<'_>, spec: &mut ModelSpec) {
    let chain: Vec<AxisName> = spec.chain.axes().iter().map(|a| a.name).collect();
    for axis in chain {
        if let Some(at) = section.number(grid_key(axis), Allowed::Finite) {
            spec.datum.push((axis, (PositionKeys::of(axis).read)(at.value)));
        }
    }
}

/// A point in M at home, mm.
fn point(section: &Section<'_>, key: &'static str) -> Option<Vec3> {
    section.fixed::<3>(key, "[x, y, z]").map(|list| Vec3::from(list.value))
}

fn read_chain(top: &Section<'_>, text: &str) -> Option<Placed<Chain>> {
    let remedy = "add the axes from workpiece through bed to tool, for example chain = \"[w X' b Y Z t]\"";
    top.require("chain", remedy)?;
    let written = top.text("chain")?;
    if written.value.len() > Name::MAX * 8 {
        return top.refuse(written.place, "chain is too long", "a chain has at most 8 axes");
    }
    match Chain::parse(written.value) {
        Ok(chain) => Some(Placed::new(chain, written.place)),
        Err(e) => {
            top.refuse(
                inside(text, &written, &e),
                format!("chain, {e}"),
                "write the axes from the workpiece w through the bed b to the tool t, primes on the workpiece side: \
                 [w X' b Y Z t]",
            )
        }
    }
}

/// The word of a chain that is wrong, inside its quotes.
fn inside(text: &str, written: &Placed<&str>, error: &ChainError) -> core::ops::Range<usize> {
    let raw = text.get(written.place.clone()).unwrap_or("");
    // escapes and long strings shift the columns: the whole value is marked then
    if raw.get(1..raw.len().saturating_sub(1)) != Some(written.value) {
        return written.place.clone();
    }
    let mut rest = written.value.char_indices().skip(error.column.saturating_sub(1)).peekable();
    let Some(&(start, _)) = rest.peek() else { return written.place.clone() };
    let end = rest
        .find(|&(i, c)| i > start && (c.is_whitespace() || c == ']'))
        .map_or(written.value.len(), |(i, _)| i);
    let open = written.place.start + 1;
    open + start..open + end
}

/// What to do about a broken rule of the model.
fn remedy(error: &ModelError, chain: &str) -> String {
    match error {
        ModelError::AxisNotInChain { axis }
        | ModelError::ErrorOfMissingAxis { axis, .. }
        | ModelError::GridOverMissingAxis { axis, .. } => {
            format!("the chain is {chain}: add {axis} to it or take this entry out")
        }
        ModelError::Datum { axis } => {
            format!("the chain is {chain}: add {axis} to it or take it out of [frame.datum]")
        }
        ModelError::TooManyDynamicTerms { .. } => "take some out".to_owned(),
        ModelError::ToolWithoutGaugePoint => "add gauge-point-mm = [x, y, z] to [frame]".to_owned(),
        ModelError::ToolTooLarge => "give angles in arcsec and the length error in um/m".to_owned(),
        ModelError::TooManySensors { .. } => "let several errors share a sensor, or take some out".to_owned(),
        ModelError::SquarenessWithoutPartner { partner, .. } => {
            format!("the chain is {chain}: add {partner} to it or take this entry out")
        }
        ModelError::AxisTwice { .. } | ModelError::ErrorTwice { .. } => "keep one of the two".to_owned(),
        ModelError::Travel { .. } => "write the lower end first".to_owned(),
        ModelError::NotConstant { .. } => "keep one constant, or give an error motion of the axis".to_owned(),
        ModelError::NotFinite { .. } => "write finite numbers".to_owned(),
        ModelError::AngleTooLarge { .. } => "give the values in arcsec (1 arcsec is 4.848 urad)".to_owned(),
        ModelError::LengthTooLarge { .. } => "give the values in um".to_owned(),
    }
}

#[cfg(test)]
mod tests;
