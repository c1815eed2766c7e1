//! Laser tests of API, `.pos`: blocks of positions and mean deviations in mm.
//!
//! A block begins with `Position   <tab>Bidirectional Avg Error`, `.. Forward Directional Avg Error` or
//! `.. Backward`/`Reverse Directional Avg Error`, and holds rows of a position and a mean deviation (actual - nominal; the public
//! reader turns it round to get a correction). Means of single directions are read where they are there, else the
//! mean of both, as one direction. Repeatability cannot be had from means.

use super::positioning_test::PositioningTest;
use crate::prelude::*;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Block {
    Both,
    Forward,
    Reverse,
    Other,
}

/// A test, and whether it holds means of both directions only.
#[derive(Debug, Clone, PartialEq)]
pub struct Means {
    /// The test.
    pub test: PositioningTest,
    /// True where the directions were not given apart.
    pub bidirectional_only: bool,
}

/// True where the beginning of a file looks like this format.
#[must_use]
pub fn recognises(text: &str) -> bool {
    text.contains("Directional Avg Error") || text.contains("Bidirectional Avg Error")
}

/// Reads a file.
///
/// # Errors
/// The first mistake, with its line and column.
pub fn parse(text: &str) -> Result<Means, FormatError> {
    let mut block = Block::Other;
    let mut rows: Vec<(Block, f64, f64, u64)> = Vec::new();
    for line in lines(text).filter(|l| !l.text.is_empty()) {
        if line.text.starts_with("Position") {
            block = match line.text {
                t if t.contains("Bidirectional Avg Error") => Block::Both,
                t if t.contains("Forward Directional Avg Error") => Block::Forward,
                t if t.contains("Directional Avg Error")
                    && (t.contains("Backward") || t.contains("Reverse")) =>
                {
                    Block::Reverse
                }
                _ => Block::Other,
            };
            continue;
        }
        let mut parts = words(line);
        let (first, second) = (parts.next(), parts.next());
        let numeric =
            first.is_some_and(|w| w.text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)));
        if block == Block::Other || !numeric {
            // anything else ends a block
            block = Block::Other;
            continue;
        }
        let (Some(position), Some(value)) = (first, second) else {
            return Err(line.unexpected("a row of two: position and mean deviation, mm"));
        };
        let (position, value) =
            (position.number("a position in mm")?, value.number("a mean deviation in mm")?);
        rows.push((block, position, value, line.line as u64));
    }
    let apart = rows.iter().any(|(b, ..)| matches!(b, Block::Forward | Block::Reverse));
    rows.retain(|(b, ..)| if apart { *b != Block::Both } else { *b == Block::Both });
    if rows.is_empty() {
        let what = "a block 'Position .. Avg Error' with rows";
        return Err(FormatError::missing(1, what, "is this a .pos file of a linear test?"));
    }
    let (readings, lines) = rows
        .into_iter()
        .map(|(block, position, value, line)| {
            let travel = if block == Block::Reverse { Travel::Reverse } else { Travel::Forward };
            (Reading { cycle: 1, travel, position, value }, line)
        })
        .unzip();
    Ok(Means {
        test: PositioningTest::new(AxisKind::Linear, readings, lines).in_standard_cycle(),
        bidirectional_only: !apart,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = "Machine X\r\nPosition   \tBidirectional Avg Error\r\n0.000 0.001\r\n10.0 -0.002\r\n\r\nPosition   \tForward Directional Avg Error\r\n0 0.002\r\n10 0.001\r\nPosition   \tBackward Directional Avg Error\r\n10 -0.005\r\n0 0\r\nENVIRONMENT::\r\n20.1\r\n";

    #[test]
    fn directions_where_they_are_there() {
        let found = parse(GOOD).unwrap();
        assert!(recognises(GOOD) && !found.bidirectional_only);
        assert_eq!(found.test.readings.len(), 4);
        assert_eq!((found.test.readings[2].travel, found.test.readings[2].value), (Travel::Reverse, -0.005));
        let both = parse(&GOOD[..GOOD.find("Position   \tForward").unwrap()]).unwrap();
        assert!(both.bidirectional_only && both.test.readings[1].value == -0.002);
        assert!(
            parse(&GOOD.replace("10 0.001", "10"))
                .unwrap_err()
                .to_string()
                .starts_with("8:1: found '10', expected a row")
        );
        assert!(parse(&GOOD.replace("10 0.001", "10 x")).unwrap_err().to_string().starts_with("8:4: 'x'"));
        assert!(parse("").unwrap_err().to_string().contains("Avg Error"));
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in 0..GOOD.len(), with in "[A-Za-z0-9. \n-]{0,6}", cut in 0usize..9) {
            let end = (at + cut).min(GOOD.len());
            let _ = parse(&format!("{}{with}{}", &GOOD[..at], &GOOD[end..]));
        }
    }
}
