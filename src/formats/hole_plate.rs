//! Tables of hole places from a coordinate measuring machine: fixed columns of millimetres separated by blanks, as
//! drilled plates of telescopes are delivered.
//!
//! `Meas X  Meas Y  Nom X  Nom Y  Err X  Err Y  Meas D  Nom D  Round` (the words of a column may be joined: `MeasX`), one
//! hole per line below. Lines before the heading are kept as a title; blank lines and `#` comments are skipped. The
//! error columns must be measured minus nominal to the rounding of the file, or the columns are not what they seem.

use super::text::finite;
use volcomp_evaluate::PlatePoint;

/// A measured plate.
#[derive(Debug, Clone, PartialEq)]
pub struct HolePlate {
    /// The lines above the heading, joined by commas.
    pub title: String,
    /// The holes, mm.
    pub holes: Vec<Hole>,
}

/// One hole, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hole {
    /// Nominal and measured place.
    pub place: PlatePoint,
    /// Nominal diameter.
    pub diameter: f64,
    /// Line in the file, from 1.
    pub line: usize,
}

/// What is wrong, and where: 1-based line and column, in characters.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{line}:{column}: {kind}")]
pub struct HolePlateError {
    /// 1-based line; 0 where the file as a whole is wrong.
    pub line: usize,
    /// 1-based column.
    pub column: usize,
    /// What is wrong.
    pub kind: HolePlateErrorKind,
}

/// What is wrong with a table of holes.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HolePlateErrorKind {
    /// No line names the columns.
    #[error(
        "no heading 'Meas X  Meas Y  Nom X  Nom Y  Err X  Err Y  Meas D  Nom D  Round'; is this a table of holes?"
    )]
    NoHeading,
    /// Not a finite number.
    #[error("'{text}' is not a finite number up to 1e30")]
    BadNumber {
        /// What stands there, shortened.
        text: String,
    },
    /// Not nine numbers.
    #[error("{found} fields, the heading has 9; is the line cut?")]
    Fields {
        /// Fields found.
        found: usize,
    },
    /// The error column contradicts the places.
    #[error(
        "measured minus nominal is {difference:.3} mm, the error column says {stated:.3} mm; are the columns in order?"
    )]
    Contradiction {
        /// From the places, mm.
        difference: f64,
        /// From the error column, mm.
        stated: f64,
    },
    /// No hole at all.
    #[error("no holes below the heading")]
    Empty,
}

const HEADING: &str = "measxmeasynomxnomyerrxerrymeasdnomdround";
/// Three roundings of a file written to 0.001 mm, with a little for their binary form.
const ROUNDING: f64 = 1.6e-3;

fn is_heading(line: &str) -> bool {
    let joined: String = line.split_whitespace().collect();
    joined.eq_ignore_ascii_case(HEADING)
}

/// True where a text looks like such a file.
#[must_use]
pub fn recognises(text: &str) -> bool {
    text.lines().take(50).any(is_heading)
}

/// Reads a table of holes.
///
/// # Errors
/// What is wrong and where; nothing is returned of a damaged file.
pub fn parse(text: &str) -> Result<HolePlate, HolePlateError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut title: Vec<&str> = Vec::new();
    let mut holes: Option<Vec<Hole>> = None;
    for (i, text) in text.lines().enumerate() {
        let trimmed = text.trim();
        if trimmed.is_empty() || trimmed.starts_with('#') {
            continue;
        }
        match &mut holes {
            None if is_heading(trimmed) => holes = Some(Vec::new()),
            None => title.push(trimmed),
            Some(holes) => {
                let line = i + 1;
                let (place, diameter) =
                    hole(text).map_err(|(column, kind)| HolePlateError { line, column, kind })?;
                holes.push(Hole { place, diameter, line });
            }
        }
    }
    let whole = |kind| HolePlateError { line: 0, column: 0, kind };
    let holes = holes.ok_or_else(|| whole(HolePlateErrorKind::NoHeading))?;
    if holes.is_empty() {
        return Err(whole(HolePlateErrorKind::Empty));
    }
    Ok(HolePlate { title: title.join(", "), holes })
}

fn hole(line: &str) -> Result<(PlatePoint, f64), (usize, HolePlateErrorKind)> {
    let mut values = [0.0; 9];
    let mut columns = [0; 9];
    let mut found = 0;
    for word in line.split_whitespace() {
        if let (Some(value), Some(place)) = (values.get_mut(found), columns.get_mut(found)) {
            // a word is a slice of its line
            let start = word.as_ptr() as usize - line.as_ptr() as usize;
            *place = line.get(..start).map_or(1, |before| before.chars().count() + 1);
            *value = finite(word).ok_or_else(|| {
                let text = word.chars().take(40).collect();
                (*place, HolePlateErrorKind::BadNumber { text })
            })?;
        }
        found += 1;
    }
    if found != 9 {
        return Err((1, HolePlateErrorKind::Fields { found }));
    }
    let [mx, my, nx, ny, ex, ey, _, diameter, _] = values;
    for (measured, nominal, stated, column) in [(mx, nx, ex, columns[4]), (my, ny, ey, columns[5])] {
        let difference = measured - nominal;
        if (difference - stated).abs() > ROUNDING {
            return Err((column, HolePlateErrorKind::Contradiction { difference, stated }));
        }
    }
    Ok((PlatePoint { nominal: [nx, ny], measured: [mx, my] }, diameter))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "Plate: 7\r\nDate: 2020-01-01\r\n\r\n  Meas X  Meas Y  Nom X  Nom Y  Err X  Err Y  Meas D  Nom D  Round\r\n";

    #[test]
    fn a_table_is_read() {
        let text = format!(
            "\u{feff}{HEAD}  11.610  -10.090  11.650  -10.184  -0.039  0.094  3.265  2.845  0.006\r\n# end\r\n"
        );
        assert!(recognises(&text));
        let plate = parse(&text).unwrap();
        assert_eq!(plate.title, "Plate: 7, Date: 2020-01-01");
        let [hole] = plate.holes[..] else { panic!("{plate:?}") };
        assert_eq!(
            (hole.place.nominal, hole.place.measured, hole.diameter, hole.line),
            ([11.65, -10.184], [11.61, -10.09], 2.845, 5)
        );
        // joined words of the heading
        assert!(recognises("MeasX MeasY NomX NomY ErrX ErrY MeasD NomD Round"));
        assert!(!recognises("nominal_x_mm,measured_x_mm"));
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_it_panic(body in "[-0-9. e+#a\\r\\n\u{e9}]{0,200}") {
            let _ = parse(&body);
            let _ = parse(&format!("{HEAD}{body}"));
        }
    }

    #[test]
    fn damage_is_named_with_its_place() {
        let row = |line: &str| parse(&format!("{HEAD}{line}\n")).unwrap_err().to_string();
        assert!(row("1 2 3 4 5").contains("5:1: 5 fields"), "{}", row("1 2 3 4 5"));
        assert!(row("1 2 3 4 5 6 7 8 9 10").contains("10 fields"));
        assert!(row(" 1.0 2,5 1 2 0 0 2 2 0").contains("5:6: '2,5' is not a finite number"));
        assert!(row("1 2 1 2 0 nan 2 2 0").contains("5:11: 'nan'"));
        assert!(row("1 2 1.5 2 0 0 2 2 0").contains("5:11: measured minus nominal is -0.500 mm"));
        assert!(parse("a\nb\n").unwrap_err().to_string().contains("no heading"));
        assert!(parse(HEAD).unwrap_err().to_string().contains("no holes"));
        assert!(parse("").is_err());
    }
}
