//! Input that cannot be right is refused before anything is computed from it.

use super::super::constants::FEW;
use super::super::constants::bounds::{DEGC, DEVIATION_UM, PAUSE_S, TRAVEL_MM};
use super::super::moment::Axis;
use super::{Note, Raw, SessionError, is_angular};

/// Columns that every session needs.
const NEEDED: [(&str, &str); 8] = [
    ("t_s", "the time of every reading in seconds"),
    ("setup", "number the mountings of the instrument; 1 for all rows where there was one"),
    ("run", "number the passes; 1 for all rows where there was one"),
    ("repeat", "number the repetitions of the program; 1 for all rows where there was one"),
    ("u_x", "the direction in which the instrument measures, as a unit vector u_x u_y u_z"),
    ("u_y", "the direction in which the instrument measures, as a unit vector u_x u_y u_z"),
    ("u_z", "the direction in which the instrument measures, as a unit vector u_x u_y u_z"),
    ("deviation_um", "measured actual minus nominal along u"),
];

/// Refuses a file that lacks columns, runs backwards or has units that cannot be right; says what looks odd.
pub(super) fn file(raw: &Raw) -> Result<Vec<Note>, SessionError> {
    for (column, remedy) in NEEDED {
        if raw.column(column).is_none() {
            return Err(SessionError::Missing { file: raw.file.clone(), column, remedy });
        }
    }
    if !Axis::ALL.iter().any(|a| raw.column(&a.column()).is_some()) {
        let remedy = "at least one commanded position, such as x_mm or c_deg, is needed";
        return Err(SessionError::Missing { file: raw.file.clone(), column: "x_mm", remedy });
    }
    for column in ["t_s", "setup", "run", "repeat"] {
        never_empty(raw, column, &|_| true)?;
    }
    // a lost reading looked nowhere
    for column in ["u_x", "u_y", "u_z"] {
        never_empty(raw, column, &|i| !is_lost(raw, i))?;
    }
    for axis in Axis::ALL {
        if raw.column(&axis.column()).is_some() {
            never_empty(raw, &axis.column(), &|_| true)?;
        }
    }
    whole(raw)?;
    marks(raw)?;
    travel(raw)?;
    in_order(raw)?;
    directions(raw)?;
    units(raw)?;
    super::plausibility_warnings::units_of_setups(raw)?;
    Ok(super::plausibility_warnings::of(raw))
}

/// Setups, runs, repeats and pairs are counted, not measured.
fn whole(raw: &Raw) -> Result<(), SessionError> {
    for column in ["setup", "run", "repeat", "pair"] {
        let values = raw.column(column).unwrap_or(&[]);
        if let Some(i) = values.iter().position(|v| v.is_finite() && v.fract() != 0.0) {
            return Err(SessionError::Value {
                file: raw.file.clone(),
                line: raw.lines[i],
                column: column.to_owned(),
                value: values[i],
                what: "is a number that counts; write a whole one",
            });
        }
    }
    Ok(())
}

/// An outlier is marked or not.
fn marks(raw: &Raw) -> Result<(), SessionError> {
    let values = raw.column("outlier").unwrap_or(&[]);
    let bad = values.iter().position(|v| v.is_finite() && ![0.0, 1.0].contains(v));
    bad.map_or(Ok(()), |i| {
        Err(SessionError::Value {
            file: raw.file.clone(),
            line: raw.lines[i],
            column: "outlier".to_owned(),
            value: values[i],
            what: "marks a reading as an outlier; write 1, or 0 or nothing for an ordinary reading",
        })
    })
}

/// A direction of travel is a sign.
fn travel(raw: &Raw) -> Result<(), SessionError> {
    for axis in Axis::ALL {
        let column = format!("dir_{axis}");
        let values = raw.column(&column).unwrap_or(&[]);
        if let Some(i) = values.iter().position(|v| v.is_finite() && ![-1.0, 0.0, 1.0].contains(v)) {
            return Err(SessionError::Value {
                file: raw.file.clone(),
                line: raw.lines[i],
                column,
                value: values[i],
                what: "is a direction of travel; write +1 or -1, 0 before the axis has moved",
            });
        }
    }
    Ok(())
}

/// True for a row without a deviation.
fn is_lost(raw: &Raw, row: usize) -> bool {
    raw.column("deviation_um").is_some_and(|d| !d[row].is_finite())
}

fn never_empty(raw: &Raw, column: &str, matters: &dyn Fn(usize) -> bool) -> Result<(), SessionError> {
    let values = raw.column(column).unwrap_or(&[]);
    let empty = (0..values.len()).find(|i| !values[*i].is_finite() && matters(*i));
    empty.map_or(Ok(()), |i| {
        Err(SessionError::Empty { file: raw.file.clone(), line: raw.lines[i], column: column.to_owned() })
    })
}

