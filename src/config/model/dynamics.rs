//! Terms that follow the motion of an axis, `[errors.exx.reversal]` .. `[errors.exx.acceleration]`, and `[tool]`.

use super::keys::{PositionKeys, ValueKeys};
use super::number::shortest;
use super::write::{entry, heading, part_heading};
use crate::prelude::*;
use volcomp_model::{DynamicTerm, Law, ToolErrors};
use volcomp_units::RAD_PER_DEG;

/// The section of each law.
const SECTIONS: [&str; 5] = ["reversal", "friction-peak", "friction", "velocity", "acceleration"];
/// Longest time of a law, ms.
const TIME_MS: Allowed = Allowed::Positive { high: 1e4 };
/// Speed from which friction has its full size, mm/s or deg/s.
const SPEED: Allowed = Allowed::Positive { high: 1e3 };
/// Micrometres per metre, as a share.
const PER_MILLION: f64 = 1e-6;
const MS_PER_S: f64 = 1e3;

/// A conversion between file and inside.
type Convert = fn(f64) -> f64;

/// The keys that carry the units of both error and axis.
struct Keys {
    value: &'static ValueKeys,
    axis: &'static PositionKeys,
    width: &'static str,
    height: &'static str,
    build_up: &'static str,
    growth: &'static str,
    speed: &'static str,
    velocity: &'static str,
    acceleration: &'static str,
    /// A gain of the file per mm or rad and s, and back.
    gains: [Convert; 2],
    /// A relative growth of the file per mm or rad, and back.
    growths: [Convert; 2],
}

impl Keys {
    fn of(symbol: ErrorSymbol) -> Self {
        let (value, axis) = (ValueKeys::of(symbol), PositionKeys::of(symbol.axis()));
        let [width, height] =
            if symbol.is_angle() { ["width-arcsec", "height-arcsec"] } else { ["width-um", "height-um"] };
        let (build_up, growth, speed, growths): (_, _, _, [Convert; 2]) = match symbol.axis().kind() {
            AxisKind::Linear => {
                ("build-up-mm", "growth-per-mm", "speed-mm-per-s", [core::convert::identity; 2])
            }
            AxisKind::Rotary => (
                "build-up-deg",
                "growth-per-deg",
                "speed-deg-per-s",
                [|v| v / RAD_PER_DEG, |v| v * RAD_PER_DEG],
            ),
        };
        let (velocity, acceleration, gains): (_, _, [Convert; 2]) =
            match (symbol.is_angle(), symbol.axis().kind()) {
                (false, AxisKind::Linear) => {
                    ("gain-um-s-per-mm", "gain-um-s2-per-mm", [mm_from_um, um_from_mm])
                }
                (false, AxisKind::Rotary) => (
                    "gain-um-s-per-deg",
                    "gain-um-s2-per-deg",
                    [|v| mm_from_um(v) / RAD_PER_DEG, |v| um_from_mm(v * RAD_PER_DEG)],
                ),
                (true, AxisKind::Linear) => {
                    ("gain-arcsec-s-per-mm", "gain-arcsec-s2-per-mm", [rad_from_arcsec, arcsec_from_rad])
                }
                (true, AxisKind::Rotary) => (
                    "gain-arcsec-s-per-deg",
                    "gain-arcsec-s2-per-deg",
                    [|v| rad_from_arcsec(v) / RAD_PER_DEG, |v| arcsec_from_rad(v * RAD_PER_DEG)],
                ),
            };
        Self { value, axis, width, height, build_up, growth, speed, velocity, acceleration, gains, growths }
    }
}

/// Reads all dynamic terms of an error; `None` where one of them is wrong.
pub(super) fn read(section: &Section<'_>, symbol: ErrorSymbol) -> Option<Vec<DynamicTerm>> {
    let mut found = Vec::new();
    for name in SECTIONS {
        found.extend(section.read_all(name, |part| read_term(part, name, &Keys::of(symbol))));
    }
    found.into_iter().collect()
}

fn read_term(section: &Section<'_>, name: &str, keys: &Keys) -> Option<DynamicTerm> {
    let required = |key: &'static str, allowed: Allowed| {
        section.require(key, &format!("add {key} = .."));
        section.number(key, allowed).map(|n| n.value)
    };
    let growth = section.number(keys.growth, Allowed::Finite).map_or(0.0, |n| n.value);
    let limit = required(keys.value.limit, Allowed::Positive { high: 5000.0 });
    let (law, gain) = match name {
        "reversal" => {
            let length = section.number(keys.build_up, Allowed::Within { low: 0.0, high: 1e3 });
            let build_up = length.map_or(0.0, |n| (keys.axis.read)(n.value));
            (Some(Law::Reversal { build_up }), required(keys.width, Allowed::Finite).map(keys.value.read))
        }
        "friction-peak" => {
            let (rise, fall) = (required("rise-ms", TIME_MS), required("fall-ms", TIME_MS));
            let law = rise
                .zip(fall)
                .map(|(rise, fall)| Law::FrictionPeak { rise_s: rise / MS_PER_S, fall_s: fall / MS_PER_S });
            (law, required(keys.height, Allowed::Finite).map(keys.value.read))
        }
        "friction" => {
            let speed = required(keys.speed, SPEED).map(keys.axis.read);
            (
                speed.map(|speed| Law::Friction { speed }),
                required(keys.height, Allowed::Finite).map(keys.value.read),
            )
        }
        "velocity" => (Some(Law::Velocity), required(keys.velocity, Allowed::Finite).map(keys.gains[0])),
        _ => (Some(Law::Acceleration), required(keys.acceleration, Allowed::Finite).map(keys.gains[0])),
    };
    Some(DynamicTerm {
        law: law?,
        gain: gain?,
        growth: (keys.growths[0])(growth),
        limit: (keys.value.read)(limit?),
    })
}

