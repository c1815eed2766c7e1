//! `[thermal.NAME]`: thermal displacement, told to the errors whose live value names it.

use super::number::{plain, shortest};
use super::write::{entry, entry_if, heading, line_of};
use crate::prelude::*;
use volcomp_estimate::{Quantity, Thermal, ThermalInput};

/// Reference temperature of ISO 1, degC.
const REFERENCE_DEGC: f64 = 20.0;
const FADE_PERCENT: f64 = 25.0;
const TEMPERATURE: Allowed = Allowed::Within { low: -60.0, high: 200.0 };
const SPEED: Allowed = Allowed::Within { low: 0.0, high: 200_000.0 };

/// A length in um or a strain in um/m, to mm or mm/mm and back.
#[derive(Debug, Clone, Copy)]
struct Unit {
    offset: &'static str,
    std: &'static str,
    per_kelvin: &'static str,
    per_speed: &'static str,
    read: fn(f64) -> f64,
    write: fn(f64) -> f64,
}

const GROWTH: Unit = Unit {
    offset: "offset-um",
    std: "std-um",
    per_kelvin: "growth-um-per-k",
    per_speed: "growth-um-per-krpm",
    read: mm_from_um,
    write: um_from_mm,
};
const EXPANSION: Unit = Unit {
    offset: "offset-um-per-m",
    std: "std-um-per-m",
    per_kelvin: "strain-um-per-m-k",
    per_speed: "strain-um-per-m-krpm",
    read: |um_per_m| um_per_m / 1e6,
    write: |strain| strain * 1e6,
};

impl Unit {
    const fn of(expansion: bool) -> Self {
        if expansion { EXPANSION } else { GROWTH }
    }
}

/// Reads all growths.
pub(super) fn read(section: &Section<'_>, spec: &ModelSpec) -> Vec<Thermal> {
    let mut found = Vec::new();
    for name in section.names() {
        let Some(one) = section.named(&name) else { continue };
        let thermal = read_one(&one, name.value);
        if let Some(thermal) = &thermal {
            check_use(&one, thermal, spec);
        }
        found.extend(thermal);
        one.finish();
    }
    found
}

/// A strain needs the point that does not move, a length must not have one.
fn check_use(section: &Section<'_>, thermal: &Thermal, spec: &ModelSpec) {
    for (symbol, function) in &spec.errors {
        for live in function.live.iter().filter(|l| l.sensor == thermal.name) {
            let heading = format!("[errors.{}.live]", symbol.to_string().to_lowercase());
            match (thermal.expansion, live.reference) {
                (true, None) => section.report_here(
                    format!(
                        "{} is an expansion, and {heading} does not say about which point",
                        section.title()
                    ),
                    format!("add reference-mm to {heading}, the coordinate that does not move"),
                ),
                (false, Some(_)) => section.report_here(
                    format!("{} is a length, and {heading} takes it for a strain", section.title()),
                    format!("remove reference-mm from {heading}, or write kind = \"expansion\""),
                ),
                _ => {}
            }
            if symbol.is_angle() {
                section.report_here(
                    format!("{} is a length or strain, and {heading} is an angle", section.title()),
                    "name it in a positioning or straightness error",
                );
            }
        }
    }
}

fn read_one(section: &Section<'_>, name: &str) -> Option<Thermal> {
    let expansion = section.choice("kind", &[("growth", false), ("expansion", true)]).unwrap_or(false);
    let unit = Unit::of(expansion);
    let offset = section.number(unit.offset, Allowed::Finite).map_or(0.0, |n| (unit.read)(n.value));
    let std = section.number(unit.std, Allowed::Within { low: 0.0, high: 1e6 }).map(|n| (unit.read)(n.value));
    let fade = section.number("fade-percent", Allowed::Positive { high: 1000.0 });
    let inputs = section.read_all("input", |input| read_input(input, unit));
    if inputs.is_empty() {
        section.missing("input", "add [[thermal.NAME.input]] with the sensor that it depends on");
    }
    let thermal = Thermal {
        name: name.to_owned(),
        expansion,
        offset,
        fade_share: fade.map_or(FADE_PERCENT, |n| n.value) / 100.0,
        std,
        inputs: inputs.into_iter().collect::<Option<_>>()?,
    };
    if let Err(e) = thermal.validate()
        && !thermal.inputs.is_empty()
    {
        section.report_here(e.to_string(), "correct the number, or fit anew with volcomp fit thermal");
        return None;
    }
    Some(thermal)
}

