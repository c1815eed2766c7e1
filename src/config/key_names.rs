//! Names of keys: the unit at their end, and the nearest known name for an unknown one.

/// The units that keys end in, longest first where one is the end of another.
const UNITS: &[(&str, &str)] = &[
    ("um-per-m-krpm", "um/m per 1000/min"),
    ("um-per-m-k", "um/m/K"),
    ("um-per-m", "um/m"),
    ("um-per-krpm", "um per 1000/min"),
    ("um-per-k", "um/K"),
    ("um-per-s2", "um/s^2"),
    ("mm-per-s2", "mm/s^2"),
    ("arcsec-per-s2", "arcsec/s^2"),
    ("deg-per-s2", "deg/s^2"),
    ("um-per-h", "um/h"),
    ("arcsec-per-h", "arcsec/h"),
    ("um-per-s", "um/s"),
    ("mm-per-s", "mm/s"),
    ("arcsec-per-s", "arcsec/s"),
    ("deg-per-s", "deg/s"),
    ("arcsec", "arcsec"),
    ("urad", "urad"),
    ("mrad", "mrad"),
    ("rad", "rad"),
    ("deg", "deg"),
    ("degc", "degC"),
    ("mm", "mm"),
    ("um", "um"),
    ("nm", "nm"),
    ("rpm", "1/min"),
    ("percent", "%"),
    ("min", "min"),
    ("ms", "ms"),
    ("us", "us"),
    ("ns", "ns"),
    ("s", "s"),
];

/// The unit that a key ends in.
pub(super) fn unit_of(key: &str) -> Option<&'static str> {
    UNITS
        .iter()
        .map(|(unit, _)| *unit)
        .find(|unit| key.strip_suffix(unit).is_some_and(|stem| stem.ends_with('-') && stem.len() > 1))
}

/// A key without its unit.
pub(super) fn stem(key: &str) -> &str {
    match unit_of(key) {
        Some(unit) => &key[..key.len() - unit.len() - 1],
        None => key,
    }
}

/// A unit as people write it.
pub(super) fn in_words(unit: &str) -> &str {
    UNITS.iter().find(|(u, _)| *u == unit).map_or(unit, |(_, words)| words)
}

/// The message of a deserialiser about an unknown field or variant, with the nearest known one.
#[must_use]
pub fn with_nearest(message: &str) -> String {
    let message = message.trim_end();
    let Some((_, words)) = message.split_once("unknown ") else { return message.to_owned() };
    let mut quoted = words.split('`').skip(1).step_by(2);
    let Some(written) = quoted.next() else { return message.to_owned() };
    let known: Vec<&str> = quoted.collect();
    match suggestion(written, &known, "") {
        hint if hint.starts_with("did you mean") => format!("{message}; {hint}"),
        _ => message.to_owned(),
    }
}

/// The nearest known word, or all of them behind `introduction`.
#[must_use]
pub fn suggestion(written: &str, known: &[&str], introduction: &str) -> String {
    let nearest = known.iter().map(|k| (distance(written, k), *k)).min();
    match nearest {
        // a third of the letters may differ
        Some((d, word)) if d <= written.chars().count().max(word.chars().count()).div_ceil(3) => {
            format!("did you mean {word}?")
        }
        _ => format!("{introduction}{}", known.join(", ")),
    }
}

/// Edit distance of two words whatever their case: letters to insert, delete, replace or swap with their neighbour.
fn distance(a: &str, b: &str) -> usize {
    let plain = |word: &str| word.to_lowercase().chars().take(64).collect::<String>();
    strsim::osa_distance(&plain(a), &plain(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_counts_edits_and_swaps() {
        for (a, b, d) in [
            ("", "", 0),
            ("ramp-s", "ramp-s", 0),
            ("rmap-s", "ramp-s", 1),
            ("cycle", "cycel", 1),
            ("abc", "", 3),
            ("fourier", "furier", 1),
        ] {
            assert_eq!((distance(a, b), distance(b, a)), (d, d), "{a} {b}");
        }
    }

    #[test]
    fn suggestions_are_near_or_complete() {
        assert_eq!(
            suggestion("adress", &["address", "cycle-ms"], "expected one of: "),
            "did you mean address?"
        );
        assert_eq!(
            suggestion("zzz", &["address", "cycle-ms"], "expected one of: "),
            "expected one of: address, cycle-ms"
        );
    }

    #[test]
    fn an_unknown_field_gets_the_nearest_one() {
        let message = "unknown field `gian`, expected one of `command`, `gain`, `map` at line 1 column 27";
        assert_eq!(with_nearest(message), format!("{message}; did you mean gain?"));
        for other in ["unknown field `zzzzzzz`, expected `gain`", "missing field `command`", ""] {
            assert_eq!(with_nearest(other), other);
        }
    }

    #[test]
    fn units_are_the_end_of_a_key() {
        for (key, unit, bare) in [
            ("position-mm", Some("mm"), "position"),
            ("rate-um-per-s", Some("um-per-s"), "rate"),
            ("acceleration-um-per-s2", Some("um-per-s2"), "acceleration"),
            ("hold-s", Some("s"), "hold"),
            ("stale-ms", Some("ms"), "stale"),
            ("sense", None, "sense"),
            ("temperature-degc", Some("degc"), "temperature"),
            ("sin-um", Some("um"), "sin"),
            ("mm", None, "mm"),
        ] {
            assert_eq!((unit_of(key), stem(key)), (unit, bare), "{key}");
        }
    }
}
