//! Lists the dictionaries inside the program: every `dictionaries/NAME.lfd` that has its card (`NAME.md`) and its recipe
//! (`NAME.json`), the default first.

#![allow(clippy::print_stdout)] // how a build script speaks to cargo

use std::error::Error;
use std::path::Path;
use std::{env, fs};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("../dictionaries");
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut names = Vec::new();
    for entry in fs::read_dir(&folder)? {
        let path = entry?.path();
        let complete = ["lfd", "md", "json"].iter().all(|ending| path.with_extension(ending).is_file());
        if let Some(name) = path.file_stem().and_then(|name| name.to_str())
            && path.extension().is_some_and(|ending| ending == "lfd")
            && complete
        {
            names.push(name.to_string());
        }
    }
    names.sort_by_key(|name| (name != "default", name.clone()));
    let mut index = format!("const INDEX: [(&str, &[u8]); {}] = [\n", names.len());
    for name in &names {
        let file = folder.join(name).with_extension("lfd").canonicalize()?;
        index.push_str(&format!("    ({name:?}, include_bytes!({:?})),\n", file.display().to_string()));
    }
    index.push_str("];\n");
    fs::write(Path::new(&env::var("OUT_DIR")?).join("embedded_index.rs"), index)?;
    Ok(())
}
