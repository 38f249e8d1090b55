//! `lenslet ablate`: the paper's experiments as a run matrix, their tables and report, checks of the orderings.

use std::fs;
use std::path::{Path, PathBuf};

use crate::ablation::{
    self, CalibratedBy, Experiment, Record, Settings, UsedDictionaries, compare, orderings, page, record, table,
};
use lenslet_core::output::{self, Kind};
use serde_json::json;

use super::inputs::{Input, each};
use super::written::check_folder_name;
use super::{Context, Outcome, Usage, dict};

/// Run the paper's experiments: tables, pictures and a report
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet ablate --out ablation/ --quick --check
         lenslet ablate --out ablation/ --experiment resampling --calibration cam.calib --captures IMG_4.jpg

Experiments: calibration, subpixel, resampling, paper, dictionary, noise, demosaic, vignetting, views, peers (with --peer and
--truth). A run that was interrupted goes on where it stopped. Writes runs.jsonl (a line a run), tables.json, tables.csv,
tables.md, orderings.json, report.html and the pictures.")]
pub struct Args {
    /// Folder to write, or to go on with
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only these experiments (default: all)
    #[arg(long, value_name = "NAME", num_args = 1.., value_parser = parse_experiment)]
    experiment: Vec<Experiment>,
    /// A small sensor, two seeds, fewer variants: minutes instead of an hour
    #[arg(long)]
    quick: bool,
    /// Number of seeds (default: 3, with --quick 2)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100))]
    seeds: Option<u64>,
    /// White images of a real camera
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "captures", group = "calibrated_by")]
    whites: Vec<PathBuf>,
    /// Captures to calibrate a real camera from, instead of white images
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "captures", group = "calibrated_by")]
    from_captures: Vec<PathBuf>,
    /// A calibration of a real camera instead of white images; it has no variants, so that only methods are compared
    #[arg(long, value_name = "CAM.calib", requires = "captures", group = "calibrated_by")]
    calibration: Option<PathBuf>,
    /// Captures of that camera, measured without a ground truth (docs/assessing.md)
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "calibrated_by")]
    captures: Vec<PathBuf>,
    /// Dictionaries (names or files) to use instead of the embedded ones for the views that they were trained on
    #[arg(long, value_name = "NAME|FILE", num_args = 1..)]
    dictionary: Vec<PathBuf>,
    /// Photos or folders to train the dictionaries of the dictionary experiment on (default: those inside the program)
    #[arg(long, value_name = "PHOTO", num_args = 1..)]
    photos: Vec<PathBuf>,
    /// A light field decoded by another tool
    #[arg(long, value_name = "NAME=PATH", value_parser = parse_peer, requires = "truth")]
    peer: Vec<(String, PathBuf)>,
    /// The true light field of the capture the peers decoded
    #[arg(long, value_name = "LF")]
    truth: Option<PathBuf>,
    /// Fail unless the orderings that must hold do
    #[arg(long)]
    check: bool,
    /// Compare with another run's runs.jsonl (or its folder): which scores changed
    #[arg(long, value_name = "OLD")]
    against: Option<PathBuf>,
    /// Also write the tables as a Markdown page with command, machine and date
    #[arg(long, value_name = "FILE")]
    results: Option<PathBuf>,
    /// Write into a folder that holds something else, or runs of other parameters (what is there stays); replace the
    /// file of --results
    #[arg(long)]
    force: bool,
}

fn parse_experiment(text: &str) -> Result<Experiment, String> {
    text.parse()
}

fn parse_peer(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => Ok((name.to_owned(), path.into())),
        _ => Err("write NAME=PATH".to_owned()),
    }
}

