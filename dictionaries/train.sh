#!/bin/sh
# Trains the dictionaries that are inside the program, from a folder of photos: dictionaries/train.sh PHOTOS [NAME…]
# NAME (default: default) is that of a recipe NAME.json here; what it leaves out has its default (see
# train/src/parameters.rs). Pictures of the run go with its log, the dictionary stays here. With a card NAME.md beside it
# the next build embeds it.
set -eu
[ $# -ge 1 ] || { echo "usage: $0 PHOTOS [NAME...]" >&2; exit 2; }
here=$(cd "$(dirname "$0")" && pwd)
photos=$(cd "$1" && pwd)
shift
cd "$here/.."
for name in "${@:-default}"; do
  cargo run --release --bin lenslet -- train-dict "$photos" --parameters "$here/$name.json" --out "$here/$name.lfd" --force
  rm -f "$here/$name.lfd.log.jsonl" "$here/$name.lfd.plot.svg" "$here/$name.lfd.atoms.png"
  sha256sum "$here/$name.lfd"
done
