//! The orderings that the paper reports and those of this project's methods, each with its margin: a mean over seeds of
//! paired differences; on real captures paired differences at rays or raw pixels, with their standard error.

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
    must("resampling", "barycentric", "bicubic", [0.62, 0.53]),
    must("resampling", "cubic", "barycentric", [0.56, 0.41]),
    over("resampling", "multiview", "barycentric"),
    must("resampling", "multiview", "cubic", [2.34, 2.44]),
    must("resampling", "LASSO", "barycentric", [1.21, 0.87]),
    must("resampling", "LASSO", "cubic", [0.65, 0.45]),
    must("resampling", "LASSO", "no codes", [0.43, 0.19]),
    must("resampling", "LASSO", "ridge", [0.32, 0.23]),
    must("resampling", "anchored", "ridge", [0.18, 0.18]),
    must("resampling", "network", "ridge", [0.29, 0.22]),
    // One linear filter lowers the score on photographs (by 0.08 dB): a bound on the harm.
    must("resampling", "ridge", "no codes", [0.11, -0.16]),
    // On refined views codes lower the score (by 0.03 and 0.06 dB): a bound on the harm.
    must("resampling", "LASSO on multiview", "no codes on multiview", [-0.06, -0.12]),
    // One linear filter is worth nothing on refined views.
    over("resampling", "ridge on multiview", "no codes on multiview"),
    // On photographs, which are sharper and have less noise than what they were trained on, anchored regressors lower the
    // score (by 0.33 dB).
    must("resampling", "anchored on multiview", "no codes on multiview", [0.04, -0.66]),
    must("resampling", "network on multiview", "no codes on multiview", [0.53, 0.17]),
    must("resampling", "network on multiview", "multiview", [0.52, 0.08]),
];

/// What is asked of two rows on real captures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    /// The first is over the second, beyond the standard error.
    Over,
    /// The first is not below the second by more than [`EQUAL`], beyond the standard error.
    NotBelow,
    /// Nothing: it is reported.
    Nothing,
}

/// That of two rows on real captures; of calibrations at raw pixels, of methods at rays.
const REAL: [(&str, &str, &str, Asked); 9] = [
    ("calibration", "full", "none", Asked::Over),
    ("calibration", "rotation only", "none", Asked::Over),
    // A lattice without scatter has nothing that rotation and pitch do not tell.
    ("calibration", "full", "rotation only", Asked::NotBelow),
    ("subpixel", "lattice and residual", "whole pixels", Asked::Over),
    ("subpixel", "lattice and residual", "paraboloids", Asked::Over),
    // Equal on dark captures, where noise outweighs detail.
    ("resampling", "barycentric", "bicubic", Asked::Nothing),
    ("resampling", "multiview", "barycentric", Asked::Over),
    ("resampling", "network on multiview", "barycentric", Asked::Over),
    ("resampling", "network on multiview", "multiview", Asked::Nothing),
];

/// Difference on real captures within which two rows count as equal, dB.
/// Source: docs/assessing.md: a calibration's smooth warp moves the raw score by as much.
const EQUAL: f64 = 0.05;

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
    /// The score compared: PSNR of the middle view's luminance; of real captures at rays or raw pixels.
    pub score: String,
    /// Paired differences, dB.
    pub margin: Cell,
    /// Standard error of a real capture's difference; at most that, where neither row is the reference of the other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
    /// Whether the mean difference is above 0.005 dB and above two standard errors.
    pub holds: bool,
    /// Whether it is beyond these the other way.
    pub reversed: bool,
    /// The mean below which the program fails, where it does.
    pub least: Option<f64>,
    /// Whether the program fails below it.
    pub must: bool,
    /// Whether it had to hold and does not.
    pub broken: bool,
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
}

/// Whether a mean is more than 0.005 dB and, where there are several values, two standard errors.
fn is_beyond_spread(margin: &Cell) -> bool {
    margin.mean > LEAST && margin.mean > 2.0 * margin.spread / (margin.n as f64).sqrt()
}

/// The verdict on every ordering whose two rows the records have.
pub fn judge_orderings(records: &[Record]) -> Vec<Verdict> {
    let simulated = ORDERINGS.into_iter().flat_map(|o| judge_ordering(o, records));
    simulated.chain(REAL.into_iter().flat_map(|o| judge_on_captures(o, records))).collect()
}

/// The scores over the reference and its standard error that an experiment's real captures have.
fn real_score(experiment: &str) -> [&'static str; 2] {
    if experiment == "resampling" { ["rays_over", "rays_over_error"] } else { ["raw_over", "raw_over_error"] }
}

fn judge_on_captures(
    (experiment, better, worse, asked): (&str, &str, &str, Asked),
    records: &[Record],
) -> Vec<Verdict> {
    let [score, error] = real_score(experiment);
    let of = |r: &Record| Some([*r.scores.get(score)?, *r.scores.get(error)?]);
    let row = |name: &str, subject: &str| {
        let mut own =
            records.iter().filter(|r| r.experiment == experiment && r.variant == name && r.subject == subject);
        own.find_map(of)
    };
    captures_in(experiment, records)
        .into_iter()
        .filter_map(|subject| {
            let ([a, a_error], [b, b_error]) = (row(better, subject)?, row(worse, subject)?);
            let (mean, error) = (a - b, a_error.hypot(b_error));
            let least = match asked {
                Asked::Over => Some(LEAST),
                Asked::NotBelow => Some(-EQUAL),
                Asked::Nothing => None,
            };
            let holds = match asked {
                Asked::NotBelow => mean > -EQUAL - 2.0 * error,
                _ => mean > LEAST && mean > 2.0 * error,
            };
            Some(Verdict {
                experiment: experiment.into(),
                subject: subject.into(),
                better: better.into(),
                worse: worse.into(),
                score: score.into(),
                margin: Cell { mean, spread: 0.0, n: 1 },
                error: Some(error),
                holds,
                reversed: -mean > LEAST && -mean > 2.0 * error && !holds,
                least,
                must: least.is_some(),
                broken: least.is_some() && !holds,
            })
        })
        .collect()
}

