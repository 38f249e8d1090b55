#!/usr/bin/env python3
"""Makes lf_*.mat beside this file: a small light field as MATLAB users keep it, written by scipy.

LF[v, u, t, s, c] = 65535 * (1000 v + 100 u + 10 t + s + 0.1 c) / 4000 of shape (3, 2, 4, 5, 4), uint16; the fourth
channel is a weight. Ran with scipy 1.17.1:
    python3 make_mat_fixture.py
"""
import os

import numpy as np
from scipy.io import savemat

here = os.path.dirname(os.path.abspath(__file__))
v, u, t, s, c = np.meshgrid(*map(np.arange, (3, 2, 4, 5, 4)), indexing="ij")
lf = 65535 * (1000 * v + 100 * u + 10 * t + s + 0.1 * c) / 4000
lf = np.round(lf).astype(np.uint16)
extra = {"DecodeOptions": {"Name": "x", "Size": 3}, "Note": "text before the light field", "Small": np.eye(3)}
savemat(f"{here}/lf_uint16_compressed.mat", {**extra, "LF": lf}, do_compression=True)
savemat(f"{here}/lf_uint16_plain.mat", {**extra, "LF": lf}, do_compression=False)
savemat(f"{here}/lf_double_other_name.mat", {**extra, "views": lf[..., :3] / 65535.0}, do_compression=True)
