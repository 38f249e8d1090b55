#!/usr/bin/env python3
"""Writes imageio_raw.json: what imageio's readers `lytro-f01-raw` and `lytro-illum-raw` make of raw files whose bytes
follow a formula, as the sha256 of the pixels in DN (u16, little-endian, row-major) and a few single pixels.

Byte i of a file is ((i * 2654435761) >> 13 ^ (i * 40503) >> 3) & 255.

    pip install imageio numpy
    python3 tests/reference/imageio_raw.py            # writes the fixture
    python3 tests/reference/imageio_raw.py FILE.raw   # prints width, height and the mean, least and largest DN of a file
"""
import hashlib
import json
import os
import sys
import tempfile

import imageio
import imageio.v2 as iio
import numpy as np

CAMERAS = {
    "lytro-f01": ("lytro-f01-raw", 3280 * 3280 * 3 // 2, 4095),
    "lytro-illum": ("lytro-illum-raw", 7728 * 5368 * 5 // 4, 1023),
}


def pixels(path, reader, white):
    values = np.asarray(iio.imread(path, format=reader), dtype=np.float64) * white
    dn = np.rint(values)
    assert np.abs(values - dn).max() < 1e-6
    return dn.astype("<u2")


def one(path):
    length = os.path.getsize(path)
    name = next(n for n, c in CAMERAS.items() if c[1] == length)
    dn = pixels(path, CAMERAS[name][0], CAMERAS[name][2])
    print(json.dumps({"camera": name, "width": dn.shape[1], "height": dn.shape[0], "min": int(dn.min()), "max": int(dn.max()),
                      "mean": float(dn.mean()), "sha256": hashlib.sha256(dn.tobytes()).hexdigest()}))


def main():
    if len(sys.argv) > 1:
        return one(sys.argv[1])
    out = {"tool": "imageio " + imageio.__version__}
    for name, (reader, length, white) in CAMERAS.items():
        i = np.arange(length, dtype=np.uint64)
        data = ((i * np.uint64(2654435761)) >> np.uint64(13) ^ (i * np.uint64(40503)) >> np.uint64(3)).astype(np.uint8)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "x.raw")
            data.tofile(path)
            dn = pixels(path, reader, white)
        h, w = dn.shape
        probes = [[0, 0], [0, w - 1], [h - 1, 0], [h - 1, w - 1], [171, 94], [701, 292], [1480, 1758], [1531, 95]]
        out[name] = {"width": w, "height": h, "sha256": hashlib.sha256(dn.tobytes()).hexdigest(),
                     "pixels": [[r, c, int(dn[r, c])] for r, c in probes]}
    target = os.path.join(os.path.dirname(os.path.abspath(__file__)), "imageio_raw.json")
    with open(target, "w") as f:
        json.dump(out, f, indent=1)
        f.write("\n")


main()
