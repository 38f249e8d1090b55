#!/bin/sh
# Trains the dictionary that is embedded in the program, from a folder of photos: dictionaries/train.sh PHOTOS
# What is not in default.json stands at its default (see train/src/parameters.rs).
set -eu
[ $# -eq 1 ] || { echo "usage: $0 PHOTOS" >&2; exit 2; }
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/.."
cargo run --release --bin lenslet -- train-dict "$1" --parameters "$here/default.json" --out "$here/default.lfd" --force
sha256sum "$here/default.lfd"
