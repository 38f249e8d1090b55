//! Whether what lies together belongs together: a light field's description, its pictures and the samples beside it; and
//! whether a light field is one that a command can improve.

use std::path::Path;

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::SensorToView;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{ColourSpace, Meta, ViewOrigin, ViewSource, colour};
use lenslet_views::view_pitch;

/// Relative difference of pitches, and of aspect ratios, that rounding makes.
/// Source: chosen.
const ROUNDING: f64 = 0.03;
/// Mean difference of pictures and samples (linear light, relative to the samples' mean) that means other contents: views
/// that are sharpened, interpolated or made of noisy samples differ by a tenth of it.
/// Source: chosen.
const OTHER: f64 = 0.35;

/// Refuses samples that are not those of the light field, by number of views, pitch, shape, and contents in the colour
/// space that it states. `option`: how to go on without them.
pub fn check_samples(source: &dyn ViewSource, samples: &HexSamples, path: &Path, option: &str) -> anyhow::Result<()> {
    let meta = source.meta();
    let refuse = |what: String| {
        anyhow::bail!("{}: {what}; mend the description, or leave the samples out with {option}", path.display())
    };
    let [rows, columns] = meta.views;
    let n = samples.views;
    if [n; 2] != meta.views {
        return refuse(format!("the samples are of {n}x{n} views, the light field has {rows}x{columns}"));
    }
    let bad = samples.values.iter().filter(|x| !x.is_finite()).count();
    if bad > 0 {
        let at = samples.values.indexed_iter().find(|(_, x)| !x.is_finite()).map_or((0, 0, 0), |(at, _)| at);
        anyhow::bail!(
            "{}: {bad} of {} samples are not finite numbers, the first of view {}, lenslet {}, channel {}; leave them out with \
             {option}, or decode the capture again",
            path.display(),
            samples.values.len(),
            at.0,
            at.1,
            at.2
        );
    }
    let [height, width] = meta.size;
    let Size { width: sensor_width, height: sensor_height } = samples.sensor;
    let aspect = (width as f64 / height as f64) / (sensor_width as f64 / sensor_height as f64);
    // A pixel more or less changes small views by more.
    if (aspect - 1.0).abs() > ROUNDING + 2.0 / width.min(height) as f64 {
        return refuse(format!(
            "the samples are of a sensor of {sensor_width}x{sensor_height}, the views have {width}x{height}"
        ));
    }
    let actual = view_pitch(samples, width);
    if let Some(pitch) = meta.pitch
        && (pitch / actual - 1.0).abs() > ROUNDING + 2.0 / width as f64
    {
        return refuse(format!(
            "the description says a pitch of {pitch:.3} pixels, the samples have one of {actual:.3}"
        ));
    }
    let view = source.read(rows / 2, columns / 2)?;
    let own = samples.view(rows / 2, columns / 2);
    let channels = view.dim().2.min(own.ncols());
    let map = SensorToView::new(samples.sensor, Size::new(width, height));
    // Mean difference, where it is stated to be linear light or sRGB, relative to the mean.
    let off = |space: ColourSpace| {
        let mut view = view.clone();
        colour::convert(&mut view, space, ColourSpace::Linear);
        let (mut sum, mut all) = (0.0, 1e-9);
        for (centre, value) in samples.centres.iter().zip(own.rows()) {
            let [x, y] = map.to_view(*centre);
            let inside = x >= 0.0 && y >= 0.0 && x <= (width - 1) as f64 && y <= (height - 1) as f64;
            for c in (0..channels).filter(|_| inside) {
                let there = view[[(y + 0.5) as usize, (x + 0.5) as usize, c]];
                // What a picture cannot show was cut.
                let value = value[c].clamp(0.0, 1.0);
                sum += f64::from((there - value).abs());
                all += f64::from(value);
            }
        }
        sum / all
    };
    let (stated, other) = match meta.colour {
        ColourSpace::Srgb => (off(ColourSpace::Srgb), off(ColourSpace::Linear)),
        ColourSpace::Linear => (off(ColourSpace::Linear), off(ColourSpace::Srgb)),
    };
    if stated > OTHER && other < 0.5 * stated {
        let says = if meta.colour == ColourSpace::Linear { "linear light" } else { "sRGB" };
        return refuse(format!(
            "the description says {says}, but the pictures fit the samples only as the other colour space"
        ));
    }
    if stated > 2.0 * OTHER {
        return refuse("the pictures show something else than the samples: they are of another capture".into());
    }
    Ok(())
}

/// Refuses learned reconstruction of views that are learned already.
pub fn refuse_learned(meta: &Meta, path: &Path) -> anyhow::Result<()> {
    let made = meta.method.as_ref();
    if made == Some(&ViewOrigin::Learned) {
        anyhow::bail!(
            "{0}: its views are learned already, and learning them again makes them worse; decode the capture with --method \
             barycentric or --method multiview, then lenslet infer (or at once: lenslet decode --method learned)",
            path.display()
        );
    }
    Ok(())
}

/// Refuses multi-view refinement, without samples, of views that hold the samples of all the others already.
pub fn refuse_refined(meta: &Meta, path: &Path) -> anyhow::Result<()> {
    let refined = matches!(meta.method, Some(ViewOrigin::Learned | ViewOrigin::Interpolated(Interpolation::Multiview)));
    anyhow::ensure!(
        !refined,
        "{}: its views are {} already, and refining them without the measured samples makes them worse; refine the light field \
         that lies beside its samples.npz, or one decoded with --method barycentric",
        path.display(),
        meta.method.as_ref().map_or("refined", ViewOrigin::name)
    );
    Ok(())
}