fn read_input(section: &Section<'_>, unit: Unit) -> Option<ThermalInput> {
    let sensor = section.text("sensor");
    section.require("sensor", "add sensor = \"name\", the thermometer or the spindle");
    let is_speed = section.value("range-rpm").is_some() || section.value(unit.per_speed).is_some();
    let (quantity, range_key, reference_key, value_key, allowed, usual) = if is_speed {
        (Quantity::Speed, "range-rpm", "reference-rpm", unit.per_speed, SPEED, 0.0)
    } else {
        (Quantity::Temperature, "range-degc", "reference-degc", unit.per_kelvin, TEMPERATURE, REFERENCE_DEGC)
    };
    section.require(range_key, &format!("add {range_key} = [low, high], within which the numbers hold"));
    section.require(value_key, &format!("add {value_key} = [..], one number per lag"));
    let range = section.interval(range_key);
    let reference = section.number(reference_key, allowed).map_or(usual, |n| n.value);
    let power = match quantity {
        Quantity::Speed => section.number("power", Allowed::Positive { high: 4.0 }).map_or(1.0, |n| n.value),
        Quantity::Temperature => 1.0,
    };
    let numbers =
        |key| section.numbers(key).map(|l| (l.value.into_iter().map(|n| n.value).collect(), l.place));
    let lags: Option<(Vec<f64>, _)> = numbers("lags-s");
    let values: (Vec<f64>, _) = numbers(value_key)?;
    let lags_s = lags.map_or_else(|| vec![0.0], |(list, _)| list);
    if lags_s.len() != values.0.len() {
        return section.refuse(
            values.1,
            format!(
                "{} has {} numbers for {} lags",
                section.named_key(value_key),
                values.0.len(),
                lags_s.len()
            ),
            "write one number per entry of lags-s",
        );
    }
    let coefficients = values.0.into_iter().map(unit.read).collect();
    let (sensor, range) = (sensor?.value.to_owned(), range?.value);
    Some(ThermalInput { sensor, quantity, range, reference, power, lags_s, coefficients })
}

/// Writes a growth so that reading it gives the same one.
pub(super) fn write(out: &mut String, thermal: &Thermal) {
    let unit = Unit::of(thermal.expansion);
    let number = |inside: f64| shortest(inside, (unit.write)(inside), unit.read);
    let name = key(&thermal.name);
    heading(out, &format!("thermal.{name}"));
    line_of(out, format_args!("kind = \"{}\"", if thermal.expansion { "expansion" } else { "growth" }));
    entry(out, unit.offset, number(thermal.offset));
    entry_if(out, unit.std, thermal.std.map(number));
    entry(out, "fade-percent", shortest(thermal.fade_share, thermal.fade_share * 100.0, |p| p / 100.0));
    for input in &thermal.inputs {
        let list = |values: &[f64], text: &dyn Fn(f64) -> String| {
            values.iter().map(|v| text(*v)).collect::<Vec<_>>().join(", ")
        };
        let (suffix, value_key) = match input.quantity {
            Quantity::Temperature => ("degc", unit.per_kelvin),
            Quantity::Speed => ("rpm", unit.per_speed),
        };
        line_of(out, format_args!("\n[[thermal.{name}.input]]"));
        line_of(out, format_args!("sensor = {}", super::write::quoted(&input.sensor)));
        line_of(out, format_args!("range-{suffix} = [{}]", list(&input.range, &plain)));
        line_of(out, format_args!("reference-{suffix} = {}", plain(input.reference)));
        if input.quantity == Quantity::Speed {
            line_of(out, format_args!("power = {}", plain(input.power)));
        }
        line_of(out, format_args!("lags-s = [{}]", list(&input.lags_s, &plain)));
        line_of(out, format_args!("{value_key} = [{}]", list(&input.coefficients, &number)));
    }
}

