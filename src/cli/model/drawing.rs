//! The chain as a small text drawing, from the workpiece over the bed to the tool.

use crate::prelude::*;

/// A station of the drawing: what stands in its column from top to bottom.
type Station = [String; 3];

/// Three lines: the chain, what each joint does, and how far.
pub(super) fn chain(model: &ModelSpec) -> Vec<String> {
    let mut lines = [String::new(), String::new(), String::new()];
    for (i, station) in stations(model).iter().enumerate() {
        let width = station.iter().map(|r| r.chars().count()).max().unwrap_or(0);
        for (row, (line, text)) in lines.iter_mut().zip(station).enumerate() {
            line.push_str(&match (row, i) {
                // the chain ends at the workpiece and at the tool
                (0, 0) => format!("{:>width$}", format!("{text:-^width$}").trim_start_matches('-')),
                (0, _) => format!("---{text:-^width$}"),
                (_, 0) => format!("{text:^width$}"),
                _ => format!("   {text:^width$}"),
            });
        }
    }
    lines.map(|l| l.trim_end_matches(['-', ' ']).to_owned()).into()
}

fn stations(model: &ModelSpec) -> Vec<Station> {
    let fixed = |name: &str, what: &str| [format!(" {name} "), what.to_owned(), String::new()];
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
        out.push([name, what.to_owned(), travel]);
    }
    if !bed {
        out.push(fixed("b", "bed"));
    }
    out.push(fixed("t", "tool"));
    out
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
