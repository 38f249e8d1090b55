//! Embeds every camera profile of `profiles/`, so that a new camera is a new file and nothing else.

#![allow(clippy::print_stdout)] // a build script talks to cargo so

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

fn main() -> std::io::Result<()> {
    println!("cargo::rerun-if-changed=profiles");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("profiles");
    let mut files = std::fs::read_dir(folder)?.map(|f| Ok(f?.path())).collect::<std::io::Result<Vec<PathBuf>>>()?;
    files.retain(|f| f.extension().is_some_and(|e| e == "toml"));
    files.sort();
    let mut code =
        String::from("/// Text of every built-in profile, in order of file name.\nstatic EMBEDDED: &[&str] = &[\n");
    for file in files {
        println!("cargo::rerun-if-changed={}", file.display());
        // The path as a Rust string, whatever is in it.
        let _ = writeln!(code, "    include_str!({:?}),", file.display().to_string());
    }
    code.push_str("];\n");
    let out = std::env::var_os("OUT_DIR").ok_or_else(|| std::io::Error::other("cargo sets no OUT_DIR"))?;
    std::fs::write(PathBuf::from(out).join("profiles.rs"), code)
}
