//! The command line: `mesophyll --help` is the table of contents.

use std::process::ExitCode;

fn main() -> ExitCode {
    mesophyll_cli::main()
}
