//! How views are numbered, by their pictures: to which side they move from the middle view to its neighbours.
//!
//! A step of one column moves a point by (D, 0) pixels, a step of one row by (0, D), with the same D. Each order of the
//! views says something else of the four neighbours, and each block of the middle view is looked for in them under
//! each: under the right order it is found in all four, at the distance D that suits the block. Four orders can be told:
//! rows or columns first, and whether both are counted in the same sense. Counting *both* from the other end turns the
//! sign of D, as does another plane of focus, and cannot be told.

use std::collections::HashMap;

use rayon::prelude::*;

use super::view_io::{Numbering, ViewSource};
use super::view_order::{ReadOrder, ViewOrder};
use crate::geometry::Size;
use crate::image::Plane;
use crate::picture_file::may_expand;

/// Longest side of the pictures compared, pixels; larger ones are halved.
/// Source: chosen.
const SIDE: usize = 512;
/// Shortest side of the pictures compared: five blocks of eight pixels and the way that they move.
/// Source: chosen.
const LEAST_SIDE: usize = 5 * 8 + 2 * (REACH as usize + 1);
/// Blocks have 16 pixels a side where pictures have this many, else 8.
/// Source: chosen.
const LARGE_BLOCKS: usize = 160;
/// Farthest that a block is looked for, pixels of the pictures compared: halved ones look farther.
/// Source: chosen.
const REACH: f32 = 4.0;
/// Distance of the places where it is looked for, pixels.
/// Source: chosen.
const SPACING: f32 = 0.25;
/// Variance of a block, of pictures of mean 1, from which on it is looked for.
/// Source: chosen: contrast of 2 %.
const TEXTURE: f32 = 4e-4;
/// Errors below this share of the variance, and this variance, do not count: rounding of pictures of 8 bits.
/// Source: chosen.
const FLOOR: [f32; 2] = [0.01, 1e-5];
/// Pixels of a view above which views are read one after the other.
/// Source: chosen.
const LARGE_VIEW: usize = 1 << 22;
/// Least blocks with texture.
/// Source: chosen.
const BLOCKS: usize = 8;
/// Mean difference of the logarithms of errors, and its size in standard errors, that prove an order.
/// Source: chosen, between what views moved at random reach and what real light fields show.
const PROOF: [f64; 2] = [0.15, 3.0];

/// Logarithms of the errors of each block under the four orders: as numbered, mirrored, columns first, both.
type Fits = [Vec<f64>; 4];

/// How the views are numbered, where their pictures tell. Views that cannot be read count as absent.
pub(super) fn find_order(source: &dyn ViewSource) -> Option<ReadOrder> {
    let [rows, columns] = source.meta().views;
    let (height, width, channels) = source.meta().view_shape();
    let needed = (5 * 4 * height * width * channels) as u64;
    if rows < 2 || columns < 2 || source.stored_bytes().is_some_and(|stored| !may_expand(needed, stored)) {
        return None;
    }
    let mut pictures = Pictures { source, seen: HashMap::new() };
    let plain = ViewOrder::default();
    let snake = ViewOrder { serpentine: true, ..plain };
    let serpentine =
        source.numbering() == Numbering::Running && rows > 2 && is_serpentine(&mut pictures, [plain, snake]);
    let stored = if serpentine { snake } else { plain };
    let at = [rows / 2, columns / 2];
    let far = rows.min(columns).div_ceil(2) - 1;
    let mut fits = fits_of(&mut pictures, stored, at, 1);
    if far > 1 {
        fits.extend(fits_of(&mut pictures, stored, at, far));
    }
    let lesser = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x.min(*y)).collect::<Vec<_>>();
    let turned = strongest(fits.iter().map(|[a, b, c, d]| Evidence::of(&lesser(a, b), &lesser(c, d))));
    let columns_first = turned.proves();
    let own = if columns_first { [2, 3] } else { [0, 1] };
    let mirrored = strongest(fits.iter().map(|f| Evidence::of(&f[own[0]], &f[own[1]])));
    if !(turned.proves() || turned.refutes() || mirrored.proves()) {
        return None;
    }
    let order = ViewOrder { columns_first, mirror_v: mirrored.proves(), ..stored };
    let decided = [turned, mirrored].into_iter().filter(|e| e.proves() || e.refutes());
    let agreement = decided.fold(1.0, |least, e| e.agreement.min(least));
    Some(ReadOrder { order, agreement: Some(agreement as f32) })
}

