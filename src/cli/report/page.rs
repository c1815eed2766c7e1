//! A page of HTML: headings, tables, figures. One file, no scripts, no fonts or pictures from elsewhere; printed, it
//! fits A4 upright, sections start where asked, and tables and figures are not cut.

use std::fmt::{Display, Write as _};

const STYLE: &str = "body{font:15px/1.45 sans-serif;color:#222;background:#fff;max-width:1240px;margin:24px auto;padding:0 16px}\
h1{font-size:24px;margin-bottom:2px}h2{font-size:18px;margin:26px 0 6px}h3{font-size:15px;margin:18px 0 4px}\
table{border-collapse:collapse;margin:4px 0 10px}td,th{padding:3px 12px 3px 0;text-align:left;border-bottom:1px solid #ddd;vertical-align:top}\
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}pre{font:13px/1.35 monospace;overflow-x:auto}\
figure{margin:8px 0 14px}figcaption{font-size:13px;color:#444}p.note{font-size:13px;color:#444}\
th:first-child{white-space:nowrap}td.s{font-size:12px}svg{max-width:100%;height:auto;display:block}\
@page{size:A4;margin:14mm 14mm 16mm}\
@media print{body{font-size:10pt;max-width:none;margin:0;padding:0}h1{font-size:16pt}h2{font-size:12.5pt}h3{font-size:10.5pt}\
pre{font-size:8pt;white-space:pre-wrap}td,th{padding:2px 9px 2px 0}td.s{font-size:7.5pt}figcaption,p.note{font-size:8.5pt}\
h1,h2,h3{break-after:avoid}figure,table.keep,svg{break-inside:avoid}tr{break-inside:avoid}thead{display:table-header-group}\
.sheet{break-before:page}*{print-color-adjust:exact;-webkit-print-color-adjust:exact}}";

/// A page under construction.
#[derive(Debug)]
pub(crate) struct Page {
    text: String,
}

/// A cell of a table.
#[derive(Debug, Clone)]
pub(crate) enum Cell {
    /// Words.
    Text(String),
    /// Words that name the row.
    Head(String),
    /// A number, to the right.
    Number(String),
    /// Words in small print.
    Small(String),
}

impl Cell {
    /// Words.
    pub(crate) fn text(words: impl Display) -> Self {
        Self::Text(words.to_string())
    }

    /// Words in small print, such as a hash.
    pub(crate) fn small(words: impl Display) -> Self {
        Self::Small(words.to_string())
    }

    /// Words that name the row.
    pub(crate) fn head(words: impl Display) -> Self {
        Self::Head(words.to_string())
    }

    /// A number, to the right.
    pub(crate) fn number(number: impl Display) -> Self {
        Self::Number(number.to_string())
    }
}

impl Page {
    /// A page with its title.
    pub(crate) fn new(title: &str) -> Self {
        let title = escape(title);
        Self {
            text: format!(
                "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
                 <style>{STYLE}</style></head>\n<body><h1>{title}</h1>\n"
            ),
        }
    }

    fn put(&mut self, text: std::fmt::Arguments<'_>) {
        // writing to a string cannot fail
        let _ = self.text.write_fmt(text);
    }

    /// A heading.
    pub(crate) fn heading(&mut self, words: impl Display) {
        self.put(format_args!("<h2>{}</h2>\n", escape(&words.to_string())));
    }

    /// A heading that starts a sheet of paper.
    pub(crate) fn sheet(&mut self, words: impl Display) {
        self.put(format_args!("<h2 class=\"sheet\">{}</h2>\n", escape(&words.to_string())));
    }

    /// A paragraph.
    pub(crate) fn paragraph(&mut self, words: impl Display) {
        self.put(format_args!("<p>{}</p>\n", escape(&words.to_string())));
    }

    /// A remark in small print.
    pub(crate) fn note(&mut self, words: impl Display) {
        self.put(format_args!("<p class=\"note\">{}</p>\n", escape(&words.to_string())));
    }

    /// Text whose lines stay as they are.
    pub(crate) fn lines(&mut self, lines: &[String]) {
        self.put(format_args!("<pre>{}</pre>\n", escape(&lines.join("\n"))));
    }

    /// A table; no head where `head` is empty. Short ones are not cut at the end of a sheet.
    pub(crate) fn table(&mut self, head: &[Cell], rows: &[Vec<Cell>]) {
        self.text.push_str(if rows.len() <= 30 { "<table class=\"keep\">" } else { "<table>" });
        if !head.is_empty() {
            self.text.push_str("<thead>");
            self.row(head, true);
            self.text.push_str("</thead>");
        }
        for row in rows {
            self.row(row, false);
        }
        self.text.push_str("</table>\n");
    }

    fn row(&mut self, cells: &[Cell], head: bool) {
        self.text.push_str("<tr>");
        for cell in cells {
            match cell {
                Cell::Number(t) if head => self.put(format_args!("<th class=\"n\">{}</th>", escape(t))),
                Cell::Number(t) => self.put(format_args!("<td class=\"n\">{}</td>", escape(t))),
                Cell::Text(t) if !head => self.put(format_args!("<td>{}</td>", escape(t))),
                Cell::Small(t) if !head => self.put(format_args!("<td class=\"s\">{}</td>", escape(t))),
                Cell::Text(t) | Cell::Head(t) | Cell::Small(t) => {
                    self.put(format_args!("<th>{}</th>", escape(t)))
                }
            }
        }
        self.text.push_str("</tr>\n");
    }

    /// A picture with what it shows; `svg` is markup.
    pub(crate) fn figure(&mut self, svg: &str, caption: impl Display) {
        let caption = escape(&caption.to_string());
        self.put(format_args!("<figure>{svg}<figcaption>{caption}</figcaption></figure>\n"));
    }

    /// A picture without caption; `svg` is markup.
    pub(crate) fn picture(&mut self, svg: &str) {
        self.put(format_args!("<figure>{svg}</figure>\n"));
    }

    /// The finished page.
    pub(crate) fn finish(mut self) -> String {
        self.text.push_str("</body></html>\n");
        self.text
    }
}

/// Text of a file as text of a page.
fn escape(raw: &str) -> String {
    raw.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_from_files_cannot_become_markup() {
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
        let text = page.finish();
        assert!(!text.contains("<x>") && text.matches("&lt;x&gt;").count() == 12, "{text}");
    }

    #[test]
    fn the_page_needs_nothing_from_elsewhere_and_prints_on_a4() {
        let text = Page::new("t").finish();
        assert!(!text.contains("http") && !text.contains("src=") && !text.contains("<script"));
        assert!(text.contains("@page{size:A4") && text.contains("break-before:page"));
    }
}
