//! Counts and numbers as a person reads them: no `1 readings`, no `-0.00`.

use core::fmt::{Display, Write as _};

/// `1 reading`, `2 readings`.
pub(crate) fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

/// A probability that has failed a test.
pub(crate) fn small(p: f64) -> String {
    if p < 1e-12 { "below 1e-12".to_owned() } else { format!("{p:.1e}") }
}

/// From here numbers have an exponent.
const LONG: f64 = 1e9;

/// A number with so many decimals, never minus zero; with an exponent where it would be long.
pub(crate) fn plain(v: f64, decimals: usize) -> String {
    if v.abs() >= LONG {
        return format!("{v:.4e}");
    }
    let text = format!("{v:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| matches!(b, b'0' | b'.')) => rest.to_owned(),
        _ => text,
    }
}

/// A number in all its digits, with an exponent where it would be long.
pub(crate) fn figure(v: f64) -> String {
    let long = v != 0.0 && v.is_finite() && !(1e-6..LONG).contains(&v.abs());
    if long { format!("{v:e}") } else { format!("{v}") }
}

/// A number with its sign, which zero has not.
pub(crate) fn signed(v: f64, decimals: usize) -> String {
    let text = plain(v, decimals);
    let is_zero = text.bytes().all(|b| matches!(b, b'0' | b'.'));
    if is_zero || text.starts_with('-') { text } else { format!("+{text}") }
}

/// Words that are joined to a list.
pub(crate) trait Joined: Iterator<Item: Display> + Sized {
    /// The items with `separator` between them.
    fn joined(self, separator: &str) -> String {
        let mut text = String::new();
        for (k, item) in self.enumerate() {
            // writing to a string cannot fail
            let _ = write!(text, "{}{item}", if k > 0 { separator } else { "" });
        }
        text
    }
}

impl<I: Iterator<Item: Display>> Joined for I {}

/// Words for a person: `µm` and `µs` where a key says `um` and `us`; lines that quote a file stay as they are.
pub(crate) fn micro(words: &str) -> String {
    let line = |line: &str| if line.contains(" | ") { line.to_owned() } else { micro_line(line) };
    words.split_inclusive('\n').map(line).collect()
}

fn micro_line(line: &str) -> String {
    let mut is_after_number = false;
    let word = |w: &str| {
        let bare =
            w.trim_start_matches(['(', '[']).trim_end_matches([',', ';', ')', ']', '.', ':', '?', '\n']);
        // `us` alone is a word of English
        let is_unit = bare == "um"
            || ["um/", "um^"].iter().any(|s| bare.starts_with(s))
            || bare == "us" && is_after_number;
        is_after_number = bare.ends_with(|c: char| c.is_ascii_digit());
        if is_unit { w.replacen('u', "µ", 1) } else { w.to_owned() }
    };
    line.split(' ').map(word).joined(" ")
}

/// Whether a terminal or a viewer obeys a character instead of showing it: controls, line and paragraph separators, and
/// the controls of bidirectional text.
pub(crate) fn is_obeyed(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Text without characters that a terminal would obey, which files may hold; line ends and tabs stay.
pub(crate) fn printable(text: &str) -> String {
    let shown = |c: char| if is_obeyed(c) && !matches!(c, '\n' | '\t') { '\u{fffd}' } else { c };
    text.chars().map(shown).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_replaced() {
        assert_eq!(printable("a\u{1b}[31m\0 b\n\tc"), "a\u{fffd}[31m\u{fffd} b\n\tc");
        assert_eq!(
            printable("a\u{202e}b\u{2028}c\u{2067}d\u{200f}é"),
            "a\u{fffd}b\u{fffd}c\u{fffd}d\u{fffd}é"
        );
    }

    #[test]
    fn one_has_no_plural_and_zero_no_sign() {
        assert_eq!([plain(-0.004, 2), plain(-0.0, 0), plain(-1.5, 1)], ["0.00", "0", "-1.5"]);
        assert_eq!(
            [plain(f64::MAX, 3), signed(-2e9, 2), signed(1e12, 0)],
            ["1.7977e308", "-2.0000e9", "+1.0000e12"]
        );
        assert_eq!(
            [figure(1e308), figure(-0.0), figure(1e-7), figure(850.5)],
            ["1e308", "-0", "1e-7", "850.5"]
        );
        assert_eq!([signed(-0.004, 0), signed(0.4, 0), signed(12.0, 0)], ["0", "0", "+12"]);
        assert_eq!(micro("1000 um/s, 2 um/s^2"), "1000 µm/s, 2 µm/s^2");
        assert_eq!([micro("um"), micro("3 um, at 1  Y"), micro("a sum")], ["µm", "3 µm, at 1  Y", "a sum"]);
        assert_eq!(
            micro("is read in um:\n  (um) 5 us, tell us\n3 | # um"),
            "is read in µm:\n  (µm) 5 µs, tell us\n3 | # um"
        );
        assert_eq!([counted(1, "reading"), counted(0, "reading")], ["1 reading", "0 readings"]);
    }
}
