//! Exports are the same bytes in every run.

use super::bench::Bench;

/// The header's metadata once came in the order of a hash map, another in every process.
#[test]
fn a_dictionary_is_exported_to_the_same_bytes_in_every_run() {
    let bench = Bench::new();
    for name in ["a.safetensors", "b.safetensors", "c.safetensors", "a.lfd", "b.lfd", "c.lfd"] {
        bench.done(&format!("dict export default --out {name}"));
    }
    for ending in ["safetensors", "lfd"] {
        let first = bench.bytes(&format!("a.{ending}"));
        assert!(first.len() > 1000);
        for name in ["b", "c"] {
            assert!(bench.bytes(&format!("{name}.{ending}")) == first, "{name}.{ending} differs");
        }
    }
}
