//! A page of HTML: headings, tables, figures. One file, no scripts, no fonts or pictures from elsewhere; printed, it
//! fits A4 upright, sections start where asked, and tables and figures are not cut.

use std::fmt::{Display, Write as _};

use super::chart::{Bar, Ink, bars};
use crate::numerals::{micro, printable};
use crate::report_page::Plot;

/// Light, dark and print; the classes of charts are those of [`super::chart`], and pictures with colours of their own (attributes of
/// [`super::plot`]) follow the scheme, too.
const STYLE: &str = include_str!("page.css");

/// A page under construction.
#[derive(Debug)]
pub struct Page {
    text: String,
}

/// A cell of a table.
#[derive(Debug, Clone)]
pub(crate) struct Cell {
    tag: &'static str,
    /// Class of the style sheet: of numbers and of small print.
    class: &'static str,
    is_pale: bool,
    /// What stands in it, as markup.
    content: String,
}

impl Cell {
    fn new(tag: &'static str, class: &'static str, words: impl Display) -> Self {
        Self { tag, class, is_pale: false, content: words_of(words) }
    }

    /// Words.
    pub(crate) fn text(words: impl Display) -> Self {
        Self::new("td", "", words)
    }

    /// Words in small print, such as a hash.
    pub(crate) fn small(words: impl Display) -> Self {
        Self::new("td", "s", words)
    }

    /// Words that name the row.
    pub(crate) fn head(words: impl Display) -> Self {
        Self::new("th", "", words)
    }

    /// Markup; the caller has escaped its words.
    pub(crate) const fn html(markup: String) -> Self {
        Self { tag: "td", class: "", is_pale: false, content: markup }
    }

    /// The same cell in pale letters.
    pub(crate) fn faint(self) -> Self {
        Self { is_pale: true, ..self }
    }

    /// A number, to the right.
    pub(crate) fn number(number: impl Display) -> Self {
        Self::new("td", "n", number)
    }

    fn is_number(&self) -> bool {
        self.class == "n"
    }

    /// The cell of a row; `label` is what names its column where the page is narrow.
    fn markup(&self, label: Option<&str>) -> String {
        let Self { tag, class, is_pale, content } = self;
        let class = format!("{class}{}", if *is_pale { " faint" } else { "" });
        let class = class.trim();
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        let label = label.map_or_else(String::new, |l| format!(" data-l=\"{}\"", escape(l)));
        format!("<{tag}{class}{label}>{content}</{tag}>")
    }
}

