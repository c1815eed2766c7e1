//! Session files and log as text (`docs/reference/session-files.md`).

use std::fmt::Write;

use super::row::Row;
use super::{Measurement, Reading};

/// The columns of a session file.
const COLUMNS: &str = "t_s,instrument,setup,run,repeat,pair,u_x,u_y,u_z,deviation_um,x_mm,y_mm,z_mm,a_deg,c_deg,\
moving,vx_mm_per_s,ax_mm_per_s2,dir_x,since_reversal_x_mm,since_reversal_x_s,vy_mm_per_s,ay_mm_per_s2,dir_y,\
since_reversal_y_mm,since_reversal_y_s,vz_mm_per_s,az_mm_per_s2,dir_z,since_reversal_z_mm,since_reversal_z_s,dir_a,\
dir_c,tool_length_mm,range_mm,target_x_mm,target_y_mm,target_z_mm,station_x_mm,station_y_mm,station_z_mm,force_x_n,\
force_y_n,force_z_n,spindle_rpm\n";

/// A file by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sheet {
    /// Its name.
    pub name: String,
    /// What stands in it.
    pub text: String,
}

/// One session file per instrument, in the order of their first use.
#[must_use]
pub fn sessions(measurement: &Measurement) -> Vec<Sheet> {
    let mut files: Vec<Sheet> = Vec::new();
    for (row, reading) in measurement.rows.iter().zip(&measurement.readings) {
        let name = format!("{}.csv", row.instrument);
        let at = files.iter().position(|f| f.name == name).unwrap_or_else(|| {
            files.push(Sheet { name, text: COLUMNS.to_owned() });
            files.len() - 1
        });
        if let Some(file) = files.get_mut(at) {
            line(&mut file.text, row, reading);
        }
    }
    files
}

/// A number, or nothing where there is none, and a comma.
fn field(text: &mut String, value: Option<f64>, digits: usize) {
    if let Some(v) = value {
        // writing to a String cannot fail
        let _ = write!(text, "{v:.digits$}");
    }
    text.push(',');
}

fn line(text: &mut String, r: &Row, reading: &Reading) {
    let [setup, run, repeat, pair] = r.place;
    let _ = write!(text, "{:.5},{},{setup},{run},{repeat},{pair},", r.t_s, r.instrument);
    let mut number = |value: f64, digits: usize| field(text, Some(value), digits);
    r.u.iter().for_each(|u| number(*u, 7));
    field(text, reading.deviation_um, 4);
    let mut number = |value: f64, digits: usize| field(text, Some(value), digits);
    r.position.iter().for_each(|q| number(*q, 5));
    r.turn.iter().for_each(|q| number(q.to_degrees(), 6));
    number(f64::from(u8::from(r.moving)), 0);
    for k in 0..3 {
        number(r.speed[k], 5);
        number(r.acceleration[k], 4);
        number(r.direction[k], 0);
        number(r.since_mm[k], 4);
        number(r.since_s[k], 4);
    }
    r.direction[3..].iter().for_each(|d| number(*d, 0));
    number(r.tool_mm, 2);
    field(text, r.range_mm, 3);
    for point in [r.target_mm, r.station_mm] {
        (0..3).for_each(|k| field(text, point.map(|p| p[k]), 3));
    }
    r.force_n.iter().for_each(|f| field(text, Some(*f), 1));
    field(text, Some(r.rpm), 0);
    text.pop();
    text.push('\n');
}

/// The machine's log.
#[must_use]
pub fn history(measurement: &Measurement) -> Sheet {
    let mut text = String::from(
        "t_s,spindle_rpm,temp_screw_x_degc,temp_screw_y_degc,temp_screw_z_degc,temp_spindle_nose_degc,temp_room_degc\n",
    );
    for [t, rpm, temperatures @ ..] in measurement.heat.log() {
        let _ = write!(text, "{t:.2},{rpm:.0}");
        for v in temperatures {
            let _ = write!(text, ",{v:.2}");
        }
        text.push('\n');
    }
    Sheet { name: "history.csv".to_owned(), text }
}
