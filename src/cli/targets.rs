//! Targets of a command: no file that it reads is written over.
//!
//! [`conflict`] compares the options before any work is done. [`check`] covers the files that only a description or a
//! compound value names, at the moment of writing.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::sync::{Mutex, PoisonError};

use clap::{Arg, ArgMatches, Command};

use crate::prelude::*;

/// Options that name a file to write.
const WRITES: &str = "out html svg json picture record drawing motions write-signs write-calibration";
/// Options that may write the file which another one reads: it is taken up and continued.
const CONTINUES: &[(&str, &str)] =
    &[("out", "into"), ("write-signs", "signs"), ("write-calibration", "calibration")];

/// Bytes of an existing file in which a model states its format.
const HEAD: u64 = 1 << 16;

/// Files that this process has read, with links resolved.
static READ: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// The file behind a path, with links resolved; `None` for a stream or where there is none.
fn file_of(path: &Path) -> Option<PathBuf> {
    path.canonicalize().ok().filter(|p| p.is_file())
}

/// Keeps in mind that a file has been read.
pub(super) fn record_input(path: &Path) {
    if let Some(file) = file_of(path) {
        READ.lock().unwrap_or_else(PoisonError::into_inner).insert(file);
    }
}

/// Refuses to write over a file that this command has read.
pub(super) fn check(path: &Path) -> Result<()> {
    let is_read = |file: PathBuf| READ.lock().unwrap_or_else(PoisonError::into_inner).contains(&file);
    if file_of(path).is_some_and(is_read) {
        return Err(usage!("{}: is an input of this command; write to another file", path.display()));
    }
    Ok(())
}

/// Refuses to write a model over an existing file that is none.
#[expect(clippy::disallowed_methods, reason = "looks at the file to be replaced, which is no input")]
pub(super) fn check_model(path: &Path) -> Result<()> {
    let Some(file) = file_of(path) else { return check_folder(path) };
    let mut head = Vec::new();
    let io = |e: &std::io::Error| Failure::io(path, e);
    File::open(file).and_then(|f| f.take(HEAD).read_to_end(&mut head)).map_err(|e| io(&e))?;
    let head = String::from_utf8_lossy(&head);
    let is_model = |line: &str| line.starts_with("format") && line.contains("volcomp-model/");
    if head.trim().is_empty() || head.lines().any(is_model) {
        return Ok(());
    }
    Err(usage!("{}: exists and is not a model file; write the model to another file", path.display()))
}

/// Refuses a target in a folder that does not exist.
fn check_folder(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let is_there = path.as_os_str() == "-" || folder.is_none_or(Path::is_dir);
    if is_there { Ok(()) } else { Err(Failure::io(path, &ErrorKind::NotFound.into())) }
}

/// Files that an option names.
fn files<'m>(matches: &'m ArgMatches, argument: &Arg) -> impl Iterator<Item = &'m PathBuf> {
    let is_path = argument.get_value_parser().type_id() == std::any::TypeId::of::<PathBuf>();
    let values = is_path.then(|| matches.try_get_many::<PathBuf>(argument.get_id().as_str()).ok()).flatten();
    values.flatten().into_iter().flatten()
}

/// What is wrong where an option writes a file that another one reads or writes.
pub(super) fn conflict(command: &Command, matches: &ArgMatches) -> Option<String> {
    let named = || command.get_arguments().flat_map(|a| files(matches, a).map(move |path| (a, path)));
    let writes = |a: &Arg| a.get_long().is_some_and(|long| WRITES.split(' ').any(|known| known == long));
    for (i, (output, target)) in named().enumerate().filter(|(_, (a, _))| writes(a)) {
        for (j, (other, path)) in named().enumerate() {
            let is_same = target == path || file_of(target).is_some_and(|f| file_of(path) == Some(f));
            let longs = (output.get_long().unwrap_or_default(), other.get_long().unwrap_or_default());
            let may_be = j == i || CONTINUES.contains(&longs) || target.as_os_str() == "-";
            if is_same && !may_be {
                let (long, target) = (longs.0, target.display());
                return Some(format!("--{long} {target}: is the file of {other}; write to another file"));
            }
        }
    }
    let (name, matches) = matches.subcommand()?;
    conflict(command.find_subcommand(name)?, matches)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_option_that_writes_is_one_of_a_command() {
        fn longs(command: &Command, all: &mut BTreeSet<String>) {
            all.extend(command.get_arguments().filter_map(|a| a.get_long().map(str::to_owned)));
            command.get_subcommands().for_each(|c| longs(c, all));
        }
        let mut all = BTreeSet::new();
        longs(&crate::command(), &mut all);
        for name in WRITES.split(' ') {
            assert!(all.contains(name), "--{name}");
        }
    }

    #[test]
    fn a_file_that_is_continued_may_be_its_own_successor() {
        let said = |line: &str| {
            let mut command = crate::command();
            let matches = command.try_get_matches_from_mut(line.split(' ')).unwrap();
            conflict(&command, &matches)
        };
        for (line, named) in [
            ("volcomp fit --errors a.csv --axis x --into m.toml --out m.toml", None),
            ("volcomp fit --errors a.csv --axis x --out - --json -", None),
            ("volcomp fit --errors a.csv --axis x --out a.csv", Some("--errors")),
            (
                "volcomp identify straightness --axis x --tilt-test t.csv --signs s.toml --write-signs s.toml",
                None,
            ),
            (
                "volcomp identify straightness --axis x --tilt-test t.csv --signs s.toml --write-signs t.csv",
                Some("--tilt-test"),
            ),
        ] {
            let said = said(line);
            assert_eq!(said.is_some(), named.is_some(), "{line}: {said:?}");
            assert!(said.is_none_or(|s| s.contains(named.unwrap_or(""))), "{line}");
        }
    }

    #[test]
    fn a_link_or_another_spelling_is_the_same_file() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a.csv");
        std::fs::write(&file, "x\n").unwrap();
        let link = dir.path().join("link.csv");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        assert!(check(&link).is_ok());
        crate::input::read(&file, crate::input::InputKind::Table).unwrap();
        for path in [&file, &link, &dir.path().join(".").join("a.csv")] {
            let failure = check(path).unwrap_err();
            assert_eq!(failure.code, crate::EX_USAGE);
            assert!(failure.message.contains("is an input of this command"), "{}", failure.message);
        }
        assert!(check(&dir.path().join("b.csv")).is_ok());
    }

    #[test]
    fn a_model_replaces_a_model_only() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a.toml");
        for (text, is_replaced) in [
            ("", true),
            ("# of July\nformat = \"volcomp-model/1\"\n", true),
            ("[machine]\nid = \"vmc\"\n", false),
            ("position_mm,exx_um\n0,1\n", false),
        ] {
            std::fs::write(&file, text).unwrap();
            assert_eq!(check_model(&file).is_ok(), is_replaced, "{text}");
        }
        assert!(check_model(&dir.path().join("none.toml")).is_ok());
    }
}