impl Args {
    fn calibrated_by(&self) -> CalibratedBy {
        match &self.calibration {
            Some(file) => CalibratedBy::File(file.clone()),
            None if !self.from_captures.is_empty() => CalibratedBy::Captures(self.from_captures.clone()),
            None if !self.whites.is_empty() => CalibratedBy::Whites(self.whites.clone()),
            None => CalibratedBy::Nothing,
        }
    }
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        let calibration = self.calibration.as_deref().map(|p| (p, Input::CalibrationFile));
        let truth = self.peer.iter().map(|p| &p.1).chain(&self.truth).map(|p| (p.as_path(), Input::LightField));
        each(&self.whites, Input::WhiteImage)
            .chain(each(&self.from_captures, Input::CaptureFile))
            .chain(each(&self.captures, Input::CaptureFile))
            .chain(each(&self.dictionary, Input::Dictionary))
            .chain(each(&self.photos, Input::Photos))
            .chain(calibration)
            .chain(truth)
            .collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    let given = args.dictionary.iter().map(|name| dict::find(name)).collect::<anyhow::Result<_>>()?;
    let settings = Settings {
        experiments: args.experiment.clone(),
        quick: args.quick,
        seeds: args.seeds.unwrap_or(0),
        calibrated_by: args.calibrated_by(),
        captures: args.captures.clone(),
        dictionaries: UsedDictionaries::new(given)?,
        photos: args.photos.clone(),
        peers: args.peer.clone(),
        truth: args.truth.clone(),
    };
    if ablation::plan(&settings)?.is_empty() {
        return Err(Usage("nothing to run: peers need --peer and --truth".into()).into());
    }
    // Before the work rather than after it.
    check_folder_name(&args.out)?;
    if let Some(path) = &args.results {
        let mut inputs: Vec<&Path> = args.captures.iter().chain(&args.photos).map(PathBuf::as_path).collect();
        inputs.extend(settings.calibrated_by.files().iter().map(PathBuf::as_path));
        inputs.extend(args.truth.as_deref().into_iter().chain(args.against.as_deref()));
        inputs.extend(args.peer.iter().map(|p| p.1.as_path()));
        output::check_target(path, Kind::File, args.force, &inputs)?;
    }
    let old = args.against.as_deref().map(read_records_of).transpose()?;
    // Held to the end, so that two runs never write into one folder.
    let (done, _lock) = ablation::run(&args.out, &settings, args.force, &context.progress)?;

    let records = ablation::records(&args.out, &settings)?;
    let tables = table::tabulate(&records);
    let verdicts = orderings::judge_orderings(&records);
    let about = provenance(&records);
    ablation::write_tables(&args.out, &tables)?;
    output::replace_listed(&args.out, "orderings.json", &serde_json::to_vec_pretty(&verdicts)?)?;
    page::write_page(&args.out, &tables, &verdicts, &about)?;
    if let Some(path) = &args.results {
        output::write_file(path, args.force, results_page(&tables, &verdicts, &about).as_bytes())?;
    }
    let changes = old.map(|old| compare::compare_runs(&old, &records));
    if let Some(changes) = &changes {
        output::replace_listed(&args.out, "against.json", &serde_json::to_vec_pretty(changes)?)?;
    }
    let broken = orderings::broken_orderings(&verdicts, &records);
    if args.check && !broken.is_empty() {
        anyhow::bail!("{} of the orderings that must hold do not: {}", broken.len(), broken.join("; "));
    }

    let report = args.out.join("report.html").display().to_string();
    let mut text =
        format!("{report}: {} runs ({} new, {} without a score)", done.kept + done.made, done.made, done.failed);
    for v in verdicts.iter().filter(|v| !v.holds) {
        text += &format!(
            "\n{}: {}, {} over {} on {}, {:+.2} dB",
            v.name(),
            v.experiment,
            v.better,
            v.worse,
            v.subject,
            v.margin.mean
        );
    }
    if let Some(changes) = &changes {
        text = format!("{text}\n{}", compare::describe_changes(changes));
    }
    let json = json!({
        "report": report, "kept": done.kept, "made": done.made, "failed": done.failed,
        "tables": tables, "orderings": verdicts, "broken": broken, "changes": changes,
    });
    Ok(Outcome { json, text })
}

