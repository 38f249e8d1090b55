//! Parameters of the network.

use super::dictionary::DictionaryParameters;
use lenslet_core::dictionary::SideInput;
use serde::{Deserialize, Serialize};

use crate::error::Error;

/// Parameters of a network and of its fitting.
///
/// | name | default | purpose | range |
/// |---|---|---|---|
/// | `beside` (field `side_inputs`) | none | further inputs of the base multiview: barycentric, cubic, noise | |
/// | `features` | \[60\] | principal components kept of the low image, then of each side input | 2 (of side inputs 1) … (window+4)² − 1, at most 4·window² |
/// | `window` | 9 | side of the window whose gradients are features | odd, 3 … 25 |
/// | `patch` | 5 | side of a residual patch | odd, 3 … window + 4 |
/// | `hidden` | \[256, 128\] | outputs of each hidden layer | one to four of 1 … 4096 |
/// | `epochs` | 14 | passes over the pairs | 1 … 1000 |
/// | `batch` | 512 | pairs a step | 16 … 65536 |
/// | `rate` | 0.001 | first learning rate of Adam; it falls to a fiftieth as half a cosine | 0 … 1 |
/// | `pairs` | 400 000 | training pairs | 100 … 20 000 000 |
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // in the table above
pub struct NetworkParameters {
    #[serde(rename = "beside")]
    pub side_inputs: Vec<SideInput>,
    pub features: Vec<usize>,
    pub window: usize,
    pub patch: usize,
    pub hidden: Vec<usize>,
    pub epochs: usize,
    pub batch: usize,
    pub rate: f32,
    pub pairs: usize,
}

impl Default for NetworkParameters {
    fn default() -> Self {
        NetworkParameters {
            side_inputs: Vec::new(),
            features: vec![60],
            window: 9,
            patch: 5,
            hidden: vec![256, 128],
            epochs: 14,
            batch: 512,
            rate: 0.001,
            pairs: 400_000,
        }
    }
}

impl NetworkParameters {
    /// Checks every range of the table.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the name and the value.
    pub fn check(&self) -> Result<(), Error> {
        let wrong = |what: String| Err(Error::Parameter(format!("network: {what}")));
        let odd = |n: usize, least: usize, most: usize| n % 2 == 1 && (least..=most).contains(&n);
        if !odd(self.window, 3, 25) || !odd(self.patch, 3, self.window + 4) {
            return wrong(format!("window {} or patch {} is out of range", self.window, self.patch));
        }
        if self.features.len() != self.side_inputs.len() + 1 {
            return wrong(format!(
                "{:?} features are not one number for each of {} images",
                self.features,
                self.side_inputs.len() + 1
            ));
        }
        let most = DictionaryParameters::most_features(self.window);
        let in_range = |(which, &count): (usize, &usize)| (if which == 0 { 2 } else { 1 }..=most).contains(&count);
        if !self.features.iter().enumerate().all(in_range) {
            return wrong(format!("features {:?} are out of range", self.features));
        }
        if !(1..=4).contains(&self.hidden.len()) || self.hidden.iter().any(|h| !(1..=4096).contains(h)) {
            return wrong(format!("hidden layers {:?} are out of range", self.hidden));
        }
        if !(1..=1000).contains(&self.epochs) || !(16..=65_536).contains(&self.batch) {
            return wrong(format!("epochs {} or batch {} is out of range", self.epochs, self.batch));
        }
        if !(0.0..=1.0).contains(&self.rate) || !(100..=20_000_000).contains(&self.pairs) {
            return wrong(format!("rate {} or pairs {} is out of range", self.rate, self.pairs));
        }
        Ok(())
    }
}
