//! The `anyface` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    anyface_cli::main()
}