/// What is said of an order that was found; nothing of this project's own.
pub(super) fn describe_order(found: ViewOrder, numbering: Numbering) -> Option<String> {
    if found.is_own() {
        return None;
    }
    let mut facts = Vec::new();
    match (found.columns_first, numbering) {
        (false, _) => {}
        (true, Numbering::Running) => facts.push("views are numbered column by column"),
        (true, _) => facts.push("the first of the two numbers of a view is its column"),
    }
    if found.serpentine {
        facts.push(if found.columns_first {
            "every second column is numbered backwards"
        } else {
            "every second row is numbered backwards"
        });
    }
    if found.mirror_v {
        facts.push("rows are numbered from below (or columns from the right, which parallax does not tell)");
    }
    let facts = facts.join(", and ");
    Some(format!("by parallax {facts}; read so (--order rows takes them as they are numbered, --order {found} as now)"))
}

/// Whether every second row runs backwards: by the motion in two rows, one after the other.
fn is_serpentine(pictures: &mut Pictures, orders: [ViewOrder; 2]) -> bool {
    let [rows, columns] = pictures.source.meta().views;
    let rows = [(rows - 1) / 2, (rows - 1) / 2 + 1];
    let mut levels: Vec<[Fits; 2]> = Vec::new();
    for (k, order) in orders.into_iter().enumerate() {
        for row in rows {
            for (level, fits) in fits_of(pictures, order, [row, columns / 2], 1).into_iter().enumerate() {
                if level == levels.len() {
                    levels.push(Default::default());
                }
                levels[level][k].iter_mut().zip(fits).for_each(|(all, some)| all.extend(some));
            }
        }
    }
    // The order that suits both rows best, under each of the two.
    let best = |fits: &Fits| {
        let moments = fits.each_ref().map(|logs| moments(logs));
        moments.into_iter().min_by(|a, b| a.mean.total_cmp(&b.mean)).filter(|_| fits[0].len() >= 2 * BLOCKS)
    };
    let strongest = strongest(levels.iter().filter_map(|[plain, snake]| {
        let (plain, snake) = (best(plain)?, best(snake)?);
        let error = (plain.error.powi(2) + snake.error.powi(2)).sqrt();
        let mean = plain.mean - snake.mean;
        Some(Evidence { mean, errors: mean / error.max(1e-9), agreement: 1.0 })
    }));
    strongest.proves()
}

/// What speaks for one of two orders, and against the other where it is negative.
#[derive(Debug, Clone, Copy, Default)]
struct Evidence {
    mean: f64,
    /// The mean in standard errors.
    errors: f64,
    /// Share of the evidence that has the sign of the mean.
    agreement: f64,
}

impl Evidence {
    /// By the logarithms of the errors of the same blocks under both orders: against the first, for the second.
    fn of(first: &[f64], second: &[f64]) -> Evidence {
        let differences: Vec<f64> = first.iter().zip(second).map(|(a, b)| a - b).collect();
        let Moments { mean, error } = moments(&differences);
        let total: f64 = differences.iter().map(|d| d.abs()).sum();
        let with: f64 = differences.iter().filter(|d| **d * mean > 0.0).map(|d| d.abs()).sum();
        Evidence { mean, errors: mean / error.max(1e-9), agreement: if total > 0.0 { with / total } else { 0.0 } }
    }

    fn proves(self) -> bool {
        self.mean > PROOF[0] && self.errors > PROOF[1]
    }

    fn refutes(self) -> bool {
        -self.mean > PROOF[0] && -self.errors > PROOF[1]
    }
}

fn strongest(all: impl Iterator<Item = Evidence>) -> Evidence {
    all.max_by(|a, b| a.errors.abs().total_cmp(&b.errors.abs())).unwrap_or_default()
}

/// A mean and its standard error.
struct Moments {
    mean: f64,
    error: f64,
}

fn moments(values: &[f64]) -> Moments {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
    Moments { mean, error: (variance / n).sqrt() }
}

/// A neighbour of the middle view: its picture, whether it lies in the direction of the second number, and to which side.
struct Neighbour {
    picture: Plane,
    second: bool,
    forward: bool,
}

