//! `lenslet calibrate`

use super::{Context, Outcome};

/// calibrate
#[derive(Debug, clap::Args)]
pub struct Args {}

pub fn run(_args: &Args, _context: &Context) -> anyhow::Result<Outcome> {
    anyhow::bail!("not built yet")
}
