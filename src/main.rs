//! The command line: `mesophyll --help` is the table of contents.

use std::process::ExitCode;

#[global_allocator]
static MEMORY: mesophyll::cli::ReportingAllocator = mesophyll::cli::ReportingAllocator;

fn main() -> ExitCode {
    mesophyll::cli::main()
}
