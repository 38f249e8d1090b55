//! The support of one signal in f64: values, signs, and the explicit inverse of its Gram matrix, on SIMD lanes.
//!
//! The inverse is updated by rank one when an atom enters or leaves. It only gives directions: errors are computed from
//! the residual of the values themselves, so its rounding slows convergence at worst. A place whose member left is taken
//! by the next; until then its row and column, value and sign are zero.
// Loops by index: iterator chains are not always inlined into the function that has the processor's features.
#![allow(clippy::needless_range_loop)]

use super::gap;
use super::simd::{Chunk, Kernel, Lanes, dispatch};
use super::wide::{Begin, NO_ATOM, add_square, multiply, subtract_atoms};
use crate::sparse::prepared::Prepared;

/// The share of an atom's square that the support must leave for it to count as independent.
///
/// Source: chosen; f64 resolves 1e-16, and the copies of an atom that f32 files hold differ by 1e-14.
const LEAST_INDEPENDENT_SHARE: f64 = 1e-10;

/// The share of an atom's square that the support must leave, of every atom, for inner products to be taken from the Gram
/// matrix in f32. Where less is left the inverse is made anew in f64: rounding is magnified by the inverse of each share.
///
/// Source: chosen; the values are corrected by their residual, so that it costs digits of a step and none of the result.
const ROUGH_SHARE: f64 = 2e-3;

/// The share of an atom's square below which what the support leaves of it is computed in two steps: the first leaves,
/// besides, what the inverse is wrong by, and that must not count as independent.
///
/// Source: chosen; the inverse of supports that span all but one dimension, after a hundred updates, was wrong by 1e-5.
const DOUBTFUL_SHARE: f64 = 1e-4;

/// Members that leave, one after the other, for an atom that depends on the support.
///
/// Source: chosen; one is enough unless members depend on each other, too.
const MOST_EXCHANGES: u32 = 4;

/// The support of one signal.
#[derive(Default)]
pub(crate) struct Support {
    /// All members are before this place.
    places: usize,
    /// Chunks of sixteen places in a row of the inverse.
    stride: usize,
    atoms: Vec<u32>,
    values: Vec<[f64; 16]>,
    signs: Vec<[f64; 16]>,
    /// Where the values move.
    target: Vec<[f64; 16]>,
    /// Errors of the members' conditions: c − λθ.
    errors: Vec<[f64; 16]>,
    /// Inner products of the entering atom with the members.
    overlap: Vec<[f64; 16]>,
    /// G_SS⁻¹ times those, or a column of the inverse.
    direction: Vec<[f64; 16]>,
    /// Rows of `stride` chunks.
    inverse: Vec<[f64; 16]>,
    /// The entering atom.
    column: Vec<[f64; 16]>,
    /// What the support leaves of it.
    rest: Vec<[f64; 16]>,
    accuracy: Accuracy,
}

/// What the inverse is made of.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
enum Accuracy {
    /// Nothing, or inner products in f32, of atoms of which much is left.
    #[default]
    Rough,
    /// Inner products in f64.
    Exact,
}

/// How an atom was added.
pub(crate) enum Added {
    /// The residual moved by −step times [`Support::rest`].
    Along(f64),
    /// Members left.
    Otherwise,
    /// Rounding left nothing to do.
    Failed,
}

impl Support {
    pub fn is_empty(&self) -> bool {
        self.atoms.iter().all(|&atom| atom == NO_ATOM)
    }

