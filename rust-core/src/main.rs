//! The `anyface` command.

fn main() -> std::process::ExitCode {
    anyface::cli::run()
}
