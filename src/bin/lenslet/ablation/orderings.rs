//! The orderings that the paper reports and those of this project's methods, each with its margin: a mean over seeds of
//! paired differences.

use std::collections::BTreeMap;

use serde::Serialize;

use super::record::Record;
use super::table::{Cell, summarise};

/// That `better` scores more than `worse` in an experiment.
#[derive(Debug, Clone, Copy)]
struct Ordering {
    experiment: &'static str,
    better: &'static str,
    worse: &'static str,
    /// By how much the mean must be more, dB, on the scenes of [`JUDGED`], by a failure of the program otherwise.
    /// `None`: it is reported as it is.
    least: Option<[f64; JUDGED.len()]>,
}

/// The scenes on which orderings must hold; experiments without the second are judged on the first.
const JUDGED: [&str; 2] = ["natural", "photos"];

const fn over(experiment: &'static str, better: &'static str, worse: &'static str) -> Ordering {
    Ordering { experiment, better, worse, least: None }
}

const fn must(
    experiment: &'static str,
    better: &'static str,
    worse: &'static str,
    least: [f64; JUDGED.len()],
) -> Ordering {
    Ordering { experiment, better, worse, least: Some(least) }
}

/// Every ordering. The least margins are half of what
/// `lenslet ablate --quick --experiment calibration subpixel resampling` measured (luminance; natural, photos).
const ORDERINGS: [Ordering; 22] = [
    over("calibration", "full", "rotation only"),
    over("calibration", "rotation only", "none"),
    must("calibration", "full", "none", [1.90, 0.00]),
    must("subpixel", "lattice and residual", "whole pixels", [0.15, 0.00]),
    over("subpixel", "paraboloids", "whole pixels"),
    over("subpixel", "lattice and residual", "paraboloids"),
    must("resampling", "barycentric", "bicubic", [1.07, 0.94]),
    must("resampling", "cubic", "barycentric", [0.93, 0.60]),
    over("resampling", "multiview", "barycentric"),
    must("resampling", "multiview", "cubic", [2.00, 2.30]),
    must("resampling", "LASSO", "barycentric", [1.17, 1.00]),
    must("resampling", "LASSO", "cubic", [0.23, 0.40]),
    must("resampling", "LASSO", "no codes", [0.62, 0.47]),
    must("resampling", "LASSO", "ridge", [0.38, 0.29]),
    must("resampling", "anchored", "ridge", [0.33, 0.32]),
    must("resampling", "network", "ridge", [0.34, 0.22]),
    must("resampling", "ridge", "no codes", [0.23, 0.18]),
    // On refined views of the drawn scene codes and anchors lower the score (by 0.24 and 0.07 dB): bounds on the harm.
    must("resampling", "LASSO on multiview", "no codes on multiview", [-0.40, 0.20]),
    // One linear filter is worth nothing on refined views.
    over("resampling", "ridge on multiview", "no codes on multiview"),
    must("resampling", "anchored on multiview", "no codes on multiview", [-0.20, 0.10]),
    must("resampling", "network on multiview", "no codes on multiview", [0.45, 0.95]),
    must("resampling", "network on multiview", "multiview", [0.48, 0.97]),
];

/// The least margin that counts besides the spread, dB.
/// Source: chosen: half of the last digit that tables show.
const LEAST: f64 = 0.005;

/// How an ordering came out.
#[derive(Debug, Clone, Serialize)]
pub struct Verdict {
    /// Experiment.
    pub experiment: String,
    /// Scene or file.
    pub subject: String,
    /// What should score more.
    pub better: String,
    /// What should score less.
    pub worse: String,
    /// The score compared: PSNR of the middle view's luminance, or of hidden lenslets.
    pub score: String,
    /// Paired differences, dB.
    pub margin: Cell,
    /// Whether the mean difference is above 0.005 dB and above two standard errors.
    pub holds: bool,
    /// Whether it is beyond these the other way.
    pub reversed: bool,
    /// The mean below which the program fails, where it does.
    pub least: Option<f64>,
    /// Whether the program fails below it.
    pub must: bool,
}

impl Verdict {
    /// In words.
    pub fn name(&self) -> &'static str {
        match (self.holds, self.reversed) {
            (true, _) => "holds",
            (_, true) => "does not hold",
            _ => "within the spread",
        }
    }

    /// The mean below which the program fails, as tables show it; nothing where there is none.
    pub fn least_text(&self) -> String {
        self.least.map(|least| format!("{least:.2}")).unwrap_or_default()
    }

    /// Whether it had to hold by a margin, and does not.
    fn is_broken(&self) -> bool {
        self.least.is_some_and(|least| self.margin.mean <= least)
    }
}

/// Whether a mean is more than 0.005 dB and, where there are several values, two standard errors.
fn is_beyond_spread(margin: &Cell) -> bool {
    margin.mean > LEAST && margin.mean > 2.0 * margin.spread / (margin.n as f64).sqrt()
}

/// The verdict on every ordering whose two rows the records have.
pub fn judge_orderings(records: &[Record]) -> Vec<Verdict> {
    ORDERINGS.into_iter().flat_map(|o| judge_ordering(o, records)).collect()
}