/// The pictures that were looked at, by their place as stored; `None` of absent, unreadable and black ones.
struct Pictures<'a> {
    source: &'a dyn ViewSource,
    seen: HashMap<[usize; 2], Option<Plane>>,
}

impl Pictures<'_> {
    /// Reads those of `places` that were not read before.
    fn look_at(&mut self, places: impl Iterator<Item = [usize; 2]>) {
        let new: Vec<[usize; 2]> = places.filter(|place| !self.seen.contains_key(place)).collect();
        let source = self.source;
        let read = |&[a, b]: &[usize; 2]| {
            if source.is_absent(a, b).ok()? { None } else { grey(&source.read(a, b).ok()?) }
        };
        // Large views one at a time, for the sake of memory.
        let large = source.meta().size.iter().product::<usize>() > LARGE_VIEW;
        let pictures: Vec<Option<Plane>> =
            if large { new.iter().map(read).collect() } else { new.par_iter().map(read).collect() };
        self.seen.extend(new.into_iter().zip(pictures));
    }
}

/// The fits of the blocks of the view at `at`, on pictures of falling size, to the views `step` views from it.
fn fits_of(pictures: &mut Pictures, order: ViewOrder, at: [usize; 2], step: usize) -> Vec<Fits> {
    let views = pictures.source.meta().views;
    let steps = [(false, false), (false, true), (true, false), (true, true)];
    let places: Vec<Option<[usize; 2]>> = steps
        .iter()
        .map(|&(second, forward)| {
            let along = |k: usize, moved: bool| match (moved, forward) {
                (false, _) => Some(at[k]),
                (true, true) => Some(at[k] + step).filter(|&p| p < views[k]),
                (true, false) => at[k].checked_sub(step),
            };
            Some([along(0, !second)?, along(1, second)?])
        })
        .collect();
    let stored = |place| order.stored_place(place, views);
    pictures.look_at(places.iter().copied().flatten().chain([at]).map(stored));
    let picture = |place| pictures.seen.get(&stored(place)).cloned().flatten();
    let Some(mut middle) = picture(at) else { return Vec::new() };
    let neighbour = |(&(second, forward), place): (&(bool, bool), Option<[usize; 2]>)| {
        Some(Neighbour { picture: picture(place?)?, second, forward })
    };
    let mut neighbours: Vec<Neighbour> = steps.iter().zip(places).filter_map(neighbour).collect();
    let mut levels = Vec::new();
    if !(neighbours.iter().any(|n| n.second) && neighbours.iter().any(|n| !n.second)) {
        return levels;
    }
    while middle.width.min(middle.height) >= LEAST_SIDE {
        levels.extend(block_fits(&middle, &neighbours));
        middle = middle.halved();
        neighbours.iter_mut().for_each(|n| n.picture = n.picture.halved());
    }
    levels
}

/// The mean of the channels, of mean 1 and limited size; `None` of a black view.
fn grey(view: &ndarray::Array3<f32>) -> Option<Plane> {
    let (height, width, channels) = view.dim();
    let mut plane = Plane::filled(Size::new(width, height), 0.0);
    for (out, pixel) in plane.data.iter_mut().zip(view.rows()) {
        *out = pixel.sum() / channels as f32;
    }
    let mean = plane.data.iter().map(|x| f64::from(*x)).sum::<f64>() / plane.data.len() as f64;
    if !(mean > 1e-3 && mean.is_finite()) {
        return None;
    }
    plane.data.iter_mut().for_each(|x| *x /= mean as f32);
    while plane.width.max(plane.height) > SIDE {
        plane = plane.halved();
    }
    Some(plane)
}

/// The fits of one picture's blocks under the four orders; `None` where few have texture.
fn block_fits(middle: &Plane, neighbours: &[Neighbour]) -> Option<Fits> {
    let side = if middle.width.min(middle.height) >= LARGE_BLOCKS { 16 } else { 8 };
    let border = REACH as usize + 1;
    let corners: Vec<[usize; 2]> = (border..middle.height.saturating_sub(border + side - 1))
        .step_by(side)
        .flat_map(|t| (border..middle.width.saturating_sub(border + side - 1)).step_by(side).map(move |s| [t, s]))
        .collect();
    let fits = |corner: &[usize; 2]| Some(Block::of(middle, *corner, side)?.fits(neighbours));
    let found: Vec<[f64; 4]> = corners.par_iter().filter_map(fits).collect();
    (found.len() >= BLOCKS).then(|| [0, 1, 2, 3].map(|k| found.iter().map(|f| f[k]).collect()))
}

