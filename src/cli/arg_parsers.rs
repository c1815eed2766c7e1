//! Parsers of option values: axes, points, numbers.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use volcomp_daemon::socket::check_reason;
use volcomp_formats::text::finite;

use crate::prelude::*;

/// An axis by its letter.
pub(super) fn axis_letter(text: &str) -> Result<AxisName, String> {
    let mut letters = text.chars();
    match (letters.next().and_then(AxisName::from_letter), letters.next()) {
        (Some(axis), None) => Ok(axis),
        _ => Err(format!("unknown axis '{text}'; expected one of x y z u v w a b c s")),
    }
}

/// A linear axis by its letter.
pub(super) fn linear_axis(text: &str) -> Result<AxisName, String> {
    let axis = axis_letter(text).ok().filter(|axis| axis.kind() == AxisKind::Linear);
    axis.ok_or_else(|| format!("invalid linear axis '{text}'; expected one of x y z u v w"))
}

/// Numbers with commas between them.
pub(super) fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let list: Option<Vec<f64>> = text.split(',').map(|t| finite(t.trim())).collect();
    list?.try_into().ok()
}

/// Three numbers in mm.
pub(super) fn point(text: &str) -> Result<Vec3, String> {
    numbers::<3>(text).map(Vec3::from).ok_or_else(|| {
        format!("invalid point '{text}'; write three finite numbers in mm, such as 0,250,-120")
    })
}

/// A reason or a name for the audit log.
pub(super) fn reason(text: &str) -> Result<String, String> {
    check_reason(text).map(|()| text.to_owned())
}

/// A finite number.
pub(super) fn number(text: &str) -> Result<f64, String> {
    finite(text.trim()).ok_or_else(|| format!("'{text}' is not a finite number"))
}

/// A finite number from 0 up.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    let value = number(text).ok().filter(|v| *v >= 0.0);
    value.ok_or_else(|| format!("'{text}' is not a finite number from 0 up"))
}

/// A finite number above 0.
pub(super) fn above_zero(text: &str) -> Result<f64, String> {
    number(text).ok().filter(|v| *v > 0.0).ok_or_else(|| format!("'{text}' is not a finite number above 0"))
}

/// One of some words: each with its help, which may be empty, and with what it means.
pub(super) fn one_of<T: Copy + Send + Sync + 'static>(
    words: &'static [(&'static str, &'static str, T)],
) -> impl TypedValueParser<Value = T> {
    let value = |(word, help, _): &(&'static str, &'static str, T)| {
        let value = PossibleValue::new(*word);
        if help.is_empty() { value } else { value.help(*help) }
    };
    let find = |given: String| words.iter().find(|(word, ..)| *word == given).map(|(.., meaning)| *meaning);
    PossibleValuesParser::new(words.iter().map(value))
        .try_map(move |given| find(given).ok_or("none of the words"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_on_command_lines() {
        assert_eq!(axis_letter("C"), Ok(AxisName::C));
        assert_eq!(linear_axis("y"), Ok(AxisName::Y));
        assert!(axis_letter("xy").is_err() && axis_letter("").is_err() && linear_axis("c").is_err());
        assert_eq!(point("0, 250,-120"), Ok(Vec3::new(0.0, 250.0, -120.0)));
        assert!(point("1,2").is_err() && point("1,2,3,4").is_err() && point("1,2,nan").is_err());
        assert_eq!((above_zero("0.5"), not_negative("0")), (Ok(0.5), Ok(0.0)));
        assert!(above_zero("0").is_err() && not_negative("-1").is_err() && number("inf").is_err());
    }
}
