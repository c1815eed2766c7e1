//! Screw compensation of LinuxCNC: `[JOINT_n] COMP_FILE`, `COMP_FILE_TYPE`.
//!
//! One row of three numbers per position: nominal, then for travel towards plus and towards minus the actual position (type
//! 0), or the trim nominal - actual (type 1). The control adds the trim to the position of the motor. So with the
//! deviation E = actual - nominal: type 0 holds nominal + E, type 1 holds -E. Units are those of the joint: mm or inch,
//! degrees for a rotary joint. The control stops reading at the first row that is not three numbers, without a word:
//! here it is an error, and no comment is ever written. Positions increase; at most 256 rows.
//!
//! The file holds the positioning error of one joint, nothing else. `BACKLASH` must not be set beside it.
//! Source: `usrmotintf.cc` and `command.c` of LinuxCNC.

use super::axis_table::{Row, curve};
use super::sample::sample_positioning;
use crate::prelude::*;

/// `COMP_FILE_TYPE`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CompType {
    /// Nominal, actual forward, actual reverse.
    Actual,
    /// Nominal, trim forward, trim reverse.
    Trim,
}

/// `LINEAR_UNITS` of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LinearUnit {
    /// Millimetres.
    #[default]
    Mm,
    /// Inches.
    Inch,
}

/// `EMCMOT_COMP_SIZE`.
pub const ROWS_MAX: usize = 256;
const MM_PER_INCH: f64 = 25.4;
const LIMITS: Limits = Limits {
    format: "linuxcnc",
    equidistant: false,
    points: ROWS_MAX,
    two_directions: true,
    decimals: DECIMALS_MAX,
};

/// Millimetres or degrees in the unit of the file.
fn size(kind: AxisKind, unit: LinearUnit) -> f64 {
    if kind == AxisKind::Linear && unit == LinearUnit::Inch { MM_PER_INCH } else { 1.0 }
}

/// Reads the positioning error of an axis.
///
/// # Errors
/// The first mistake, with its line and column.
pub fn parse(
    text: &str,
    kind: AxisKind,
    file: CompType,
    unit: LinearUnit,
) -> Result<ErrorFunction, FormatError> {
    let to_inner = |value: f64| kind.position_in(value * size(kind, unit));
    let mut rows = Vec::new();
    let mut blank = None;
    for line in lines(text) {
        if line.text.is_empty() {
            blank = blank.or(Some(line));
            continue;
        }
        if let Some(blank) = blank.filter(|_| !rows.is_empty()) {
            return Err(blank
                .unexpected("three numbers: the control stops reading at an empty line, and rows follow"));
        }
        let mut parts = words(line);
        let (Some(nominal), Some(forward), Some(reverse)) = (parts.next(), parts.next(), parts.next()) else {
            return Err(
                line.unexpected("three numbers: nominal, forward, reverse; the control stops reading here")
            );
        };
        if rows.len() == ROWS_MAX {
            return Err(line.too_many("rows", ROWS_MAX + 1, ROWS_MAX));
        }
        let nominal = nominal.number("a nominal position")?;
        let of = |value: f64| match file {
            // a difference of positions carries their rounding: 50.002 - 50 is not 0.002
            CompType::Actual => to_inner(((value - nominal) * 1e12).round() / 1e12),
            CompType::Trim => -to_inner(value),
        };
        rows.push(Row {
            line: line.line,
            position: to_inner(nominal),
            forward: of(forward.number("an actual position or a trim")?),
            reverse: of(reverse.number("an actual position or a trim")?),
        });
    }
    if rows.is_empty() {
        return Err(FormatError::missing(1, "a row of three numbers", "is this a COMP_FILE?"));
    }
    curve(&rows, kind)
}

