//! Which axis of an array is which: rows and columns of views (v, u), rows and columns of pixels (t, s), channels (c),
//! or views in a row (n).

use std::fmt;
use std::str::FromStr;

use super::error::Error;
use super::meta::MAX_SIDE;

/// The order of the axes of an array, as letters: `vutsc` is this project's own.
///
/// ```
/// use lenslet_core::lightfield::Axes;
///
/// assert_eq!("t,s,v,u,c".parse::<Axes>()?.to_string(), "tsvuc");
/// assert!("vutsx".parse::<Axes>().is_err() && "vuts".parse::<Axes>().is_ok());
/// # Ok::<(), lenslet_core::lightfield::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Axes(Vec<u8>);

impl FromStr for Axes {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let letters: Vec<u8> = text.bytes().filter(|b| *b != b',').map(|b| b.to_ascii_lowercase()).collect();
        let once = |b: u8| letters.iter().filter(|&&l| l == b).count();
        let views = (once(b'v'), once(b'u'), once(b'n'));
        let sound = letters.iter().all(|b| b"vutscn".contains(b))
            && once(b't') == 1
            && once(b's') == 1
            && once(b'c') <= 1
            && matches!(views, (1, 1, 0) | (0, 0, 1) | (0, 0, 0));
        if sound {
            return Ok(Axes(letters));
        }
        Err(Error::Parameter(format!(
            "`{text}` is no order of axes: one letter an axis, as in tsvuc (v, u: rows and columns of views, or n: views \
             in a row; t, s: rows and columns of pixels; c: channels)"
        )))
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&String::from_utf8_lossy(&self.0))
    }
}

/// Where the value (v, u, t, s, c) of an array is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ArrayLayout {
    pub(super) views: [usize; 2],
    pub(super) size: [usize; 2],
    /// Channels stored: 1, 3, or 4 where the last is a weight.
    pub(super) stored: usize,
    /// Steps along v, u, t, s and c, in numbers.
    pub(super) strides: [usize; 5],
}

impl ArrayLayout {
    /// Channels of the light field.
    pub(super) fn channels(&self) -> usize {
        if self.stored == 4 { 3 } else { self.stored }
    }

    /// Whether the pixels of a view are stored one after the other.
    pub(super) fn has_whole_views(&self) -> bool {
        let [_, _, t, s, c] = self.strides;
        c == 1 && s == self.stored && t == self.size[1] * self.stored
    }
}

/// The layout of an array of these sides; `fortran`: the first index runs fastest. Without `axes` the order is that of
/// this project, refused where the sides show that it is another.
pub(super) fn lay_out(
    sides: &[usize],
    fortran: bool,
    axes: Option<&Axes>,
    views: Option<[usize; 2]>,
) -> Result<ArrayLayout, String> {
    let letters: &[u8] = match axes {
        Some(axes) if axes.0.len() == sides.len() => &axes.0,
        Some(axes) => return Err(format!("an array of {} axes {sides:?}, but --axes {axes}", sides.len())),
        None => usual_axes(sides)?,
    };
    let side_of = |letter: u8| letters.iter().position(|l| *l == letter).map(|k| sides[k]);
    // Sides are those of a file: their product may be beyond 2^64, which the caller refuses by the file's length.
    let stride_of = |letter: u8| {
        let k = letters.iter().position(|l| *l == letter)?;
        let faster = if fortran { &sides[..k] } else { &sides[k + 1..] };
        Some(faster.iter().fold(1usize, |a, &b| a.saturating_mul(b)))
    };
    let stored = side_of(b'c').unwrap_or(1);
    if !matches!(stored, 1 | 3 | 4) {
        return Err(format!("{stored} channels; there must be 1, 3, or 4 with a weight"));
    }
    let size = [side_of(b't').unwrap_or(1), side_of(b's').unwrap_or(1)];
    let [stride_t, stride_s, stride_c] = [b't', b's', b'c'].map(|l| stride_of(l).unwrap_or(1));
    let (views, stride_v, stride_u) = match (side_of(b'v'), side_of(b'u'), side_of(b'n')) {
        (Some(v), Some(u), _) => ([v, u], stride_of(b'v').unwrap_or(0), stride_of(b'u').unwrap_or(0)),
        (_, _, Some(n)) => {
            let [v, u] = arrange(n, views)?;
            let one = stride_of(b'n').unwrap_or(0);
            ([v, u], one.saturating_mul(u), one)
        }
        _ => ([1, 1], 0, 0),
    };
    Ok(ArrayLayout { views, size, stored, strides: [stride_v, stride_u, stride_t, stride_s, stride_c] })
}

