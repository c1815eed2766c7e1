//! Mistakes in a text file, with their place.

use core::fmt;
use core::ops::Range;

use annotate_snippets::{AnnotationKind, Level, Origin, Renderer, Snippet};

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// Byte range in the text; `None` where the mistake has no place (something is missing altogether).
    pub span: Option<Range<usize>>,
    /// What is wrong, with value and limit.
    pub message: String,
    /// What to do about it.
    pub remedy: Option<String>,
}

impl Diagnostic {
    /// A mistake at a place.
    pub fn at(place: Range<usize>, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { span: Some(place), message: message.into(), remedy: Some(remedy.into()) }
    }

    /// A mistake of the file as a whole.
    pub fn of_file(message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { span: None, message: message.into(), remedy: Some(remedy.into()) }
    }
}

/// A place in a text, both numbers from 1; the column counts characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Line.
    pub line: usize,
    /// Column.
    pub column: usize,
}

/// All mistakes found in one file. `Display` shows each with file, line, caret and remedy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigErrors {
    /// The file, as the user named it.
    pub file: String,
    /// Its text, without a byte order mark.
    pub source: String,
    /// The mistakes, in the order of the text.
    pub diagnostics: Vec<Diagnostic>,
}

impl ConfigErrors {
    /// The mistakes of a file, sorted into the order of the text; the same mistake at the same place counts once.
    #[must_use]
    pub fn new(file: &str, source: &str, mut diagnostics: Vec<Diagnostic>) -> Self {
        diagnostics.sort_by_key(|d| d.span.as_ref().map_or((0, 0), |s| (1, s.start)));
        diagnostics.dedup();
        Self { file: file.to_owned(), source: source.to_owned(), diagnostics }
    }

    /// Line and column at which a mistake starts.
    #[must_use]
    pub fn place(&self, diagnostic: &Diagnostic) -> Option<Place> {
        let start = diagnostic.span.as_ref()?.start.min(self.source.len());
        let before = self.source.get(..start)?;
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        Some(Place {
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
        })
    }

    /// The mistakes as text; `color` adds the escape codes of a terminal.
    #[must_use]
    pub fn render(&self, color: bool) -> String {
        let renderer = if color { Renderer::styled() } else { Renderer::plain() };
        let mut out = String::new();
        for (i, diagnostic) in self.diagnostics.iter().take(MOST_SHOWN).enumerate() {
            if i > 0 {
                out.push_str("\n\n");
            }
            out.push_str(&self.render_one(&renderer, diagnostic));
        }
        let found = self.diagnostics.len();
        if found > MOST_SHOWN {
            out.push_str(&format!("\n\n{}: {found} mistakes, the first {MOST_SHOWN} are shown", self.file));
        } else if found > 1 {
            out.push_str(&format!("\n\n{}: {found} mistakes", self.file));
        }
        out
    }

    fn render_one(&self, renderer: &Renderer, diagnostic: &Diagnostic) -> String {
        let title = Level::ERROR.primary_title(diagnostic.message.as_str());
        let mut group = match &diagnostic.span {
            Some(span) => {
                let (line, number, place) = self.line_of(span);
                title.element(
                    Snippet::source(line)
                        .line_start(number)
                        .path(self.file.as_str())
                        .annotation(AnnotationKind::Primary.span(place)),
                )
            }
            None => title.element(Origin::path(self.file.as_str())),
        };
        if let Some(remedy) = &diagnostic.remedy {
            group = group.element(Level::HELP.message(remedy.as_str()));
        }
        renderer.render(&[group])
    }

    /// The line on which a span starts, its number, and the part of the span on it: a caret line, never a page.
    fn line_of(&self, span: &Range<usize>) -> (&str, usize, Range<usize>) {
        let start = span.start.min(self.source.len());
        let Some((before, after)) = self.source.split_at_checked(start) else {
            return (&self.source, 1, 0..0);
        };
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        let line_end = start + after.find(['\r', '\n']).unwrap_or(after.len());
        let line = self.source.get(line_start..line_end).unwrap_or("");
        let end = span.end.clamp(start, line_end);
        (line, before.matches('\n').count() + 1, start - line_start..end - line_start)
    }
}

/// Most mistakes shown at once; the rest is only counted.
const MOST_SHOWN: usize = 30;

impl fmt::Display for ConfigErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl core::error::Error for ConfigErrors {}

/// A number as it is written by hand: with an exponent where it would have many digits.
pub(super) fn figure(v: f64) -> String {
    let long = v != 0.0 && !(1e-6..1e9).contains(&v.abs());
    if long { format!("{v:e}") } else { format!("{v}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(source: &str, span: Option<Range<usize>>) -> ConfigErrors {
        let diagnostic =
            Diagnostic { span, message: "cycle-ms is 20".into(), remedy: Some("write 1".into()) };
        ConfigErrors::new("m.toml", source, vec![diagnostic])
    }

    #[test]
    fn a_mistake_shows_file_line_column_caret_and_remedy() {
        let shown = one("a = 1\ncycle-ms = 20\n", Some(17..19)).to_string();
        assert_eq!(
            shown,
            "error: cycle-ms is 20\n --> m.toml:2:12\n  |\n2 | cycle-ms = 20\n  |            ^^\n  |\n  = help: write 1"
        );
    }

    #[test]
    fn a_mistake_without_a_place_still_names_the_file() {
        let shown = one("", None).to_string();
        assert!(shown.contains("error: cycle-ms is 20") && shown.contains("--> m.toml"), "{shown}");
    }

    #[test]
    fn columns_count_characters_and_lines_survive_crlf() {
        let source = "# µm\r\nµ = 20\r\n";
        let errors = one(source, Some(12..14));
        assert_eq!(errors.place(&errors.diagnostics[0]), Some(Place { line: 2, column: 5 }));
        assert!(errors.to_string().contains("m.toml:2:5"), "{errors}");
        assert!(!errors.to_string().contains('\r'));
    }

    #[test]
    fn spans_at_or_beyond_the_end_do_not_panic() {
        for span in [5..5, 5..99, 70..80] {
            let shown = one("a = 1", Some(span)).to_string();
            assert!(shown.contains("m.toml"), "{shown}");
        }
        assert!(one("", Some(0..0)).to_string().contains("m.toml"));
    }

    #[test]
    fn color_is_asked_for() {
        assert!(!one("a = 1", Some(0..1)).render(false).contains('\u{1b}'));
        assert!(one("a = 1", Some(0..1)).render(true).contains('\u{1b}'));
    }

    #[test]
    fn several_mistakes_come_in_the_order_of_the_text_with_their_number() {
        let later = Diagnostic::at(6..7, "second", "x");
        let first = Diagnostic::at(0..1, "first", "x");
        let errors = ConfigErrors::new("m.toml", "a = 1\nb = 2\n", vec![later, first.clone(), first]);
        assert_eq!(errors.diagnostics.len(), 2);
        let shown = errors.to_string();
        assert!(shown.find("first") < shown.find("second"));
        assert!(shown.ends_with("m.toml: 2 mistakes"));
    }
}