    /// Members: atom and value.
    pub fn members(&self) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.atoms.iter().copied().zip(self.values.as_flattened().iter().copied()).filter(|member| member.0 != NO_ATOM)
    }

    /// ‖φ‖₁.
    pub fn norm1(&self) -> f64 {
        self.values.as_flattened()[..self.places].iter().map(|v| v.abs()).sum()
    }

    /// As [`Self::clear`], for about `members` members of `values` values each: a support that nearly spans all signals
    /// leaves little of its last atoms, and its inverse is made in f64 from the beginning.
    pub fn clear_for(&mut self, members: usize, values: usize) {
        self.clear();
        if 4 * members > 3 * values {
            self.accuracy = Accuracy::Exact;
        }
    }

    /// Forgets all members.
    pub fn clear(&mut self) {
        self.inverse.clear();
        self.atoms.clear();
        for row in [&mut self.values, &mut self.signs, &mut self.target, &mut self.errors, &mut self.overlap] {
            row.clear();
        }
        self.direction.clear();
        (self.places, self.stride) = (0, 0);
        self.accuracy = Accuracy::Rough;
    }

    /// Room for `places` places.
    fn reserve(&mut self, places: usize) {
        let stride = places.div_ceil(16);
        if stride <= self.stride {
            return;
        }
        let mut inverse = vec![[0.0; 16]; 16 * stride * stride];
        if self.stride > 0 {
            for (to, from) in inverse.chunks_exact_mut(stride).zip(self.inverse.chunks_exact(self.stride)) {
                to[..self.stride].copy_from_slice(from);
            }
        }
        self.inverse = inverse;
        self.stride = stride;
        let rows = [&mut self.values, &mut self.signs, &mut self.target, &mut self.errors, &mut self.overlap];
        for row in rows.into_iter().chain([&mut self.direction]) {
            row.resize(stride, [0.0; 16]);
        }
    }

    /// Chunks that the places in use fill.
    #[inline(always)]
    fn chunks(&self) -> usize {
        self.places.div_ceil(16)
    }

    /// Puts y − Dᵀφ into `residual`.
    #[inline(always)]
    pub fn subtract_fit<S: Lanes>(
        &self,
        lanes: S,
        dictionary: &Prepared,
        signal: &[Chunk],
        residual: &mut [[f64; 16]],
    ) {
        subtract_atoms(lanes, dictionary, &self.atoms, self.values.as_flattened(), Begin::Signal(signal), residual);
    }

    /// What the support left of the atom that entered last.
    pub fn rest(&self) -> &[[f64; 16]] {
        &self.rest
    }

    /// Records the errors of the members' conditions for a residual. Returns the largest |c| (or c) of the members.
    #[inline(always)]
    pub fn record_errors<S: Lanes>(
        &mut self,
        lanes: S,
        dictionary: &Prepared,
        residual: &[[f64; 16]],
        lambda: f64,
        nonnegative: bool,
    ) -> f64 {
        let mut largest = 0.0f64;
        for place in 0..self.places {
            let mut error = 0.0;
            if self.atoms[place] != NO_ATOM {
                let c = gap::inner_product(lanes, dictionary.padded_atom(self.atoms[place] as usize), residual);
                error = c - lambda * self.signs.as_flattened()[place];
                largest = largest.max(if nonnegative { c } else { c.abs() });
            }
            self.errors.as_flattened_mut()[place] = error;
        }
        largest
    }

    /// Moves to the minimum for the recorded errors: φ_S += G_SS⁻¹ρ. With `keep_signs` members that would change sign
    /// leave on the way. False when that does not end.
    #[inline(always)]
    pub fn correct_values<S: Lanes>(&mut self, lanes: S, keep_signs: bool) -> bool {
        multiply(lanes, &self.inverse, self.stride, self.places, &self.errors, &mut self.direction);
        for v in 0..self.chunks() {
            for lane in 0..16 {
                self.target[v][lane] = self.values[v][lane] + self.direction[v][lane];
            }
        }
        self.move_to_target(lanes, keep_signs)
    }

    /// Takes over a member with its value, without moving the others. False, and nothing done, where it depends on them.
    #[inline(always)]
    pub fn take<S: Lanes>(&mut self, lanes: S, dictionary: &Prepared, atom: u32, value: f64) -> bool {
        if self.accuracy == Accuracy::Rough {
            let row = dictionary.gram_row(atom as usize);
            let own = f64::from(row[atom as usize]);
            for place in 0..self.places {
                let member = self.atoms[place];
                let overlap = if member == NO_ATOM { 0.0 } else { f64::from(row[member as usize]) };
                self.overlap.as_flattened_mut()[place] = overlap;
            }
            let left = own - self.direction_of_overlap(lanes);
            if left > ROUGH_SHARE * own {
                self.insert(lanes, atom, value, value.signum(), left);
                return true;
            }
            self.make_exact(lanes, dictionary);
        }
        let own = self.load_column(lanes, dictionary, atom);
        self.find_overlaps(lanes, dictionary);
        let mut left = own - self.direction_of_overlap(lanes);
        if left.is_nan() || left <= ROUGH_SHARE * own {
            // Too few digits are left of a difference.
            left = self.find_rest(lanes, dictionary);
            left = self.surely_left(dictionary, own, left);
        }
        if left.is_nan() || left <= LEAST_INDEPENDENT_SHARE * own {
            return false;
        }
        self.insert(lanes, atom, value, value.signum(), left);
        true
    }

    /// Adds an atom whose condition has the error `error` = c − λθ ≠ 0, all other errors being zero, and moves to the
    /// minimum. An atom that depends linearly on the support takes the place of the member that the null direction
    /// brings to zero first.
    #[inline(always)]
    pub fn add<S: Lanes>(&mut self, lanes: S, dictionary: &Prepared, atom: u32, error: f64, keep_signs: bool) -> Added {
        let sign = 1.0f64.copysign(error);
        let mut own = self.load_column(lanes, dictionary, atom);
        let (mut start, mut exchanges) = (0.0, 0);
        let left = loop {
            let left = self.find_direction(lanes, dictionary, own);
            if self.accuracy == Accuracy::Rough && !(left > ROUGH_SHARE * own) {
                self.make_exact(lanes, dictionary);
                own = self.load_column(lanes, dictionary, atom);
                continue;
            }
            if left > LEAST_INDEPENDENT_SHARE * own || exchanges == MOST_EXCHANGES {
                break left;
            }
            let Some(reached) = self.exchange(lanes, sign) else { return Added::Failed };
            exchanges += 1;
            start += reached * sign;
        };
        if left.is_nan() || left <= LEAST_INDEPENDENT_SHARE * own {
            return Added::Failed;
        }
        self.insert(lanes, atom, start, sign, left);
        // With the direction extended by −1 for the new member, one formula for all.
        let step = error / left;
        let mut flips = false;
        for v in 0..self.chunks() {
            for lane in 0..16 {
                self.target[v][lane] = self.values[v][lane] - step * self.direction[v][lane];
                flips |= self.target[v][lane] * self.signs[v][lane] < 0.0;
            }
        }
        if !(flips && keep_signs) {
            let chunks = self.chunks();
            self.values[..chunks].copy_from_slice(&self.target[..chunks]);
            let finite = self.values.as_flattened()[..self.places].iter().all(|v| v.is_finite());
            return match (finite, exchanges > 0) {
                (false, _) => Added::Failed,
                (true, false) => Added::Along(step),
                (true, true) => Added::Otherwise,
            };
        }
        if self.move_to_target(lanes, keep_signs) { Added::Otherwise } else { Added::Failed }
    }

    /// Widens the entering atom; returns its square.
    #[inline(always)]
    fn load_column<S: Lanes>(&mut self, lanes: S, dictionary: &Prepared, atom: u32) -> f64 {
        let atom = dictionary.padded_atom(atom as usize);
        self.column.resize(atom.len(), [0.0; 16]);
        for (to, from) in self.column.iter_mut().zip(atom) {
            lanes.wide_store(to, lanes.wide(from));
        }
        gap::inner_product(lanes, atom, &self.column)
    }

    /// Puts G_SS⁻¹g into `direction`, g the inner products of the entering atom with the members, and what the support
    /// leaves of the atom into `rest`; returns the square of that.
    #[inline(always)]
    fn find_direction<S: Lanes>(&mut self, lanes: S, dictionary: &Prepared, own: f64) -> f64 {
        self.find_overlaps(lanes, dictionary);
        multiply(lanes, &self.inverse, self.stride, self.places, &self.overlap, &mut self.direction);
        let left = self.find_rest(lanes, dictionary);
        self.surely_left(dictionary, own, left)
    }

    /// What the support leaves of an entering atom of square `own`, of which `left` was found to be left.
    fn surely_left(&mut self, dictionary: &Prepared, own: f64, left: f64) -> f64 {
        if left > DOUBTFUL_SHARE * own || self.places == 0 {
            return left;
        }
        dispatch(dictionary.simd(), ImproveDirection { support: self, dictionary })
    }

    /// Inner products of the entering atom with the members.
    #[inline(always)]
    fn find_overlaps<S: Lanes>(&mut self, lanes: S, dictionary: &Prepared) {
        for place in 0..self.places {
            let atom = self.atoms[place];
            self.overlap.as_flattened_mut()[place] = if atom == NO_ATOM {
                0.0
            } else {
                gap::inner_product(lanes, dictionary.padded_atom(atom as usize), &self.column)
            };
        }
    }

    /// What the support leaves of the entering atom, given the direction; returns its square.
    #[inline(always)]
    fn find_rest<S: Lanes>(&mut self, lanes: S, dictionary: &Prepared) -> f64 {
        let mut rest = std::mem::take(&mut self.rest);
        rest.resize(self.column.len(), [0.0; 16]);
        subtract_atoms(
            lanes,
            dictionary,
            &self.atoms,
            self.direction.as_flattened(),
            Begin::Wide(&self.column),
            &mut rest,
        );
        let mut square = lanes.wide_splat(0.0);
        for rest in &rest {
            square = lanes.wide_fma(lanes.wide_load(rest), lanes.wide_load(rest), square);
        }
        self.rest = rest;
        lanes.wide_sum(square)
    }

    /// Makes the inverse anew, of inner products in f64; members that depend on others leave.
    #[inline(always)]
    pub fn make_exact<S: Lanes>(&mut self, lanes: S, dictionary: &Prepared) {
        if self.accuracy == Accuracy::Exact {
            return;
        }
        let members: Vec<(u32, f64, f64)> =
            self.members().zip(self.member_signs()).map(|((atom, value), sign)| (atom, value, sign)).collect();
        self.clear();
        self.accuracy = Accuracy::Exact;
        for (atom, value, sign) in members {
            let own = self.load_column(lanes, dictionary, atom);
            let left = self.find_direction(lanes, dictionary, own);
            if left > LEAST_INDEPENDENT_SHARE * own {
                self.insert(lanes, atom, value, sign, left);
            }
        }
    }

    fn member_signs(&self) -> impl Iterator<Item = f64> + '_ {
        let signs = self.atoms.iter().zip(self.signs.as_flattened());
        signs.filter(|(atom, _)| **atom != NO_ATOM).map(|(_, sign)| *sign)
    }

    /// Puts G_SS⁻¹g into `direction` for the overlaps g; returns their inner product with it.
    #[inline(always)]
    fn direction_of_overlap<S: Lanes>(&mut self, lanes: S) -> f64 {
        multiply(lanes, &self.inverse, self.stride, self.places, &self.overlap, &mut self.direction);
        let mut sum = lanes.wide_splat(0.0);
        for v in 0..self.chunks() {
            sum = lanes.wide_fma(lanes.wide_load(&self.overlap[v]), lanes.wide_load(&self.direction[v]), sum);
        }
        lanes.wide_sum(sum)
    }

    /// Moves the values along the null direction of a dependent atom until the first member is zero, which leaves.
    /// Returns the size that the entering atom has there; none when no member comes to zero.
    #[inline(always)]
    fn exchange<S: Lanes>(&mut self, lanes: S, sign: f64) -> Option<f64> {
        let (mut t, mut first) = (f64::INFINITY, usize::MAX);
        for place in 0..self.places {
            let rate = sign * self.direction.as_flattened()[place] * self.signs.as_flattened()[place];
            let value = self.values.as_flattened()[place].abs();
            if rate > 1e-12 && value / rate < t {
                (t, first) = (value / rate, place);
            }
        }
        if first == usize::MAX {
            return None;
        }
        for v in 0..self.chunks() {
            for lane in 0..16 {
                self.values[v][lane] -= t * sign * self.direction[v][lane];
            }
        }
        self.remove(lanes, first);
        Some(t)
    }

    /// Gives an atom a place, and extends `direction` by −1 there and the inverse by its row and column.
    #[inline(always)]
    fn insert<S: Lanes>(&mut self, lanes: S, atom: u32, value: f64, sign: f64, left: f64) -> usize {
        let place = self.atoms[..self.places].iter().position(|&a| a == NO_ATOM).unwrap_or(self.places);
        self.reserve(place + 1);
        if place == self.places {
            self.places += 1;
            self.atoms.push(NO_ATOM);
        }
        self.atoms[place] = atom;
        self.values.as_flattened_mut()[place] = value;
        self.signs.as_flattened_mut()[place] = sign;
        for v in self.chunks() - 1..self.stride {
            for lane in 0..16 {
                if 16 * v + lane >= self.places {
                    self.direction[v][lane] = 0.0;
                }
            }
        }
        self.direction.as_flattened_mut()[place] = -1.0;
        add_square(lanes, &mut self.inverse, self.stride, self.places, &self.direction, 1.0 / left);
        place
    }

    /// Moves to `target`; with `keep_signs` members that would change sign leave on the way.
    #[inline(always)]
    fn move_to_target<S: Lanes>(&mut self, lanes: S, keep_signs: bool) -> bool {
        for _ in 0..4 * self.places + 4 {
            let (mut t, mut first) = (1.0f64, usize::MAX);
            if keep_signs {
                for place in 0..self.places {
                    let (from, to) = (self.values.as_flattened()[place], self.target.as_flattened()[place]);
                    if to * self.signs.as_flattened()[place] < 0.0 {
                        let crossing = (from / (from - to)).clamp(0.0, 1.0);
                        if crossing < t || first == usize::MAX {
                            (t, first) = (crossing, place);
                        }
                    }
                }
            }
            if first == usize::MAX {
                let chunks = self.chunks();
                self.values[..chunks].copy_from_slice(&self.target[..chunks]);
                return self.values.as_flattened()[..self.places].iter().all(|v| v.is_finite());
            }
            for v in 0..self.chunks() {
                for lane in 0..16 {
                    self.values[v][lane] += t * (self.target[v][lane] - self.values[v][lane]);
                }
            }
            self.remove(lanes, first);
        }
        false
    }

    /// Removes the member at a place, and moves `target` to the minimum without it.
    #[inline(always)]
    fn remove<S: Lanes>(&mut self, lanes: S, place: usize) {
        let chunks = self.chunks();
        self.direction[..chunks].copy_from_slice(&self.inverse[place * self.stride..][..chunks]);
        let scale = 1.0 / self.direction.as_flattened()[place];
        let excess = self.target.as_flattened()[place] * scale;
        for v in 0..chunks {
            for lane in 0..16 {
                self.target[v][lane] -= excess * self.direction[v][lane];
            }
        }
        add_square(lanes, &mut self.inverse, self.stride, self.places, &self.direction, -scale);
        for row in 0..self.places {
            self.inverse[row * self.stride + place / 16][place % 16] = 0.0;
        }
        self.inverse[place * self.stride..][..self.stride].fill([0.0; 16]);
        self.atoms[place] = NO_ATOM;
        for row in [&mut self.values, &mut self.signs, &mut self.target, &mut self.errors] {
            row.as_flattened_mut()[place] = 0.0;
        }
    }
}

