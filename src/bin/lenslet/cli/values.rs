//! Values that options take by name, and the values of the libraries that they become.

use clap::ValueEnum;
use clap::builder::PossibleValue;
use lenslet_core::dictionary::{Footprint, PatchPredictor};
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, Format};
use lenslet_core::metrics::SsimWindow;
use lenslet_train::{Algorithm, KsvdUpdate};
use lenslet_views::multiview::Fit;

/// Defines an enum of option values and what each becomes.
macro_rules! named_values {
    ($(#[$doc:meta])* $name:ident => $target:ty { $($(#[$value_doc:meta])* $value:ident => $result:expr,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, serde::Serialize)]
        #[serde(rename_all = "kebab-case")]
        pub enum $name {
            $($(#[$value_doc])* $value,)+
        }

        impl From<$name> for $target {
            fn from(name: $name) -> $target {
                match name {
                    $($name::$value => $result,)+
                }
            }
        }
    };
}

named_values! {
    /// `--footprint`: what a sample of a hexagonal lattice is.
    FootprintName => Footprint {
        Point => Footprint::Point,
        Lenslet => Footprint::Lenslet,
    }
}

named_values! {
    /// `--ksvd-update`: how K-SVD updates an atom.
    KsvdUpdateName => KsvdUpdate {
        /// The leading singular pair of the residual
        Exact => KsvdUpdate::Exact,
        /// One alternation between the atom and its coefficients
        Approximate => KsvdUpdate::Approximate,
    }
}

/// `--path`: how residual patches are predicted, each predictor by its word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PredictorName(pub PatchPredictor);

impl ValueEnum for PredictorName {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: [PredictorName; PatchPredictor::ALL.len()] = {
            let mut all = [PredictorName(PatchPredictor::ALL[0]); PatchPredictor::ALL.len()];
            let mut k = 0;
            while k < all.len() {
                all[k] = PredictorName(PatchPredictor::ALL[k]);
                k += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let value = PossibleValue::new(self.0.word()).help(self.0.meaning());
        // As tables call it.
        Some(if self.0 == PatchPredictor::NoCodes { value.alias("no-codes") } else { value })
    }
}

named_values! {
    /// `--format`: how a light field is written.
    FormatName => Format {
        Dir => Format::Directory,
        Npy => Format::Npy,
        Mat => Format::Mat,
        Eslf => Format::Eslf,
    }
}

named_values! {
    /// `--ssim`: the window of SSIM.
    SsimName => SsimWindow {
        Gaussian => SsimWindow::Gaussian,
        Uniform => SsimWindow::Uniform,
    }
}

named_values! {
    /// `--algorithm`: how a dictionary is learned.
    AlgorithmName => Algorithm {
        Ksvd => Algorithm::Ksvd,
        Online => Algorithm::Online,
        Ista => Algorithm::Ista,
    }
}

named_values! {
    /// `--fit`: how multi-view samples become pixels.
    FitName => Fit {
        /// Every sample a point; the pixels that fit all of them best
        LeastSquares => Fit::LeastSquares,
        /// As printed in the paper: all samples triangulated, the pixels between them interpolated barycentrically
        Triangulation => Fit::Triangulation,
        /// The picture of which every sample is the mean over its footprint: of a lenslet a disc as wide as lenslets are
        /// apart, of a pixel what it covers of the result
        Joint => Fit::Joint(None),
    }
}

named_values! {
    /// `--base` of training: the views that a dictionary is to sharpen.
    TrainingBase => Interpolation {
        Barycentric => Interpolation::Barycentric,
        Multiview => Interpolation::Multiview,
    }
}

/// A finite number; negative zero as zero.
pub fn finite<T: std::str::FromStr + Into<f64> + Copy + std::ops::Add<Output = T> + Default>(
    text: &str,
) -> Result<T, String> {
    match text.trim().parse::<T>() {
        Ok(x) if x.into().is_finite() => Ok(x + T::default()),
        _ => Err(format!("`{text}` is not a finite number")),
    }
}

/// `FROM:TO`, disparities in pixels per view step.
pub fn parse_range(text: &str) -> Result<(f32, f32), String> {
    let ends = text.split_once(':').and_then(|(a, b)| finite::<f32>(a).ok().zip(finite::<f32>(b).ok()));
    match ends {
        Some((a, b)) if a < b && f32::max(a.abs(), b.abs()) < 1e4 => Ok((a, b)),
        _ => Err(format!("`{text}` is not FROM:TO, as in --range=-2:2")),
    }
}

/// Which disparities are looked for.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct RangeArgs {
    /// Disparities to look for, pixels per view step [default: found from the light field]
    #[arg(long, value_name = "FROM:TO", allow_hyphen_values = true, value_parser = parse_range)]
    pub range: Option<(f32, f32)>,
}

/// Share of disparities at the ends of the range above which it is said.
/// Source: chosen.
const AT_ENDS: f32 = 0.03;

impl RangeArgs {
    /// A note where many of the disparities found lie at the ends of the range that was searched. `pixel`: side of a pixel
    /// of the light field in those of the disparities.
    pub fn note(self, found: &lenslet_views::disparity::Disparity, pixel: f32) -> Option<String> {
        let share = found.share_at_ends();
        let (low, high) = found.searched.filter(|_| share > AT_ENDS).map(|(a, b)| (a / pixel, b / pixel))?;
        Some(format!(
            "{:.0} % of the disparities lie at the ends of the range {low:.2} to {high:.2} that was searched: the true ones \
             may lie beyond; give a wider --range",
            100.0 * share
        ))
    }
}

/// `7` or `7x9` as (rows, columns).
pub fn parse_views(text: &str) -> Result<[usize; 2], String> {
    let one = |t: &str| match t.parse() {
        Ok(n) if (1..=lightfield::MAX_VIEWS).contains(&n) => Ok(n),
        _ => Err(format!("`{t}` is not a number from 1 to {}", lightfield::MAX_VIEWS)),
    };
    match text.split_once('x') {
        Some((rows, columns)) => Ok([one(rows)?, one(columns)?]),
        None => one(text).map(|n| [n, n]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_finite() {
        assert_eq!(finite::<f32>("-1.5"), Ok(-1.5));
        assert!(finite::<f64>("-0").unwrap().is_sign_positive());
        for bad in ["nan", "NaN", "inf", "-inf", "infinity", "1e999", "", "x"] {
            assert!(finite::<f64>(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_range("-2:2.5"), Ok((-2.0, 2.5)));
        for bad in ["2:-2", "nan:1", "0:inf", "1", ":", "-20000:2"] {
            assert!(parse_range(bad).is_err(), "{bad}");
        }
    }
}
