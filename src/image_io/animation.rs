//! Animations as the bytes of a file: APNG of all colours, GIF of 256.

#[cfg(feature = "gif")]
use rayon::prelude::*;

use super::error::Error;
use super::picture::Picture;

/// The bytes of an endless animated PNG, every colour kept; `delay` between pictures in hundredths of a second.
///
/// # Errors
/// [`Error::Animation`] when there are no pictures or they differ in size, [`Error::Apng`] when they are empty.
///
/// ```
/// use lenslet::image_io::{Picture, apng};
///
/// let frame = |grey| Picture { width: 2, height: 2, rgb: vec![grey; 12] };
/// let bytes = apng(&[frame(0), frame(255)], 50)?;
/// let reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info()?;
/// assert_eq!(reader.info().animation_control().map(|a| a.num_frames), Some(2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn apng(pictures: &[Picture], delay: u16) -> Result<Vec<u8>, Error> {
    let first = first_of_one_size(pictures)?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, first.width as u32, first.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_animated(pictures.len() as u32, 0)?;
    encoder.set_frame_delay(delay, 100)?;
    let mut writer = encoder.write_header()?;
    for picture in pictures {
        writer.write_image_data(&picture.rgb)?;
    }
    writer.finish()?;
    Ok(bytes)
}

/// The bytes of an endless animated GIF; `delay` between pictures in hundredths of a second.
///
/// # Errors
/// [`Error::Animation`] when there are no pictures, they differ in size, or have more than 65535 pixels a side.
#[cfg(feature = "gif")]
pub fn gif(pictures: &[Picture], delay: u16) -> Result<Vec<u8>, Error> {
    let first = first_of_one_size(pictures)?;
    let side = |n: usize| u16::try_from(n).map_err(|_| Error::Animation("a GIF has at most 65535 pixels a side"));
    let (width, height) = (side(first.width)?, side(first.height)?);
    let frames: Vec<gif::Frame> = pictures
        .par_iter()
        .map(|p| {
            let mut frame = gif::Frame::from_rgb_speed(width, height, &p.rgb, 10);
            frame.delay = delay;
            frame.make_lzw_pre_encoded();
            frame
        })
        .collect();
    let mut bytes = Vec::new();
    {
        let mut encoder = gif::Encoder::new(&mut bytes, width, height, &[])?;
        encoder.set_repeat(gif::Repeat::Infinite)?;
        for frame in &frames {
            encoder.write_lzw_pre_encoded_frame(frame)?;
        }
    }
    Ok(bytes)
}

/// The first picture, when all are of its size.
fn first_of_one_size(pictures: &[Picture]) -> Result<&Picture, Error> {
    let first = pictures.first().ok_or(Error::Animation("an animation needs at least one picture"))?;
    if pictures.iter().any(|p| (p.width, p.height) != (first.width, first.height)) {
        return Err(Error::Animation("the pictures of an animation must be of one size"));
    }
    Ok(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(grey: u8) -> Picture {
        Picture { width: 20, height: 10, rgb: vec![grey; 600] }
    }

    #[cfg(feature = "gif")]
    #[test]
    fn a_gif_reads_back() {
        let bytes = gif(&[picture(10), picture(200)], 5).unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(&bytes[..]).unwrap();
        let mut values = vec![];
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            values.push(frame.buffer[0]);
        }
        assert_eq!(values, [10, 200]);
        assert!(gif(&[], 5).is_err());
        assert!(gif(&[picture(1), Picture { width: 1, height: 1, rgb: vec![0; 3] }], 5).is_err());
    }

    #[test]
    fn an_animated_png_reads_back() {
        let bytes = apng(&[picture(10), picture(200)], 5).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().map(|a| (a.num_frames, a.num_plays)), Some((2, 0)));
        for value in [10, 200] {
            let mut frame = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut frame).unwrap();
            assert!(frame.iter().all(|v| *v == value));
        }
        assert!(apng(&[], 5).is_err());
    }
}
