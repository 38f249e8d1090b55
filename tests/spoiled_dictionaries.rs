//! Every shipped dictionary reaches its margins, and none that was spoiled does: the checks notice a dictionary that does
//! nothing, or harm.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and prints its table

use lenslet_core::dictionary::Dictionary;
use lenslet_views::reconstruct::{embedded_by_name, embedded_names};

use dictionary_checks::{Psnr, WORLDS, broken, least_margins, measure};
use spoil::SPOILINGS;

mod dictionary_checks;
mod spoil;

fn shipped() -> impl Iterator<Item = (&'static str, Dictionary)> {
    embedded_names().map(|name| (name, embedded_by_name(name).unwrap().unwrap()))
}

fn show(name: &str, measured: &[Psnr; 2]) {
    for (world, psnr) in WORLDS.iter().zip(measured) {
        let all: Vec<String> = psnr.iter().map(|(method, psnr)| format!("{method} {psnr:.2}")).collect();
        println!("{name}, {world}: {}", all.join(", "));
    }
    for (better, worse, least) in least_margins(name) {
        let margin = |k: usize| measured[k][better] - measured[k][worse];
        println!("{name}: {better} over {worse} {:+.3} {:+.3}, least {least:?}", margin(0), margin(1));
    }
}

#[test]
fn every_shipped_dictionary_is_worth_its_margins() {
    let mut missed = Vec::new();
    for (name, dictionary) in shipped() {
        let measured = measure(&dictionary);
        show(name, &measured);
        missed.extend(broken(least_margins(name), &measured).iter().map(|b| format!("{name}: {b}")));
    }
    assert_eq!(missed, [""; 0]);
}

#[test]
fn every_spoiled_dictionary_is_caught() {
    let mut missed = Vec::new();
    for (name, dictionary) in shipped() {
        for spoiling in &SPOILINGS {
            let Some(spoiled) = spoiling.of(&dictionary) else { continue };
            lenslet_core::dictionary::validate(&spoiled).unwrap();
            let caught = broken(least_margins(name), &measure(&spoiled));
            println!("| {name} | {} | {} |", spoiling.name, caught.join("; "));
            // By a check of what was spoiled, not of something beside it.
            if !caught.iter().any(|c| c.contains(spoiling.predictor.name())) {
                missed.push(format!("{name}: {}", spoiling.name));
            }
        }
    }
    assert_eq!(missed, [""; 0]);
}