/// A block of the middle view.
struct Block {
    corner: [usize; 2],
    side: usize,
    /// Less their mean.
    values: Vec<f32>,
    variance: f32,
}

impl Block {
    /// `None` without texture.
    fn of(middle: &Plane, [t, s]: [usize; 2], side: usize) -> Option<Block> {
        let mut values: Vec<f32> = (t..t + side).flat_map(|t| middle.row(t)[s..s + side].iter().copied()).collect();
        let n = values.len() as f32;
        let mean = values.iter().sum::<f32>() / n;
        values.iter_mut().for_each(|x| *x -= mean);
        let variance = values.iter().map(|x| x * x).sum::<f32>() / n;
        (variance > TEXTURE).then_some(Block { corner: [t, s], side, values, variance })
    }

    /// Variance of the difference from `picture`, moved by each distance along its rows (`across`) or columns.
    fn errors(&self, picture: &Plane, across: bool) -> Vec<f32> {
        let steps = (REACH / SPACING) as i32;
        let n = self.values.len() as f32;
        (-steps..=steps)
            .map(|k| {
                let d = k as f32 * SPACING;
                let (whole, share) = (d.floor(), d - d.floor());
                let from = |place: usize| (place as f32 + whole) as usize;
                let (mut sum, mut squares) = (0.0, 0.0);
                for (t, own) in self.values.chunks_exact(self.side).enumerate() {
                    let row = self.corner[0] + t;
                    let (near, next) = if across {
                        let at = from(self.corner[1]);
                        let row = picture.row(row);
                        (&row[at..at + self.side], &row[at + 1..=at + self.side])
                    } else {
                        let (at, columns) = (from(row), self.corner[1]..self.corner[1] + self.side);
                        (&picture.row(at)[columns.clone()], &picture.row(at + 1)[columns])
                    };
                    for ((own, a), b) in own.iter().zip(near).zip(next) {
                        let e = a + share * (b - a) - own;
                        sum += e;
                        squares += e * e;
                    }
                }
                squares / n - (sum / n).powi(2)
            })
            .collect()
    }

    /// Logarithms of the least errors under the four orders.
    fn fits(&self, neighbours: &[Neighbour]) -> [f64; 4] {
        let errors: Vec<[Vec<f32>; 2]> =
            neighbours.iter().map(|n| [self.errors(&n.picture, true), self.errors(&n.picture, false)]).collect();
        let count = errors.first().map_or(0, |e| e[0].len());
        [(false, false), (false, true), (true, false), (true, true)].map(|(columns_first, mirrored)| {
            let error = |k: usize| {
                let one = |(n, errors): (&Neighbour, &[Vec<f32>; 2])| {
                    // The first number, too, counts forward, or against the second if mirrored.
                    let forward = n.forward != (mirrored && !n.second);
                    let across = n.second != columns_first;
                    errors[usize::from(!across)][if forward { k } else { count - 1 - k }]
                };
                neighbours.iter().zip(&errors).map(one).sum::<f32>() / neighbours.len() as f32
            };
            let least = (0..count).map(error).fold(f32::INFINITY, f32::min);
            f64::from(least.max(0.0) + FLOOR[0] * self.variance + FLOOR[1]).ln()
        })
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, Array5, s};
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

    use super::super::colour::ColourSpace;
    use super::super::error::Error;
    use super::super::meta::Meta;
    use super::*;
    use crate::random::{standard_normal, standard_normal_pair};

    /// Views in memory, their numbers in another order.
    struct Stored {
        meta: Meta,
        data: Array5<f32>,
        numbering: Numbering,
    }

    impl Stored {
        fn new(data: &Array5<f32>, order: ViewOrder, numbering: Numbering) -> Stored {
            let (rows, columns, t, w, c) = data.dim();
            let views = order.stored_views([rows, columns]);
            let mut stored = Array5::zeros((views[0], views[1], t, w, c));
            for v in 0..rows {
                for u in 0..columns {
                    let [a, b] = order.stored_place([v, u], [rows, columns]);
                    stored.slice_mut(s![a, b, .., .., ..]).assign(&data.slice(s![v, u, .., .., ..]));
                }
            }
            Stored { meta: Meta::new(views, [t, w], c, ColourSpace::Srgb), data: stored, numbering }
        }
    }

