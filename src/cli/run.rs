//! `mesophyll run`.

use super::Common;
use crate::{Error, Result};

#[derive(Debug, clap::Args)]
pub struct Args {}

pub fn run(_args: &Args, _common: &Common) -> Result<u8> {
    Err(Error::Usage("this build does not have the verb run yet".into()))
}
