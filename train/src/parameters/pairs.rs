//! Parameters of the photos, crops and pairs that training takes.

use super::range::within;
use crate::error::Error;

/// Photos, crops and pairs.
///
/// | name | field | default | purpose | range |
/// |---|---|---|---|---|
/// | `pairs` | `count` | 200 000 | training pairs | 100 … 20 000 000 |
/// | `crop` | | 256 | side of a crop, pixels | 32 … 4096 |
/// | `crops` | | 6 | crops a photo | 1 … 10 000 |
/// | `shrink` | | 1.5 | photos are made smaller by this first | 1 … 16 |
/// | `held_out` | | 8 | every n-th photo is kept for scores (of few photos see below) | 0 (none), 2 … |
/// | `linear_light` | | false | photos hold linear light, not sRGB-encoded values | |
/// | `memory` | | 4 | GiB that pairs and crops may take: fewer pairs where they would not fit | 0.05 … 1024 |
///
/// Of fewer than `held_out` photos crops of the last one are kept for scores, of one to three photos a quarter of each.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // in the table above
pub struct PairParameters {
    pub count: usize,
    pub crop: usize,
    pub crops: usize,
    pub shrink: f64,
    pub held_out: usize,
    pub linear_light: bool,
    pub memory: f64,
}

impl Default for PairParameters {
    fn default() -> Self {
        PairParameters {
            count: 200_000,
            crop: 256,
            crops: 6,
            shrink: 1.5,
            held_out: 8,
            linear_light: false,
            memory: 4.0,
        }
    }
}

impl PairParameters {
    pub(super) fn check(&self) -> Result<(), Error> {
        within("pairs", self.count, 100, 20_000_000)?;
        within("crop", self.crop, 32, 4096)?;
        within("crops", self.crops, 1, 10_000)?;
        within("shrink", self.shrink, 1.0, 16.0)?;
        within("memory", self.memory, 0.05, 1024.0)?;
        if self.held_out == 1 {
            return Err(Error::Parameter("held_out 1 would leave no photo to learn from".into()));
        }
        Ok(())
    }
}