    impl ViewSource for Stored {
        fn meta(&self) -> &Meta {
            &self.meta
        }

        fn numbering(&self) -> Numbering {
            self.numbering
        }

        fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
            Ok(self.data.slice(s![v, u, .., .., ..]).to_owned())
        }
    }

    /// Two surfaces with disparities of both signs times `depth`, views of 72 × 80 pixels, with noise.
    fn scene([rows, columns]: [usize; 2], depth: f32, noise: f32) -> Array5<f32> {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut data = Array5::zeros((rows, columns, 72, 80, 1));
        for ((v, u, t, s, _), value) in data.indexed_iter_mut() {
            let near = (s + t) % 60 < 30;
            let d = if near { -1.3 * depth } else { 0.9 * depth };
            let step = |k: usize, n: usize| k as f32 - (n / 2) as f32;
            let (x, y) = (s as f32 - d * step(u, columns), t as f32 - d * step(v, rows));
            let wave = (0.9 * x + 0.2 * y).sin() + (0.35 * x - 0.7 * y).cos() + (0.13 * x * y / 20.0).sin();
            *value = 0.5 + 0.12 * wave + noise * standard_normal(&mut random) as f32;
        }
        data
    }

    fn orders() -> impl Iterator<Item = ViewOrder> {
        (0..16).map(|k| ViewOrder {
            columns_first: k & 1 > 0,
            mirror_v: k & 2 > 0,
            mirror_u: k & 4 > 0,
            serpentine: k & 8 > 0,
        })
    }

    #[test]
    fn orders_are_found_but_for_the_sense_of_both() {
        for views in [[5, 5], [4, 4], [4, 7], [3, 3]] {
            let data = scene(views, 1.0, 0.01);
            for order in orders() {
                let numbering = if order.serpentine { Numbering::Running } else { Numbering::Pairs };
                let found = find_order(&Stored::new(&data, order, numbering)).unwrap();
                let expected = ViewOrder { mirror_v: order.mirror_v != order.mirror_u, mirror_u: false, ..order };
                assert_eq!(found.order, expected, "{views:?} {order}");
                assert!(found.agreement.unwrap() > 0.8, "{views:?} {order} {found:?}");
            }
        }
    }

    #[test]
    fn what_pictures_do_not_tell_is_not_found() {
        let untold = |data: &Array5<f32>, numbering: Numbering| {
            let found = find_order(&Stored::new(data, ViewOrder::default(), numbering));
            assert!(found.is_none_or(|found| found.order.is_own()), "{found:?}");
            found
        };
        for numbering in [Numbering::Pairs, Numbering::Running] {
            assert_eq!(untold(&scene([5, 5], 0.0, 0.0), numbering), None, "no parallax");
            assert_eq!(untold(&scene([5, 5], 0.0, 0.05), numbering), None, "noise alone");
            assert_eq!(untold(&Array5::from_elem((5, 5, 72, 80, 1), 0.5), numbering), None, "no texture");
            assert_eq!(untold(&Array5::zeros((5, 5, 72, 80, 1)), numbering), None, "black");
            assert_eq!(untold(&scene([1, 5], 1.0, 0.0), numbering), None, "one row");
            assert!(untold(&scene([5, 5], 1.0, 0.0), numbering).is_some());
            // Views that are not where their numbers say: each moved by its own.
            let mut random = ChaCha8Rng::seed_from_u64(5);
            let one: Array3<f32> = scene([1, 1], 0.0, 0.0).slice_move(s![0, 0, .., .., ..]);
            let one = grey(&one).unwrap();
            let mut moved = Array5::<f32>::zeros((5, 5, 72, 80, 1));
            for k in 0..25 {
                let [x, y] = standard_normal_pair(&mut random).map(|x| 0.2 * x as f32);
                for ((row, column), value) in moved.slice_mut(s![k / 5, k % 5, .., .., 0]).indexed_iter_mut() {
                    *value = one.bilinear_at(column as f32 + x, row as f32 + y);
                }
            }
            untold(&moved, numbering);
        }
    }
}
