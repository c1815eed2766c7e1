//! `docs/explanation/safety.md` says what the code does: its table and its picture of the states are made from the engine's rules, and
//! every number in them stands in the catalogue of `volcomp explain`.
//!
//! After an intended change: `UPDATE_PAGES=1 cargo test --test repository safety_page` writes both anew.

#![expect(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test reads files, and stops where its own set-up is wrong"
)]

use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use volcomp::engine::fault::{self, Code};
use volcomp::engine::transitions::{Cause, RULES, Rule, all};
use volcomp::engine::{Reason, State};
use volcomp::protocol::CorrectionState::{
    Active, Armed, FadingToStatic, Faulted, Holding, Off, RampingIn, RampingOut,
};

const BEGIN: &str = "<!-- made from the rules of the engine by tests/repository/safety_page.rs -->\n";
const END: &str = "<!-- end -->\n";

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name)
}

/// Compares a file with what it should be, or writes it anew where that is asked for.
fn check(name: &str, wanted: &str) {
    if std::env::var_os("UPDATE_PAGES").is_some() {
        fs::write(path(name), wanted).expect("written");
    }
    let found = fs::read_to_string(path(name)).expect("page");
    assert!(found == wanted, "docs/{name} is not what the code does; UPDATE_PAGES=1 writes it anew");
}

const fn name(state: State) -> &'static str {
    match state {
        State::Off => "off",
        State::Armed => "armed",
        State::RampingIn => "ramping in",
        State::Active => "active",
        State::Holding => "holding",
        State::RampingOut => "ramping out",
        State::Faulted => "faulted",
        State::FadingToStatic => "fading to static",
    }
}

fn code(cause: Cause) -> Code {
    match cause {
        Cause::Reason(reason) => fault::reason_code(reason),
        Cause::Command => fault::reason_code(Reason::Command),
        Cause::Link => Code::LINK_LOST,
    }
}

fn row(rule: &Rule) -> String {
    let from: Vec<_> = rule.from.iter().map(|s| name(*s)).collect();
    let causes: Vec<_> = rule
        .causes
        .iter()
        .map(|cause| {
            let entry = code(*cause).entry().expect("every cause is in the catalogue");
            format!("{} {}", entry.code, entry.name)
        })
        .collect();
    format!("| {} | {} | {} | {} |\n", from.join(", "), name(rule.to), causes.join(", "), rule.reaction)
}

#[test]
fn the_table_of_states_is_that_of_the_engine() {
    let page = fs::read_to_string(path("explanation/safety.md")).expect("page");
    let (before, rest) = page.split_once(BEGIN).expect("beginning of the table");
    let (_, after) = rest.split_once(END).expect("end of the table");
    let mut wanted = format!("{before}{BEGIN}\n| from | to | cause | reaction |\n|---|---|---|---|\n");
    for rule in RULES {
        wanted.push_str(&row(rule));
    }
    wanted.push('\n');
    wanted.push_str(END);
    wanted.push_str(after);
    check("explanation/safety.md", &wanted);
}

#[test]
fn no_rule_is_written_twice_and_no_state_is_a_dead_end() {
    let mut seen = BTreeSet::new();
    for transition in all() {
        assert!(transition.0 != transition.1, "{transition:?}");
        assert!(seen.insert(transition), "{transition:?} twice");
    }
    for (from, _, _) in all() {
        assert!(all().any(|(_, to, _)| to == from) || from == State::Off, "{from:?} is never entered");
    }
    for (_, to, _) in all() {
        assert!(all().any(|(from, _, _)| from == to), "{to:?} is never left");
    }
}

#[test]
fn every_reason_of_the_engine_makes_a_transition_but_one() {
    for reason in Reason::ALL {
        let used = all().any(|(_, _, cause)| cause == Cause::Reason(reason));
        // a frame out of order is passed over: it changes nothing
        assert_eq!(used, reason != Reason::Sequence, "{reason:?}");
    }
}

/// A box of the picture.
struct Place {
    state: State,
    at: [i32; 2],
}

/// An arrow of the picture: its path, its words, and the changes of state that it stands for.
struct Arrow {
    line: &'static str,
    words: &'static [&'static str],
    at: [i32; 2],
    anchor: &'static str,
    from: &'static [State],
    to: &'static [State],
}

const FOLLOWING: &[State] = &[RampingIn, Active, FadingToStatic];

