//! The `lenslet` program.

mod ablation;
mod cli;
mod report;

fn main() -> std::process::ExitCode {
    cli::main()
}
