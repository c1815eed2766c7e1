//! `cncsim dev certificates`: a set of files to try the secure link with.

use std::path::{Path, PathBuf};

use super::{EX_IOERR, EX_SOFTWARE, EX_USAGE, Failure};
use crate::certificates::{Authority, Role, Validity};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder for the files; existing files are never overwritten.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Name or number of the control, once for each; default: localhost, 127.0.0.1 and ::1.
    #[arg(long, value_name = "HOST")]
    name: Vec<String>,
    /// Days until the certificates expire, 1 to 3650.
    #[arg(long, value_name = "N", default_value = "365", value_parser = clap::value_parser!(u32).range(1..=3650))]
    days: u32,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let failed = |e| Failure::new(EX_USAGE, e);
    let validity = Validity::days(args.days);
    let mut names: Vec<&str> = args.name.iter().map(String::as_str).collect();
    if names.is_empty() {
        names.extend(["localhost", "127.0.0.1", "::1"]);
    }
    let authority = Authority::new("trial authority", validity).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
    let control = authority.issue(Role::Control, &names, validity).map_err(failed)?;
    let daemon = authority.issue(Role::Daemon, &["volcompd"], validity).map_err(failed)?;
    crate::cli::make_folder(&args.out).map_err(|e| Failure::in_file(EX_IOERR, &args.out, e))?;
    for (stem, issued) in [("ca", authority.own()), ("control", control), ("daemon", daemon)] {
        issued.write(&args.out, stem).map_err(|(path, e)| Failure::in_file(EX_IOERR, &path, e))?;
    }
    report(&args.out, names[0]);
    Ok(())
}

fn report(dir: &Path, name: &str) {
    let dir = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    let dir = dir.display();
    say!("# for the machine file of volcompd");
    say!("[link.tls]");
    for (key, file) in [("ca", "ca.pem"), ("certificate", "daemon.pem"), ("key", "daemon.key")] {
        say!("{key} = \"{dir}/{file}\"");
    }
    say!("server-name = \"{name}\"");
    say!("# for the simulated control");
    say!(
        "# cncsim serve --tls-ca {dir}/ca.pem --tls-certificate {dir}/control.pem --tls-key {dir}/control.key"
    );
    note!(
        "certificates for trying and testing; ca.key can make more of them: take it away from this computer"
    );
}