const PLACES: &[Place] = &[
    Place { state: Off, at: [130, 130] },
    Place { state: RampingOut, at: [500, 130] },
    Place { state: Holding, at: [930, 130] },
    Place { state: Armed, at: [130, 420] },
    Place { state: RampingIn, at: [500, 420] },
    Place { state: Active, at: [810, 420] },
    Place { state: FadingToStatic, at: [1110, 420] },
    Place { state: Faulted, at: [650, 650] },
];

#[rustfmt::skip]
const ARROWS: &[Arrow] = &[
    Arrow { line: "M110 155 V395", words: &["enable"], at: [102, 270], anchor: "end", from: &[Off], to: &[Armed] },
    Arrow { line: "M150 395 V155", words: &["disable,", "link ends"], at: [158, 300], anchor: "start", from: &[Armed], to: &[Off] },
    Arrow { line: "M205 420 H425", words: &["machine ready,", "data good"], at: [310, 395], anchor: "middle", from: &[Armed], to: &[RampingIn] },
    Arrow { line: "M205 120 H425", words: &["offset found"], at: [315, 112], anchor: "middle", from: &[Off], to: &[RampingOut] },
    Arrow { line: "M425 142 H205", words: &["at zero"], at: [315, 158], anchor: "middle", from: &[RampingOut], to: &[Off] },
    Arrow { line: "M170 395 L435 155", words: &["offset found"], at: [270, 262], anchor: "end", from: &[Armed], to: &[RampingOut] },
    Arrow { line: "M458 155 L195 395", words: &["at zero,", "enabled"], at: [320, 305], anchor: "start", from: &[RampingOut], to: &[Armed] },
    Arrow { line: "M575 412 H735", words: &["ramp done"], at: [655, 404], anchor: "middle", from: &[RampingIn], to: &[Active] },
    Arrow { line: "M735 430 H575", words: &["other tool or model"], at: [655, 446], anchor: "middle", from: &[Active], to: &[RampingIn] },
    Arrow { line: "M885 412 H1035", words: &["sensor silent"], at: [960, 404], anchor: "middle", from: &[Active], to: &[FadingToStatic] },
    Arrow { line: "M1035 430 H885", words: &["done, or it is back"], at: [960, 446], anchor: "middle", from: &[FadingToStatic], to: &[Active] },
    Arrow { line: "M1110 445 C1110 485 540 485 520 445", words: &["other tool or model"], at: [860, 490], anchor: "middle", from: &[FadingToStatic], to: &[RampingIn] },
    Arrow { line: "M540 345 V155", words: &["disable, stop,", "out of travel"], at: [548, 190], anchor: "start", from: FOLLOWING, to: &[RampingOut] },
    Arrow { line: "M490 155 V395", words: &["enabled", "again"], at: [482, 320], anchor: "end", from: &[RampingOut], to: &[RampingIn] },
    Arrow { line: "M950 345 V155", words: &["no or bad data; drives off,", "emergency stop, not homed;", "the control took over;", "stop with rest = \"hold\""], at: [958, 215], anchor: "start", from: FOLLOWING, to: &[Holding] },
    Arrow { line: "M880 155 L560 395", words: &["data good"], at: [748, 235], anchor: "end", from: &[Holding], to: &[RampingIn] },
    Arrow { line: "M575 120 H855", words: &["machine not ready, control took over"], at: [715, 112], anchor: "middle", from: &[RampingOut], to: &[Holding] },
    Arrow { line: "M855 142 H575", words: &["hold-s over, disable, out of travel"], at: [715, 158], anchor: "middle", from: &[Holding], to: &[RampingOut] },
    Arrow { line: "M930 105 V55 H130 V105", words: &["stop with rest = \"hold\""], at: [530, 47], anchor: "middle", from: &[Holding], to: &[Off] },
    Arrow { line: "M650 500 V625", words: &["correction beyond", "the stop limit"], at: [658, 560], anchor: "start", from: FOLLOWING, to: &[Faulted] },
    Arrow { line: "M400 650 H575", words: &["read-back mismatch;", "at zero, and no data yet"], at: [488, 625], anchor: "middle", from: &[Off, Armed, RampingIn, Active, FadingToStatic, Holding, RampingOut], to: &[Faulted] },
    Arrow { line: "M650 675 V715 H30 V130 H55", words: &["fault cleared, at zero"], at: [330, 707], anchor: "middle", from: &[Faulted], to: &[Off] },
    Arrow { line: "M1080 650 H1140", words: &["link ends"], at: [1110, 622], anchor: "middle", from: &[RampingIn, Active, FadingToStatic, Holding, RampingOut], to: &[Armed, Off] },
];

