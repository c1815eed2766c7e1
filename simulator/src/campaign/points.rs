//! The readings of a campaign as points for `volcomp predict`, with the machine's log between them.
//!
//! What goes with heat lags behind its sources, so the log's entries stand in the table too, in the order of time.

use std::fmt::Write;

use super::Campaign;
use super::run::{Entry, State};

/// A table of points.
#[derive(Debug, Clone, PartialEq)]
pub struct Points {
    /// The table.
    pub text: String,
    /// The state behind each row; `None` for an entry of the log.
    pub states: Vec<Option<usize>>,
}

/// All readings and all entries of the log, in the order of time.
#[must_use]
pub fn points(campaign: &Campaign) -> Points {
    let (states, log) = (&campaign.taken.states, &campaign.taken.log);
    let mut order: Vec<(f64, Option<usize>, usize)> =
        log.iter().enumerate().map(|(k, e)| (e.t_s, None, k)).collect();
    order.extend(states.iter().enumerate().map(|(k, s)| (s.t_s, Some(k), k)));
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut text = String::from("t_s,x_mm,y_mm,z_mm,c_deg");
    for axis in ["x", "y", "z"] {
        // writing to a String cannot fail
        let _ = write!(
            text,
            ",v{axis}_mm_per_s,a{axis}_mm_per_s2,dir_{axis},since_reversal_{axis}_mm,since_reversal_{axis}_s,\
             target_{axis}_mm,force_{axis}_n"
        );
    }
    text += ",dir_c,tool_length_mm,range_mm,spindle_rpm";
    for (name, _) in log.first().map(|e| &e.temperatures[..]).unwrap_or_default() {
        let _ = write!(text, ",temp_{name}_degc");
    }
    text.push('\n');
    let mut now = log.first();
    let mut rows = Vec::with_capacity(order.len());
    for (t_s, state, k) in order {
        if state.is_none() {
            now = log.get(k);
        }
        row(&mut text, t_s, state.and_then(|k| states.get(k)), now);
        rows.push(state);
    }
    Points { text, states: rows }
}

/// A direction of travel; forward where an axis has not moved yet.
const fn way(direction: f64) -> f64 {
    if direction < 0.0 { -1.0 } else { 1.0 }
}

/// A row: a reading, or an entry of the log with the axes at zero.
fn row(text: &mut String, t_s: f64, state: Option<&State>, log: Option<&Entry>) {
    let mut number = |v: f64| {
        let _ = write!(text, "{},", if v.is_finite() { v } else { 0.0 });
    };
    let of = |f: &dyn Fn(&State) -> f64| state.map_or(0.0, f);
    number(t_s);
    for k in 0..3 {
        number(of(&|s| s.command.linear[k].q));
    }
    number(of(&|s| s.command.table.q.to_degrees()));
    for k in 0..3 {
        number(of(&|s| s.command.linear[k].v));
        number(of(&|s| s.command.linear[k].a));
        number(way(of(&|s| s.direction[k])));
        number(of(&|s| s.since_mm[k]));
        number(of(&|s| s.since_s[k]));
        number(of(&|s| s.target_mm.map_or(0.0, |p| p[k])));
        number(of(&|s| s.force_n[k]));
    }
    number(way(of(&|s| s.direction[3])));
    number(of(&|s| s.tool_mm));
    number(of(&|s| s.range_mm));
    number(state.map(|s| s.spindle_rpm).or(log.map(|e| e.spindle_rpm)).unwrap_or_default());
    for (_, degc) in log.map(|e| &e.temperatures[..]).unwrap_or_default() {
        number(*degc);
    }
    text.pop();
    text.push('\n');
}
