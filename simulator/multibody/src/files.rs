//! Session files and log (`docs/reference/session-files.md`).

use std::fmt::Write;

use crate::heat::{Heat, SENSORS};
use crate::program::{Program, Sample, Segment};

const COLUMNS: &str = "t_s,instrument,setup,run,repeat,pair,x_mm,y_mm,z_mm,b_deg,u_x,u_y,u_z,deviation_um,vx_mm_per_s,\
vy_mm_per_s,vz_mm_per_s,ax_mm_per_s2,ay_mm_per_s2,az_mm_per_s2,dir_x,dir_y,dir_z,dir_b,since_reversal_x_mm,\
since_reversal_y_mm,since_reversal_z_mm,since_reversal_x_s,since_reversal_y_s,since_reversal_z_s,moving,\
tool_length_mm,range_mm,target_x_mm,target_y_mm,target_z_mm,station_x_mm,station_y_mm,station_z_mm,force_x_n,\
force_y_n,force_z_n,spindle_rpm\n";

/// One session file per instrument: name, text, and the readings behind its rows.
pub fn sessions(program: &Program, readings: &[Option<f64>]) -> Vec<(String, String, Vec<usize>)> {
    let mut files: Vec<(String, String, Vec<usize>)> = Vec::new();
    for (k, (s, r)) in program.samples.iter().zip(readings).enumerate() {
        let name = format!("{}.csv", s.instrument);
        let at = files.iter().position(|f| f.0 == name).unwrap_or_else(|| {
            files.push((name, COLUMNS.to_owned(), Vec::new()));
            files.len() - 1
        });
        if let (Some(file), Some(segment)) = (files.get_mut(at), program.segments.get(s.segment)) {
            row(&mut file.1, s, segment, *r);
            file.2.push(k);
        }
    }
    files
}

fn row(text: &mut String, s: &Sample, segment: &Segment, reading: Option<f64>) {
    let mut put = |value: Option<f64>, digits: usize| {
        if let Some(v) = value {
            // writing to a String cannot fail
            let _ = write!(text, "{v:.digits$}");
        }
        text.push(',');
    };
    put(Some(s.t_s), 4);
    let _ = write!(text, "{},{},{},{},{},", s.instrument, s.place[0], s.place[1], s.place[2], s.place[3]);
    let mut put = |value: Option<f64>, digits: usize| {
        if let Some(v) = value {
            let _ = write!(text, "{v:.digits$}");
        }
        text.push(',');
    };
    let c = &s.command;
    (0..3).for_each(|k| put(Some(c.q[k]), 4));
    put(Some(c.q[3].to_degrees()), 5);
    s.u.iter().for_each(|u| put(Some(*u), 7));
    put(reading, 4);
    (0..3).for_each(|k| put(Some(c.v[k]), 4));
    (0..3).for_each(|k| put(Some(c.a[k]), 3));
    (0..4).for_each(|k| put(Some(s.direction[k]), 0));
    (0..3).for_each(|k| put(Some(s.since[k][0]), 4));
    (0..3).for_each(|k| put(Some(s.since[k][1]), 4));
    put(Some(f64::from(u8::from(s.moving))), 0);
    put(Some(segment.tool_mm), 2);
    put(s.range_mm, 2);
    for point in [s.target, s.station] {
        (0..3).for_each(|k| put(point.map(|p| p[k]), 3));
    }
    segment.force.iter().for_each(|f| put(Some(*f), 1));
    put(Some(segment.rpm), 0);
    text.pop();
    text.push('\n');
}

/// The machine's log.
pub fn history(heat: &Heat) -> String {
    let mut text = String::from("t_s,spindle_rpm");
    for name in SENSORS {
        let _ = write!(text, ",temp_{name}_degc");
    }
    text.push('\n');
    for s in heat.log() {
        let _ = write!(text, "{:.1},{:.0}", s.t_s, s.rpm);
        for v in s.sensors {
            let _ = write!(text, ",{v:.2}");
        }
        text.push('\n');
    }
    text
}
