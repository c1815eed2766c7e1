//! Numbers and counts in sentences: no negative zero, no `1 readings`.

/// A number with some decimals; what rounds to zero has no sign.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(size) if size.bytes().all(|b| b == b'0' || b == b'.') => size.to_owned(),
        _ => text,
    }
}

/// A share as a whole percentage, without its sign of percent.
pub(crate) fn percent(share: f64) -> String {
    fixed(100.0 * share, 0)
}

/// `1 reading`, `2 readings`.
pub(crate) fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_has_no_sign_and_one_has_no_plural() {
        assert_eq!(
            [fixed(-0.001, 2), fixed(-0.006, 2), fixed(-0.0, 0), fixed(f64::NAN, 1)],
            ["0.00", "-0.01", "0", "NaN"]
        );
        assert_eq!([percent(-0.004), percent(-0.006), percent(0.5)], ["0", "-1", "50"]);
        assert_eq!([counted(1, "reading"), counted(0, "reading")], ["1 reading", "0 readings"]);
    }
}
