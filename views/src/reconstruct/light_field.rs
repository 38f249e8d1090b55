//! Whole light fields, view after view.

use lenslet_core::decode::HexSamples;
use lenslet_core::ensure;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{ColourSpace, Meta, Srgb, View, ViewSink, ViewSource, colour};
use lenslet_core::progress::Observer;
use lenslet_core::sampling::bicubic;
use ndarray::Array3;

use super::data_consistent::DataConsistent;
use super::reconstructor::Reconstructor;
use crate::Error;

/// What is done to a view before it is reconstructed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Enlargement {
    /// Nothing: the view has its final size.
    None,
    /// Bicubic enlargement by this factor, 1 to 16; sides are rounded.
    Bicubic(f64),
}

impl Enlargement {
    /// The size (t, s) of a view of `size`.
    #[must_use]
    pub fn size(self, size: [usize; 2]) -> [usize; 2] {
        match self {
            Enlargement::None => size,
            Enlargement::Bicubic(f) => size.map(|n| ((n as f64 * f).round() as usize).max(1)),
        }
    }

    fn apply(self, view: Array3<f32>) -> Result<Array3<f32>, Error> {
        let (h, w, _) = view.dim();
        let [rows, columns] = self.size([h, w]);
        if (rows, columns) == (h, w) {
            Ok(view)
        } else {
            Ok(bicubic::resize_bicubic(view.view(), Size::new(columns, rows))?)
        }
    }
}

/// Reconstructs every view of `source` into `sink`, which takes values in colour space `to`. One view at a time in
/// memory. With the samples that the views were made of, and the standard deviation of their noise where it is known,
/// these stay true (see [`DataConsistent`]). Absent views stay absent.
///
/// # Errors
/// Views that cannot be read or written, samples of other views, a factor out of range, interruption
/// ([`Error::Interrupted`]).
pub fn reconstruct_light_field(
    source: &dyn ViewSource,
    sink: &mut dyn ViewSink,
    to: ColourSpace,
    reconstructor: &Reconstructor,
    enlargement: Enlargement,
    samples: Option<(&HexSamples, Option<f32>)>,
    observer: &dyn Observer,
) -> Result<(), Error> {
    if let Enlargement::Bicubic(f) = enlargement {
        ensure!(Error::Parameter, (1.0..=16.0).contains(&f), "views cannot be enlarged by {f} (1 to 16)");
    }
    let meta: &Meta = source.meta();
    let [rows, columns] = meta.views;
    let size = enlargement.size(meta.size);
    let base = if meta.method == Some(Interpolation::Multiview.into()) {
        Interpolation::Multiview
    } else {
        Interpolation::Barycentric
    };
    let consistent = match samples {
        Some((samples, noise)) => {
            ensure!(
                Error::Shape,
                samples.views == rows && samples.views == columns && samples.values.dim().0 == rows * columns,
                "the samples are of {0}x{0} views, the light field has {rows}x{columns}",
                samples.views
            );
            Some((
                DataConsistent::new(reconstructor.clone(), samples, base, Size::new(size[1], size[0]), noise)?,
                samples,
            ))
        }
        None => None,
    };
    observer.begin("learned reconstruction", (rows * columns) as u64);
    for v in 0..rows {
        for u in 0..columns {
            observer.check()?;
            if source.is_absent(v, u)? {
                observer.advance(1);
                continue;
            }
            let mut view = source.read(v, u)?;
            colour::convert(&mut view, meta.colour, ColourSpace::Srgb);
            let low = View::<Srgb>::new(enlargement.apply(view)?);
            let mut sharp = match &consistent {
                Some((f, samples)) => f.reconstruct_view(&low, samples.view(v, u))?,
                None => reconstructor.reconstruct_view(&low)?,
            }
            .into_pixels();
            colour::convert(&mut sharp, ColourSpace::Srgb, to);
            sink.write(v, u, &sharp)?;
            observer.advance(1);
        }
    }
    Ok(())
}
