//! Where the gap lies, without any library of effects: shares of the structured gap that any function of one factor
//! explains (bins, whitened, minus what as many bins explain of noise).
//!
//! Shares by axis, instrument and setup add up to 1; those by position, direction, speed and the like overlap, because
//! factors move together. Source: `docs/explanation/diagnosis.md` (where).

use super::constants::{LISTED, MOST, SIGNIFICANT, TOLD};
use super::library::STILL;
use super::moment::{Axis, Moment};
use super::report::Place;
use super::search::Problem;
use super::session::Session;
use volcomp_units::RAD_PER_DEG;
use volcomp_units::axes::AxisKind;

/// A factor: its name, whose, and its value per reading.
struct Factor {
    by: &'static str,
    of: String,
    detail: String,
    values: Vec<f64>,
}

fn factors(session: &Session) -> Vec<Factor> {
    let mut all = Vec::new();
    let mut add = |by, of: String, detail: String, of_moment: &dyn Fn(&Moment) -> f64| {
        all.push(Factor { by, of, detail, values: session.moments.iter().map(of_moment).collect() });
    };
    for axis in Axis::ALL.into_iter().filter(|a| session.axes.contains(a)) {
        let i = axis.slot();
        let (length, unit) =
            if axis.name().kind() == AxisKind::Linear { ("mm", 1.0) } else { ("deg", 1.0 / RAD_PER_DEG) };
        add("position", axis.to_string(), format!("position of {axis}, {length}"), &|m| m.position[i] * unit);
        add("direction", axis.to_string(), format!("direction of travel of {axis}"), &|m| m.direction[i]);
        let recent = |m: &Moment| {
            if m.since_s[i].is_finite() && m.velocity[i].abs() > STILL {
                m.direction[i] * (m.since_s[i] + 1e-3).ln()
            } else {
                f64::NAN
            }
        };
        add(
            "direction",
            axis.to_string(),
            format!("direction of travel of {axis} and time since its reversal"),
            &recent,
        );
        add("speed", axis.to_string(), format!("velocity of {axis}, {length}/s"), &|m| m.velocity[i] * unit);
        add("acceleration", axis.to_string(), format!("acceleration of {axis}, {length}/s2"), &|m| {
            m.acceleration[i] * unit
        });
    }
    let time = if session.is_ordinal() { "order of the readings" } else { "time, s" };
    add("time", String::new(), time.to_owned(), &|m| m.t_s);
    add("tool-length", String::new(), "tool length, mm".to_owned(), &|m| m.tool_length_mm);
    for (k, signal) in session.signals.iter().enumerate().filter(|(_, s)| s.tau_s == 0.0) {
        let name = signal.source.to_string();
        add("temperature", name.clone(), name, &|m| m.signals[k]);
    }
    for extra in &session.extra {
        let (of, detail) = (extra.name.clone(), format!("column {}", extra.name));
        all.push(Factor { by: "column", of, detail, values: extra.values.clone() });
    }
    all
}

/// Bin of every value: quantiles, or the values themselves where there are few; `None` where nothing changes.
fn bins(values: &[f64], rows: &[usize]) -> Option<(Vec<usize>, usize, Vec<f64>)> {
    let mut sorted: Vec<f64> = rows.iter().map(|i| values[*i]).filter(|v| v.is_finite()).collect();
    if sorted.len() < rows.len() / 10 || sorted.is_empty() {
        return None;
    }
    sorted.sort_by(f64::total_cmp);
    let mut different = sorted.clone();
    different.dedup_by(|b, a| (*b - *a).abs() <= 1e-9 * (1.0 + a.abs()));
    let edges: Vec<f64> = if different.len() <= MOST {
        different[1..].iter().zip(&different).map(|(b, a)| 0.5 * (a + b)).collect()
    } else {
        let mut e: Vec<f64> = (1..MOST).map(|k| sorted[k * sorted.len() / MOST]).collect();
        e.dedup();
        e
    };
    if edges.is_empty() {
        return None;
    }
    let missing = edges.len() + 1;
    let bin = rows
        .iter()
        .map(|i| if values[*i].is_finite() { edges.partition_point(|e| *e <= values[*i]) } else { missing })
        .collect();
    let mut bounds = vec![sorted[0]];
    bounds.extend(&edges);
    bounds.push(sorted[sorted.len() - 1]);
    Some((bin, missing, bounds))
}

/// Whitens columns (a row of some width per row of the problem) as `y` has been whitened.
type Whiten<'a> = dyn Fn(&mut [f64], usize) + 'a;

/// Shares of what `y` (whitened, in the problem's order) holds beyond noise.
#[must_use]
pub(super) fn localise(session: &Session, problem: &Problem, whiten: &Whiten<'_>, y: &[f64]) -> Vec<Place> {
    let n = y.len();
    let structured = y.iter().map(|v| v * v).sum::<f64>() - n as f64;
    let noise = SIGNIFICANT * (2.0 * n as f64).sqrt();
    if structured < noise {
        return Vec::new();
    }
    let mut places = partitions(session, problem, y, structured);
    for factor in factors(session) {
        let Some((bin, count, bounds)) = bins(&factor.values, &problem.rows) else { continue };
        if let Some(p) = share_of(session, problem, whiten, y, structured, &factor, (&bin, count, &bounds)) {
            places.push(p);
        }
    }
    places.retain(|p| p.share >= TOLD);
    places.sort_by(|a, b| b.share.total_cmp(&a.share).then(a.by.cmp(b.by)).then(a.of.cmp(&b.of)));
    let mut seen: Vec<(&str, String)> = Vec::new();
    places.retain(|p| {
        let new = !seen.contains(&(p.by, p.of.clone()));
        seen.push((p.by, p.of.clone()));
        new
    });
    places.truncate(LISTED);
    places
}

