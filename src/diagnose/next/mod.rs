//! What to measure next: for every pair that the data cannot separate the measurement that does.

mod program;

pub use self::program::Dialect;

use self::program::Program;
use super::constants::TOLD;
use super::library::{Effect, Library, Measurement as Motion};
use super::report::{Cause, Next, Unexplained};
use super::session::Session;

/// Information of a measurement that separates two equally probable causes, nats.
const ONE_OF_TWO: f64 = core::f64::consts::LN_2;
/// Preparation of a measurement that is no part of the catalogue, min.
const PREPARE_MIN: f64 = 30.0;
/// Effects named that a measurement shows and these data cannot.
const UNSEEN_NAMED: usize = 4;
/// Most measurements listed.
const LISTED: usize = 8;

/// A measurement of the catalogue.
struct Measurement {
    action: &'static str,
    motion: Motion,
    /// Preparation by somebody who has done it before: mounting, alignment, warm-up, min.
    prepare_min: f64,
}

const CATALOGUE: [Measurement; 11] = [
    Measurement {
        action: "repeat the circles of each plane at a second feed, three times as high, in both directions",
        motion: Motion::Circles,
        prepare_min: 20.0,
    },
    Measurement {
        action: "measure points of the line at rest, approached from both directions, with 3 s of dwell",
        motion: Motion::Points,
        prepare_min: 30.0,
    },
    Measurement {
        action: "repeat the lines cold and after an hour of warm-up, at least 3 K apart",
        motion: Motion::ColdAndWarm,
        prepare_min: 90.0,
    },
    Measurement {
        action: "repeat the grid with a second tool length in the same setup",
        motion: Motion::TwoTools,
        prepare_min: 20.0,
    },
    Measurement {
        action: "repeat the line at a second place of the other axes",
        motion: Motion::SecondPlace,
        prepare_min: 20.0,
    },
    Measurement {
        action: "run a short line with steps below a tenth of the pitch, not equal",
        motion: Motion::FineSteps,
        prepare_min: 30.0,
    },
    Measurement {
        action: "spindle on, off, on for an hour each with a probe at the tool",
        motion: Motion::Spindle,
        prepare_min: 200.0,
    },
    Measurement {
        action: "measure with a trigger shared by control and instrument, with a start and stop step in each file",
        motion: Motion::StartAndStop,
        prepare_min: 20.0,
    },
    Measurement {
        action: "measure a known length with a second instrument, or from a second station",
        motion: Motion::SecondInstrument,
        prepare_min: 45.0,
    },
    Measurement {
        action: "repeat the R-test with the ball at a second radius and height, in uneven steps of the angle",
        motion: Motion::Turn,
        prepare_min: 30.0,
    },
    Measurement {
        action: "measure the lines over the whole travel: over a part of it the slope of a curve is a straight line",
        motion: Motion::WholeTravel,
        prepare_min: 30.0,
    },
];

/// True where a measurement changes the size of an effect (label); it separates that from those whose size it leaves.
fn changes(m: &Measurement, label: &str) -> bool {
    let name = label.split(':').next().unwrap_or(label);
    Effect::find(name).is_some_and(|e| e.changes_with.contains(&m.motion))
}

/// Letters of the axes along which effects act or are counted: the last one of their subjects.
fn axes(labels: &[String]) -> Vec<char> {
    labels.iter().filter_map(|l| l.split_once(':')?.1.chars().next_back()).collect()
}

/// A measurement with its part program and its duration.
fn asked(
    program: &Program,
    action: &str,
    motion: Motion,
    prepare_min: f64,
    separates: Vec<String>,
    information: f64,
    decides: String,
) -> Next {
    let gcode = program.text(motion, &axes(&separates));
    let minutes = (prepare_min + program.minutes(motion, &gcode)).ceil();
    Next { action: action.to_owned(), separates, information, decides, minutes, gcode }
}

/// What the result of a measurement decides between the pairs that it tells apart.
fn decides(m: &Measurement, told: &[&(String, String, f64)]) -> String {
    let mut groups: [Vec<&str>; 2] = Default::default();
    for label in told.iter().flat_map(|p| [&p.0, &p.1]) {
        let group = &mut groups[usize::from(!changes(m, label))];
        if !group.contains(&label.as_str()) {
            group.push(label);
        }
    }
    let [moved, stays] = groups.map(|g| g.join(" or "));
    format!("decides between {moved}, which changes with it, and {stays}, which does not")
}

