"""Time of sparse coding against N, K, m, λ and threads; prints the tables of docs/sparse-coding.md.

usage: python sparse_table.py SPARSE_CODE [PEERS]
SPARSE_CODE is the built example. Signals are windows of 1/f noise, mean removed, unit norm; so are the atoms. With PEERS (the
directory with prob/) also the rows over N, λ and threads on its patches. Needs numpy.
"""
import json, os, subprocess, sys, tempfile
import numpy as np

exe, peers = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None
folder = tempfile.mkdtemp()


def run(atoms, signals, lam, *more):
    return json.loads(subprocess.check_output([exe, atoms, signals, str(lam), "--repeats", "3", *more]))


def noise(side, rng):
    """A square of 1/f noise."""
    f = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None])
    f[0, 0] = 1
    return np.fft.irfft2(np.fft.rfft2(rng.standard_normal((side, side))) / f)


def windows(count, width, picture, rng):
    at = rng.integers(0, len(picture) - width, (count, 2))
    rows = np.stack([picture[y:y + width, x:x + width].ravel() for y, x in at])
    rows -= rows.mean(1, keepdims=True)
    return np.ascontiguousarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), np.float32)


def saved(name, rows):
    np.save(f"{folder}/{name}.npy", rows)
    return f"{folder}/{name}.npy"


rng = np.random.default_rng(7)
picture = noise(1024, rng)
sizes = (64, 256, 512, 1024, 2048)
for lam in (0.2, 0.1):
    print(f"\n| λ = {lam} | " + " | ".join(f"K = {k}" for k in sizes) + " |\n|---|" + "---|" * len(sizes))
    for width in (5, 7, 9, 12):
        m, cells = width * width, []
        signals = saved(f"signals{m}", windows(20_000, width, picture, rng))
        for k in sizes:
            r = run(saved(f"atoms{m}", windows(k, width, picture, rng)), signals, lam)
            mark = "" if r["converged"] else " not all converged"
            cells.append(f"{r['patches_per_cpu_second'] / 1e3:.0f}k ({r['mean_nonzeros']:.1f}){mark}")
        print(f"| m = {m} | " + " | ".join(cells) + " |", flush=True)

signals = windows(1000, 7, picture, rng)
weights = (rng.random(signals.shape) > 0.25).astype(np.float32)
files = saved("signals", signals), saved("weights", weights)
print("\nweighted (a quarter of the values hidden), m = 49, λ = 0.2:")
for k in (256, 512, 1024):
    r = run(saved("atoms", windows(k, 7, picture, rng)), files[0], 0.2, "--weights", files[1])
    print(f"K = {k}: {r['patches_per_cpu_second'] / 1e3:.1f}k a CPU second, largest gap {r['max_gap']:.0e}")

if peers:
    atoms, patches = f"{peers}/prob/D_raw49_K512.npy", np.load(f"{peers}/prob/test_raw49.npy")
    print("\nraw49, K = 512:")
    for n in (1000, 10_000, len(patches)):
        r = run(atoms, saved("some", patches[:: len(patches) // n][:n]), 0.1)
        print(f"N = {n}: {1e3 * r['cpu_seconds']:.1f} ms CPU")
    everything = saved("all", patches)
    for lam in (0.05, 0.1, 0.2, 0.4):
        r = run(atoms, everything, lam)
        print(f"λ = {lam}: {r['patches_per_cpu_second'] / 1e3:.0f}k ({r['mean_nonzeros']:.1f} non-zeros)")
    one = {}
    for threads in range(1, (os.cpu_count() or 1) + 1):
        r = run(atoms, everything, 0.1, "--threads", str(threads))
        one.setdefault("wall", r["seconds"])
        print(f"{threads} threads: {1e3 * r['seconds']:.0f} ms wall ({one['wall'] / r['seconds']:.2f}×), {1e3 * r['cpu_seconds']:.0f} ms CPU")
