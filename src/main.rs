//! The command line: `mesophyll --help` is the table of contents.

use std::process::ExitCode;

#[global_allocator]
static MEMORY: mesophyll_cli::OrSentence = mesophyll_cli::OrSentence;

fn main() -> ExitCode {
    mesophyll_cli::main()
}
