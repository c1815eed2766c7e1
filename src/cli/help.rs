//! The verbs of `volcomp` by what they are for. clap has one list of subcommands and no headings within it.

use clap::{Command, Subcommand};

use super::Verb;

/// Headings of the help, and the verbs below each.
const GROUPS: [(&str, &[&str]); 5] = [
    (
        "Operate",
        &[
            "check", "enable", "disable", "gain", "status", "watch", "load", "rollback", "explain", "audit",
            "bench",
        ],
    ),
    ("Measure", &["identify", "evaluate", "verify"]),
    ("Model", &["fit", "model", "predict", "correct", "diff", "filter"]),
    ("Diagnose", &["diagnose", "replay"]),
    ("Exchange", &["import", "export", "gateway", "schema"]),
];

/// The template of the help: clap's own, with the verbs grouped.
pub(super) fn template() -> String {
    let program = Command::new("volcomp").disable_help_subcommand(true).help_template("{subcommands}");
    let list = Verb::augment_subcommands(program).render_help().to_string();
    let mut template = "{about-with-newline}\n{usage-heading} {usage}\n".to_owned();
    for (heading, verbs) in GROUPS {
        template += &format!("\n{heading}:\n");
        template.extend(verbs.iter().map(|verb| entry(&list, verb)));
    }
    template + "\n`volcomp help VERB` explains a verb and its options.\n\nOptions:\n{options}{after-help}"
}

/// The lines of one verb in the list as clap wraps and aligns it; none where the build lacks it.
fn entry(list: &str, verb: &str) -> String {
    let is_name = |line: &str| line.split_whitespace().next() == Some(verb) && !line.starts_with("   ");
    let of_verb = list.lines().skip_while(|line| !is_name(line));
    let more = |(i, line): &(usize, &str)| *i == 0 || line.starts_with("   ");
    of_verb.enumerate().take_while(more).map(|(_, line)| format!("{}\n", line.trim_end())).collect()
}

#[cfg(test)]
mod tests {
    use super::GROUPS;

    #[test]
    fn every_verb_stands_once_below_a_heading() {
        let cli = crate::command();
        let mut verbs: Vec<&str> = cli.get_subcommands().map(clap::Command::get_name).collect();
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, verbs)| verbs.iter().copied()).collect();
        verbs.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(verbs, grouped);
    }

    #[test]
    fn the_help_has_each_verb_with_what_it_does() {
        let help = crate::command().render_help().to_string();
        let lines: Vec<&str> = help.lines().collect();
        for (heading, verbs) in GROUPS {
            let at = lines.iter().position(|l| *l == format!("{heading}:")).expect("a heading");
            let below: Vec<&&str> = lines[at + 1..].iter().take_while(|l| !l.is_empty()).collect();
            for verb in verbs {
                let line = below.iter().find(|l| l.split_whitespace().next() == Some(verb));
                assert!(line.is_some_and(|l| l.split_whitespace().count() > 2), "{verb}: {below:?}");
            }
        }
        assert!(help.contains("--version") && help.contains("Exit codes"), "{help}");
    }
}