/// Writes the positioning error of an axis.
///
/// # Errors
/// What the format cannot hold.
pub fn write(
    spec: &ModelSpec,
    axis: AxisName,
    file: CompType,
    unit: LinearUnit,
    sampling: &Sampling,
) -> Result<(String, AxisTable), ExportError> {
    let size = size(axis.kind(), unit);
    let table = sample_positioning(spec, axis, sampling, &LIMITS)?;
    let column = &table.columns[0];
    let reverse = column.reverse.as_ref().unwrap_or(&column.forward);
    let mut out = String::new();
    for ((q, forward), reverse) in table.positions.iter().zip(&column.forward).zip(reverse) {
        let of = |deviation: f64| match file {
            CompType::Actual => q + deviation,
            CompType::Trim => -deviation,
        };
        let row = [*q, of(*forward), of(*reverse)].map(|v| rounded(axis.kind().position_out(v) / size, 6));
        out.push_str(&row.join(" "));
        out.push('\n');
    }
    Ok((out, table))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use volcomp_model::curve::Curve;
    use volcomp_model::{Chain, ErrorSymbol};
    use volcomp_units::axes::Travel;

    fn read(text: &str, file: CompType) -> Result<ErrorFunction, FormatError> {
        parse(text, AxisKind::Linear, file, LinearUnit::Mm)
    }

    /// What the control does with a row, transcribed: type 0 turns actual positions into trims, and the motor goes to
    /// nominal + trim.
    fn motor(row: [f64; 3], file: CompType, forward: bool) -> f64 {
        let trim = match file {
            CompType::Actual => row[0] - row[if forward { 1 } else { 2 }],
            CompType::Trim => row[if forward { 1 } else { 2 }],
        };
        row[0] + trim
    }

    #[test]
    fn both_types_mean_the_same() {
        let actual = read(
            "0.000000 0.000000 -0.001279\n0.100000 0.098742 0.051632\n0.2 0.171529 0.194216 note\n",
            CompType::Actual,
        )
        .unwrap();
        let trim =
            read("0 0 0.001279\n0.1 0.001258 0.048368\n0.2 0.028471 0.005784\n", CompType::Trim).unwrap();
        for (x, travel) in [(0.0, Travel::Reverse), (0.1, Travel::Forward), (0.15, Travel::Reverse)] {
            assert!((actual.value(x, travel) - trim.value(x, travel)).abs() < 1e-12);
        }
        assert!((actual.value(0.1, Travel::Forward) + 0.001258).abs() < 1e-12);
    }

    #[test]
    fn a_machine_that_goes_too_far_is_held_back() {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X t]").unwrap());
        let exx = read("0 0 0\n100 100.01 100.02\n", CompType::Actual).unwrap();
        spec.errors = vec![(ErrorSymbol::parse("exx").unwrap(), exx)];
        for file in [CompType::Actual, CompType::Trim] {
            let (text, _) = write(&spec, AxisName::X, file, LinearUnit::Mm, &Sampling::default()).unwrap();
            let row: Vec<f64> = text.lines().nth(1).unwrap().split(' ').map(|w| w.parse().unwrap()).collect();
            let row = [row[0], row[1], row[2]];
            assert!(
                (motor(row, file, true) - 99.99).abs() < 1e-12
                    && (motor(row, file, false) - 99.98).abs() < 1e-12
            );
        }
    }

    #[test]
    fn units_and_rotary_joints() {
        let inch =
            parse("0 0 0\n1 1.001 1.001\n", AxisKind::Linear, CompType::Actual, LinearUnit::Inch).unwrap();
        assert!((inch.value(25.4, Travel::Forward) - 0.0254).abs() < 1e-12);
        let deg =
            parse("0 0 0\n180 0.001 0.001\n", AxisKind::Rotary, CompType::Trim, LinearUnit::Mm).unwrap();
        assert!((deg.value(core::f64::consts::PI, Travel::Forward) + 1e-3f64.to_radians()).abs() < 1e-15);
        assert!(matches!(&deg.curves[0], Curve::Table(t) if t.columns().2.is_none()));
    }

    #[test]
    fn what_the_control_would_skip_is_an_error() {
        for (text, expected) in [
            ("", "1:1: a row of three numbers is missing"),
            ("# made by hand\n0 0 0\n", "1:1: '#' is not a finite number"),
            ("0 0 0\n1 1\n", "2:1: found '1 1', expected three numbers"),
            ("0 0 0\n\n1 1 1\n", "2:1: found '', expected three numbers: the control stops"),
            ("0 0 0\n1 0.9 7\n", "2:1: 6 is larger than any error of a machine (5 mm)"),
            ("0 0 0\n1 x 1\n", "2:3: 'x' is not a finite number"),
            ("0 0 0\n5 5 5\n5 5 5\n", "3:1: position 5 is not above 5"),
            ("0 0 0\n", "1:1: a table needs at least 2 positions"),
        ] {
            let message = read(text, CompType::Actual).unwrap_err().to_string();
            assert!(message.contains(expected), "{text:?} gives {message:?}");
        }
        let many: String = (0..257).map(|i| format!("{i} {i} {i}\n")).collect();
        assert!(
            read(&many, CompType::Actual)
                .unwrap_err()
                .to_string()
                .contains("rows: 257 found, the limit is 256")
        );
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(values in prop::collection::vec((-0.5..0.5f64, -0.5..0.5f64), 2..60), trim: bool) {
            let file = if trim { CompType::Trim } else { CompType::Actual };
            let text: String = values.iter().enumerate().map(|(i, (f, r))| format!("{} {f} {r}\n", i * 7)).collect();
            let first = read(&text, CompType::Trim).unwrap();
            let mut spec = ModelSpec::new("m", Chain::parse("[w b X t]").unwrap());
            spec.errors = vec![(ErrorSymbol::parse("exx").unwrap(), first.clone())];
            let (text, table) = write(&spec, AxisName::X, file, LinearUnit::Mm, &Sampling::default()).unwrap();
            prop_assert_eq!(table.positions.len(), values.len());
            let back = read(&text, file).unwrap();
            for i in 0..=values.len() * 7 {
                for travel in [Travel::Forward, Travel::Reverse] {
                    let (a, b) = (first.value(i as f64, travel), back.value(i as f64, travel));
                    prop_assert!((a - b).abs() < 1e-11);
                }
            }
            spec.errors[0].1 = back;
            prop_assert_eq!(write(&spec, AxisName::X, file, LinearUnit::Mm, &Sampling::default()).unwrap().0, text);
        }

        #[test]
        fn damaged_files_never_panic(text in "([0-9.eE+\\-]{1,4}[ \t\n]{0,2}){0,30}") {
            let _ = read(&text, CompType::Actual);
        }
    }
}
