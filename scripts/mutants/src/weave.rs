//! The text of a file with chosen mutants woven in, each behind the number that switches it on.

use std::cmp::Reverse;
use std::ops::Range;

use super::candidates::{Candidate, Form};

/// Bytes of the woven text that belong to a mutant.
pub struct Woven {
    pub number: u32,
    /// Its own text.
    pub arm: Range<usize>,
    /// The whole of the place, with all that stands inside.
    pub place: Range<usize>,
}

/// The woven text, and where its mutants are. Mutants inside of others stand in the unchanged arm only: one at a time
/// is on.
pub fn weave(text: &str, chosen: &[(u32, &Candidate)]) -> (String, Vec<Woven>) {
    let mut sorted = chosen.to_vec();
    // An outer place before its inner ones.
    sorted.sort_by_key(|(number, c)| (c.range.start, Reverse(c.range.end), *number));
    let places = sorted.chunk_by(|a, b| a.1.range == b.1.range);
    let places: Vec<Place<'_>> = places.map(|mutants| (mutants[0].1.range.clone(), mutants.to_vec())).collect();
    let mut weaver = Weaver { text, out: String::new(), woven: Vec::new() };
    weaver.write(0..text.len(), &places);
    (weaver.out, weaver.woven)
}

type Place<'a> = (Range<usize>, Vec<(u32, &'a Candidate)>);

struct Weaver<'a> {
    text: &'a str,
    out: String,
    woven: Vec<Woven>,
}

impl Weaver<'_> {
    /// Writes a piece of the text with the places inside, which are sorted, an outer one before its inner ones.
    fn write(&mut self, piece: Range<usize>, places: &[Place<'_>]) {
        let (mut at, mut k) = (piece.start, 0);
        while k < places.len() {
            let (range, mutants) = &places[k];
            let inner = places[k + 1..].iter().take_while(|(r, _)| r.start < range.end).count();
            self.out.push_str(&self.text[at..range.start]);
            self.write_place(range.clone(), mutants, &places[k + 1..k + 1 + inner]);
            at = range.end;
            k += 1 + inner;
        }
        self.out.push_str(&self.text[at..piece.end]);
    }

    fn write_place(&mut self, range: Range<usize>, mutants: &[(u32, &Candidate)], inner: &[Place<'_>]) {
        let begin = self.out.len();
        let statement = mutants[0].1.form == Form::Deletion;
        self.out.push_str(if statement { "" } else { "(" });
        let mut arms = Vec::new();
        for (number, candidate) in mutants {
            self.out.push_str(&format!("if crate::mutant_is_on({number}) {{ "));
            let arm = self.out.len();
            self.out.push_str(&candidate.replacement);
            arms.push((*number, arm..self.out.len()));
            self.out.push_str(" } else ");
        }
        self.out.push_str("{ ");
        self.write(range, inner);
        self.out.push_str(if statement { " }" } else { " })" });
        let place = begin..self.out.len();
        self.woven.extend(arms.into_iter().map(|(number, arm)| Woven { number, arm, place: place.clone() }));
    }
}

#[cfg(test)]
mod tests {
    use super::super::candidates::find_candidates;
    use super::*;

    /// The text with the mutants of the kinds in it, numbered from 1.
    fn woven(text: &str, kinds: &[&str]) -> String {
        let found = find_candidates(text).unwrap();
        let found: Vec<_> = found.iter().filter(|c| kinds.contains(&c.kind)).collect();
        weave(text, &found.into_iter().enumerate().map(|(k, c)| (k as u32 + 1, c)).collect::<Vec<_>>()).0
    }

    #[test]
    fn an_inner_mutant_stands_in_the_unchanged_arm_of_an_outer_one() {
        assert_eq!(
            woven("fn f(a: i32, b: i32) -> i32 { a * b + a }", &["arithmetic"]),
            "fn f(a: i32, b: i32) -> i32 { (if crate::mutant_is_on(2) { (a * b) - (a) } else \
             { (if crate::mutant_is_on(1) { (a) / (b) } else { a * b }) + a }) }"
        );
    }

    #[test]
    fn statements_conditions_and_comparisons() {
        assert_eq!(
            woven("fn f(a: &mut Vec<i32>) { if a.len() > 3 { a.clear(); } }", &["deletion", "condition"]),
            "fn f(a: &mut Vec<i32>) { if (if crate::mutant_is_on(1) { true } else if crate::mutant_is_on(2) { false } \
             else { a.len() > 3 }) { if crate::mutant_is_on(3) {  } else { a.clear(); } } }"
        );
        assert_eq!(
            woven("fn f(a: i32) -> bool { a < 3 }", &["comparison"]),
            "fn f(a: i32) -> bool { (if crate::mutant_is_on(1) { (a) <= (3) } else if crate::mutant_is_on(2) \
             { (a) >= (3) } else { a < 3 }) }"
        );
    }

    #[test]
    fn what_no_mutant_may_touch_stays() {
        let text = "const A: usize = 1 + 2;\nconst fn f() -> usize { 1 + 2 }\n#[cfg(test)] mod tests { fn f() { g(1 + 2); } }\n\
                    fn g(x: [f64; 2 + 1]) { let Some(1..2) = h() else { return }; Vec::with_capacity(1 + 1); }";
        assert_eq!(woven(text, &["arithmetic", "literal", "range", "condition"]), text);
    }
}
