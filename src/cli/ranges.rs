//! Ranges of numeric arguments, one table for every program: the unit or the quantity in the name of an argument gives
//! its range, so that a new argument has one, too.

use core::error::Error;
use core::num::ParseIntError;

use clap::builder::ValueParser;
use clap::error::{ContextKind, ErrorKind};
use clap::{Arg, ArgMatches, Command, Parser};

use crate::prelude::*;

/// Smallest and largest value.
type Range = [f64; 2];

/// Ranges of whole names, with blanks between those of one range.
const NAMES: &[(&str, Range)] = &[
    ("temperature_degc", [-50.0, 150.0]),
    ("gain tracker_outliers tracker_dropouts significance", [0.0, 1.0]),
    ("u_temperature_degc hold_out_percent", [0.0, 100.0]),
    ("order", [0.0, 1e3]),
    ("targets", [0.0, 1e4]),
    ("sigma noise limit walk_per_sqrt_h paced_ms resting", [0.0, 1e5]),
    ("lags_s speed_lags_s", [0.0, 1e7]),
    ("lambda ridge", [0.0, 1e12]),
    ("increment_um", [1e-6, 1e5]),
    ("spacing_mm pitch_mm", [1e-3, 1e3]),
    ("step", [1e-3, 1e5]),
    ("feed", [1e-3, 1e6]),
    ("bar_radius_mm ball_radius_mm", [1e-2, 1e3]),
    ("radius_mm", [1e-2, 1e4]),
    ("step_mm seconds", [1e-2, 1e5]),
    ("rate_hz", [1e-1, 1e5]),
    ("runs", [1.0, 1e3]),
    ("arc_deg", [1.0, 3600.0]),
    ("positions stops steps", [1.0, 1e4]),
    ("points blocks", [1.0, 1e5]),
    ("days", [1.0, 36_525.0]),
];

/// Ranges by the unit at the end of a name; a longer unit stands before one that it ends in.
const UNITS: &[(&str, Range)] = &[
    ("_um_per_m_degc", [-1e4, 1e4]),
    ("_um_per_m", [-1e4, 1e4]),
    ("_um_per_h", [-1e6, 1e6]),
    ("_mm_per_min", [1e-3, 1e6]),
    ("_degc", [-273.15, 1e4]),
    ("_arcsec", [-1e5, 1e5]),
    ("_percent", [0.0, 100.0]),
    ("_deg", [-3600.0, 3600.0]),
    ("_um", [-1e5, 1e5]),
    ("_mm", [-1e5, 1e5]),
    ("_us", [0.0, 1e9]),
    ("_ms", [0.0, 1e7]),
    ("_hz", [1e-3, 1e6]),
    ("_s", [-1e9, 1e9]),
];

/// Words in a name whose quantity cannot be below zero.
const NOT_NEGATIVE: &str = "sigma noise std tolerance accept between drift lies spike limit correlation length diameter box \
                            wait settle dwell";

/// Any other number, and any other count.
const OTHER: Range = [-1e9, 1e9];
const OTHER_COUNT: Range = [0.0, 1e8];

/// The range of a whole name.
fn named(name: &str) -> Option<Range> {
    NAMES.iter().find(|(names, _)| names.split(' ').any(|known| known == name)).map(|(_, range)| *range)
}

/// The range of a number with this name.
fn range(name: &str) -> Range {
    if let Some(range) = named(name) {
        return range;
    }
    let [low, high] = UNITS.iter().find(|(unit, _)| name.ends_with(unit)).map_or(OTHER, |(_, range)| *range);
    let not_negative = name.starts_with("u_")
        || name.split('_').any(|word| NOT_NEGATIVE.split(' ').any(|known| known == word));
    [if not_negative { low.max(0.0) } else { low }, high]
}

/// The range of a count with this name; `None` for a seed, which is any number.
fn count_range(name: &str) -> Option<Range> {
    (name != "seed").then(|| named(name).unwrap_or(OTHER_COUNT))
}