/// A name as a key: in quotes where it is no bare one.
fn key(name: &str) -> String {
    let bare = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
    if bare { name.to_owned() } else { super::write::quoted(name) }
}

#[cfg(test)]
mod tests {
    use super::super::{parse_file, write_file};

    const HEAD: &str = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w X' b Y Z t]\"\n\
        [axes.x]\ntravel-mm = [0, 500]\n[axes.y]\ntravel-mm = [0, 500]\n[axes.z]\ntravel-mm = [-500, 0]\n";
    const SPINDLE: &str = "[errors.ezz.live]\nsensor = \"spindle-z\"\nlimit-um = 60\n\
        [errors.exx.live]\nsensor = \"scale-x\"\nlimit-um = 80\nreference-mm = 100\n\
        [thermal.spindle-z]\noffset-um = -3.5\nstd-um = 2\n\
        [[thermal.spindle-z.input]]\nsensor = \"t4\"\nrange-degc = [21, 38.5]\nreference-degc = 25\n\
        lags-s = [0, 600]\ngrowth-um-per-k = [1.5, 0.7]\n\
        [[thermal.spindle-z.input]]\nsensor = \"spindle\"\nrange-rpm = [0, 5000]\npower = 1.5\n\
        lags-s = [1800]\ngrowth-um-per-krpm = [-2.25]\n\
        [thermal.scale-x]\nkind = \"expansion\"\n\
        [[thermal.scale-x.input]]\nsensor = \"tx\"\nrange-degc = [10, 35]\nstrain-um-per-m-k = [11.5]\n";

    #[test]
    fn a_growth_is_read_and_written_back() {
        let file = parse_file("m.toml", &format!("{HEAD}{SPINDLE}")).unwrap();
        let [spindle, scale] = file.thermal.as_slice() else { panic!("two growths") };
        assert!(spindle.inputs[1].coefficients == [-0.00225] && spindle.inputs[0].lags_s == [0.0, 600.0]);
        assert!(scale.expansion && (scale.inputs[0].coefficients[0] - 11.5e-6).abs() < 1e-20);
        assert!(scale.inputs[0].lags_s == [0.0] && scale.inputs[0].reference == 20.0);
        let back = parse_file("m.toml", &write_file(&file, &[])).unwrap();
        assert_eq!(back, file);
    }

    #[test]
    fn mistakes_are_named_with_their_remedy() {
        let of = |from: &str, to: &str| {
            let text = format!("{HEAD}{}", SPINDLE.replace(from, to));
            parse_file("m.toml", &text).unwrap_err().to_string()
        };
        for (from, to, words) in [
            ("growth-um-per-k = [1.5, 0.7]", "growth-um-per-k = [1.5]", "has 1 numbers for 2 lags"),
            ("range-degc = [21, 38.5]\n", "", "range-degc"),
            ("sensor = \"t4\"\n", "", "the thermometer or the spindle"),
            ("lags-s = [1800]", "lags-s = [-1]", "lag -1"),
            ("kind = \"expansion\"", "kind = \"shrinking\"", "growth"),
            ("std-um = 2", "std-um-per-m = 2", "std-um"),
            ("reference-mm = 100\n", "", "does not say about which point"),
            ("limit-um = 60\n", "limit-um = 60\nreference-mm = 0\n", "takes it for a strain"),
            (
                "errors.ezz.live]\nsensor = \"spindle-z\"\nlimit-um",
                "errors.eaz.live]\nsensor = \"spindle-z\"\nlimit-arcsec",
                "is an angle",
            ),
        ] {
            let said = of(from, to);
            assert!(said.contains(words), "{to}: {said}");
        }
    }
}
