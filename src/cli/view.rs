//! `lenslet view`

use super::{Context, Outcome};

/// view
#[derive(Debug, clap::Args)]
pub struct Args {}

pub fn run(_args: &Args, _context: &Context) -> anyhow::Result<Outcome> {
    anyhow::bail!("not built yet")
}