/// Numbers of an argument, by the type of its values; `None` where they are no numbers.
fn numbers(matches: &ArgMatches, name: &str, parser: &ValueParser) -> Option<(Vec<f64>, bool)> {
    let is = parser.type_id();
    macro_rules! of {
        ($($type:ty, $count:literal, $to:expr);* $(;)?) => {$(
            if is == std::any::TypeId::of::<$type>() {
                let to: fn(&$type) -> Vec<f64> = $to;
                let values = matches.try_get_many::<$type>(name).ok()??;
                return Some((values.flat_map(to).collect(), $count));
            }
        )*};
    }
    of! {
        f64, false, |v| vec![*v];
        Vec3, false, |v| v.iter().copied().collect();
        [f64; 3], false, |v| v.to_vec();
        [f64; 2], false, |v| v.to_vec();
        (f64, f64), false, |v| vec![v.0, v.1];
        (AxisName, f64), false, |v| vec![v.1];
        (ErrorSymbol, f64), false, |v| vec![v.1];
        (AxisName, [f64; 2]), false, |v| v.1.to_vec();
        super::fit::AutoOr<f64>, false, |v| v.number().into_iter().collect();
        u64, true, |v| vec![*v as f64];
        u32, true, |v| vec![f64::from(*v)];
        usize, true, |v| vec![*v as f64];
    }
    None
}

/// The first number of a command line that is outside its range: its argument and what is wrong.
fn outside<'c>(command: &'c Command, matches: &ArgMatches) -> Option<(&'c Arg, f64, Range)> {
    for argument in command.get_arguments() {
        let name = argument.get_id().as_str();
        let Some((values, is_count)) = numbers(matches, name, argument.get_value_parser()) else { continue };
        let Some([low, high]) = (if is_count { count_range(name) } else { Some(range(name)) }) else {
            continue;
        };
        // a NaN is in no range
        if let Some(value) = values.into_iter().find(|v| !(low..=high).contains(v)) {
            return Some((argument, value, [low, high]));
        }
    }
    let (name, matches) = matches.subcommand()?;
    outside(command.find_subcommand(name)?, matches)
}

/// Lets every option take a negative number, so that its range answers and not the parser of options.
fn with_negative_numbers(command: Command) -> Command {
    let allow = |a: Arg| if a.get_action().takes_values() { a.allow_negative_numbers(true) } else { a };
    command.mut_args(allow).mut_subcommands(with_negative_numbers)
}

/// A count that is no whole number, with what is expected.
fn as_whole_number(command: &mut Command, error: clap::Error) -> clap::Error {
    let is_count = error.source().is_some_and(<dyn Error>::is::<ParseIntError>);
    match (error.get(ContextKind::InvalidArg), error.get(ContextKind::InvalidValue)) {
        (Some(argument), Some(value)) if is_count => {
            let what = format!("invalid value '{value}' for '{argument}': expected a whole number from 0 up");
            command.error(ErrorKind::ValueValidation, what)
        }
        _ => error,
    }
}

/// Parses a command line, checks every number in it, and refuses to write over a file that it reads.
///
/// # Errors
/// A wrong command line, a number outside its range, or an output that is an input.
pub fn parse<A: Parser>(args: impl IntoIterator<Item = std::ffi::OsString>) -> Result<A, clap::Error> {
    parse_with(A::command(), args)
}

/// [`parse`] with the command tree of `A` as the caller has dressed it.
pub(crate) fn parse_with<A: Parser>(
    command: Command,
    args: impl IntoIterator<Item = std::ffi::OsString>,
) -> Result<A, clap::Error> {
    let mut command = with_negative_numbers(command);
    let parsed = command.try_get_matches_from_mut(args);
    let mut matches = parsed.map_err(|e| as_whole_number(&mut command, e))?;
    if let Some((argument, value, [low, high])) = outside(&command, &matches) {
        let what = format!("invalid value '{}' for '{argument}': expected {low} to {high}", figure(value));
        return Err(command.error(ErrorKind::ValueValidation, what));
    }
    if let Some(what) = super::targets::conflict(&command, &matches) {
        return Err(command.error(ErrorKind::ArgumentConflict, what));
    }
    A::from_arg_matches_mut(&mut matches).map_err(|e| e.format(&mut command))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_and_words_give_ranges() {
        assert_eq!(range("noise_um"), [0.0, 1e5]);
        assert_eq!(range("u_device_um_per_m"), [0.0, 1e4]);
        assert_eq!(range("zero_at_mm"), [-1e5, 1e5]);
        assert_eq!(range("temperature_degc"), [-50.0, 150.0]);
        assert_eq!((count_range("seed"), count_range("stops")), (None, Some([1.0, 1e4])));
    }

    #[test]
    fn every_range_is_finite_and_holds_the_default() {
        fn check(command: &Command) {
            for argument in command.get_arguments() {
                let name = argument.get_id().as_str();
                let [low, high] = range(name);
                assert!(low.is_finite() && high.is_finite() && low < high, "{name}");
            }
            command.get_subcommands().for_each(check);
        }
        check(&crate::command());
    }
}
