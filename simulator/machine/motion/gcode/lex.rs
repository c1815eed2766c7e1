//! A line of a program to words and comments.

use super::{GcodeError, Problem};

/// A letter and its number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Word {
    pub(super) letter: char,
    pub(super) value: f64,
    pub(super) column: u32,
}

/// What a score mark says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mark {
    On,
    Off,
}

/// A line taken apart.
#[derive(Debug, Default)]
pub(super) struct Block {
    pub(super) words: Vec<Word>,
    pub(super) mark: Option<Mark>,
}

/// Takes a line apart.
pub(super) fn block(text: &str, line: u32) -> Result<Block, GcodeError> {
    let mut block = Block::default();
    let chars: Vec<char> = text.chars().collect();
    let mut at = 0;
    let error = |at: usize, problem| GcodeError { line, column: column(at), problem };
    while let Some(&c) = chars.get(at) {
        match c {
            c if c.is_whitespace() => at += 1,
            ';' | '%' => break,
            '#' => {
                let variable = chars[at + 1..].iter().find(|c| !c.is_whitespace());
                let first = block.words.is_empty();
                if !first || variable.is_some_and(|c| c.is_ascii_digit() || matches!(c, '<' | '[' | '#')) {
                    return Err(error(at, Problem::Variable));
                }
                break;
            }
            '/' => return Err(error(at, Problem::BlockDelete)),
            '(' => {
                let Some(length) = chars[at..].iter().position(|&c| c == ')') else {
                    return Err(error(at, Problem::OpenComment));
                };
                let comment: String = chars[at + 1..at + length].iter().collect();
                block.mark = mark(&comment).or(block.mark);
                at += length + 1;
            }
            '[' | '=' => return Err(error(at, Problem::Variable)),
            c if c.is_ascii_alphabetic() => {
                let (word, next) = word(&chars, at, line)?;
                block.words.push(word);
                at = next;
            }
            found => return Err(error(at, Problem::Character { found })),
        }
    }
    Ok(block)
}

fn column(at: usize) -> u32 {
    u32::try_from(at + 1).unwrap_or(u32::MAX)
}

fn mark(comment: &str) -> Option<Mark> {
    let words: Vec<String> = comment.split_whitespace().map(str::to_ascii_uppercase).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["SCORE", "ON"] => Some(Mark::On),
        ["SCORE", "OFF"] => Some(Mark::Off),
        _ => None,
    }
}

fn word(chars: &[char], at: usize, line: u32) -> Result<(Word, usize), GcodeError> {
    let letter = chars[at].to_ascii_uppercase();
    let mut from = at + 1;
    while chars.get(from).is_some_and(|c| c.is_whitespace()) {
        from += 1;
    }
    if chars.get(from).is_some_and(|c| matches!(c, '#' | '[' | '=')) {
        return Err(GcodeError { line, column: column(from), problem: Problem::Variable });
    }
    let mut end = from;
    while chars.get(end).is_some_and(|c| c.is_ascii_digit() || matches!(c, '+' | '-' | '.')) {
        end += 1;
    }
    if end == from {
        return Err(GcodeError { line, column: column(at), problem: Problem::NoNumber { letter } });
    }
    let text: String = chars[from..end].iter().collect();
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok((Word { letter, value, column: column(at) }, end)),
        _ => Err(GcodeError { line, column: column(at), problem: Problem::BadNumber { letter, text } }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<(char, f64)> {
        block(text, 1).unwrap().words.iter().map(|w| (w.letter, w.value)).collect()
    }

    #[test]
    fn words_with_and_without_spaces() {
        assert_eq!(
            words("N10G1x-1.5 Y.25Z+3."),
            [('N', 10.0), ('G', 1.0), ('X', -1.5), ('Y', 0.25), ('Z', 3.0)]
        );
        assert_eq!(words("G 1 X 2"), [('G', 1.0), ('X', 2.0)]);
    }

    #[test]
    fn comments_vanish_and_marks_stay() {
        assert_eq!(words("G1 (to the left) X2 ; the end Y3"), [('G', 1.0), ('X', 2.0)]);
        assert_eq!(block("(score  on)", 1).unwrap().mark, Some(Mark::On));
        assert!(words("%").is_empty() && words("# a remark").is_empty() && words("").is_empty());
    }

    #[test]
    fn mistakes_have_a_column() {
        for (text, column) in [
            ("G1 X", 4),
            ("G1 X1..2", 4),
            ("G1 ?", 4),
            ("G1 (open", 4),
            ("#100=5", 1),
            ("X#1", 2),
            ("/G1", 1),
        ] {
            assert_eq!(block(text, 7).unwrap_err().column, column, "{text}");
        }
    }
}
