//! Counts in sentences: no `1 readings`.

/// `1 reading`, `2 readings`.
pub(crate) fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_has_no_plural() {
        assert_eq!([counted(1, "reading"), counted(0, "reading")], ["1 reading", "0 readings"]);
    }
}
