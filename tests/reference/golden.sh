#!/usr/bin/env bash
# How the golden files of format version 1 were made: tests/reference/golden-1.calib, golden-1.lfd (maps as bytes)
# and golden-1-f32.lfd (maps as floats).
# Run with the `lenslet` of that time; a later one writes later versions, so the files themselves are what is kept.
# Usage: golden.sh PATH-OF-LENSLET OUT-FOLDER
set -euo pipefail
lenslet=$1
out=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$lenslet" -q simulate --sensor 160 --size 160 --views 1 --whites 1 --noise 0 --seed 1 --out "$work/sim"
"$lenslet" -q calibrate "$work/sim/white-00.lfp" --out "$out/golden-1.calib"
for storage in i8 f32; do
  name=golden-1$([ $storage = i8 ] || echo -f32)
  cat > "$work/parameters.json" <<JSON
{"storage": "$storage", "atoms": 12, "features": 8, "patch": 5, "window": 5, "epochs": 1, "refine": 1, "pairs": 400, "crop": 64, "crops": 2,
 "shrink": 1.0, "anchors": 6, "neighbours": 100, "held_out": 0, "footprints": ["point", "lenslet"], "seed": 1}
JSON
  "$lenslet" -q train-dict "$work/sim/truth/views" --parameters "$work/parameters.json" --out "$out/$name.lfd"
  rm -f "$out/$name.lfd.log.jsonl"
done
