"""Makes the sparse_*.npy fixtures beside this file: objectives by scikit-learn and SPAMS for a seeded random problem.

python3 -m venv v && v/bin/pip install numpy scikit-learn spams-bin && v/bin/python make_sparse.py
Objective: 1/2 ||y - D^T phi||^2 + lambda ||phi||_1, atoms in rows. Both tools work in f64 here.
"""
import os

import numpy as np
import spams
from sklearn.linear_model import Lasso, orthogonal_mp

here = os.path.dirname(os.path.abspath(__file__)) + "/"
rng = np.random.default_rng(5)
k, m, n = 96, 30, 60
atoms = rng.standard_normal((k, m))
atoms[40:70] += 1.5 * atoms[0:30]  # coherent ones, too
atoms = (atoms / np.linalg.norm(atoms, axis=1, keepdims=True)).astype(np.float32)
signals = np.zeros((n, m))
for i in range(n):
    chosen = rng.choice(k, 5, replace=False)
    signals[i] = rng.standard_normal(5) @ atoms[chosen] + 0.1 * rng.standard_normal(m)
signals = signals.astype(np.float32)
weights = rng.choice([0.0, 0.3, 1.0], (n, m)).astype(np.float32)
np.save(here + "sparse_atoms.npy", atoms)
np.save(here + "sparse_signals.npy", signals)
np.save(here + "sparse_weights.npy", weights)
D, Y = atoms.astype(np.float64), signals.astype(np.float64)


def objective(phi, lam, w=None):
    r = Y - phi @ D
    w = np.ones_like(Y) if w is None else w
    return 0.5 * (w * r * r).sum(1) + lam * np.abs(phi).sum(1)


def sklearn(lam, positive=False, w=None):
    phi = np.zeros((n, k))
    for i in range(n):
        s = np.ones(m) if w is None else np.sqrt(w[i].astype(np.float64))
        solver = Lasso(alpha=lam / m, fit_intercept=False, tol=1e-14, max_iter=1000000, positive=positive)
        phi[i] = solver.fit((D * s).T, Y[i] * s).coef_
    return phi


for lam in (0.05, 0.3, 1.0):
    np.save(here + f"sparse_sklearn_{lam}.npy", objective(sklearn(lam), lam))
    phi = spams.lasso(np.asfortranarray(Y.T), D=np.asfortranarray(D.T), lambda1=lam, mode=2).T.toarray()
    np.save(here + f"sparse_spams_{lam}.npy", objective(phi, lam))
np.save(here + "sparse_sklearn_nonnegative_0.3.npy", objective(sklearn(0.3, positive=True), 0.3))
np.save(here + "sparse_sklearn_weighted_0.3.npy", objective(sklearn(0.3, w=weights), 0.3, weights.astype(np.float64)))
np.save(here + "sparse_sklearn_omp_5.npy", objective(orthogonal_mp(D.T, Y.T, n_nonzero_coefs=5).T, 0.0))
