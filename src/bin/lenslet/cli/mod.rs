//! The command line: one file a command; what is printed and the exit code are decided here.

mod ablate;
mod assess;
mod belong;
mod budget;
mod calibrate;
mod context;
mod convert;
mod decode;
mod demo;
mod depth;
mod dict;
mod extract;
mod gen_pairs;
mod infer;
mod info;
mod inputs;
mod learned;
mod progress;
mod refine;
mod refocus;
mod score;
mod simulate;
mod source;
mod streams;
mod threads;
mod train_dict;
mod train_report;
mod values;
mod view;
mod viewpoint;
mod written;

use std::path::Path;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};
use clap::{Parser, Subcommand};
pub use context::{Context, Outcome, Usage};
use inputs::Input;
use lenslet_core::progress::Observer as _;
use progress::Progress;
use streams::tell;

#[derive(Debug, Parser)]
#[command(
    name = "lenslet",
    version,
    about = "From raw captures of lenslet light-field cameras to high-resolution light fields",
    propagate_version = true
)]
struct Cli {
    /// Threads to use (default: all cores)
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory this run may take, MiB: one that needs more ends with exit code 1 and a message
    #[arg(long, global = true, value_name = "MIB", value_parser = clap::value_parser!(u32).range(16..))]
    memory: Option<u32>,
    /// No progress, no notes
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Print exactly one JSON object on standard output
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Args),
    Info(info::Args),
    Extract(extract::Args),
    Simulate(simulate::Args),
    Calibrate(calibrate::Args),
    Decode(decode::Args),
    Convert(convert::Args),
    GenPairs(gen_pairs::Args),
    TrainDict(train_dict::Args),
    Dict(dict::Args),
    Refine(refine::Args),
    Infer(infer::Args),
    Score(score::Args),
    Ablate(ablate::Args),
    Assess(assess::Args),
    Refocus(refocus::Args),
    Depth(depth::Args),
    Viewpoint(viewpoint::Args),
    View(view::Args),
}

impl Command {
    /// What the user gives it, and what that must be.
    fn inputs(&self) -> Vec<(&Path, Input)> {
        match self {
            // Without an input, or for any.
            Command::Demo(_) | Command::Info(_) => Vec::new(),
            Command::Extract(a) => a.inputs(),
            Command::Simulate(a) => a.inputs(),
            Command::Calibrate(a) => a.inputs(),
            Command::Decode(a) => a.inputs(),
            Command::Convert(a) => a.inputs(),
            Command::GenPairs(a) => a.inputs(),
            Command::TrainDict(a) => a.inputs(),
            Command::Dict(a) => a.inputs(),
            Command::Refine(a) => a.inputs(),
            Command::Infer(a) => a.inputs(),
            Command::Score(a) => a.inputs(),
            Command::Ablate(a) => a.inputs(),
            Command::Assess(a) => a.inputs(),
            Command::Refocus(a) => a.inputs(),
            Command::Depth(a) => a.inputs(),
            Command::Viewpoint(a) => a.inputs(),
            Command::View(a) => a.inputs(),
        }
    }

    /// Whether it multiplies matrices, which takes addresses.
    fn multiplies(&self) -> bool {
        !matches!(
            self,
            Command::Info(_) | Command::Extract(_) | Command::Convert(_) | Command::Dict(_) | Command::Score(_)
        )
    }
}

fn dispatch(command: &Command, context: &Context) -> anyhow::Result<Outcome> {
    inputs::check(command.inputs())?;
    match command {
        Command::Demo(a) => demo::run(a, context),
        Command::Info(a) => info::run(a, context),
        Command::Extract(a) => extract::run(a, context),
        Command::Simulate(a) => simulate::run(a, context),
        Command::Calibrate(a) => calibrate::run(a, context),
        Command::Decode(a) => decode::run(a, context),
        Command::Convert(a) => convert::run(a, context),
        Command::GenPairs(a) => gen_pairs::run(a, context),
        Command::TrainDict(a) => train_dict::run(a, context),
        Command::Dict(a) => dict::run(a, context),
        Command::Refine(a) => refine::run(a, context),
        Command::Infer(a) => infer::run(a, context),
        Command::Score(a) => score::run(a, context),
        Command::Ablate(a) => ablate::run(a, context),
        Command::Assess(a) => assess::run(a, context),
        Command::Refocus(a) => refocus::run(a, context),
        Command::Depth(a) => depth::run(a, context),
        Command::Viewpoint(a) => viewpoint::run(a, context),
        Command::View(a) => view::run(a, context),
    }
}

pub fn main() -> ExitCode {
    progress::watch_interrupts();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) if e.use_stderr() => {
            match file_for_command(&e) {
                Some(name) => tell(&format!(
                    "lenslet: {name} is a file or folder, not a command; look at it with `lenslet info {name}`, decode a capture \
                     with `lenslet decode {name} --calibration CAM.calib --out OUT`, or see `lenslet --help`"
                )),
                None => tell(e.render().to_string().trim_end()),
            }
            return ExitCode::from(2);
        }
        // Help and version are answers.
        Err(e) => return told(e.render().to_string().as_str()),
    };
    if let Err(why) = threads::start(cli.threads.map(usize::from), cli.command.multiplies()) {
        tell(&format!("lenslet: {why}"));
        return ExitCode::from(1);
    }
    let context = Context { progress: Progress::new(cli.quiet) };
    let memory = cli.memory.map(|mib| mib as usize);
    if let Some(Err(e)) = memory.map(budget::watch) {
        tell(&format!("lenslet: cannot watch --memory: {e}"));
        return ExitCode::from(1);
    }
    let result = dispatch(&cli.command, &context);
    context.progress.clear();
    // These leave nothing behind that could count as done.
    let reads_only = matches!(cli.command, Command::Info(_) | Command::Score(_));
    match result {
        Ok(_) if reads_only && context.progress.cancelled() => interrupted(),
        Ok(outcome) => told(&if cli.json { outcome.json.to_string() } else { outcome.text }),
        Err(e) => {
            if let Some(why) = budget::exceeded(memory) {
                tell(&format!("lenslet: {why}"));
                return ExitCode::from(1);
            }
            if context.progress.cancelled() {
                return interrupted();
            }
            tell(&format!("lenslet: {}", one_line(&e)));
            ExitCode::from(if e.chain().any(|c| c.is::<Usage>()) { 2 } else { 1 })
        }
    }
}

/// The file that was given where a command belongs.
fn file_for_command(error: &clap::Error) -> Option<String> {
    let (ContextKind::InvalidSubcommand, ContextValue::String(name)) =
        error.context().find(|(kind, _)| *kind == ContextKind::InvalidSubcommand)?
    else {
        return None;
    };
    std::path::Path::new(name).exists().then(|| name.clone())
}

fn interrupted() -> ExitCode {
    tell("lenslet: interrupted");
    ExitCode::from(130)
}

/// Prints the answer; one that is lost is a failure, though what was written to files stays.
fn told(answer: &str) -> ExitCode {
    match streams::answer(answer) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            tell(&format!("lenslet: the answer cannot be written to standard output: {e}"));
            ExitCode::from(1)
        }
    }
}

/// An error's causes in one line: line breaks flattened, no cause twice.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain() {
        let text = cause.to_string().replace(['\n', '\r'], " ");
        if !line.contains(&text) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&text);
        }
    }
    line
}
