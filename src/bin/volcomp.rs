//! The program `volcomp`; everything it does is in the library.

fn main() -> std::process::ExitCode {
    volcomp::cli::volcomp(std::env::args_os())
}
