"""Sparse coding against SPAMS, both run in turns on one thread; prints the tables of docs/sparse-coding.md.

usage: python sparse_spams.py SPARSE_CODE [PEERS] [--rounds R] [--only NAME] [--size S]
SPARSE_CODE is the built example (cargo build --release --example sparse_code). Needs numpy and SPAMS: pip install numpy spams-bin.
Without PEERS: a grid of λ and dictionaries, all drawn here under a fixed seed; times are CPU microseconds a signal, medians over R
rounds of ours, SPAMS, ours, … With PEERS, the directory with bench.py and prob/: throughput on its patches.
"""
import argparse, json, os, subprocess, sys, tempfile, time

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
import numpy as np

SHARES, ABSOLUTE = (0.5, 0.2, 0.1), (0.1, 0.03, 0.01, 1e-3, 1e-4)


def noise(side, rng):
    """A square of 1/f noise."""
    f = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None])
    f[0, 0] = 1
    return np.fft.irfft2(np.fft.rfft2(rng.standard_normal((side, side))) / f)


def unit(rows):
    return np.ascontiguousarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), np.float32)


def windows(count, width, picture, rng):
    at = rng.integers(0, len(picture) - width, (count, 2))
    rows = np.stack([picture[y:y + width, x:x + width].ravel() for y, x in at])
    return unit(rows - rows.mean(1, keepdims=True))


def learned(atoms, signals):
    import spams
    x = np.asfortranarray(signals.T, np.float64)
    options = dict(K=atoms, lambda1=0.15, numThreads=1, batchsize=400, iter=150, verbose=False)
    return unit(spams.trainDL(x, D=np.asfortranarray(x[:, :atoms]), **options).T)


def problems(size):
    """Name, atoms (K×m), signals (N×m)."""
    rng = np.random.default_rng(7)
    picture = noise(1024, rng)
    count = lambda n: max(24, int(n * size))
    small, medium, large = (windows(20_000, side, picture, rng) for side in (7, 9, 12))
    yield "learned, m = 49, K = 256", learned(256, small), small[-count(1500):]
    yield "learned, m = 49, K = 64", learned(64, small), small[-count(1500):]
    yield "learned, m = 81, K = 512", learned(512, medium), medium[-count(500):]
    yield "random, m = 49, K = 512", unit(rng.standard_normal((512, 49))), small[-count(1000):]
    yield "coherent (windows), m = 49, K = 512", windows(512, 7, picture, rng), small[-count(1000):]
    yield "coherent (windows), m = 144, K = 1024", windows(1024, 12, picture, rng), large[-count(200):]
    spectrum = np.geomspace(1, 1e-3, 48)
    flat = unit(rng.standard_normal((1500, 48)))
    yield "ill-conditioned (1000), m = 48, K = 64", unit(rng.standard_normal((64, 48)) * spectrum), flat[:count(1000)]
    yield "ill-conditioned (1000), m = 48, K = 512", unit(rng.standard_normal((512, 48)) * spectrum), flat[:count(1000)]
    yield "K < m: windows, m = 49, K = 32", windows(32, 7, picture, rng), small[-count(3000):]
    yield "random, m = 49, K = 2000", unit(rng.standard_normal((2000, 49))), small[-count(400):]
    yield "coherent (windows), m = 49, K = 2000", windows(2000, 7, picture, rng), small[-count(400):]


def objectives(atoms, signals, codes, lam):
    atoms, codes = atoms.astype(np.float64), codes.astype(np.float64)
    rest = signals.astype(np.float64) - codes @ atoms
    return 0.5 * (rest ** 2).sum(1) + lam * np.abs(codes).sum(1)


def grid(exe, rounds, only, size):
    import spams
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    folder = tempfile.mkdtemp()
    print("| dictionary | λ | non-zeros | ours, µs | SPAMS, µs | ratio | largest gap / ½‖y‖² | SPAMS above ours / ½‖y‖² |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for name, atoms, signals in problems(size):
        if only and only not in name:
            continue
        files = f"{folder}/atoms.npy", f"{folder}/signals.npy"
        np.save(files[0], atoms)
        np.save(files[1], signals)
        x, d = np.asfortranarray(signals.T), np.asfortranarray(atoms.T)
        top = float(np.median(np.abs(signals @ atoms.T).max(1)))
        for share, lam in [(s, s * top) for s in SHARES] + [(None, a) for a in ABSOLUTE]:
            ours, theirs, ratios = [], [], []
            for _ in range(rounds):
                start = time.process_time()
                codes = spams.lasso(x, D=d, lambda1=lam, mode=2, numThreads=1)
                theirs.append((time.process_time() - start) / len(signals))
                command = [exe, *files, str(lam), "--repeats", "3", "--objectives", f"{folder}/objectives.npy"]
                mine = json.loads(subprocess.check_output(command))
                ours.append(mine["cpu_seconds"] / len(signals))
                ratios.append(theirs[-1] / ours[-1])
            energy = 0.5 * (signals.astype(np.float64) ** 2).sum(1)
            best = np.load(f"{folder}/objectives.npy")
            excess = (objectives(atoms, signals, np.asarray(codes.todense()).T, lam) - best) / energy
            shown = f"{share} λ_max = {lam:.3g}" if share else f"{lam:g}"
            sure = f"{mine['max_gap'] / energy.min():.0e}" + ("" if mine["converged"] else " not all converged")
            print(f"| {name} | {shown} | {mine['mean_nonzeros']:.1f} | {1e6 * np.median(ours):.1f} | {1e6 * np.median(theirs):.1f} "
                  f"| {np.median(ratios):.1f} | {sure} | {excess.max():.0e} |", flush=True)


def patches(exe, peers, rounds):
    prob = f"{peers}/prob"
    members = np.load(f"{prob}/sub2k.npy")
    found_file = f"{tempfile.mkdtemp()}/objectives.npy"
    print("| set, λ | K | ours | SPAMS | ratio (median of rounds) | relative sub-optimality |\n|---|---|---|---|---|---|")
    for name, lam in (("raw49", "0.1"), ("pca36", "0.2")):
        for k in (256, 512, 1024):
            ours, theirs = [], []
            for _ in range(rounds):
                mine = ["taskset", "-c", "1", exe, f"{prob}/D_{name}_K{k}.npy", f"{prob}/test_{name}.npy", lam]
                mine += ["--repeats", "7", "--objectives", found_file]
                ours.append(json.loads(subprocess.check_output(mine))["patches_per_cpu_second"])
                other = ["taskset", "-c", "1", sys.executable, f"{peers}/bench.py", "spams_lars", name, str(k), lam]
                other += ["1", "20000", "3", "dt=f32", "stride=5"]
                theirs.append(json.loads(subprocess.check_output(other))["pps_cpu"])
            ratio = np.median(np.array(ours) / np.array(theirs))
            found = np.load(found_file)[members].mean()
            best = np.load(f"{prob}/opt_{name}_K{k}_lam{lam}.npy").mean()
            print(f"| {name}, {lam} | {k} | {np.median(ours) / 1e3:.0f}k | {np.median(theirs) / 1e3:.1f}k "
                  f"| {ratio:.1f} | {found / best - 1:.1e} |", flush=True)


if __name__ == "__main__":
    p = argparse.ArgumentParser(usage=__doc__)
    p.add_argument("exe")
    p.add_argument("peers", nargs="?")
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--only", help="part of the name of a dictionary")
    p.add_argument("--size", type=float, default=1.0, help="times the number of signals")
    a = p.parse_args()
    patches(a.exe, a.peers, a.rounds) if a.peers else grid(a.exe, a.rounds, a.only, a.size)
