//! Session files and logs as text (`docs/reference/session-files.md`).

use std::fmt::Write;

use super::Campaign;
use super::run::State;
use crate::twin::machine::nominal_model;

/// The columns of a session file.
const COLUMNS: &str = "t_s,instrument,setup,run,repeat,pair,x_mm,y_mm,z_mm,c_deg,u_x,u_y,u_z,deviation_um,\
vx_mm_per_s,vy_mm_per_s,vz_mm_per_s,ax_mm_per_s2,ay_mm_per_s2,az_mm_per_s2,dir_x,dir_y,dir_z,dir_c,\
since_reversal_x_mm,since_reversal_y_mm,since_reversal_z_mm,since_reversal_x_s,since_reversal_y_s,\
since_reversal_z_s,moving,tool_length_mm,range_mm,target_x_mm,target_y_mm,target_z_mm,station_x_mm,station_y_mm,\
station_z_mm,force_x_n,force_y_n,force_z_n,spindle_rpm\n";

/// A file by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Text {
    /// Its name.
    pub name: String,
    /// What stands in it.
    pub text: String,
}

impl Text {
    /// The nominal model of a machine.
    #[must_use]
    pub fn model(text: String) -> Self {
        Self { name: "model.toml".to_owned(), text }
    }
}

/// What a day's measurement gives the tool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Files {
    /// One session file per instrument.
    pub sessions: Vec<Text>,
    /// The machine's log.
    pub history: Text,
    /// The nominal model.
    pub model: Text,
}

impl Files {
    /// Those of a campaign on the twin.
    #[must_use]
    pub fn of(campaign: &Campaign) -> Self {
        Self { sessions: sessions(campaign), history: history(campaign), model: Text::model(nominal_model()) }
    }
}

/// One session file per instrument, in the order of their first use.
#[must_use]
pub fn sessions(campaign: &Campaign) -> Vec<Text> {
    let mut files: Vec<Text> = Vec::new();
    for (s, m) in campaign.taken.states.iter().zip(&campaign.measured) {
        let name = format!("{}.csv", s.instrument);
        let at = files.iter().position(|f| f.name == name).unwrap_or_else(|| {
            files.push(Text { name, text: COLUMNS.to_owned() });
            files.len() - 1
        });
        if let Some(file) = files.get_mut(at) {
            row(&mut file.text, s, m.deviation_um);
        }
    }
    files
}

/// A number, or nothing where there is none.
fn field(text: &mut String, value: Option<f64>, digits: usize) {
    if let Some(v) = value.filter(|v| v.is_finite()) {
        // writing to a String cannot fail
        let _ = write!(text, "{v:.digits$}");
    }
    text.push(',');
}

fn row(text: &mut String, s: &State, deviation: Option<f64>) {
    let [setup, run, repeat, pair] = s.place;
    let _ = write!(text, "{:.4},{},{setup},{run},{repeat},{pair},", s.t_s, s.instrument);
    for a in s.command.linear {
        field(text, Some(a.q), 4);
    }
    field(text, Some(s.command.table.q.to_degrees()), 5);
    for u in s.u {
        field(text, Some(u), 7);
    }
    field(text, deviation, 4);
    for a in s.command.linear {
        field(text, Some(a.v), 4);
    }
    for a in s.command.linear {
        field(text, Some(a.a), 3);
    }
    for d in s.direction {
        field(text, Some(d), 0);
    }
    for v in s.since_mm {
        field(text, Some(v), 4);
    }
    for v in s.since_s {
        field(text, Some(v), 4);
    }
    field(text, Some(f64::from(u8::from(s.moving))), 0);
    field(text, Some(s.tool_mm), 3);
    field(text, Some(s.range_mm), 3);
    for point in [s.target_mm, s.station_mm] {
        for k in 0..3 {
            field(text, point.and_then(|p| p.get(k).copied()), 3);
        }
    }
    for f in s.force_n {
        field(text, Some(f), 1);
    }
    field(text, Some(s.spindle_rpm), 0);
    text.pop();
    text.push('\n');
}

/// The machine's log.
#[must_use]
pub fn history(campaign: &Campaign) -> Text {
    let mut text = String::from("t_s,spindle_rpm");
    if let Some(first) = campaign.taken.log.first() {
        for (name, _) in first.temperatures {
            let _ = write!(text, ",temp_{name}_degc");
        }
    }
    text.push('\n');
    for e in &campaign.taken.log {
        let _ = write!(text, "{:.2},{:.0}", e.t_s, e.spindle_rpm);
        for (_, v) in e.temperatures {
            let _ = write!(text, ",{v:.2}");
        }
        text.push('\n');
    }
    Text { name: "history.csv".to_owned(), text }
}
