//! Renishaw ballbar `.b5r`: XML with the test's description and the figures of its analysis.
//!
//! `<FEATURE NAME="AF_SQUARENESS" DT="UT_SQUARENESS">12.5</FEATURE>`; `TEST_PLANE` with its plane XY, YZ or ZX;
//! `OPERATOR`, `DATE_STARTED`, `MACHINE_TESTED`, `SERIAL_NUMBER`, `LAST_CALIBRATED`, `PART_NUMBER`. Units follow from `DT`.
//! The elements of the raw samples are not documented anywhere public and are not read.
//!
//! Source: a public reader of the features.

use roxmltree::{Document, Node};

use crate::prelude::*;

/// A figure of the analysis.
#[derive(Debug, Clone, PartialEq)]
pub struct Feature {
    /// Its name, such as `AF_SQUARENESS`.
    pub name: String,
    /// What kind of quantity it is, such as `UT_SQUARENESS`.
    pub data_type: String,
    /// Its value.
    pub value: f64,
    /// Its unit, where the data type is known.
    pub unit: Option<&'static str>,
}

/// A ballbar test.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ballbar {
    /// XY, YZ or ZX.
    pub plane: Option<String>,
    /// Texts that describe the test: key in lower case, text.
    pub about: Vec<(&'static str, String)>,
    /// The figures, in the order of the file.
    pub features: Vec<Feature>,
}

/// Units by data type.
const UNITS: [(&str, &str); 9] = [
    ("UT_LENGTH_MM", "mm"),
    ("UT_LENGTH_UM", "um"),
    ("UT_FEEDRATE", "mm/min"),
    ("UT_SQUARENESS", "um/m"),
    ("UT_SERVO_MISMATCH", "ms"),
    ("UT_ANGLE", "deg"),
    ("UT_SCALE_ERROR", "ppm"),
    ("UT_PERCENT", "%"),
    ("UT_RANKING", "rank"),
];

/// Elements that describe the test, by the attribute that holds the text, or the text itself.
const ABOUT: [(&str, &str, &str); 7] = [
    ("TEST_SPEC", "NAME", "test"),
    ("OPERATOR", "NAME", "operator"),
    ("DATE_STARTED", "", "date"),
    ("MACHINE_TESTED", "NAME", "machine"),
    ("SERIAL_NUMBER", "", "serial number"),
    ("LAST_CALIBRATED", "", "last calibrated"),
    ("PART_NUMBER", "", "part number"),
];

/// Most elements of a file.
const NODES_MAX: u32 = 4_000_000;

/// True where the beginning of a file looks like this format.
#[must_use]
pub fn recognises(text: &str) -> bool {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    text.starts_with('<')
        && ["<FEATURE", "TEST_PLANE", "TEST_SPEC", "MACHINE_TESTED"].iter().any(|w| text.contains(w))
}

/// Reads a file.
///
/// # Errors
/// Broken XML, a figure that is no number, a file without figures.
pub fn parse(text: &str) -> Result<Ballbar, FormatError> {
    let text = text.trim_start_matches('\u{feff}');
    let options = roxmltree::ParsingOptions { nodes_limit: NODES_MAX, ..Default::default() };
    let document = Document::parse_with_options(text, options).map_err(|e| {
        let at = e.pos();
        // the reader puts the place behind its message; ours stands in front
        let message = e.to_string();
        let message = message.split(" at ").next().unwrap_or("broken XML").to_owned();
        FormatError::at(at.row as usize, at.col as usize, FormatErrorKind::Syntax { message })
    })?;
    let mut ballbar = Ballbar::default();
    for node in document.descendants().filter(Node::is_element) {
        let name = node.tag_name().name();
        if name == "FEATURE" {
            ballbar.features.push(feature(&document, node)?);
        } else if name == "TEST_PLANE" || node.attribute("TEST_PLANE").is_some() {
            let plane =
                node.attribute("TEST_PLANE").or_else(|| node.attribute("PLANE")).or_else(|| node.text());
            ballbar.plane = plane.map(|p| p.trim().to_owned()).filter(|p| !p.is_empty()).or(ballbar.plane);
        } else if name == "PLANE" && ballbar.plane.is_none() {
            ballbar.plane = node.text().map(|p| p.trim().to_owned()).filter(|p| !p.is_empty());
        }
        if let Some((_, attribute, key)) = ABOUT.iter().find(|(element, ..)| *element == name) {
            let text = node.attribute(*attribute).or_else(|| node.text()).unwrap_or("").trim();
            if !text.is_empty() {
                ballbar.about.push((key, text.to_owned()));
            }
        }
    }
    if ballbar.features.is_empty() {
        let kind = FormatErrorKind::Missing {
            what: "an element FEATURE with a figure",
            remedy: "raw samples alone are not read: their elements are not documented; analyse and save the test first",
        };
        return Err(FormatError::of_file(kind));
    }
    Ok(ballbar)
}