/// Boxes that stand for several states: words, middle, width.
const GROUPS: &[(&str, [i32; 2], i32)] = &[
    ("any state", [330, 650], 140),
    ("any but off and faulted", [975, 650], 210),
    ("armed or off", [1200, 650], 120),
];

fn picture() -> String {
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 1280 740\" font-family=\"sans-serif\" \
         font-size=\"14\" role=\"img\">\n<title>States of volcomp's engine</title>\n\
         <defs><marker id=\"tip\" viewBox=\"0 0 10 10\" refX=\"9\" refY=\"5\" markerWidth=\"8\" markerHeight=\"8\" \
         orient=\"auto\"><path d=\"M0 0 L10 5 L0 10 z\" fill=\"#333\"/></marker></defs>\n\
         <rect width=\"1280\" height=\"740\" fill=\"#fff\"/>\n\
         <rect x=\"405\" y=\"345\" width=\"800\" height=\"155\" rx=\"10\" fill=\"#eef6ee\" stroke=\"#7a7\" \
         stroke-dasharray=\"6 4\"/>\n<text x=\"1195\" y=\"365\" text-anchor=\"end\" fill=\"#575\">follows the \
         correction</text>\n",
    );
    let mut text = |line: std::fmt::Arguments<'_>| writeln!(svg, "{line}").expect("text");
    for Place { state, at: [x, y] } in PLACES {
        let fill = if *state == Faulted { "#fbe3e0" } else { "#fff" };
        text(format_args!(
            "<rect x=\"{}\" y=\"{}\" width=\"150\" height=\"50\" rx=\"8\" fill=\"{fill}\" stroke=\"#333\" \
             stroke-width=\"2\"/><text x=\"{x}\" y=\"{}\" text-anchor=\"middle\" font-size=\"17\">{}</text>",
            x - 75,
            y - 25,
            y + 6,
            name(*state)
        ));
    }
    for (words, [x, y], width) in GROUPS {
        text(format_args!(
            "<rect x=\"{}\" y=\"{}\" width=\"{width}\" height=\"34\" rx=\"17\" fill=\"#f3f3f3\" stroke=\"#777\"/>\
             <text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{words}</text>",
            x - width / 2,
            y - 17,
            y + 5
        ));
    }
    for arrow in ARROWS {
        text(format_args!(
            "<path d=\"{}\" fill=\"none\" stroke=\"#333\" stroke-width=\"1.5\" marker-end=\"url(#tip)\"/>",
            arrow.line
        ));
        for (line, words) in (0..).zip(arrow.words) {
            text(format_args!(
                "<text x=\"{}\" y=\"{}\" text-anchor=\"{}\" fill=\"#222\">{}</text>",
                arrow.at[0],
                arrow.at[1] + 17 * line,
                arrow.anchor,
                words.replace('"', "&quot;")
            ));
        }
    }
    svg.push_str("</svg>\n");
    svg
}

#[test]
fn the_picture_shows_every_change_of_state_and_no_other() {
    let rules: BTreeSet<_> = all().map(|(from, to, _)| (from, to)).collect();
    let pairs = |a: &Arrow| a.from.iter().flat_map(|f| a.to.iter().map(|t| (*f, *t))).collect::<Vec<_>>();
    let drawn: BTreeSet<_> = ARROWS.iter().flat_map(pairs).collect();
    let missing: Vec<_> = rules.difference(&drawn).collect();
    let invented: Vec<_> = drawn.difference(&rules).collect();
    assert!(missing.is_empty() && invented.is_empty(), "missing: {missing:?}; invented: {invented:?}");
    check("images/states.svg", &picture());
}

#[test]
fn the_operators_page_has_every_warning_and_fault_as_the_catalogue_tells_it() {
    let page =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/how-to/troubleshooting.md"))
            .unwrap();
    for entry in fault::CATALOGUE.iter().filter(|e| e.severity != fault::Severity::Notice) {
        let row = format!(
            "| {} {} | {} | {} | {} |",
            entry.code, entry.name, entry.text, entry.reaction, entry.remedy
        );
        assert!(page.contains(&row), "docs/how-to/troubleshooting.md lacks this row:\n{row}");
    }
}
