//! What to measure next: for every pair that the data cannot separate the measurement that does.

mod program;

pub use self::program::Dialect;

use self::program::Program;
use super::constants::{MOST, TOLD};
use super::library::{Effect, Kind, Label, Library, Measurement as Motion, PROCEDURES, Procedure};
use super::noise::is_revisited;
use super::report::{Cause, Next, Unexplained};
use super::session::Session;

/// Information of a measurement that separates two equally probable causes, nats.
const ONE_OF_TWO: f64 = core::f64::consts::LN_2;
/// Preparation of a measurement that is no part of the catalogue, min.
const PREPARE_MIN: f64 = 30.0;
/// Time for a place of a session whose times are ordinal, with positioning and dwell, s.
const PLACE_S: f64 = 10.0;
/// Effects named that a measurement shows and these data cannot.
const UNSEEN_NAMED: usize = 4;

/// True where a measurement changes the size of an effect (label); it separates that from those whose size it leaves.
fn changes(m: &Procedure, label: &str) -> bool {
    let name = label.split(':').next().unwrap_or(label);
    Effect::find(name).is_some_and(|e| e.changes_with.contains(&m.motion))
}

/// Entropy of a yes or no with this probability, nats.
fn entropy(p: f64) -> f64 {
    [p, 1.0 - p].iter().filter(|p| **p > 0.0).map(|p| -p * p.ln()).sum()
}

/// Letters of the axes along which effects act or are counted: the last one of their subjects.
fn axes(labels: &[String]) -> Vec<char> {
    labels.iter().filter_map(|l| l.split_once(':')?.1.chars().next_back()).collect()
}

/// A measurement with its part program and its duration.
fn asked(
    program: &Program,
    m: &Procedure,
    separates: Vec<String>,
    information: f64,
    decides: String,
) -> Next {
    let gcode = program.text(m.motion, &axes(&separates));
    let minutes = (m.prepare_min + program.minutes(m.motion, &gcode)).ceil();
    let action = program.action(m.motion).unwrap_or(m.action).to_owned();
    Next { action, separates, information, decides, minutes, gcode }
}

/// What the result of a measurement decides between the pairs that it tells apart.
fn decides(m: &Procedure, told: &[&(String, String, f64)]) -> String {
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

/// Duration of the session, min; from the number of its places where its times are ordinal.
fn session_minutes(session: &Session) -> f64 {
    if session.is_ordinal() {
        return (session.distinct_times().len() as f64 * PLACE_S / 60.0).ceil();
    }
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
            let known = pairs
                .iter()
                .any(|(x, y, _)| (*x == other && *y == c.label()) || (*x == c.label() && *y == other));
            if !known {
                pairs.push((c.label(), other, entropy(a / (a + b))));
            }
        }
    }
    let program = Program::of(session, dialect);
    let is_new = |m: &&Procedure| m.motion != Motion::WholeTravel || library.partly.contains(&true);
    let mut all: Vec<Next> = PROCEDURES
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
                asked(&program, m, separates, information, decides)
            })
        })
        .collect();
    if !session.readings.iter().any(|r| r.pair.is_some()) && !is_revisited(session) {
        // a log at one place knows its noise, and not whether its coefficients hold on another day
        let stands = session.moments.windows(2).all(|m| m[0].position == m[1].position);
        let (separates, [action, decides, gcode]) = if stands {
            let told = [
                "log a second period of the same kind: only it shows whether the coefficients hold",
                "shows whether what goes with a temperature or with the spindle comes again",
                "(the same once more)",
            ];
            (["spindle-growth", "ambient-drift"], told)
        } else {
            let told = [
                "run every part program at least twice: only repeats show the noise",
                "shows the noise, so that probabilities and the unexplained part no longer rest on neighbouring readings",
                "(the same part programs again)",
            ];
            (["outliers", "range-noise"], told)
        };
        all.push(Next {
            action: action.to_owned(),
            separates: separates.map(str::to_owned).into(),
            information: ONE_OF_TWO,
            decides: decides.to_owned(),
            minutes: (session_minutes(session)).max(1.0),
            gcode: gcode.to_owned(),
        });
    }
    if unexplained.significant && !unexplained.is_pointwise {
        // what the readings do not record may be at work in them; what its column shows to be constant cannot
        let unrecorded: Vec<&str> =
            library.blind.iter().filter(|b| b.is_unrecorded).map(|b| b.label.as_str()).collect();
        for m in PROCEDURES.iter().filter(is_new) {
            let shown: Vec<String> =
                unrecorded.iter().filter(|l| changes(m, l)).map(|l| (*l).to_owned()).collect();
            if !shown.is_empty() && !all.iter().any(|n| n.action == m.action) {
                let share = shown.len() as f64 / (unrecorded.len() + 1) as f64;
                let rest = shown.len().saturating_sub(UNSEEN_NAMED);
                let more = if rest > 0 { format!(" or {rest} more") } else { String::new() };
                let named = shown[..shown.len() - rest].join(" or ");
                let decides =
                    format!("shows whether {named}{more} contributes, which these data do not record");
                all.push(asked(&program, m, shown, entropy(share), decides));
            }
        }
    }
    if unexplained.is_pointwise
        && let Some(m) = PROCEDURES.iter().find(|m| m.motion == Motion::FineSteps)
    {
        const OVER_POSITION: [&str; 5] =
            ["positioning", "cyclic", "wear", "rotary-motion", "rotary-eccentricity"];
        let over_position = |l: &&Label| OVER_POSITION.contains(&l.effect);
        let separates: Vec<String> =
            library.labels.iter().filter(over_position).map(ToString::to_string).collect();
        let decides =
            "shows the curve between the points, which the values at the points alone do not".to_owned();
        if !separates.is_empty() && !all.iter().any(|n| n.action == m.action) {
            all.push(asked(&program, m, separates, 2.0 * ONE_OF_TWO, decides));
        }
    }
    if session.instruments.iter().all(|i| i.contains("cmm")) && !session.instruments.is_empty() {
        let separates: Vec<String> =
            causes.iter().filter(|c| c.declared && c.kind == Kind::Machine).map(Cause::label).collect();
        if !separates.is_empty() {
            all.push(Next {
                action: "measure the part again, turned by 90 degrees on the CMM".to_owned(),
                decides: format!(
                    "decides whether {} turns with the part, as an error of the machine does, or stays with the CMM",
                    separates.join(" or ")
                ),
                separates,
                information: ONE_OF_TWO,
                minutes: PREPARE_MIN + session_minutes(session),
                gcode: "(the inspection program again, the part turned by 90 degrees)".to_owned(),
            });
        }
    }
    for c in causes.iter().filter(|c| c.declared && !c.confounded_with.is_empty()) {
        let settled = all.iter().any(|n| n.separates.contains(&c.label()));
        if let (false, Some(p)) = (settled, Effect::find(&c.effect)) {
            let separates: Vec<String> = [c.label()].into_iter().chain(c.confounded_with.clone()).collect();
            let decides = format!("decides which of {} it is", separates.join(", "));
            let action = p.settles.trim_end_matches('.');
            let m = Procedure { action, motion: Motion::Points, prepare_min: PREPARE_MIN };
            all.push(asked(&program, &m, separates, ONE_OF_TWO, decides));
        }
    }
    all.sort_by(|a, b| b.information.total_cmp(&a.information).then(a.action.cmp(&b.action)));
    all.truncate(MOST);
    all
}
