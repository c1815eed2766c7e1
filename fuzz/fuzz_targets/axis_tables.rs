//! The tables of one axis (LinuxCNC, Heidenhain, ISG leadscrew): never a panic, neither reading nor writing.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::linuxcnc::{CompType, LinearUnit};
use volcomp::formats::sample::Sampling;
use volcomp::formats::text::decode;
use volcomp::formats::{axis_table, heidenhain, isg_lis, linuxcnc};
use volcomp::model::axes::{AxisKind, AxisName};
use volcomp::model::{Chain, ErrorFunction, ErrorSymbol, ModelSpec};

fn spec(errors: Vec<(ErrorSymbol, ErrorFunction)>) -> ModelSpec {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").expect("a chain"));
    spec.errors = errors;
    spec
}

fuzz_target!(|data: &[u8]| {
    let [choice, rest @ ..] = data else { return };
    let decoded = decode(rest);
    let (text, axis) = (decoded.text.as_ref(), AxisName::Y);
    let file = if choice & 4 == 0 { CompType::Actual } else { CompType::Trim };
    let unit = if choice & 8 == 0 { LinearUnit::Mm } else { LinearUnit::Inch };
    let sign = if choice & 4 == 0 { heidenhain::Sign::Deviation } else { heidenhain::Sign::Correction };
    let read = match choice & 3 {
        0 => linuxcnc::parse(text, AxisKind::Linear, file, unit)
            .map(|f| vec![(axis_table::positioning_symbol(axis), f)]),
        1 => heidenhain::parse(text, axis, Some(sign)).map(|t| t.errors),
        _ => isg_lis::parse(text, AxisKind::Linear, Some(1e-3))
            .map(|f| vec![(axis_table::positioning_symbol(axis), f)]),
    };
    let errors = match read {
        Ok(errors) => errors,
        Err(error) => return drop(error.to_string()),
    };
    let spec = spec(errors);
    let sampling = Sampling::default();
    if let Ok((text, table)) = linuxcnc::write(&spec, axis, file, unit, &sampling) {
        assert!(table.positions.len() <= linuxcnc::ROWS_MAX);
        let _ = linuxcnc::parse(&text, AxisKind::Linear, file, unit);
    }
    if let Ok((text, _)) = heidenhain::write(&spec, axis, Some(sign), &sampling) {
        let _ = heidenhain::parse(&text, axis, Some(sign));
    }
    if let Ok((text, _)) = isg_lis::write(&spec, axis, &sampling) {
        let _ = isg_lis::parse(&text, AxisKind::Linear, None);
    }
});