fn judge_ordering(ordering: Ordering, records: &[Record]) -> Vec<Verdict> {
    let Ordering { experiment, better, worse, least } = ordering;
    let mut verdicts = Vec::new();
    for score in ["psnr_y", "hidden_psnr"] {
        // (better, worse) of each subject and seed.
        let mut pairs: BTreeMap<&str, BTreeMap<u64, [Option<f64>; 2]>> = BTreeMap::new();
        for r in records.iter().filter(|r| r.experiment == experiment) {
            let side = usize::from(r.variant == worse);
            if r.variant == better || r.variant == worse {
                pairs.entry(&r.subject).or_default().entry(r.seed).or_default()[side] = r.scores.get(score).copied();
            }
        }
        for (subject, seeds) in pairs {
            let differences: Vec<f64> = seeds.values().filter_map(|[a, b]| Some((*a)? - (*b)?)).collect();
            if let Some(margin) = summarise(&differences) {
                let at = JUDGED.iter().position(|judged| *judged == subject);
                let least = at.and_then(|at| Some(least?[at]));
                let other_way = Cell { mean: -margin.mean, ..margin };
                verdicts.push(Verdict {
                    experiment: experiment.into(),
                    subject: subject.into(),
                    better: better.into(),
                    worse: worse.into(),
                    score: score.into(),
                    margin,
                    holds: is_beyond_spread(&margin),
                    reversed: is_beyond_spread(&other_way),
                    least,
                    must: least.is_some(),
                });
            }
        }
    }
    verdicts
}

/// Orderings that had to hold and do not, and those of an experiment in the records whose two rows are missing.
pub fn broken_orderings(verdicts: &[Verdict], records: &[Record]) -> Vec<String> {
    let mut out: Vec<String> = verdicts
        .iter()
        .filter(|v| v.is_broken())
        .map(|v| {
            format!(
                "{}: {} is not over {} on {} by {:.2} dB ({:+.2} dB)",
                v.experiment,
                v.better,
                v.worse,
                v.subject,
                v.least.unwrap_or_default(),
                v.margin.mean
            )
        })
        .collect();
    for Ordering { experiment, better, worse, .. } in ORDERINGS.into_iter().filter(|o| o.least.is_some()) {
        let judged =
            verdicts.iter().any(|v| v.must && v.experiment == experiment && v.better == better && v.worse == worse);
        if !judged && records.iter().any(|r| r.experiment == experiment) {
            out.push(format!("{experiment}: {better} and {worse} could not be compared"));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::record;
    use super::*;

    /// Records of all rows that must be compared, so far apart that every ordering holds.
    fn complete() -> Vec<Record> {
        let needed: Vec<&Ordering> = ORDERINGS.iter().filter(|o| o.least.is_some()).collect();
        // 10 dB over the best of what a row must be over.
        fn height(needed: &[&Ordering], experiment: &str, name: &str) -> f64 {
            let below = needed.iter().filter(|o| (o.experiment, o.better) == (experiment, name));
            below.map(|o| 10.0 + height(needed, experiment, o.worse)).fold(20.0, f64::max)
        }
        let mut rows: Vec<(&str, &str)> =
            needed.iter().flat_map(|o| [(o.experiment, o.better), (o.experiment, o.worse)]).collect();
        rows.sort_unstable();
        rows.dedup();
        let record = |&(experiment, name): &(&str, &str)| {
            let psnr = height(&needed, experiment, name);
            [1, 2].map(|seed| record(experiment, name, seed, Some(psnr + 0.1 * seed as f64)))
        };
        rows.iter().flat_map(record).collect()
    }

    #[test]
    fn margins_are_paired_by_seed_and_must_reach_their_least() {
        let mut records = complete();
        let verdicts = judge_orderings(&records);
        assert_eq!(broken_orderings(&verdicts, &records), [""; 0]);
        let find = |verdicts: &[Verdict], better: &str, worse: &str| {
            verdicts.iter().find(|v| v.better == better && v.worse == worse).unwrap().clone()
        };
        let bicubic = find(&verdicts, "barycentric", "bicubic");
        assert!(bicubic.holds && bicubic.must && bicubic.margin.n == 2 && bicubic.margin.spread < 1e-9);
        // A dictionary whose codes are zero scores what no codes score.
        let of = |records: &[Record], name: &str, seed| {
            records.iter().find(|r| r.variant == name && r.seed == seed).unwrap().scores["psnr_y"]
        };
        let zero = [of(&records, "no codes", 1), of(&records, "no codes", 2)];
        for r in records.iter_mut().filter(|r| r.variant == "LASSO") {
            r.scores.insert("psnr_y".into(), zero[r.seed as usize - 1]);
        }
        let verdicts = judge_orderings(&records);
        let broken = broken_orderings(&verdicts, &records);
        assert!(broken.iter().any(|b| b.contains("LASSO is not over no codes on natural")), "{broken:?}");
        let lasso = find(&verdicts, "LASSO", "no codes");
        assert!(!lasso.holds && !lasso.reversed && lasso.name() == "within the spread");
        // An experiment in the records without the rows that must be compared counts as a failure.
        let some = &records[..2];
        let broken = broken_orderings(&judge_orderings(some), some);
        assert!(broken.iter().any(|b| b.contains("could not be compared")), "{broken:?}");
    }

    #[test]
    fn what_holds_is_beyond_the_spread() {
        let cell = |mean, spread, n| Cell { mean, spread, n };
        assert!(is_beyond_spread(&cell(0.3, 0.2, 4)) && !is_beyond_spread(&cell(0.1, 0.2, 4)));
        assert!(!is_beyond_spread(&cell(0.004, 0.0, 2)) && is_beyond_spread(&cell(0.006, 0.0, 1)));
    }
}
