//! Which of several images can be used: one bad capture must not cost the user the others.

use super::{Error, Options, average};
use crate::container::Capture;
use crate::progress::Observer;

/// An image that can be used, and its place in the list given.
pub type Kept<'a> = (usize, &'a Capture);

/// The images that are sound, lit, and of the camera most of them are of; a note says what was left out and why.
///
/// # Errors
/// Without any, what is wrong with the first; where no camera has most of the images, the first of another one.
pub fn usable<'a>(captures: &'a [Capture], options: &Options, observer: &dyn Observer) -> Result<Vec<Kept<'a>>, Error> {
    let (mut kept, mut first_error): (Vec<Kept<'a>>, _) = (Vec::new(), None);
    for (n, capture) in captures.iter().enumerate() {
        // A single image is judged where it is averaged.
        let judged = average::sound(capture, n + 1).and_then(|()| match captures.len() {
            1 => Ok(()),
            _ => average::average(std::slice::from_ref(capture), |v| v).map(drop),
        });
        match judged {
            Ok(()) => kept.push((n, capture)),
            Err(e) => {
                if captures.len() > 1 {
                    leave_out(n, &e, options, observer);
                }
                first_error.get_or_insert(e);
            }
        }
    }
    let camera = |a: &Capture, b: &Capture| average::together(a, b, 0).is_ok();
    let like = |c: &Capture| kept.iter().filter(|(_, other)| camera(c, other)).count();
    let Some(&(_, model)) = kept.iter().max_by_key(|(n, c)| (like(c), std::cmp::Reverse(*n))) else {
        return Err(first_error.unwrap_or(Error::NoImages));
    };
    if 2 * like(model) <= kept.len() {
        average::check(&kept.iter().map(|k| k.1).collect::<Vec<_>>())?;
    }
    kept.retain(|(n, c)| match average::together(model, c, n + 1) {
        Ok(()) => true,
        Err(e) => {
            leave_out(*n, &e, options, observer);
            false
        }
    });
    Ok(kept)
}

/// Says which image was left out, by its name where it has one.
pub fn leave_out(n: usize, why: &Error, options: &Options, observer: &dyn Observer) {
    let name = options.names.get(n).cloned().unwrap_or_else(|| format!("image {}", n + 1));
    observer.note(&format!("{name}: left out: {why}"));
}
