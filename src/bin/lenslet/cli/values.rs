//! Values that options take by name, and the values of the libraries that they become.

use clap::ValueEnum;
use lenslet_core::dictionary::Footprint;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, Format};
use lenslet_core::metrics::SsimWindow;
use lenslet_train::{Algorithm, KsvdUpdate};
use lenslet_views::reconstruct::Mode;

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

named_values! {
    /// `--path`: how residual patches are predicted.
    PredictorName => Mode {
        Lasso => Mode::Lasso,
        Network => Mode::Network,
        Anchored => Mode::Anchored,
        Ridge => Mode::Ridge,
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
    /// `--base` of training: the views that a dictionary is to sharpen.
    TrainingBase => Interpolation {
        Barycentric => Interpolation::Barycentric,
        Multiview => Interpolation::Multiview,
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
