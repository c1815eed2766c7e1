//! `cncsim dev manuals`: manual pages and shell completions of the three programs, from their command trees, for packages.

use std::path::{Path, PathBuf};

use clap::Command;
use clap_complete::{Shell, generate};
use clap_mangen::Man;

use super::{EX_IOERR, Failure};

/// Hidden, because it is for those who make packages.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder for `man1/`, `man8/` and `completions/`.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let programs =
        [(volcomp_cli::command(), "1"), (super::command(), "1"), (volcomp_cli::daemon_command(), "8")];
    for (program, section) in programs {
        let mut program = program.disable_help_subcommand(true);
        program.build();
        let folder = args.out.join(format!("man{section}"));
        pages(&folder, &program, section, program.get_version().unwrap_or_default())?;
        for (shell, suffix) in [(Shell::Bash, "bash"), (Shell::Zsh, "zsh"), (Shell::Fish, "fish")] {
            let name = program.get_name().to_owned();
            let mut text = Vec::new();
            generate(shell, &mut program, name.clone(), &mut text);
            write(&args.out.join("completions"), &format!("{name}.{suffix}"), &text)?;
        }
    }
    Ok(())
}

/// The page of a command and those of its parts.
fn pages(folder: &Path, command: &Command, section: &str, version: &str) -> Result<(), Failure> {
    let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
    let program = name.split('-').next().unwrap_or_default();
    let mut text = Vec::new();
    Man::new(command.clone())
        .title(name.clone())
        .section(section)
        .source(format!("{program} {version}"))
        .manual("volcomp")
        .render(&mut text)
        .map_err(|e| Failure::in_file(EX_IOERR, folder, e))?;
    // ragged right: long options leave nothing to adjust a line with
    let text = String::from_utf8_lossy(&text).replacen(".SH NAME", ".ad l\n.SH NAME", 1);
    write(folder, &format!("{name}.{section}"), text.as_bytes())?;
    for part in command.get_subcommands().filter(|part| !part.is_hide_set()) {
        pages(folder, part, section, version)?;
    }
    Ok(())
}

fn write(folder: &Path, name: &str, text: &[u8]) -> Result<(), Failure> {
    super::make_folder(folder).map_err(|e| Failure::in_file(EX_IOERR, folder, e))?;
    let file = folder.join(name);
    super::write_file(&file, text).map_err(|e| Failure::in_file(EX_IOERR, &file, e))
}
