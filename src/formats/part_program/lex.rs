//! A line of a part program to words.

/// A letter and its number, with their places in the line (bytes).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Word<'a> {
    pub(super) letter: char,
    pub(super) value: f64,
    /// The whole word.
    pub(super) text: &'a str,
    /// Where the letter stands.
    pub(super) from: usize,
    /// Where the number begins.
    pub(super) number: usize,
    /// Behind the number.
    pub(super) to: usize,
}

impl Word<'_> {
    /// This letter with this number.
    #[expect(clippy::float_cmp, reason = "codes are whole numbers or tenths as written")]
    pub(super) fn is(&self, letter: char, value: f64) -> bool {
        self.letter == letter && self.value == value
    }
}

/// Words of a line; comments `( .. )`, `;`, `%` are skipped.
///
/// # Errors
/// Column (0-based) and message.
pub(super) fn words(text: &str) -> Result<Vec<Word<'_>>, (usize, String)> {
    let bytes = text.as_bytes();
    let mut out = Vec::new();
    let mut at = 0;
    while let Some(&c) = bytes.get(at) {
        match c {
            c if c.is_ascii_whitespace() => at += 1,
            b';' | b'%' => break,
            b'(' => match text[at..].find(')') {
                Some(length) => at += length + 1,
                None => return Err((at, "comment without end; close it with )".to_owned())),
            },
            b'/' => {
                return Err((
                    at,
                    "block delete (/) is not corrected; remove the block or the slash".to_owned(),
                ));
            }
            c if c.is_ascii_alphabetic() => {
                let word = word(text, at)?;
                at = word.to;
                out.push(word);
            }
            _ => {
                let what =
                    "variables, expressions and other characters are not corrected; write the numbers out";
                return Err((at, what.to_owned()));
            }
        }
    }
    Ok(out)
}

fn word(text: &str, from: usize) -> Result<Word<'_>, (usize, String)> {
    let bytes = text.as_bytes();
    let skip = |mut at: usize, f: fn(&u8) -> bool| {
        while bytes.get(at).is_some_and(f) {
            at += 1;
        }
        at
    };
    let number = skip(from + 1, u8::is_ascii_whitespace);
    let to = skip(number, |b| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.'));
    let letter = char::from(bytes[from]).to_ascii_uppercase();
    // a control may read the E as part of the number, or as a word of its own
    if let [b'e' | b'E', rest @ ..] = &bytes[to..]
        && to > number
        && rest.first().is_some_and(|b| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.'))
    {
        let what = format!(
            "{letter} with an exponent is not corrected; write the number out, such as {letter}0.00001"
        );
        return Err((from, what));
    }
    match text[number..to].parse::<f64>().ok().filter(|v| v.is_finite()) {
        Some(value) => Ok(Word { letter, value, text: &text[from..to], from, number, to }),
        None => Err((
            from,
            format!("{letter} without a number that can be read; write digits, such as {letter}-12.5"),
        )),
    }
}