/// The real captures among an experiment's records.
fn captures_in<'a>(experiment: &str, records: &'a [Record]) -> Vec<&'a str> {
    let [score, _] = real_score(experiment);
    let measured = records.iter().filter(|r| r.experiment == experiment && r.scores.contains_key(score));
    let mut subjects: Vec<&str> = measured.map(|r| r.subject.as_str()).collect();
    subjects.sort_unstable();
    subjects.dedup();
    subjects
}

fn judge_ordering(ordering: Ordering, records: &[Record]) -> Vec<Verdict> {
    let Ordering { experiment, better, worse, least } = ordering;
    let mut verdicts = Vec::new();
    let score = "psnr_y";
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
                error: None,
                holds: is_beyond_spread(&margin),
                reversed: is_beyond_spread(&other_way),
                least,
                must: least.is_some(),
                broken: least.is_some_and(|least| margin.mean <= least),
            });
        }
    }
    verdicts
}

/// Orderings that had to hold and do not, and those of an experiment in the records whose two rows are missing.
pub fn broken_orderings(verdicts: &[Verdict], records: &[Record]) -> Vec<String> {
    let mut out: Vec<String> = verdicts
        .iter()
        .filter(|v| v.broken)
        .map(|v| {
            format!(
                "{}: {} is not over {} on {} by {:.2} dB ({:+.2} dB{})",
                v.experiment,
                v.better,
                v.worse,
                v.subject,
                v.least.unwrap_or_default(),
                v.margin.mean,
                v.error.map(|e| format!(", standard error {e:.2}")).unwrap_or_default()
            )
        })
        .collect();
    for Ordering { experiment, better, worse, .. } in ORDERINGS.into_iter().filter(|o| o.least.is_some()) {
        let judged = verdicts.iter().any(|v| {
            v.must && v.error.is_none() && v.experiment == experiment && v.better == better && v.worse == worse
        });
        if !judged && records.iter().any(|r| r.experiment == experiment) {
            out.push(format!("{experiment}: {better} and {worse} could not be compared"));
        }
    }
    for (experiment, better, worse, _) in REAL.into_iter().filter(|o| o.3 != Asked::Nothing) {
        for subject in captures_in(experiment, records) {
            let judged = verdicts.iter().any(|v| {
                (v.experiment.as_str(), v.subject.as_str()) == (experiment, subject)
                    && (v.better.as_str(), v.worse.as_str()) == (better, worse)
                    && v.error.is_some()
            });
            if !judged {
                out.push(format!("{experiment}: {better} and {worse} could not be compared on {subject}"));
            }
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
    fn real_captures_are_judged_by_their_standard_error() {
        let row = |name: &str, over: f64, error: f64| {
            let mut r = record("calibration", name, 1, None);
            r.subject = "IMG.jpg".into();
            r.scores = [("raw_over".to_owned(), over), ("raw_over_error".into(), error)].into();
            r
        };
        let judged = |rotation: f64, none: f64| {
            let records = [row("full", 0.0, 0.0), row("rotation only", rotation, 0.02), row("none", none, 0.05)];
            let verdicts: Vec<Verdict> = REAL.into_iter().flat_map(|o| judge_on_captures(o, &records)).collect();
            assert!(verdicts.len() == 3 && verdicts.iter().all(|v| v.must && v.error.is_some()));
            verdicts.into_iter().filter(|v| v.broken).map(|v| format!("{} {}", v.better, v.worse)).collect::<Vec<_>>()
        };
        assert_eq!(judged(0.02, -1.2), [""; 0]);
        // Rotation only above full by more than equality allows.
        assert_eq!(judged(0.2, -1.2), ["full rotation only"]);
        // Below, but not beyond two standard errors.
        assert_eq!(judged(0.0, -0.09), ["full none", "rotation only none"]);
        // A row that failed is told.
        let records = [row("full", 0.0, 0.0), row("none", -1.0, 0.05)];
        let verdicts: Vec<Verdict> = REAL.into_iter().flat_map(|o| judge_on_captures(o, &records)).collect();
        let broken = broken_orderings(&verdicts, &records);
        assert!(broken.iter().any(|b| b.contains("could not be compared on IMG.jpg")), "{broken:?}");
    }

    #[test]
    fn what_holds_is_beyond_the_spread() {
        let cell = |mean, spread, n| Cell { mean, spread, n };
        assert!(is_beyond_spread(&cell(0.3, 0.2, 4)) && !is_beyond_spread(&cell(0.1, 0.2, 4)));
        assert!(!is_beyond_spread(&cell(0.004, 0.0, 2)) && is_beyond_spread(&cell(0.006, 0.0, 1)));
    }
}
