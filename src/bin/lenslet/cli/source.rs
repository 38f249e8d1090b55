//! Where a light field comes from and how it is read: the options that every command with such an input shares.

use std::path::{Path, PathBuf};

use lenslet_core::decode::{HexSamples, SamplesOrigin, find_samples_file, samples_beside, view_fingerprint};
use lenslet_core::lightfield::{ColourSpace, ReadOptions, ViewSource};

use super::values::parse_views;

/// A light field of any tool.
#[derive(Debug, clap::Args)]
pub struct SourceArgs {
    /// The light field, in any format that convert reads
    pub input: PathBuf,
    /// Views (N or ROWSxCOLUMNS) of a lenslet picture, or of pictures numbered in a row
    #[arg(long, value_name = "N", value_parser = parse_views)]
    views: Option<[usize; 2]>,
    /// The input holds linear light although it has no description that names it
    #[arg(long)]
    input_linear: bool,
}

impl SourceArgs {
    /// How it is read.
    pub fn options(&self) -> ReadOptions {
        let colour = self.input_linear.then_some(ColourSpace::Linear);
        ReadOptions { views: self.views, colour, ..ReadOptions::default() }
    }

    /// The name of the file or folder, as provenance has it.
    pub fn name(&self) -> Option<String> {
        file_name(&self.input)
    }
}

/// The last part of a path.
pub fn file_name(path: &Path) -> Option<String> {
    path.file_name().map(|n| n.to_string_lossy().into_owned())
}

/// The samples that decode left with a light field, where they are wanted.
///
/// # Errors
/// When they cannot be read, or are not known to be those of this light field.
pub fn measured_samples(input: &Path, source: &dyn ViewSource, without: bool) -> anyhow::Result<Option<HexSamples>> {
    let Some(path) = find_samples_file(input).filter(|_| !without) else { return Ok(None) };
    let [rows, columns] = source.meta().views;
    let belongs = match SamplesOrigin::read(&path)?.and_then(|origin| origin.middle_view) {
        Some(expected) => view_fingerprint(&source.read(rows / 2, columns / 2)?) == expected,
        // Of an earlier version. One name was that of several light fields then.
        None => input.is_dir() || path == samples_beside(input),
    };
    anyhow::ensure!(
        belongs,
        "{} are not known to be the samples of {}: decode the capture again, or leave them out with --without-samples",
        path.display(),
        input.display()
    );
    Ok(Some(HexSamples::load(&path)?))
}