/// Takes the part that lies in the span of the support once more out of the rest of the entering atom; returns the square of
/// what is left. A kernel of its own, since it is seldom needed.
struct ImproveDirection<'a> {
    support: &'a mut Support,
    dictionary: &'a Prepared,
}

impl Kernel for ImproveDirection<'_> {
    type Out = f64;
    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) -> f64 {
        let ImproveDirection { support, dictionary } = self;
        let found = support.direction.clone();
        let column = std::mem::replace(&mut support.column, support.rest.clone());
        support.find_overlaps(lanes, dictionary);
        support.column = column;
        multiply(lanes, &support.inverse, support.stride, support.places, &support.overlap, &mut support.direction);
        for (to, first) in support.direction.as_flattened_mut().iter_mut().zip(found.as_flattened()) {
            *to += first;
        }
        support.find_rest(lanes, dictionary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::kernel::simd::Simd;
    use crate::sparse::prepared::prepare;
    use ndarray::Array2;

    /// A kernel on the fastest lanes of this processor.
    struct Each<'a>(&'a Prepared);

    impl Kernel for Each<'_> {
        type Out = ();
        fn run<S: Lanes>(self, lanes: S) {
            errors_are_those_of_the_residual(lanes, self.0);
            an_entering_atom_moves_along_what_is_left_of_it(lanes, self.0);
            a_dependent_atom_takes_a_place_of_sixteen(lanes, self.0);
            the_first_to_change_sign_leaves(lanes, self.0);
            what_an_inverse_is_wrong_by_is_no_independence(lanes, self.0);
        }
    }

    /// Sixteen unit vectors, (e₀ + e₁)/√2, and two with the inner product −1/2 in two more dimensions.
    fn dictionary() -> Prepared {
        let mut atoms = Array2::<f32>::eye(18);
        let s = 0.5f32.sqrt();
        (atoms[[16, 16]], atoms[[16, 0]], atoms[[16, 1]]) = (0.0, s, s);
        (atoms[[17, 17]], atoms[[17, 2]]) = (0.75f32.sqrt(), -0.5);
        prepare(atoms.view()).unwrap()
    }

    /// The internal number of one of the caller's atoms.
    fn number(dictionary: &Prepared, atom: u32) -> u32 {
        (0..dictionary.atom_count() as u32).find(|&k| dictionary.outside(k) == atom).unwrap()
    }

    fn value(support: &Support, atom: u32) -> Option<f64> {
        support.members().find(|m| m.0 == atom).map(|m| m.1)
    }

    fn errors_are_those_of_the_residual<S: Lanes>(lanes: S, dictionary: &Prepared) {
        let mut support = Support::default();
        let [one, two] = [3, 4].map(|k| number(dictionary, k));
        assert!(support.take(lanes, dictionary, one, 0.5) && support.take(lanes, dictionary, two, -0.5));
        let mut residual = [[0.0; 16]; 2];
        (residual[0][3], residual[0][4]) = (0.25, -0.75);
        assert_eq!(support.record_errors(lanes, dictionary, &residual, 0.125, false), 0.75);
        assert_eq!(support.errors.as_flattened()[..2], [0.125, -0.625]);
        assert_eq!(support.record_errors(lanes, dictionary, &residual, 0.125, true), 0.25);
        // One step for one member is enough.
        assert!(support.correct_values(lanes, true));
        assert_eq!((value(&support, one), value(&support, two)), (Some(0.625), Some(-1.125)));
        let mut single = Support::default();
        assert!(single.take(lanes, dictionary, one, 0.5));
        single.record_errors(lanes, dictionary, &residual, 0.125, false);
        assert!(single.correct_values(lanes, true));
        assert_eq!(value(&single, one), Some(0.625));
    }

    fn an_entering_atom_moves_along_what_is_left_of_it<S: Lanes>(lanes: S, dictionary: &Prepared) {
        let mut support = Support::default();
        let [one, two] = [2, 17].map(|k| number(dictionary, k));
        assert!(matches!(support.add(lanes, dictionary, one, 0.5, true), Added::Along(step) if step == 0.5));
        // The square of what is left is 3/4, and the first member moves by half of the second's value.
        let Added::Along(step) = support.add(lanes, dictionary, two, 0.375, true) else { panic!("no step") };
        assert!((step - 0.5).abs() < 1e-6);
        assert!((value(&support, one).unwrap() - 0.75).abs() < 1e-6);
        assert!((value(&support, two).unwrap() - 0.5).abs() < 1e-6);
    }

    fn a_dependent_atom_takes_a_place_of_sixteen<S: Lanes>(lanes: S, dictionary: &Prepared) {
        let mut support = Support::default();
        for k in 0..16 {
            let v = if k == 1 { 0.25 } else { 0.5 };
            assert!(support.take(lanes, dictionary, number(dictionary, k), v));
        }
        let both = number(dictionary, 16);
        assert!(!support.take(lanes, dictionary, both, 1.0));
        // e₁ comes to zero first; e₀ gives as much, and what the error asks for moves all three by little.
        assert!(matches!(support.add(lanes, dictionary, both, 1e-9, true), Added::Otherwise));
        assert_eq!(value(&support, number(dictionary, 1)), None);
        assert!((value(&support, both).unwrap() - 0.25 * 2f64.sqrt()).abs() < 1e-6);
        assert!((value(&support, number(dictionary, 0)).unwrap() - 0.25).abs() < 1e-6);
        assert_eq!(support.members().count(), 16);
    }

    fn the_first_to_change_sign_leaves<S: Lanes>(lanes: S, dictionary: &Prepared) {
        let mut support = Support::default();
        let [one, two] = [2, 17].map(|k| number(dictionary, k));
        assert!(support.take(lanes, dictionary, one, 1.0) && support.take(lanes, dictionary, two, 1.0));
        // To (−1, −0.1): the first is at zero half way, and without it the other stays above zero, at −0.1 + 0.5.
        support.errors[0][..2].copy_from_slice(&[-2.0 + 0.5 * 1.1, 0.5 * 2.0 - 1.1]);
        assert!(support.correct_values(lanes, true));
        assert_eq!(value(&support, one), None);
        assert!((value(&support, two).unwrap() - 0.4).abs() < 1e-6);
    }

    fn what_an_inverse_is_wrong_by_is_no_independence<S: Lanes>(lanes: S, dictionary: &Prepared) {
        let mut support = Support::default();
        let [one, two, both] = [0, 1, 16].map(|k| number(dictionary, k));
        support.accuracy = Accuracy::Exact;
        assert!(support.take(lanes, dictionary, one, 0.5) && support.take(lanes, dictionary, two, 0.5));
        support.inverse[0][0] *= 1.0001;
        // Of e₀ + e₁ this leaves 5e-9 of its square.
        assert!(!support.take(lanes, dictionary, both, 1.0));
        let own = support.load_column(lanes, dictionary, both);
        let left = support.find_direction(lanes, dictionary, own);
        assert!(left < 1e-15, "{left}");
        let far = support.direction[0][..2].iter().map(|d| (d - 0.5f64.sqrt()).abs()).fold(0.0, f64::max);
        assert!(far < 1e-6, "{far}");
    }

    #[test]
    fn the_support_moves_as_it_should() {
        let dictionary = dictionary();
        dispatch(Simd::best(), Each(&dictionary));
        dispatch(Simd::Plain, Each(&dictionary));
    }
}
