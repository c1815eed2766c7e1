//! The program `volcompd`; everything it does is in the library.

fn main() -> std::process::ExitCode {
    volcomp::cli::volcompd(std::env::args_os())
}
