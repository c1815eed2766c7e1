//! `cncsim`: see [`simulator::cli`].

fn main() -> std::process::ExitCode {
    simulator::cli::cncsim(std::env::args_os())
}
