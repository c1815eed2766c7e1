//! One name for one thing in the options of `volcomp`, checked over the whole command tree.

#![expect(clippy::disallowed_methods, reason = "the test writes its input and runs the program")]

use std::collections::BTreeSet;
use std::process::Command;

use clap::{Arg, ArgAction};

/// Verbs without `--json`, and why.
const WITHOUT_JSON: &[(&str, &str)] = &[
    ("import", "writes tables and models; stdout may be one of them"),
    ("export", "writes files of other programs; stdout may be one of them"),
    ("gateway", "runs until it is stopped"),
];

/// Names that are not used, and the one that is.
const SYNONYMS: &[(&str, &str)] = &[
    ("report", "html"),
    ("page", "html"),
    ("picture", "svg"),
    ("plot", "svg"),
    ("sigma-um", "noise-um"),
    ("reject-outliers", "robust"),
    ("poses", "data"),
];

/// Options with a synonym's name that are another thing, and why.
const OTHER_THINGS: &[(&str, &str, &str)] = &[("model extend", "report", "reads the report of a diagnosis")];

/// Former names that still work: verb, former name, name.
const FORMER: &[(&str, &str, &str)] = &[
    ("predict", "report", "html"),
    ("diff", "report", "html"),
    ("verify", "report", "html"),
    ("evaluate iso230-2", "report", "html"),
    ("evaluate gear", "report", "html"),
    ("filter show", "picture", "svg"),
    ("identify threepoint", "sigma-um", "noise-um"),
    ("identify nineline", "sigma-um", "noise-um"),
    ("identify circles", "sigma-um", "noise-um"),
    ("identify probe", "reject-outliers", "robust"),
    ("identify ram", "poses", "data"),
];

/// The verbs that do something: name and command.
fn verbs() -> Vec<(String, clap::Command)> {
    fn walk(command: &clap::Command, path: &str, found: &mut Vec<(String, clap::Command)>) {
        let children: Vec<_> = command.get_subcommands().collect();
        if !path.is_empty() && (children.is_empty() || !command.is_subcommand_required_set()) {
            found.push((path.to_owned(), command.clone()));
        }
        for child in children {
            walk(child, format!("{path} {}", child.get_name()).trim_start(), found);
        }
    }
    let mut found = Vec::new();
    walk(&volcomp::cli::command(), "", &mut found);
    assert!(found.len() > 40, "{}", found.len());
    found
}

fn option<'a>(command: &'a clap::Command, long: &str) -> Option<&'a Arg> {
    command.get_arguments().find(|a| a.get_long() == Some(long))
}

fn value_name(argument: &Arg) -> String {
    argument.get_value_names().unwrap_or_default().iter().map(|n| n.as_str()).collect()
}

#[test]
fn every_verb_has_json_or_a_reason() {
    let without: BTreeSet<String> =
        verbs().into_iter().filter(|(_, c)| option(c, "json").is_none()).map(|(name, _)| name).collect();
    let stated: BTreeSet<String> = WITHOUT_JSON.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(without, stated);
    for (name, command) in verbs() {
        // on stdout; of a fit a file, too
        let Some(json) = option(&command, "json") else { continue };
        let is_flag = matches!(json.get_action(), ArgAction::SetTrue);
        let is_optional = json.get_num_args().is_some_and(|n| n.min_values() == 0);
        assert!(is_flag || is_optional && name.starts_with("fit"), "{name}");
    }
}

#[test]
fn pages_are_html_pictures_are_svg() {
    for (name, command) in verbs() {
        for argument in command.get_arguments().filter(|a| !a.is_hide_set()) {
            let Some(long) = argument.get_long() else { continue };
            for ending in ["html", "svg"] {
                let is_such = value_name(argument).to_lowercase().ends_with(&format!(".{ending}"));
                assert!(!is_such || long == ending, "{name} --{long} should be --{ending}");
                assert!(is_such || long != ending, "{name} --{long}: value FILE.{ending}");
            }
        }
    }
}

#[test]
fn one_thing_has_one_name() {
    for (name, command) in verbs() {
        for (synonym, wanted) in SYNONYMS {
            let other = OTHER_THINGS.iter().any(|(verb, long, _)| *verb == name && long == synonym);
            let found = option(&command, synonym).is_some_and(|a| !a.is_hide_set());
            assert_eq!(found, other, "{name} --{synonym}: the name is --{wanted}");
        }
    }
}

#[test]
fn former_names_still_work() {
    let verbs = verbs();
    for (verb, former, now) in FORMER {
        let (_, command) = verbs.iter().find(|(name, _)| name == verb).unwrap_or_else(|| panic!("{verb}"));
        let argument = option(command, now).unwrap_or_else(|| panic!("{verb} --{now}"));
        let aliases = argument.get_all_aliases().unwrap_or_default();
        assert!(aliases.contains(former), "{verb} --{former}: {aliases:?}");
    }
}

#[test]
fn the_file_of_data_is_also_the_positional_argument() {
    let mut count = 0;
    for (name, command) in verbs() {
        let Some(data) = option(&command, "data") else { continue };
        count += 1;
        let positional = command
            .get_positionals()
            .find(|p| command.get_arg_conflicts_with(p).iter().any(|other| other.get_id() == data.get_id()));
        assert!(positional.is_some(), "{name}: no positional argument for --data");
    }
    assert!(count >= 17, "{count}");
}

#[test]
fn the_positional_file_is_read_as_data_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let table = folder.path().join("positioning.csv");
    let rows = ["1,1,0,0.1", "1,1,100,1.2", "1,-1,100,2.1", "1,-1,0,0.9", "2,1,0,0.2", "2,1,100,1.1"];
    let text =
        format!("cycle,direction,target_mm,deviation_um\n{}\n2,-1,100,2.3\n2,-1,0,0.8\n", rows.join("\n"));
    std::fs::write(&table, text).expect("written");
    let run = |more: &[&std::ffi::OsStr]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_volcomp"));
        let output =
            command.args(["evaluate", "iso230-2", "--json"]).args(more).output().expect("volcomp runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let named = run(&["--data".as_ref(), table.as_os_str()]);
    assert!(!named.is_empty());
    assert_eq!(run(&[table.as_os_str()]), named);
}
