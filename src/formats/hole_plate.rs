//! Tables of hole places from a coordinate measuring machine: fixed columns of millimetres separated by blanks, as
//! drilled plates of telescopes are delivered.
//!
//! `Meas X  Meas Y  Nom X  Nom Y  Err X  Err Y  Meas D  Nom D  Round` (the words of a column may be joined: `MeasX`), one
//! hole per line below. Lines before the heading are kept as a title; blank lines and `#` comments are skipped. The
//! error columns must be measured minus nominal to the rounding of the file, or the columns are not what they seem.

use crate::prelude::*;
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
pub fn parse(text: &str) -> Result<HolePlate, FormatError> {
    let mut title: Vec<&str> = Vec::new();
    let mut holes: Option<Vec<Hole>> = None;
    for line in lines(text).filter(|l| !l.text.is_empty() && !l.text.starts_with('#')) {
        match &mut holes {
            None if is_heading(line.text) => holes = Some(Vec::new()),
            None => title.push(line.text),
            Some(holes) => holes.push(hole(line)?),
        }
    }
    let missing = |what, remedy| FormatError::of_file(FormatErrorKind::Missing { what, remedy });
    let heading = "the heading 'Meas X  Meas Y  Nom X  Nom Y  Err X  Err Y  Meas D  Nom D  Round'";
    let holes = holes.ok_or_else(|| missing(heading, "is this a table of holes?"))?;
    if holes.is_empty() {
        return Err(missing("a row below the heading", "there are no holes"));
    }
    Ok(HolePlate { title: title.join(", "), holes })
}

fn hole(line: Word<'_>) -> Result<Hole, FormatError> {
    let fields: Vec<Word<'_>> = words(line).collect();
    let values = fields.iter().map(|w| w.number("a length in mm")).collect::<Result<Vec<_>, _>>()?;
    let &[mx, my, nx, ny, ex, ey, _, diameter, _] = values.as_slice() else {
        let (what, found) = ("fields under the heading", fields.len() as u64);
        return Err(FormatError::at(line.line, 1, FormatErrorKind::Count { what, announced: 9, found }));
    };
    for (measured, nominal, stated, at) in [(mx, nx, ex, fields[4]), (my, ny, ey, fields[5])] {
        let difference = measured - nominal;
        if (difference - stated).abs() > ROUNDING {
            return Err(at.fail(FormatErrorKind::Contradiction { difference, stated }));
        }
    }
    Ok(Hole { place: PlatePoint { nominal: [nx, ny], measured: [mx, my] }, diameter, line: line.line })
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
        assert!(row("1 2 3 4 5").contains("5:1: fields under the heading: 9 announced, 5 found"));
        assert!(row("1 2 3 4 5 6 7 8 9 10").contains("10 found"));
        assert!(row(" 1.0 2,5 1 2 0 0 2 2 0").contains("5:6: '2,5' is not a finite number"));
        assert!(row("1 2 1 2 0 nan 2 2 0").contains("5:11: 'nan'"));
        assert!(row("1 2 1.5 2 0 0 2 2 0").contains("5:11: measured minus nominal is -0.500 mm"));
        assert!(parse("a\nb\n").unwrap_err().to_string().contains("the heading 'Meas X"));
        assert!(parse(HEAD).unwrap_err().to_string().contains("no holes"));
        assert!(parse("").is_err());
    }
}
