//! Photos → hexagonal drop → barycentric re-interpolation → patch pairs (paper section 4.4).