fn feature(document: &Document<'_>, node: Node<'_, '_>) -> Result<Feature, FormatError> {
    let at = document.text_pos_at(node.range().start);
    let place = |kind| FormatError::at(at.row as usize, at.col as usize, kind);
    let attribute = |name: &'static str, what| {
        let found = node.attribute(name).map(str::trim).filter(|t| !t.is_empty());
        found.ok_or_else(|| place(FormatErrorKind::Missing { what, remedy: "a figure needs NAME and DT" }))
    };
    let name = attribute("NAME", "the attribute NAME of FEATURE")?;
    let data_type = attribute("DT", "the attribute DT of FEATURE")?;
    let text = node.text().unwrap_or("").trim();
    // some installations write a decimal comma
    let plain = if text.contains('.') { text.to_owned() } else { text.replace(',', ".") };
    let value = Word { line: 1, column: 1, text: &plain }
        .number("the value of a FEATURE")
        .map_err(|_| place(FormatErrorKind::Number { text: short(text), what: "the value of a FEATURE" }))?;
    let unit = UNITS.iter().find(|(t, _)| *t == data_type).map(|(_, unit)| *unit);
    Ok(Feature { name: name.to_owned(), data_type: data_type.to_owned(), value, unit })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<BALLBAR>\n <TEST TEST_PLANE=\"XY\"/>\n <MACHINE_TESTED NAME=\"VMC &amp; Co\"/>\n <OPERATOR>ann</OPERATOR>\n <FEATURES>\n  <FEATURE NAME=\"AF_SQUARENESS\" DT=\"UT_SQUARENESS\">-12.5</FEATURE>\n  <FEATURE NAME=\"AF_BACKLASH_A_POS\" DT=\"UT_LENGTH_UM\"> 3,25 </FEATURE>\n  <FEATURE NAME=\"AF_NEW\" DT=\"UT_NEW\">1</FEATURE>\n </FEATURES>\n</BALLBAR>\n";

    #[test]
    fn figures_and_their_units() {
        let ballbar = parse(GOOD).unwrap();
        assert!(recognises(GOOD) && !recognises("{}"));
        assert_eq!(ballbar.plane.as_deref(), Some("XY"));
        assert_eq!(ballbar.about, [("machine", "VMC & Co".to_owned()), ("operator", "ann".to_owned())]);
        let found: Vec<_> = ballbar.features.iter().map(|f| (f.name.as_str(), f.value, f.unit)).collect();
        assert_eq!(
            found,
            [
                ("AF_SQUARENESS", -12.5, Some("um/m")),
                ("AF_BACKLASH_A_POS", 3.25, Some("um")),
                ("AF_NEW", 1.0, None)
            ]
        );
        let as_element = GOOD.replace("<TEST TEST_PLANE=\"XY\"/>", "<PLANE>YZ</PLANE>");
        assert_eq!(parse(&as_element).unwrap().plane.as_deref(), Some("YZ"));
    }

    #[test]
    fn mistakes_name_their_place() {
        let fails = |from: &str, to: &str| parse(&GOOD.replace(from, to)).unwrap_err().to_string();
        assert!(fails("-12.5", "tall").starts_with("7:3: 'tall' is not a finite number"));
        assert!(fails("-12.5", "NaN").starts_with("7:3: 'NaN' is not a finite number"));
        assert!(
            fails("NAME=\"AF_SQUARENESS\" ", "").starts_with("7:3: the attribute NAME of FEATURE is missing")
        );
        assert!(
            fails("</FEATURES>", "</FEATURE>").starts_with("10:"),
            "{}",
            fails("</FEATURES>", "</FEATURE>")
        );
        assert!(parse("<A/>").unwrap_err().to_string().contains("raw samples alone are not read"));
        let bomb = "<!DOCTYPE a [<!ENTITY b \"c\">]><a>&b;</a>";
        assert!(parse(bomb).is_err(), "no document types: they can name files and grow without bound");
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in 0..GOOD.len(), with in "[<>&\"/a-z!\\[]{0,6}", cut in 0usize..9) {
            let end = (at + cut).min(GOOD.len());
            let text = format!("{}{with}{}", &GOOD[..at], &GOOD[end..]);
            let _ = parse(&text);
        }
    }
}