/// Writes the dynamic terms of an error.
pub(super) fn write(out: &mut String, symbol: ErrorSymbol, terms: &[DynamicTerm]) {
    let keys = Keys::of(symbol);
    let name = format!("errors.{}", symbol.to_string().to_lowercase());
    for term in terms {
        let kind = section_of(&term.law);
        let is_of_several = terms.iter().filter(|other| section_of(&other.law) == kind).count() > 1;
        part_heading(out, &name, kind, is_of_several);
        let mut put = |key: &str, value: String| entry(out, key, value);
        let value = |v: f64| shortest(v, (keys.value.write)(v), keys.value.read);
        let length = |v: f64| shortest(v, (keys.axis.write)(v), keys.axis.read);
        let gain = |v: f64| shortest(v, (keys.gains[1])(v), keys.gains[0]);
        match term.law {
            Law::Reversal { build_up } => {
                put(keys.width, value(term.gain));
                if build_up > 0.0 {
                    put(keys.build_up, length(build_up));
                }
            }
            Law::FrictionPeak { rise_s, fall_s } => {
                put(keys.height, value(term.gain));
                for (key, time) in [("rise-ms", rise_s), ("fall-ms", fall_s)] {
                    put(key, shortest(time, time * MS_PER_S, |ms| ms / MS_PER_S));
                }
            }
            Law::Friction { speed } => {
                put(keys.height, value(term.gain));
                put(keys.speed, length(speed));
            }
            Law::Velocity => put(keys.velocity, gain(term.gain)),
            Law::Acceleration => put(keys.acceleration, gain(term.gain)),
        }
        if term.growth != 0.0 {
            put(keys.growth, shortest(term.growth, (keys.growths[1])(term.growth), keys.growths[0]));
        }
        put(keys.value.limit, value(term.limit));
    }
}

/// The section of a law: `reversal`, `friction-peak`, `friction`, `velocity`, `acceleration`.
#[must_use]
pub const fn section_of(law: &Law) -> &'static str {
    match law {
        Law::Reversal { .. } => SECTIONS[0],
        Law::FrictionPeak { .. } => SECTIONS[1],
        Law::Friction { .. } => SECTIONS[2],
        Law::Velocity => SECTIONS[3],
        Law::Acceleration => SECTIONS[4],
    }
}

/// Reads `[tool]`: tilt of the spindle and error of the tool length.
pub(super) fn read_tool(section: &Section<'_>) -> ToolErrors {
    let tilt = section.fixed::<2>("spindle-tilt-arcsec", "[about x, about y]");
    let length = section.number("length-error-um-per-m", Allowed::Within { low: -1e4, high: 1e4 });
    ToolErrors {
        tilt: tilt.map_or([0.0; 2], |t| t.value.map(rad_from_arcsec)),
        length: length.map_or(0.0, |n| n.value * PER_MILLION),
    }
}

/// Writes `[tool]`, where there is anything in it.
pub(super) fn write_tool(out: &mut String, tool: &ToolErrors) {
    if tool.is_zero() {
        return;
    }
    heading(out, "tool");
    let [a, b] = tool.tilt.map(|v| shortest(v, arcsec_from_rad(v), rad_from_arcsec));
    entry(out, "spindle-tilt-arcsec", format_args!("[{a}, {b}]"));
    let length = shortest(tool.length, tool.length / PER_MILLION, |v| v * PER_MILLION);
    entry(out, "length-error-um-per-m", length);
}

#[cfg(test)]
mod tests {
    use super::super::parse;

    const HEAD: &str = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y Z C t]\"\n[axes.c]\npoint-mm = [0, 0, 0]\n";

    fn wrong(text: &str) -> String {
        parse("m.toml", &format!("{HEAD}{text}")).map(|_| String::new()).unwrap_or_else(|e| e.to_string())
    }

    #[test]
    fn terms_are_read_in_mm_rad_and_s() {
        let text = format!(
            "{HEAD}[errors.exx.reversal]\nwidth-um = 8\nbuild-up-mm = 0.3\nlimit-um = 6\n\
             [errors.ecc.velocity]\ngain-arcsec-s-per-deg = 3.6\nlimit-arcsec = 20\n"
        );
        let spec = parse("m.toml", &text).unwrap();
        let term = |k: usize| spec.errors[k].1.dynamics[0];
        assert!((term(0).gain - 0.008).abs() < 1e-15 && (term(0).limit - 0.006).abs() < 1e-15);
        // 3.6 arcsec s/deg are a lag of 1 ms
        assert!((term(1).gain - 1e-3).abs() < 1e-12, "{:?}", term(1));
    }

    #[test]
    fn mistakes_are_named_with_their_remedy() {
        assert!(wrong("[errors.exx.reversal]\nlimit-um = 6\n").contains("width-um"));
        assert!(
            wrong("[errors.exx.velocity]\ngain-um-s-per-deg = 1\nlimit-um = 6\n")
                .contains("gain-um-s-per-mm")
        );
        assert!(wrong("[tool]\nlength-error-um-per-m = 10\n").contains("gauge-point-mm"));
    }
}