/// Duration of the session, min.
fn session_minutes(session: &Session) -> f64 {
    let mut spans = vec![[f64::INFINITY, f64::NEG_INFINITY]; session.files.len()];
    for m in &session.moments {
        let span = &mut spans[m.file];
        *span = [span[0].min(m.t_s), span[1].max(m.t_s)];
    }
    (spans.iter().map(|[a, b]| (b - a).max(0.0)).sum::<f64>() / 60.0).ceil()
}

/// Measurements ranked by the information that they are expected to bring.
#[must_use]
pub(super) fn next(
    session: &Session,
    causes: &[Cause],
    unexplained: &Unexplained,
    library: &Library,
    dialect: Dialect,
) -> Vec<Next> {
    let mut pairs: Vec<(String, String, f64)> = Vec::new();
    for c in causes.iter().filter(|c| c.probability > TOLD) {
        let rivals = c.confounded_with.iter().cloned().chain(
            causes.iter().filter(|o| o.remark == format!("alternative to {}", c.label())).map(Cause::label),
        );
        for other in rivals {
            let p = causes.iter().find(|o| o.label() == other).map_or(0.5 * c.probability, |o| o.probability);
            let (a, b) = (c.probability.max(1e-6), p.max(1e-6));
            // the information of a test that tells the two apart: entropy of which of them it is
            let (a, b) = (a / (a + b), b / (a + b));
            let known = pairs
                .iter()
                .any(|(x, y, _)| (*x == other && *y == c.label()) || (*x == c.label() && *y == other));
            if !known {
                pairs.push((c.label(), other, -(a * a.ln() + b * b.ln())));
            }
        }
    }
    let program = Program::of(session, dialect);
    let is_new = |m: &&Measurement| m.motion != Motion::WholeTravel || library.partly.contains(&true);
    let mut all: Vec<Next> = CATALOGUE
        .iter()
        .filter(is_new)
        .filter_map(|m| {
            let told: Vec<&(String, String, f64)> =
                pairs.iter().filter(|(x, y, _)| changes(m, x) != changes(m, y)).collect();
            let information: f64 = told.iter().map(|p| p.2).sum();
            let mut separates: Vec<String> = told.iter().flat_map(|p| [p.0.clone(), p.1.clone()]).collect();
            separates.sort();
            separates.dedup();
            (!separates.is_empty()).then(|| {
                let decides = decides(m, &told);
                asked(&program, m.action, m.motion, m.prepare_min, separates, information, decides)
            })
        })
        .collect();
    if !session.readings.iter().any(|r| r.pair.is_some()) {
        all.push(Next {
            action: "run every part program at least twice: only repeats show the noise".to_owned(),
            separates: vec!["outliers".to_owned(), "range-noise".to_owned()],
            information: ONE_OF_TWO,
            decides: "shows the noise, so that probabilities and the unexplained part no longer rest on neighbouring readings"
                .to_owned(),
            minutes: (session_minutes(session)).max(1.0),
            gcode: "(the same part programs again)".to_owned(),
        });
    }
    if unexplained.significant {
        // the measurement that would bring most of what is not seen yet
        for m in CATALOGUE.iter().filter(is_new) {
            let unseen: Vec<String> =
                library.blind.iter().map(|b| b.label.clone()).filter(|l| changes(m, l)).collect();
            if !unseen.is_empty() && !all.iter().any(|n| n.action == m.action) {
                let information = 0.1 * ONE_OF_TWO * unseen.len() as f64;
                let rest = unseen.len().saturating_sub(UNSEEN_NAMED);
                let more = if rest > 0 { format!(" or {rest} more") } else { String::new() };
                let named = unseen[..unseen.len() - rest].join(" or ");
                let decides =
                    format!("shows whether {named}{more} contributes, which these data cannot show");
                all.push(asked(&program, m.action, m.motion, m.prepare_min, unseen, information, decides));
            }
        }
    }
    for c in causes.iter().filter(|c| c.declared && !c.confounded_with.is_empty()) {
        let settled = all.iter().any(|n| n.separates.contains(&c.label()));
        if let (false, Some(p)) = (settled, Effect::find(&c.effect)) {
            let separates: Vec<String> = [c.label()].into_iter().chain(c.confounded_with.clone()).collect();
            let decides = format!("decides which of {} it is", separates.join(", "));
            let action = p.settles.trim_end_matches('.');
            all.push(asked(&program, action, Motion::Points, PREPARE_MIN, separates, ONE_OF_TWO, decides));
        }
    }
    all.sort_by(|a, b| b.information.total_cmp(&a.information).then(a.action.cmp(&b.action)));
    all.truncate(LISTED);
    all
}
