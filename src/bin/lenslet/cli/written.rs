//! Where a light field goes and how it is written: the flags that every command with such a result shares.

use std::path::{Path, PathBuf};

use lenslet_core::lightfield::{ColourSpace, Format};
use lenslet_core::output::{self, Kind};

use super::values::FormatName;

/// Output flags. The format is that of a flag, else that of the ending of `--out`.
#[derive(Debug, clap::Args)]
pub struct Written {
    /// The light field to write (a folder of light fields where there are several)
    #[arg(short, long, value_name = "LF")]
    pub out: PathBuf,
    /// Format to write: dir (a folder of 16-bit PNGs), npy (float32; v,u,t,s,c), mat (MATLAB level 5, variable LF,
    /// single) or eslf (one lenslet picture, 16-bit PNG) [default: by the ending of --out: .npy, .mat, .png, else dir]
    #[arg(long, group = "written_format", value_name = "FORMAT", value_enum, hide_possible_values = true)]
    format: Option<FormatName>,
    /// Short for --format npy
    #[arg(long, group = "written_format")]
    npy: bool,
    /// Short for --format mat
    #[arg(long, group = "written_format")]
    mat: bool,
    /// Short for --format eslf
    #[arg(long, group = "written_format")]
    eslf: bool,
    /// Write linear light instead of sRGB
    #[arg(long)]
    pub linear: bool,
    /// Replace what is at --out
    #[arg(short, long)]
    pub force: bool,
}

impl Written {
    /// The format of one light field at `--out`.
    pub fn format(&self) -> Format {
        self.chosen().unwrap_or_else(|| Format::of_name(&self.out))
    }

    /// The format of each light field in the folder `--out`.
    pub fn format_of_each(&self) -> Format {
        self.chosen().unwrap_or(Format::Directory)
    }

    /// [`check_output`] of one light field.
    pub fn check(&self, inputs: &[&Path]) -> Result<(), output::Error> {
        check_output(&self.out, kind_of(self.format()), self.force, inputs)
    }

    fn chosen(&self) -> Option<Format> {
        match (self.npy, self.mat, self.eslf) {
            (true, ..) => Some(Format::Npy),
            (_, true, _) => Some(Format::Mat),
            (_, _, true) => Some(Format::Eslf),
            _ => self.format.map(Format::from),
        }
    }

    /// The colour space of what is written.
    pub fn colour(&self) -> ColourSpace {
        if self.linear { ColourSpace::Linear } else { ColourSpace::Srgb }
    }
}

/// Refuses a place to write to before the work rather than after it: what stands there is replaced only where `force` is
/// set and lenslet wrote it, and never where it is or holds one of `inputs`.
pub fn check_output(path: &Path, kind: Kind, force: bool, inputs: &[&Path]) -> Result<(), output::Error> {
    let inputs: Vec<PathBuf> = inputs.iter().map(|p| p.to_path_buf()).collect();
    output::check_target(path, kind, force, &inputs)
}

/// Whether a light field of this format is a file or a folder.
pub fn kind_of(format: Format) -> Kind {
    if format == Format::Directory { Kind::Directory } else { Kind::File }
}

/// What a file of this format is called after its stem; nothing for a folder.
pub fn ending(format: Format) -> &'static str {
    match format {
        Format::Npy => ".npy",
        Format::Mat => ".mat",
        Format::Eslf => ".png",
        Format::Directory => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Only {
        #[command(flatten)]
        written: Written,
    }

    fn parsed(words: &[&str]) -> Result<Written, clap::Error> {
        Only::try_parse_from([&["x"], words].concat()).map(|o| o.written)
    }

    #[test]
    fn a_flag_goes_before_the_ending() {
        let format = |words: &[&str]| parsed(words).unwrap().format();
        assert_eq!(format(&["-o", "a.npy"]), Format::Npy);
        assert_eq!(format(&["--out", "a.npy", "--mat"]), Format::Mat);
        assert_eq!(format(&["--out", "a", "--format", "eslf"]), Format::Eslf);
        assert_eq!(format(&["--out", "a.lf"]), Format::Directory);
        assert_eq!(parsed(&["--out", "a.npy"]).unwrap().format_of_each(), Format::Directory);
        assert_eq!(parsed(&["--out", "a", "--npy"]).unwrap().format_of_each(), Format::Npy);
        assert!(parsed(&["--out", "a", "--npy", "--mat"]).is_err());
        assert!(parsed(&["--out", "a", "--npy", "--format", "dir"]).is_err());
        assert!(parsed(&["--out", "a", "--format", "zip"]).is_err());
    }
}