impl Page {
    /// A page with its title.
    #[must_use]
    pub fn new(raw: &str) -> Self {
        let (title, style) = (escape(raw), STYLE.replace('\n', ""));
        Self {
            text: format!(
                "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
                 <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{title}</title>\
                 <style>{style}@page{{@bottom-left{{content:\"{}\";font:8pt sans-serif;color:#444}}}}</style></head>\n<body><h1>{title}</h1>\n",
                css_text(raw)
            ),
        }
    }

    fn put(&mut self, text: std::fmt::Arguments<'_>) {
        // writing to a string cannot fail
        let _ = self.text.write_fmt(text);
    }

    /// A heading.
    pub fn heading(&mut self, words: impl Display) {
        self.put(format_args!("<h2>{}</h2>\n", words_of(words)));
    }

    /// A heading that starts a sheet of paper.
    pub(crate) fn sheet(&mut self, words: impl Display) {
        self.put(format_args!("<h2 class=\"sheet\">{}</h2>\n", words_of(words)));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, words: impl Display) {
        self.put(format_args!("<p>{}</p>\n", words_of(words)));
    }

    /// The answer, in large print.
    pub fn lead(&mut self, words: impl Display) {
        self.put(format_args!("<p class=\"lead\">{}</p>\n", words_of(words)));
    }

    /// Markup as it is; the caller has escaped its words.
    pub(crate) fn html(&mut self, markup: &str) {
        self.put(format_args!("{markup}\n"));
    }

    /// Lines that are shown on request and not printed.
    pub(crate) fn folded(&mut self, summary: &str, lines: &[&str]) {
        let (summary, lines) = (escape(summary), escape(&lines.join("\n")));
        self.put(format_args!("<details><summary>{summary}</summary><pre>{lines}</pre></details>\n"));
    }

    /// Charts with their captions, side by side where there is room; both are markup.
    pub(crate) fn figures(&mut self, figures: &[(String, String)]) {
        self.text.push_str("<div class=\"figures\">\n");
        for (chart, caption) in figures {
            self.put(format_args!("<figure>{chart}<figcaption>{caption}</figcaption></figure>\n"));
        }
        self.text.push_str("</div>\n");
    }

    /// A table whose rows become blocks with the heads as labels where the page is narrow.
    pub(crate) fn stacked_table(&mut self, head: &[&str], rows: &[Vec<Cell>]) {
        let is_number = |k: usize| rows.first().and_then(|r| r.get(k)).is_some_and(Cell::is_number);
        let cell = |(k, label)| Cell::new("th", if is_number(k) { "n" } else { "" }, label);
        let heads: Vec<Cell> = head.iter().enumerate().map(cell).collect();
        self.put(format_args!("<table class=\"stack\"><thead>{}</thead>", row(&heads, &[])));
        self.rows(rows, head);
        self.text.push('\n');
    }

    /// Items of a list.
    pub(crate) fn list(&mut self, items: &[String]) {
        self.text.push_str("<ul>");
        for item in items {
            self.put(format_args!("<li>{}</li>", words_of(item)));
        }
        self.text.push_str("</ul>\n");
    }

    /// A remark in small print.
    pub fn note(&mut self, words: impl Display) {
        self.put(format_args!("<p class=\"note\">{}</p>\n", words_of(words)));
    }

    /// Text whose lines stay as they are.
    pub(crate) fn lines(&mut self, lines: &[String]) {
        self.put(format_args!("<pre>{}</pre>\n", escape(&lines.join("\n"))));
    }

    /// A table; no head where `head` is empty. Short ones are not cut at the end of a sheet.
    pub(crate) fn table(&mut self, head: &[Cell], rows: &[Vec<Cell>]) {
        self.text.push_str("<div class=\"scroll\">");
        self.text.push_str(if rows.len() <= 30 { "<table class=\"keep\">" } else { "<table>" });
        if !head.is_empty() {
            let heads: Vec<Cell> = head.iter().map(|cell| Cell { tag: "th", ..cell.clone() }).collect();
            self.put(format_args!("<thead>{}\n</thead>", row(&heads, &[])));
        }
        self.rows(rows, &[]);
        self.text.push_str("</div>\n");
    }

    /// The rows of a table and its end.
    fn rows(&mut self, rows: &[Vec<Cell>], labels: &[&str]) {
        rows.iter().for_each(|cells| self.html(&row(cells, labels)));
        self.text.push_str("</table>");
    }

    /// Charts side by side where there is room.
    pub fn charts(&mut self, plots: &[Plot]) {
        self.figures(&plots.iter().map(Plot::markup).collect::<Vec<_>>());
    }

    /// Horizontal bars from zero: label, length, words beside it.
    pub fn bars(&mut self, rows: impl IntoIterator<Item = (String, f64, String)>) {
        let bar = |(label, to, value)| Bar { label, from: 0.0, to, value, ink: Ink::Blue };
        self.html(&bars(&rows.into_iter().map(bar).collect::<Vec<_>>()));
    }

    /// Facts: what, and its words.
    pub(crate) fn facts(&mut self, rows: impl IntoIterator<Item = (impl Display, impl Display)>) {
        let rows: Vec<Vec<Cell>> =
            rows.into_iter().map(|(what, words)| vec![Cell::head(what), Cell::text(words)]).collect();
        self.table(&[], &rows);
    }

    /// Pictures below each other with their headings; the caption stands below the last one.
    pub(crate) fn plots(&mut self, plots: &[(impl Display, String)], caption: &str) {
        for (k, (heading, svg)) in plots.iter().enumerate() {
            let heading = heading.to_string();
            if !heading.is_empty() {
                self.heading(heading);
            }
            if k + 1 == plots.len() { self.figure(svg, caption) } else { self.picture(svg) }
        }
    }

    /// A table of keys and values, two pairs in a row.
    pub(crate) fn head_table(&mut self, rows: &[Vec<Cell>]) {
        self.text.push_str("<table class=\"head keep\">");
        self.rows(rows, &[]);
        self.text.push('\n');
    }

    /// A picture with what it shows; `svg` is markup.
    pub(crate) fn figure(&mut self, svg: &str, caption: impl Display) {
        let caption = words_of(caption);
        self.put(format_args!("{}{svg}<figcaption>{caption}</figcaption></figure>\n", figure_tag(svg)));
    }

    /// A picture without caption; `svg` is markup.
    pub(crate) fn picture(&mut self, svg: &str) {
        self.put(format_args!("{}{svg}</figure>\n", figure_tag(svg)));
    }

    /// The finished page.
    #[must_use]
    pub fn finish(mut self) -> String {
        self.text.push_str("</body></html>\n");
        self.text
    }
}

/// A row of a table; the labels, where there are any, name its columns.
fn row(cells: &[Cell], labels: &[&str]) -> String {
    let label = |k: usize| labels.get(k).copied().filter(|label| k > 0 && !label.is_empty());
    let cells: String = cells.iter().enumerate().map(|(k, cell)| cell.markup(label(k))).collect();
    format!("<tr>{cells}</tr>")
}

/// Height over width from which a picture takes half a sheet of paper.
const TALL: f64 = 0.65;

/// The start of a figure; a tall picture has more room on paper.
fn figure_tag(svg: &str) -> &'static str {
    let size = svg.split_once("viewBox=\"").and_then(|(_, rest)| rest.split_once('"')).map(|(size, _)| size);
    let numbers: Vec<f64> = size.unwrap_or("").split(' ').filter_map(|n| n.parse().ok()).collect();
    match numbers[..] {
        [_, _, width, height] if height > TALL * width => "<figure class=\"tall\">",
        _ => "<figure>",
    }
}

/// Words of a sentence as markup, with units as a person writes them.
fn words_of(words: impl Display) -> String {
    escape(&micro(&words.to_string()))
}

/// Text of a file as a string of the style sheet: whatever could end the string or the sheet is left out.
fn css_text(raw: &str) -> String {
    raw.chars().filter(|c| !c.is_control() && !matches!(c, '"' | '\\' | '<' | '>')).collect()
}

/// Text of a file as text of a page.
pub(crate) fn escape(raw: &str) -> String {
    printable(raw).replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_from_files_cannot_become_markup() {
        assert_eq!(escape("a\u{1b}\0"), "a\u{fffd}\u{fffd}");
        assert_eq!(escape("<b>\"A&B\"</b>"), "&lt;b&gt;&quot;A&amp;B&quot;&lt;/b&gt;");
        let mut page = Page::new("<x>");
        page.heading("<x>");
        page.sheet("<x>");
        page.paragraph("<x>");
        page.note("<x>");
        page.lines(&["<x>".to_owned()]);
        page.table(
            &[Cell::head("<x>"), Cell::number("<x>")],
            &[vec![Cell::text("<x>"), Cell::number("<x>")]],
        );
        page.figure("<svg/>", "<x>");
        page.head_table(&[vec![Cell::text("<x>")]]);
        page.list(&["<x>".to_owned()]);
        let text = page.finish();
        assert!(!text.contains("<x>") && text.matches("&lt;x&gt;").count() == 14, "{text}");
        assert_eq!(css_text("a\"}</style>\\\n\u{b5}"), "a}/style\u{b5}");
    }

    #[test]
    fn wide_tables_scroll_and_tall_pictures_get_half_a_sheet() {
        let mut page = Page::new("t");
        page.table(&[], &[vec![Cell::text("a")]]);
        page.picture("<svg viewBox=\"0 0 840 720\"></svg>");
        page.picture("<svg viewBox=\"0 0 840 370\"></svg>");
        page.note("5 um off");
        let text = page.finish();
        assert!(text.contains("<div class=\"scroll\"><table class=\"keep\">"), "{text}");
        assert_eq!(text.matches("<figure class=\"tall\">").count(), 1, "{text}");
        assert!(text.contains("<figure><svg") && text.contains("5 µm off"), "{text}");
    }

    #[test]
    fn the_page_needs_nothing_from_elsewhere_and_prints_on_a4() {
        let text = Page::new("t").finish();
        assert!(!text.contains("http") && !text.contains("src=") && !text.contains("<script"));
        assert!(text.contains("@page{size:A4") && text.contains("break-before:page"));
        assert!(text.contains("counter(page)") && text.contains("@bottom-left{content:\"t\""));
    }
}
