//! The chain as a small text drawing, from the workpiece over the bed to the tool.

use crate::prelude::*;

/// One station of the drawing, from top to bottom of its column.
struct Station {
    rows: [String; 3],
}

/// Three lines: the chain, what each joint does, and how far.
pub(super) fn chain(model: &ModelSpec) -> Vec<String> {
    let stations = stations(model);
    let mut lines = [String::new(), String::new(), String::new()];
    for (i, station) in stations.iter().enumerate() {
        let width = station.rows.iter().map(|r| r.chars().count()).max().unwrap_or(0);
        for (row, line) in lines.iter_mut().enumerate() {
            let gap = match (i, row) {
                (0, _) => "",
                (_, 0) => "---",
                _ => "   ",
            };
            let text = &station.rows[row];
            line.push_str(gap);
            line.push_str(&match (row, i) {
                // the chain ends at the workpiece and at the tool
                (0, 0) => format!(
                    "{}{text}{}",
                    " ".repeat((width - 3) / 2),
                    "-".repeat((width - 3) - (width - 3) / 2)
                ),
                (0, _) => centred(text, width, '-'),
                _ => centred(text, width, ' '),
            });
        }
    }
    lines.map(|l| l.trim_end_matches(['-', ' ']).to_owned()).into()
}

fn stations(model: &ModelSpec) -> Vec<Station> {
    let fixed =
        |name: &str, what: &str| Station { rows: [format!(" {name} "), what.to_owned(), String::new()] };
    let mut out = vec![fixed("w", "workpiece")];
    let mut bed = false;
    for axis in model.chain.axes() {
        if axis.side == Side::Tool && !bed {
            out.push(fixed("b", "bed"));
            bed = true;
        }
        let name = match (axis.side, axis.spindle) {
            (Side::Workpiece, _) => format!("[ {}' ]", axis.name),
            (Side::Tool, true) => format!("( {} )", axis.name),
            (Side::Tool, false) => format!("[ {} ]", axis.name),
        };
        let what = match (axis.kind(), axis.spindle) {
            (_, true) => "spindle",
            (AxisKind::Linear, _) => "linear",
            (AxisKind::Rotary, _) => "rotary",
        };
        let travel = model.axis(axis.name).travel.map_or(String::new(), |t| {
            let [low, high] = t.map(|v| position_out(axis.name, v));
            format!("{low}..{high} {}", position_unit(axis.name))
        });
        out.push(Station { rows: [name, what.to_owned(), travel] });
    }
    if !bed {
        out.push(fixed("b", "bed"));
    }
    out.push(fixed("t", "tool"));
    out
}

fn centred(text: &str, width: usize, fill: char) -> String {
    let room = width.saturating_sub(text.chars().count());
    let left = room / 2;
    let pad = |n: usize| fill.to_string().repeat(n);
    format!("{}{text}{}", pad(left), pad(room - left))
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::{AxisSpec, Chain};

    #[test]
    fn the_drawing_shows_sides_kinds_and_travel() {
        let mut spec = ModelSpec::new("m", Chain::parse("[w C' b X (S) t]").unwrap());
        let x = spec.chain.axes()[1].name;
        spec.axes.push(AxisSpec { travel: Some([0.0, 400.0]), ..AxisSpec::new(x) });
        let lines = chain(&spec);
        assert_eq!(lines[0], "    w ------[ C' ]--- b -----[ X ]------( S )---- t");
        assert_eq!(lines[1], "workpiece   rotary   bed    linear     spindle   tool");
        assert_eq!(lines[2], "                           0..400 mm");
    }
}
