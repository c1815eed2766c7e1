//! The page of `model show`: the report in tables and the pictures, in one file that needs no other.

use core::fmt::Write as _;

use super::report::{ErrorRow, Fact, Report};
use super::{drawing, gauge, picture};
use crate::core::model::Model;

const STYLE: &str = "body{font:15px/1.45 sans-serif;color:#222;max-width:1240px;margin:24px auto;padding:0 16px}\
h1{font-size:24px;margin-bottom:2px}h2{font-size:18px;margin:26px 0 6px}\
table{border-collapse:collapse}td,th{padding:3px 12px 3px 0;text-align:left;border-bottom:1px solid #ddd;vertical-align:top}\
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}pre{font:13px/1.35 monospace;overflow-x:auto}\
svg{max-width:100%;height:auto;display:block}";

/// The page.
///
/// # Errors
/// A picture could not be drawn.
pub(super) fn page(report: &Report<'_>, model: &Model) -> Result<String, Box<dyn std::error::Error>> {
    let spec = report.spec();
    let mut out = String::from("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">");
    let title = format!("{} {}", spec.machine, spec.chain);
    write!(out, "<title>{}</title><style>{STYLE}</style></head>\n<body>", text(&title))?;
    writeln!(out, "<h1>{}</h1><p>{}</p>", text(&title), text(report.name))?;
    writeln!(out, "<pre>{}</pre>", text(&drawing::chain(spec).join("\n")))?;
    for line in report.frame_lines() {
        write!(out, "<p>{}</p>", text(&line))?;
    }
    out.push_str("\n<h2>In the working volume</h2>");
    facts(&mut out, &report.worst())?;
    out.push_str("<h2>Largest corrections</h2>");
    facts(&mut out, &report.corrections())?;
    if let Some(volume) = picture::distorted(spec, model)? {
        write!(out, "<h2>Distorted volume</h2>{volume}")?;
    }
    out.push_str("<h2>Axes</h2><table>");
    for axis in spec.chain.axes() {
        write!(out, "<tr><th>{}</th><td>{}</td></tr>", axis.name, text(&report.axis_words(axis.name)))?;
    }
    out.push_str("</table>\n");
    let (motions, constants) = report.error_rows();
    errors(&mut out, "Squareness and location", &constants)?;
    errors(&mut out, "Error motions", &motions)?;
    for name in picture::axes_with_errors(spec) {
        out.push_str(&picture::axis(spec, name)?);
    }
    write!(out, "<h2>Gauge</h2><pre>{}</pre>", text(&gauge::lines(spec).join("\n")))?;
    out.push_str("</body></html>\n");
    Ok(out)
}

fn facts(out: &mut String, facts: &[Fact]) -> core::fmt::Result {
    out.push_str("<table>");
    for fact in facts {
        let [what, value, place] = [&fact.what, &fact.value, &fact.place].map(|t| text(t));
        write!(out, "<tr><th>{what}</th><td class=\"n\">{value}</td><td>{place}</td></tr>")?;
    }
    out.push_str("</table>\n");
    Ok(())
}

fn errors(out: &mut String, title: &str, rows: &[ErrorRow]) -> core::fmt::Result {
    if rows.is_empty() {
        return Ok(());
    }
    write!(out, "<h2>{title}</h2><table><tr><th></th><th>kind</th><th>over</th><th class=\"n\">lowest</th>")?;
    out.push_str("<th class=\"n\">highest</th><th class=\"n\">range</th><th></th><th class=\"n\">u (k=1)</th><th></th></tr>");
    for r in rows {
        let [low, high, range] = &r.size;
        write!(
            out,
            "<tr><th>{}</th><td>{}</td><td>{}</td><td class=\"n\">{low}</td><td class=\"n\">{high}</td>\
             <td class=\"n\">{range}</td><td>{}</td><td class=\"n\">{}</td><td>{}</td></tr>",
            r.symbol,
            r.kinds,
            r.range,
            r.unit,
            r.std,
            text(&r.origin)
        )?;
    }
    out.push_str("</table>\n");
    Ok(())
}

/// Text of a file as text of a page.
fn text(raw: &str) -> String {
    raw.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    #[test]
    fn names_from_files_cannot_become_markup() {
        assert_eq!(super::text("<b>\"A&B\"</b>"), "&lt;b&gt;&quot;A&amp;B&quot;&lt;/b&gt;");
    }
}
