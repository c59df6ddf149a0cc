//! `mesophyll completions SHELL`: a completion script for bash, zsh, fish, elvish or PowerShell.

use crate::cli::Result;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The shell to complete for
    shell: clap_complete::Shell,
}

pub fn run(args: &Args) -> Result<u8> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut super::command(), "mesophyll", &mut script);
    super::print(&String::from_utf8_lossy(&script))?;
    Ok(0)
}
