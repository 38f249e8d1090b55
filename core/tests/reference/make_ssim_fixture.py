#!/usr/bin/env python3
"""Makes ssim_*.npy and ssim.json beside this file: small pictures and their SSIM by scikit-image, in both settings.

Ran with scikit-image 0.26.0, numpy 2.4.6, scipy 1.17.1:
    python3 make_ssim_fixture.py
"""
import json
import os

import numpy as np
import skimage
from scipy import ndimage
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

here = os.path.dirname(os.path.abspath(__file__))
rng = np.random.default_rng(7)
height, width = 41, 58
t, s = np.mgrid[:height, :width]
texture = ndimage.gaussian_filter(rng.random((height, width)), 1.2)
texture = (texture - texture.min()) / np.ptp(texture)
edges = ((t // 6 + s // 9) % 2).astype(float)
picture = (0.5 * texture + 0.4 * edges + 0.05).astype(np.float32)
cases = {
    "noise": picture + rng.normal(0, 0.05, picture.shape),
    "blur": ndimage.gaussian_filter(picture, 1.0),
    "gain": 0.8 * picture + 0.1,
    "shift": np.roll(picture, 1, axis=1),
    "unrelated": rng.random(picture.shape),
}
np.save(f"{here}/ssim_reference.npy", picture)
out = {"made_by": "make_ssim_fixture.py", "scikit_image": skimage.__version__, "cases": {}}
for name, other in cases.items():
    other = np.clip(other, 0, 1).astype(np.float32)
    np.save(f"{here}/ssim_{name}.npy", other)
    # In double precision: the single-precision answer of scikit-image differs from it by up to 1e-6.
    a, b = picture.astype(float), other.astype(float)
    out["cases"][name] = {
        "gaussian": structural_similarity(
            a, b, data_range=1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
        ),
        "uniform": structural_similarity(a, b, data_range=1),
        "psnr": peak_signal_noise_ratio(a, b, data_range=1),
    }
with open(f"{here}/ssim.json", "w") as f:
    json.dump(out, f, indent=1)
    f.write("\n")