/// By axis of the deviation, instrument and setup: these add up.
fn partitions(session: &Session, problem: &Problem, y: &[f64], structured: f64) -> Vec<Place> {
    let mut axis = [0.0; 3];
    let mut instrument = vec![0.0; session.instruments.len()];
    let mut setup = vec![0.0; session.setups.len()];
    for (e, i) in y.iter().zip(&problem.rows) {
        let (r, m) = (&session.readings[*i], &session.moments[*i]);
        let more = e * e - 1.0;
        for (a, u) in axis.iter_mut().zip(m.u.iter()) {
            *a += u * u * more;
        }
        instrument[r.instrument] += more;
        setup[r.setup] += more;
    }
    let of = |by: &'static str, values: &[f64], name: &dyn Fn(usize) -> (String, String)| -> Vec<Place> {
        let positive: f64 = values.iter().filter(|v| **v > 0.0).sum();
        values
            .iter()
            .enumerate()
            .filter(|(_, v)| **v > 0.0)
            .map(|(i, v)| {
                let (of, detail) = name(i);
                Place { by, of, share: v / positive.max(structured.min(positive)), detail }
            })
            .collect()
    };
    let mut places = of("axis", &axis, &|i| {
        let a = ["x", "y", "z"][i];
        (a.to_owned(), format!("deviation along {a}"))
    });
    if session.instruments.len() > 1 {
        places.extend(of("instrument", &instrument, &|i| {
            (session.instruments[i].clone(), format!("readings of {}", session.instruments[i]))
        }));
    }
    if session.setups.len() > 1 {
        places.extend(of("setup", &setup, &|i| {
            (session.setups[i].clone(), format!("setup {}", session.setups[i]))
        }));
    }
    places
}

fn share_of(
    session: &Session,
    problem: &Problem,
    whiten: &Whiten<'_>,
    y: &[f64],
    structured: f64,
    factor: &Factor,
    (bin, count, bounds): (&[usize], usize, &[f64]),
) -> Option<Place> {
    let width = 3 * count;
    let mut data = vec![0.0; y.len() * width];
    for ((row, b), i) in data.chunks_exact_mut(width).zip(bin).zip(&problem.rows) {
        if *b < count {
            for (k, u) in session.moments[*i].u.iter().enumerate() {
                row[3 * b + k] = *u;
            }
        }
    }
    whiten(&mut data, width);
    let mut g = nalgebra::DMatrix::<f64>::zeros(width, width);
    let mut b = nalgebra::DVector::<f64>::zeros(width);
    for (row, e) in data.chunks_exact(width).zip(y) {
        let row = nalgebra::DVectorView::from_slice(row, width);
        g.ger(1.0, &row, &row, 1.0);
        b.axpy(*e, &row, 1.0);
    }
    // columns that nothing sees and the constant, which the offset takes, leave a singular matrix
    let eigen = g.symmetric_eigen();
    let largest = eigen.eigenvalues.max().max(1e-12);
    let (mut gain, mut rank) = (0.0, 0usize);
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > 1e-6 * largest {
            gain += vector.dot(&b).powi(2) / value;
            rank += 1;
        }
    }
    let share = ((gain - rank as f64) / structured).clamp(0.0, 1.0);
    if share < TOLD {
        return None;
    }
    // the bin with most of the gap in it says where
    let mut energy = vec![0.0; count];
    for (e, k) in y.iter().zip(bin).filter(|(_, k)| **k < count) {
        energy[*k] += e * e - 1.0;
    }
    let top = (0..count).max_by(|a, b| energy[*a].total_cmp(&energy[*b])).unwrap_or(0);
    let [low, high] = [bounds[top], bounds[top + 1]];
    let detail = if factor.by == "direction" {
        format!("{}: largest in travel towards {}", factor.detail, if low < 0.0 { "minus" } else { "plus" })
    } else {
        format!("{}: largest between {} and {}", factor.detail, short(low), short(high))
    };
    Some(Place { by: factor.by, of: factor.of.clone(), share, detail })
}

/// A number with some three digits that count.
fn short(value: f64) -> String {
    match value.abs() {
        // what rounds to zero has neither sign nor digits
        size if size < 5e-5 => "0".to_owned(),
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        size if size >= 1.0 => format!("{value:.2}"),
        _ => format!("{value:.4}"),
    }
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn a_place_is_told_with_the_digits_that_count() {
        assert_eq!(
            [214.4621, -17.2203, 1.234, 0.01234, 0.0, -0.00004].map(short),
            ["214", "-17.2", "1.23", "0.0123", "0", "0"]
        );
    }
}
