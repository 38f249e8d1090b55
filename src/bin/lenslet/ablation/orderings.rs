//! The orderings that the paper reports and those of this project's methods, each with its margin: a mean over seeds of
//! paired differences.

use std::collections::BTreeMap;

use serde::Serialize;

use super::record::Record;
use super::table::{Cell, summarise};

/// One that must hold: in this experiment and on this subject, `better` scores more than `worse`.
#[derive(Debug, Clone, Copy)]
struct Ordering {
    experiment: &'static str,
    better: &'static str,
    worse: &'static str,
}

const fn over(experiment: &'static str, better: &'static str, worse: &'static str) -> Ordering {
    Ordering { experiment, better, worse }
}

const ORDERINGS: [Ordering; 10] = [
    over("calibration", "full", "rotation only"),
    over("calibration", "rotation only", "none"),
    over("subpixel", "lattice and residual", "whole pixels"),
    over("subpixel", "paraboloids", "whole pixels"),
    over("subpixel", "lattice and residual", "paraboloids"),
    over("resampling", "barycentric", "bicubic"),
    over("resampling", "cubic", "barycentric"),
    over("resampling", "multiview", "barycentric"),
    over("resampling", "learned", "barycentric"),
    over("resampling", "learned on multiview", "multiview"),
];

/// Orderings whose failure is a failure of the program; the others are reported as they are.
const MUST: [(&str, &str); 5] = [
    ("full", "none"),
    ("lattice and residual", "whole pixels"),
    ("barycentric", "bicubic"),
    ("learned", "barycentric"),
    ("learned on multiview", "multiview"),
];

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
    /// The score compared: PSNR of the middle view, or of hidden lenslets.
    pub score: String,
    /// Paired differences, dB.
    pub margin: Cell,
    /// Whether the mean difference is above zero.
    pub holds: bool,
    /// Whether the program fails when it does not.
    pub must: bool,
}

/// The verdict on every ordering whose two rows the records have. `must` is set on the scene `natural` only.
pub fn judge_orderings(records: &[Record]) -> Vec<Verdict> {
    let all = ORDERINGS.into_iter().chain([over("calibration", "full", "none")]);
    all.flat_map(|o| judge_ordering(o, records)).collect()
}

fn judge_ordering(ordering: Ordering, records: &[Record]) -> Vec<Verdict> {
    let Ordering { experiment, better, worse } = ordering;
    let mut verdicts = Vec::new();
    for score in ["psnr", "hidden_psnr"] {
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
                let must = subject == "natural" && MUST.contains(&(better, worse));
                verdicts.push(Verdict {
                    experiment: experiment.into(),
                    subject: subject.into(),
                    better: better.into(),
                    worse: worse.into(),
                    score: score.into(),
                    margin,
                    holds: margin.mean > 0.0,
                    must,
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
        .filter(|v| v.must && !v.holds)
        .map(|v| {
            format!(
                "{}: {} is not over {} on {} ({:+.2} dB)",
                v.experiment, v.better, v.worse, v.subject, v.margin.mean
            )
        })
        .collect();
    for (better, worse) in MUST {
        let experiment =
            ORDERINGS.iter().find(|o| (o.better, o.worse) == (better, worse)).map_or("calibration", |o| o.experiment);
        let judged = verdicts.iter().any(|v| v.must && v.better == better && v.worse == worse);
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

    #[test]
    fn margins_are_paired_by_seed() {
        let records = [
            record("resampling", "bicubic", 1, Some(20.0)),
            record("resampling", "bicubic", 2, Some(30.0)),
            record("resampling", "barycentric", 1, Some(21.0)),
            record("resampling", "barycentric", 2, Some(31.5)),
            record("resampling", "learned", 1, Some(20.5)),
            record("resampling", "learned", 2, None),
            record("resampling", "multiview", 1, Some(25.0)),
            record("resampling", "learned on multiview", 1, Some(26.0)),
        ];
        let verdicts = judge_orderings(&records);
        let find = |b: &str| verdicts.iter().find(|v| v.better == b).unwrap();
        assert!(find("barycentric").holds && find("barycentric").must);
        assert_eq!((find("barycentric").margin.mean, find("barycentric").margin.n), (1.25, 2));
        assert_eq!((find("learned").margin.mean, find("learned").margin.n, find("learned").holds), (-0.5, 1, false));
        let broken = super::broken_orderings(&verdicts, &records);
        assert!(broken.iter().any(|b| b.contains("learned is not over barycentric")), "{broken:?}");
        assert_eq!(broken.len(), 1);
        // An experiment in the records without the rows that must be compared counts as a failure.
        let broken = super::broken_orderings(&super::judge_orderings(&records[..4]), &records[..4]);
        assert!(broken.iter().any(|b| b.contains("learned and barycentric could not")), "{broken:?}");
    }
}
