//! Where a light field comes from and how it is read: the options that every command with such an input shares.

use std::path::{Path, PathBuf};

use lenslet::apps::{even_out_light, to_linear_light};
use lenslet_core::decode::{HexSamples, SamplesOrigin, find_samples_file, samples_beside, view_fingerprint};
use lenslet_core::lightfield::{self, Axes, ColourSpace, LightField, ReadOptions, ViewOrder, ViewSource};
use lenslet_core::progress::Observer as _;
use ndarray::Array2;

use super::Context;
use super::inputs::Input;
use super::values::{finite, parse_views};

/// How a light field without a description is read.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Light fields of other tools")]
pub struct ReadArgs {
    /// Views (N or ROWSxCOLUMNS) of a lenslet picture, or of pictures numbered in a row (absent ones counted)
    #[arg(long, value_name = "N", value_parser = parse_views)]
    views: Option<[usize; 2]>,
    /// The input holds linear light although it has no description that names it
    #[arg(long)]
    input_linear: bool,
    /// The stored value of white, as 255, 1023, 4095 or 65535 [default: by the type and range of the numbers]
    #[arg(long, value_name = "VALUE", value_parser = parse_full_scale)]
    full_scale: Option<f32>,
    /// Order of the axes of an array, a letter each: v, u rows and columns of views (or n: views in a row), t, s rows and
    /// columns of pixels, c channels [default: vutsc]
    #[arg(long, value_name = "ORDER")]
    axes: Option<Axes>,
    /// Order of the views: rows (row, then column), or those that hold, joined by commas, of columns (column, then row),
    /// mirror-v (rows from below), mirror-u (columns from the right), serpentine (every second row backwards)
    /// [default: by the description, else by the parallax of the pictures]
    #[arg(long, value_name = "ORDER")]
    order: Option<ViewOrder>,
}

fn parse_full_scale(text: &str) -> Result<f32, String> {
    let value: f32 = finite(text)?;
    if value > 0.0 && value < 1e9 { Ok(value) } else { Err(format!("`{text}` is not above 0")) }
}

impl ReadArgs {
    /// The same as the library takes it.
    pub fn options(&self) -> ReadOptions {
        ReadOptions {
            views: self.views,
            colour: self.input_linear.then_some(ColourSpace::Linear),
            full_scale: self.full_scale,
            axes: self.axes.clone(),
            order: self.order,
            partial: true,
            ..ReadOptions::default()
        }
    }

    /// Whether the number of views is stated.
    pub fn has_views(&self) -> bool {
        self.views.is_some()
    }

    /// Opens a light field, of which views may be absent, and tells what was assumed.
    pub fn open(&self, path: &Path, context: &Context) -> anyhow::Result<Box<dyn ViewSource>> {
        opened(path, &self.options(), context)
    }

    /// Reads a whole light field in linear light, its dim views brightened; the weight of each view, 0 for those that are
    /// dark or absent. `from_middle`: what follows starts from the middle view, which must be there.
    pub fn load_light(
        &self,
        path: &Path,
        from_middle: bool,
        context: &Context,
    ) -> anyhow::Result<(LightField, Array2<f32>)> {
        context.progress.begin("reading", 0);
        let source = opened(path, &self.options(), context)?;
        if from_middle {
            need_middle(&*source, path)?;
        }
        let mut field = lightfield::read_all(&*source, path, 0)?;
        context.progress.check()?;
        to_linear_light(&mut field);
        let weights = even_out_light(&mut field);
        note_dark(path, weights.iter().filter(|w| **w <= 0.0).count(), weights.len(), context);
        Ok((field, weights))
    }
}

fn opened(path: &Path, options: &ReadOptions, context: &Context) -> anyhow::Result<Box<dyn ViewSource>> {
    let source = lightfield::open(path, options)?;
    source.notes().iter().for_each(|note| context.progress.note(note));
    Ok(source)
}

/// Refuses a light field whose middle view is absent, for work that starts from it.
pub fn need_middle(source: &dyn ViewSource, path: &Path) -> anyhow::Result<()> {
    let [rows, columns] = source.meta().views.map(|n| n / 2);
    anyhow::ensure!(
        !source.is_absent(rows, columns)?,
        "{}: the view in the middle (row {rows}, column {columns}) is absent, and this starts from it; add it, or give a folder \
         of those views alone that surround one that is there",
        path.display()
    );
    Ok(())
}

/// The places of absent views, row by row.
pub fn absent_places(source: &dyn ViewSource) -> anyhow::Result<Vec<usize>> {
    let [rows, columns] = source.meta().views;
    let mut absent = Vec::new();
    for k in 0..rows * columns {
        if source.is_absent(k / columns, k % columns)? {
            absent.push(k);
        }
    }
    Ok(absent)
}

/// What a result lacks, after its number of views; nothing where it is whole.
pub fn but_absent(absent: usize) -> String {
    if absent == 0 { String::new() } else { format!(" ({absent} absent)") }
}

/// Says how many views are too dark to be used.
pub fn note_dark(path: &Path, dark: usize, all: usize, context: &Context) {
    if dark > 0 {
        let note = format!("{}: {dark} of {all} views are dark or absent and count for nothing", path.display());
        context.progress.note(&note);
    }
}

/// A light field of any tool.
#[derive(Debug, clap::Args)]
pub struct SourceArgs {
    /// The light field, in any format that convert reads
    pub input: PathBuf,
    #[command(flatten)]
    pub read: ReadArgs,
}

impl SourceArgs {
    /// What is given, and what it must be.
    pub fn as_input(&self) -> (&Path, Input) {
        (&self.input, Input::LightField)
    }

    /// Opens it, and tells what was assumed.
    pub fn open(&self, context: &Context) -> anyhow::Result<Box<dyn ViewSource>> {
        self.read.open(&self.input, context)
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
    anyhow::ensure!(
        source.order().is_none_or(|read| read.order.is_own()),
        "{}: {} has samples that are numbered as its views are stored: leave --order out, or the samples with --without-samples",
        path.display(),
        input.display()
    );
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
    let samples = HexSamples::load(&path)?;
    super::belong::check_samples(source, &samples, &path, "--without-samples")?;
    Ok(Some(samples))
}
