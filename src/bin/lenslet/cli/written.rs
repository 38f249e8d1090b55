//! Where a light field goes and how it is written: the flags that every command with such a result shares.

use std::path::{Path, PathBuf};

use lenslet_core::lightfield::{ColourSpace, Format};
use lenslet_core::output::{self, Kind};

use super::Usage;
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
    /// The format of one light field at `--out`. An ending that is none of a light field is refused.
    pub fn format(&self) -> Result<Format, Usage> {
        match self.chosen() {
            Some(format) => Ok(format),
            None => {
                let known = matches!(ending_of(&self.out).as_str(), "" | "lf" | "npy" | "mat" | "png");
                if known || !is_an_ending(&self.out) {
                    return Ok(Format::of_name(&self.out));
                }
                Err(Usage(format!(
                    "{}: .{} is no ending of a light field: .npy, .mat, .png (ESLF), or none (or .lf) for a folder of pictures; \
                     --format says it whatever the name",
                    self.out.display(),
                    ending_of(&self.out)
                )))
            }
        }
    }

    /// The format of each light field in the folder `--out`.
    pub fn format_of_each(&self) -> Format {
        self.chosen().unwrap_or(Format::Directory)
    }

    /// [`output::check_target`] of one light field.
    pub fn check(&self, inputs: &[&Path]) -> anyhow::Result<()> {
        Ok(output::check_target(&self.out, kind_of(self.format()?), self.force, inputs)?)
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

/// The ending of a name, in small letters.
fn ending_of(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// Whether a name ends as files of some kind do; `scene-1.5` and `IMG.2024-01-02` do not.
fn is_an_ending(path: &Path) -> bool {
    let ending = ending_of(path);
    (1..=11).contains(&ending.len())
        && ending.chars().all(|c| c.is_ascii_alphanumeric())
        && ending.chars().any(|c| c.is_ascii_alphabetic())
}

/// Endings of files that this or other programs write.
const FILES: [&str; 37] = [
    "png",
    "jpg",
    "jpeg",
    "tif",
    "tiff",
    "bmp",
    "gif",
    "apng",
    "webp",
    "pgm",
    "ppm",
    "pfm",
    "exr",
    "npy",
    "npz",
    "mat",
    "csv",
    "json",
    "jsonl",
    "txt",
    "md",
    "html",
    "htm",
    "pdf",
    "zip",
    "tar",
    "gz",
    "lfp",
    "lfr",
    "raw",
    "calib",
    "lfd",
    "safetensors",
    "ply",
    "toml",
    "mp4",
    "h5",
];

/// Refuses a folder that is named as a file.
pub fn check_folder_name(out: &Path) -> Result<(), Usage> {
    let ending = ending_of(out);
    if FILES.contains(&ending.as_str()) {
        let name = out.display();
        return Err(Usage(format!("{name}: a folder is written here; give a name without the ending .{ending}")));
    }
    Ok(())
}

/// Refuses a file whose name ends as those of another kind do; `endings` are its own.
pub fn check_file_name(out: &Path, endings: &[&str]) -> Result<(), Usage> {
    let ending = ending_of(out);
    if endings.contains(&ending.as_str()) || !FILES.contains(&ending.as_str()) {
        return Ok(());
    }
    let name = out.display();
    Err(Usage(format!("{name}: .{ending} is not written here, but .{}", endings.join(" or ."))))
}

/// Refuses names that are no picture (where `one` is possible), animation or folder.
pub fn check_animation_name(out: &Path, one: bool) -> Result<(), Usage> {
    let ending = ending_of(out);
    let known = ["gif", "apng", "png"].contains(&ending.as_str());
    if known || !is_an_ending(out) {
        return Ok(());
    }
    let pictures = if one { ".png, .gif, .apng" } else { ".gif, .apng" };
    Err(Usage(format!(
        "{}: .{ending} is not written: {pictures}, or a name without an ending for a folder",
        out.display()
    )))
}

/// Refuses names that are no page.
pub fn check_page_name(out: &Path) -> Result<(), Usage> {
    let ending = ending_of(out);
    if ["html", "htm", "xhtml"].contains(&ending.as_str()) || !is_an_ending(out) {
        return Ok(());
    }
    Err(Usage(format!("{}: a page is written here; its name ends in .html, not .{ending}", out.display())))
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
        let format = |words: &[&str]| parsed(words).unwrap().format().unwrap();
        assert_eq!(format(&["-o", "a.npy"]), Format::Npy);
        assert_eq!(format(&["--out", "a.npy", "--mat"]), Format::Mat);
        assert_eq!(format(&["--out", "a", "--format", "eslf"]), Format::Eslf);
        assert_eq!(format(&["--out", "a.lf"]), Format::Directory);
        assert_eq!(parsed(&["--out", "a.npy"]).unwrap().format_of_each(), Format::Directory);
        assert_eq!(parsed(&["--out", "a", "--npy"]).unwrap().format_of_each(), Format::Npy);
        assert!(parsed(&["--out", "a", "--npy", "--mat"]).is_err());
        assert!(parsed(&["--out", "a", "--npy", "--format", "dir"]).is_err());
        assert!(parsed(&["--out", "a", "--format", "zip"]).is_err());
        for odd in ["a.jpg", "a.npz", "a.h5", "a.tiff"] {
            assert!(parsed(&["--out", odd]).unwrap().format().is_err(), "{odd}");
            assert_eq!(format(&["--out", odd, "--format", "dir"]), Format::Directory);
        }
        assert_eq!(format(&["--out", "scene-1.5"]), Format::Directory);
    }

    #[test]
    fn folders_pages_and_animations_have_their_names() {
        let bad = |name: &str| check_folder_name(Path::new(name)).is_err();
        assert!(bad("a.png") && bad("A.NPY") && !bad("a") && !bad("a.lf") && !bad("depth-1.5"));
        let bad = |name: &str| check_animation_name(Path::new(name), true).is_err();
        assert!(bad("a.jpg") && bad("a.mp4") && !bad("a.gif") && !bad("slices") && !bad("f-1.5"));
        let bad = |name: &str| check_page_name(Path::new(name)).is_err();
        assert!(bad("a.png") && !bad("a.html") && !bad("page"));
    }
}