fn in_order(raw: &Raw) -> Result<(), SessionError> {
    let (Some(t), Some(setup), Some(run)) = (raw.column("t_s"), raw.column("setup"), raw.column("run"))
    else {
        return Ok(());
    };
    for i in 1..t.len() {
        if t[i] - t[i - 1] > PAUSE_S[1] {
            return Err(SessionError::Clock {
                file: raw.file.clone(),
                line: raw.lines[i],
                before: t[i - 1],
                after: t[i],
            });
        }
        if t[i] < t[i - 1] {
            let place = if setup[i] != setup[i - 1] {
                ", where a new setup begins: each seems to have a clock of its own"
            } else if run[i] != run[i - 1] {
                ", where a new run begins: each seems to have a clock of its own"
            } else {
                ""
            };
            return Err(SessionError::Unsorted {
                file: raw.file.clone(),
                line: raw.lines[i],
                before: t[i - 1],
                after: t[i],
                place,
            });
        }
    }
    Ok(())
}

fn directions(raw: &Raw) -> Result<(), SessionError> {
    let (Some(x), Some(y), Some(z)) = (raw.column("u_x"), raw.column("u_y"), raw.column("u_z")) else {
        return Ok(());
    };
    for i in (0..raw.len()).filter(|i| !is_lost(raw, *i)) {
        let length = (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
        if !(0.95..=1.05).contains(&length) {
            return Err(SessionError::NotUnit { file: raw.file.clone(), line: raw.lines[i], length });
        }
    }
    Ok(())
}

/// Root of the mean square of the finite values.
fn rms(values: &[f64]) -> f64 {
    let (sum, n) =
        values.iter().filter(|v| v.is_finite()).fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
    if n == 0 { 0.0 } else { (sum / n as f64).sqrt() }
}

/// The only value of the deviations of a file, um; `None` where they differ, or where there are not two.
pub(super) fn constant(raw: &Raw) -> Option<f64> {
    let deviation = raw.column("deviation_um").unwrap_or(&[]);
    let mut known = deviation.iter().filter(|v| v.is_finite());
    let first = known.next()?;
    (known.all(|v| v == first) && deviation.len() > 1).then_some(*first)
}

fn units(raw: &Raw) -> Result<(), SessionError> {
    let wrong = |column: &str, what: String, remedy: &'static str| {
        Err(SessionError::Unit { file: raw.file.clone(), column: column.to_owned(), what, remedy })
    };
    let deviation = raw.column("deviation_um").unwrap_or(&[]);
    if let Some(value) = constant(raw) {
        return Err(SessionError::Constant { file: raw.file.clone(), value });
    }
    let size = rms(deviation);
    let [least, .., most] = DEVIATION_UM;
    if size > most {
        let what = format!("has an RMS of {size:.0} µm, limit {most:.0}");
        return wrong("deviation_um", what, "are these nm? the column is in µm");
    }
    // the lever of an angle is a choice, and so is the size of its displacement
    if size > 0.0 && size < least && !is_angular(raw) {
        let what = format!("has an RMS of {size:.5} µm, limit {least}");
        return wrong("deviation_um", what, "are these mm? the column is in um: multiply by 1000");
    }
    for axis in Axis::LINEAR {
        let values = raw.column(&axis.column()).unwrap_or(&[]);
        let far = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        if far > TRAVEL_MM[1] {
            let what = format!("reaches {far:.0} mm, limit {:.0}", TRAVEL_MM[1]);
            return wrong(&axis.column(), what, "are these um? the column is in mm");
        }
    }
    for (name, values) in raw.names.iter().zip(&raw.columns) {
        if name.starts_with("temp_") && name.ends_with("_degc") {
            let hot = values.iter().filter(|v| v.is_finite()).fold(0.0f64, |m, v| m.max(*v));
            if hot > DEGC[1] {
                let what = format!("reaches {hot:.1}, limit {:.0} degC", DEGC[1]);
                return wrong(name, what, "are these kelvin or millidegrees? the column is in degC");
            }
        }
    }
    Ok(())
}

/// Ratio of a stated speed to the one that positions and times give; `None` where too little moves.
pub(super) fn speed_ratio(stated: &[f64], derived: &[f64]) -> Option<f64> {
    let (mut both, mut own, mut other, mut n) = (0.0, 0.0, 0.0, 0usize);
    for (s, d) in stated.iter().zip(derived) {
        if s.is_finite() && d.abs() > 1e-9 {
            both += s * d;
            own += d * d;
            other += s * s;
            n += 1;
        }
    }
    let alike = both * both > 0.81 * own * other;
    (n >= FEW && alike && own > 0.0).then(|| both / own)
}

/// A ratio that can only come from a unit: s against ms or min, mm against m.
pub(super) fn unit_slip(ratio: f64) -> bool {
    [1000.0, 60.0, 0.001, 1.0 / 60.0, 1e6, 1e-6].iter().any(|f| (ratio / f - 1.0).abs() < 0.2)
}