fn read_records_of(path: &Path) -> anyhow::Result<Vec<Record>> {
    let file = if path.is_dir() { path.join(record::FILE) } else { path.to_path_buf() };
    record::read(&file)
}

/// How the numbers were made: command, machine and date. Of paths on the command line only the last part is kept.
fn provenance(records: &[Record]) -> Vec<String> {
    let words: Vec<String> = std::env::args_os()
        .skip(1)
        .map(|a| {
            let a = a.to_string_lossy().into_owned();
            let name = |p: &str| Path::new(p).file_name().map_or(p.to_owned(), |n| n.to_string_lossy().into_owned());
            let word = match a.split_once('=') {
                Some((key, path)) => format!("{key}={}", name(path)),
                None if a.starts_with('-') => a,
                None => name(&a),
            };
            // Quoted for a shell.
            if word.contains([' ', '"', '\'', '$']) { format!("'{}'", word.replace('\'', "'\\''")) } else { word }
        })
        .collect();
    let cpu = fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|l| l.starts_with("model name"))?;
        line.split_once(':').map(|(_, name)| name.trim().to_owned())
    });
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let seconds: f64 = records.iter().map(|r| r.seconds).sum();
    vec![
        format!("lenslet {}: lenslet {}", env!("CARGO_PKG_VERSION"), words.join(" ")),
        format!(
            "{}, {cores} threads, {}; {:.0} s for {} runs",
            cpu.unwrap_or_else(|| "unknown processor".into()),
            today(),
            seconds,
            records.len()
        ),
    ]
}

/// Today (UTC) as year-month-day.
/// Source: H. Hinnant, chrono-compatible low-level date algorithms, `civil_from_days`.
fn today() -> String {
    let seconds = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let z = (seconds / 86_400) as i64 + 719_468;
    let era = z / 146_097;
    let day_of_era = z - era * 146_097;
    let year = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let (month, carry) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    format!("{}-{month:02}-{day:02}", year + era * 400 + carry)
}

/// The Markdown page.
fn results_page(tables: &[table::Table], verdicts: &[orderings::Verdict], about: &[String]) -> String {
    let mut out = String::from(
        "# Results\n\nWritten by `lenslet ablate --results`; every number comes from the run named here, none is typed by hand.\n\n",
    );
    for line in about {
        out += &format!("- {line}\n");
    }
    out += "\n## Orderings\n\nMargins are means of paired differences (PSNR of luminance, or at rays and raw pixels of real captures), ± their standard \
            deviation over seeds. One holds where the mean is above 0.005 dB and above two standard errors; `--check` fails where \
            it is not above the least margin given.\n\n";
    out += "| experiment | subject | this | over this | margin dB | least dB | |\n|---|---|---|---|--:|--:|---|\n";
    for v in verdicts {
        let verdict = if v.holds { "holds".into() } else { format!("**{}**", v.name()) };
        let (margin, least) = (table::format_cell(&v.margin, 2), v.least_text());
        let names = format!("{} | {} | {} | {}", v.experiment, v.subject, v.better, v.worse);
        out += &format!("| {names} | {margin} | {least} | {verdict} |\n");
    }
    out += "\n## Tables\n\nMean ± standard deviation over seeds; the best of each subject in bold.\n\n";
    out += &table::tables_to_markdown(tables);
    out += "### Scores\n\n";
    for score in table::SCORES {
        out += &format!("- {}: {}\n", score.heading, score.meaning);
    }
    out
}

#[cfg(test)]
mod tests {
    #[test]
    fn dates_have_their_form() {
        let date = super::today();
        let parts: Vec<u32> = date.split('-').map(|p| p.parse().unwrap()).collect();
        assert!(parts.len() == 3 && parts[0] >= 2025 && (1..=12).contains(&parts[1]) && (1..=31).contains(&parts[2]));
    }
}