fn arrange(n: usize, wanted: Option<[usize; 2]>) -> Result<[usize; 2], String> {
    let side = n.isqrt();
    match wanted {
        Some([v, u]) if v.checked_mul(u) == Some(n) => Ok([v, u]),
        None if side * side == n => Ok([side, side]),
        _ => Err(format!("{n} views in a row: say how they are arranged with --views ROWSxCOLUMNS")),
    }
}

/// The axes of an array of these sides by their number, refused where another order is the likely one.
fn usual_axes(sides: &[usize]) -> Result<&'static [u8], String> {
    let channels = |n: usize| matches!(n, 1 | 3 | 4);
    let say = |orders: &str| {
        format!("an array of shape {sides:?} is hardly (v, u, t, s, c): say which axis is which, with {orders}")
    };
    match *sides {
        [v, u, t, s, c] if channels(c) => {
            if v > t && u > s && v.max(u) <= MAX_SIDE {
                return Err(say("--axes tsvuc, or --axes vutsc if it is so"));
            }
            Ok(b"vutsc")
        }
        [a, _, b, _, _] if channels(a) && channels(b) => Err(say("--axes cvuts or --axes vucts")),
        [c, _, _, _, _] if channels(c) => Err(say("--axes cvuts")),
        [_, _, c, _, _] if channels(c) => Err(say("--axes vucts")),
        [_, _, _, 3 | 4] => Ok(b"ntsc"),
        [n, c @ (3 | 4), t, s] if n > c && t > c && s > c => Err(say("--axes ncts, or --axes vuts if it is so")),
        [c @ (3 | 4), v, t, s] if v > c && t > c && s > c => Err(say("--axes cnts, or --axes vuts if it is so")),
        [v, u, t, s] => {
            if v > t && u > s && v.max(u) <= MAX_SIDE {
                return Err(say("--axes tsvu, or --axes vuts if it is so"));
            }
            Ok(b"vuts")
        }
        [_, _, c] if channels(c) => Ok(b"tsc"),
        [c @ (3 | 4), t, s] if t > c && s > c => Err(say("--axes cts")),
        [_, _] => Ok(b"ts"),
        _ => Err(format!("an array of shape {sides:?}; a light field has shape (v, u, t, s, c) with c = 1 or 3")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(sides: &[usize]) -> Result<ArrayLayout, String> {
        lay_out(sides, false, None, None)
    }

    #[test]
    fn the_usual_orders() {
        let own = plain(&[9, 8, 40, 50, 3]).unwrap();
        assert_eq!((own.views, own.size, own.stored), ([9, 8], [40, 50], 3));
        assert_eq!(own.strides, [8 * 40 * 50 * 3, 40 * 50 * 3, 150, 3, 1]);
        assert!(own.has_whole_views());
        let running = plain(&[9, 40, 50, 3]).unwrap();
        assert_eq!((running.views, running.strides), ([3, 3], [3 * 6000, 6000, 150, 3, 1]));
        assert_eq!(plain(&[9, 8, 40, 50]).unwrap().channels(), 1);
        let columns = lay_out(&[9, 8, 40, 50, 4], true, None, None).unwrap();
        assert_eq!((columns.strides, columns.channels()), ([1, 9, 72, 72 * 40, 72 * 2000], 3));
        assert!(!columns.has_whole_views());
    }

    #[test]
    fn other_orders_are_refused_with_their_name_and_taken_by_it() {
        for (sides, order, views, size) in [
            (&[40, 50, 9, 8, 3][..], "tsvuc", [9, 8], [40, 50]),
            (&[3, 9, 8, 40, 50], "cvuts", [9, 8], [40, 50]),
            (&[9, 8, 3, 40, 50], "vucts", [9, 8], [40, 50]),
            (&[81, 3, 40, 50], "ncts", [9, 9], [40, 50]),
            (&[40, 50, 9, 8], "tsvu", [9, 8], [40, 50]),
            (&[3, 40, 50], "cts", [1, 1], [40, 50]),
        ] {
            let error = plain(sides).unwrap_err();
            assert!(error.contains(&format!("--axes {order}")), "{error}");
            let found = lay_out(sides, false, Some(&order.parse().unwrap()), None).unwrap();
            assert_eq!((found.views, found.size), (views, size), "{order}");
        }
        let own = lay_out(&[40, 50, 9, 8, 3], false, Some(&"vutsc".parse().unwrap()), None).unwrap();
        assert_eq!(own.views, [40, 50]);
        assert!(lay_out(&[40, 50, 9], false, Some(&"vutsc".parse().unwrap()), None).is_err());
    }
}
