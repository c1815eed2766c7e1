//! A page of HTML: headings, tables, figures. One file, no scripts, no fonts or pictures from elsewhere; printed, it
//! fits A4 upright, sections start where asked, and tables and figures are not cut.

use std::fmt::{Display, Write as _};

use super::chart::{Bar, Ink, bars};
use crate::report_page::Plot;

/// Light, dark and print; the classes of charts are those of [`super::chart`], and pictures with colours of their own (attributes of
/// [`super::plot`]) follow the scheme, too.
const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#222;--soft:#555;--line:#ddd;--bg:#fff;--grey:#8c8c8c;--a:#0072b2;--b:#d55e00;--c:#00795a;--band:.22}\
@media (prefers-color-scheme:dark){:root{--ink:#e6e6e6;--soft:#b0b4b8;--line:#3c4046;--bg:#16181b;--grey:#8e949a;--a:#56b4e9;--b:#f0883e;--c:#3ec79b;--band:.3}}\
@media print{:root{color-scheme:light;--ink:#222;--soft:#444;--line:#ddd;--bg:#fff;--grey:#8c8c8c;--a:#0072b2;--b:#d55e00;--c:#00795a;--band:.22}}\
body{font:15px/1.45 sans-serif;color:var(--ink);background:var(--bg);max-width:1240px;margin:24px auto;padding:0 16px}\
h1{font-size:24px;margin-bottom:2px}h2{font-size:18px;margin:26px 0 6px}h3{font-size:15px;margin:18px 0 4px}\
p.lead{font-size:19px;line-height:1.35;margin:8px 0 14px;max-width:60em}small{color:var(--soft);font-weight:400}\
table{border-collapse:collapse;margin:4px 0 10px}td,th{padding:3px 12px 3px 0;text-align:left;border-bottom:1px solid var(--line);vertical-align:top}\
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}table.stack td.n{white-space:nowrap}pre{font:13px/1.35 monospace;overflow-x:auto}\
figure{margin:8px 0 14px}figcaption{font-size:13px;color:var(--soft)}figcaption b{color:var(--ink)}p.note{font-size:13px;color:var(--soft)}\
th:first-child{white-space:nowrap}table.stack tr>:first-child{white-space:normal;min-width:9em}td.s{font-size:12px}tr .faint{color:var(--soft);font-weight:400}\
svg{max-width:100%;height:auto;display:block}\
.figures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(340px,100%),1fr));gap:6px 22px}.figures svg.chart{width:100%}\
svg.chart text{font:12px sans-serif;fill:var(--ink)}.chart .grid{stroke:var(--line)}.chart .zero{stroke:var(--soft)}\
.ref{stroke:var(--ink);stroke-dasharray:5 4;fill:none}\
.lg,.la,.lb,.lc,.lt{fill:none;stroke-width:2;stroke-linejoin:round}.lg{stroke:var(--grey)}.la{stroke:var(--a)}.lb{stroke:var(--b);stroke-dasharray:7 3}.lc{stroke:var(--c);stroke-dasharray:2 3}.lt{stroke:var(--ink)}\
.pg,.pa,.pb,.pc,.pt{fill-opacity:.6}.pg{fill:var(--grey)}.pa{fill:var(--a)}.pb{fill:var(--b)}.pc{fill:var(--c)}.pt{fill:var(--ink)}\
.xg,.xa,.xb,.xc,.xt,.og,.oa,.ob,.oc,.ot{fill:none;stroke-width:1.1}.xg,.og{stroke:var(--grey)}.xa,.oa{stroke:var(--a)}.xb,.ob{stroke:var(--b)}.xc,.oc{stroke:var(--c)}.xt,.ot{stroke:var(--ink)}\
.fg,.fa,.fb,.fc,.ft{fill-opacity:var(--band)}.fg,.dg{fill:var(--grey)}.fa,.da{fill:var(--a)}.fb,.db{fill:var(--b)}.fc,.dc{fill:var(--c)}.ft,.dt{fill:var(--ink)}\
.key{white-space:nowrap;margin-right:10px}svg.key{display:inline-block;vertical-align:-1px;margin:0}\
.bars{display:grid;grid-template-columns:minmax(11em,max-content) 1fr max-content;gap:3px 12px;align-items:center;margin:6px 0;font-variant-numeric:tabular-nums}\
.track{position:relative;height:17px}.track span{position:absolute;top:0;bottom:0}.sg,.bar.g{background:var(--grey)}.sa,.bar.a{background:var(--a)}.sb{background:var(--b)}.sc{background:var(--c)}.st{background:var(--ink)}\
i.bar{display:inline-block;height:6px}.key i.bar{width:22px;height:8px}.pair{display:block;width:180px}.pair i{display:block;margin:2px 0}\
summary{cursor:pointer;color:var(--soft);font-size:13px}\
table.head th{font-weight:400;color:var(--soft)}table.head td:nth-child(2){padding-right:28px}\
.sign{display:grid;grid-template-columns:repeat(3,1fr);gap:28px;margin:64px 0 8px;break-inside:avoid}.sign div{border-top:1px solid var(--ink);padding-top:3px;font-size:13px}\
summary{cursor:pointer;color:var(--soft);font-size:13px}.fine{columns:26em;column-gap:24px;font-size:13px;color:var(--soft);padding-left:16px;margin:4px 0}.fine li{break-inside:avoid;margin:2px 0}.fine b{font-weight:600}\
@media (prefers-color-scheme:dark){@media screen{svg [fill='#FFFFFF']{fill:var(--bg)}svg [fill='#3C3C3C']{fill:var(--ink)}svg [stroke='#3C3C3C']{stroke:var(--ink)}\
svg [stroke='#CDCDCD']{stroke:var(--line)}svg [fill='#0072B2']{fill:var(--a)}svg [stroke='#0072B2']{stroke:var(--a)}svg [fill='#D55E00']{fill:var(--b)}svg [stroke='#D55E00']{stroke:var(--b)}}}\
@media screen and (max-width:640px){body{margin:10px auto}h1{font-size:20px}p.lead{font-size:17px}table:not(.stack){display:block;overflow-x:auto}\
table.stack,table.stack tbody,table.stack tr,table.stack td,table.stack th{display:block;border:0;text-align:left;padding:1px 0}table.stack thead{display:none}\
table.stack tr{border-bottom:1px solid var(--line);padding:6px 0}table.stack td[data-l]:before{content:attr(data-l) ': ';color:var(--soft)}table.stack td:empty{display:none}\
table.stack td.n{white-space:normal}.bars{grid-template-columns:1fr max-content;grid-auto-flow:row dense}.bars div:nth-child(3n+1){grid-column:1}.bars div:nth-child(3n){grid-column:2}.bars .track{grid-column:1/3}th:first-child{white-space:normal}td.s{font-size:13px}}\
@page{size:A4;margin:11mm 13mm 14mm;@bottom-right{content:'page ' counter(page) ' of ' counter(pages);font:8pt sans-serif;color:#444}}\
@media print{body{font-size:10pt;max-width:none;margin:0;padding:0}h1{font-size:16pt}h2{font-size:12.5pt;margin-top:14pt}h3{font-size:10.5pt}p.lead{font-size:12pt}\
pre{font-size:8pt;white-space:pre-wrap}td,th{padding:2px 9px 2px 0}td.s{font-size:7.5pt}figcaption,p.note{font-size:8.5pt}\
h1,h2,h3{break-after:avoid}figure,table.keep,svg{break-inside:avoid}body>figure>svg{max-height:84mm;margin:auto}tr,.bars{break-inside:avoid}thead{display:table-header-group}\
td.n{white-space:nowrap}.dense table{font-size:7pt;margin:2px 0 4px}.dense td,.dense th{padding:0 7px 0 0}.dense table.stack tr>:first-child{min-width:0}.dense h2{margin:5pt 0 1pt;font-size:10pt}.dense p,.dense ul{margin:2pt 0;font-size:7.5pt}.dense .sign{margin-top:30px}.dense .sign div{font-size:8pt}\
.figures{grid-template-columns:1fr 1fr;gap:0 16px}.pair{width:90px}details{display:none}\
.compact p,.compact td,.compact th{font-size:8pt;line-height:1.2}.compact h2{font-size:9.5pt;margin:4pt 0 1pt}.compact p{margin:2pt 0}.compact p.lead{font-size:10pt;max-width:none}.compact table{margin:1pt 0 3pt}.compact td,.compact th{padding:1px 8px 1px 0}\
.compact table.stack br{display:none}.compact table.stack td,.compact table.stack th{font-size:7.2pt}\
.compact td.s,.compact p.note,.compact small,.compact figcaption,.compact .fine{font-size:7.2pt;line-height:1.25}.compact p.note{margin:2pt 0}.compact .bars{gap:0 10px;font-size:7.5pt}.compact .track{height:8px}.compact figure{margin:1pt 0 2pt}\
.compact .figures{grid-template-columns:repeat(3,1fr);gap:0 10px}.sheet{break-before:page}*{print-color-adjust:exact;-webkit-print-color-adjust:exact}}";

/// A page under construction.
#[derive(Debug)]
pub struct Page {
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
    /// Markup.
    Html(String),
    /// A cell whose words are pale.
    Faint(Box<Self>),
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

    /// Markup; the caller has escaped its words.
    pub(crate) const fn html(markup: String) -> Self {
        Self::Html(markup)
    }

    /// The same cell in pale letters.
    pub(crate) fn faint(self) -> Self {
        Self::Faint(Box::new(self))
    }

    /// A number, to the right.
    pub(crate) fn number(number: impl Display) -> Self {
        Self::Number(number.to_string())
    }

    fn is_number(&self) -> bool {
        match self {
            Self::Number(_) => true,
            Self::Faint(cell) => cell.is_number(),
            _ => false,
        }
    }

    /// What stands in it, as markup.
    fn content(&self) -> String {
        match self {
            Self::Text(t) | Self::Head(t) | Self::Number(t) | Self::Small(t) => escape(t),
            Self::Html(markup) => markup.clone(),
            Self::Faint(cell) => cell.content(),
        }
    }

    /// The cell of a row; `label` is what names its column where the page is narrow.
    fn markup(&self, label: Option<&str>) -> String {
        let (inner, pale) = if let Self::Faint(cell) = self { (&**cell, "faint") } else { (self, "") };
        let (tag, kind) = match inner {
            Self::Head(_) => ("th", ""),
            Self::Number(_) => ("td", "n"),
            Self::Small(_) => ("td", "s"),
            _ => ("td", ""),
        };
        let class = format!("{kind} {pale}");
        let class = class.trim();
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        let label = label.map_or_else(String::new, |l| format!(" data-l=\"{}\"", escape(l)));
        format!("<{tag}{class}{label}>{}</{tag}>", inner.content())
    }
}

impl Page {
    /// A page with its title.
    #[must_use]
    pub fn new(raw: &str) -> Self {
        let title = escape(raw);
        Self {
            text: format!(
                "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
                 <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{title}</title>\
                 <style>{STYLE}@page{{@bottom-left{{content:\"{}\";font:8pt sans-serif;color:#444}}}}</style></head>\n<body><h1>{title}</h1>\n",
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
        self.put(format_args!("<h2>{}</h2>\n", escape(&words.to_string())));
    }

    /// A heading that starts a sheet of paper.
    pub(crate) fn sheet(&mut self, words: impl Display) {
        self.put(format_args!("<h2 class=\"sheet\">{}</h2>\n", escape(&words.to_string())));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, words: impl Display) {
        self.put(format_args!("<p>{}</p>\n", escape(&words.to_string())));
    }

    /// The answer, in large print.
    pub fn lead(&mut self, words: impl Display) {
        self.put(format_args!("<p class=\"lead\">{}</p>\n", escape(&words.to_string())));
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
        self.text.push_str("<table class=\"stack\"><thead><tr>");
        let is_number = |k: usize| rows.first().and_then(|r| r.get(k)).is_some_and(Cell::is_number);
        for (k, label) in head.iter().enumerate() {
            let class = if is_number(k) { " class=\"n\"" } else { "" };
            self.put(format_args!("<th{class}>{}</th>", escape(label)));
        }
        self.text.push_str("</tr></thead>");
        for row in rows {
            self.text.push_str("<tr>");
            for (k, (cell, label)) in row.iter().zip(head).enumerate() {
                self.put(format_args!("{}", cell.markup((k > 0 && !label.is_empty()).then_some(label))));
            }
            self.text.push_str("</tr>\n");
        }
        self.text.push_str("</table>\n");
    }

    /// Items of a list.
    pub(crate) fn list(&mut self, items: &[String]) {
        self.text.push_str("<ul>");
        for item in items {
            self.put(format_args!("<li>{}</li>", escape(item)));
        }
        self.text.push_str("</ul>\n");
    }

    /// A remark in small print.
    pub fn note(&mut self, words: impl Display) {
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
        for row in rows {
            self.row(row, false);
        }
        self.text.push_str("</table>\n");
    }

    fn row(&mut self, cells: &[Cell], head: bool) {
        self.text.push_str("<tr>");
        for cell in cells {
            if head {
                let class = if cell.is_number() { " class=\"n\"" } else { "" };
                self.put(format_args!("<th{class}>{}</th>", cell.content()));
            } else {
                self.put(format_args!("{}", cell.markup(None)));
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
    #[must_use]
    pub fn finish(mut self) -> String {
        self.text.push_str("</body></html>\n");
        self.text
    }
}

/// Text of a file as a string of the style sheet: whatever could end the string or the sheet is left out.
fn css_text(raw: &str) -> String {
    raw.chars().filter(|c| !c.is_control() && !matches!(c, '"' | '\\' | '<' | '>')).collect()
}

/// Text of a file as text of a page.
pub(crate) fn escape(raw: &str) -> String {
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
        page.head_table(&[vec![Cell::text("<x>")]]);
        page.list(&["<x>".to_owned()]);
        let text = page.finish();
        assert!(!text.contains("<x>") && text.matches("&lt;x&gt;").count() == 14, "{text}");
        assert_eq!(css_text("a\"}</style>\\\n\u{b5}"), "a}/style\u{b5}");
    }

    #[test]
    fn the_page_needs_nothing_from_elsewhere_and_prints_on_a4() {
        let text = Page::new("t").finish();
        assert!(!text.contains("http") && !text.contains("src=") && !text.contains("<script"));
        assert!(text.contains("@page{size:A4") && text.contains("break-before:page"));
        assert!(text.contains("counter(page)") && text.contains("@bottom-left{content:\"t\""));
    }
}
