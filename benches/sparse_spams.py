"""Sparse coding against SPAMS, both run in turns on one thread; prints the table of docs/sparse-coding.md.

usage: python sparse_spams.py SPARSE_CODE PEERS [ROUNDS]
SPARSE_CODE is the built example, PEERS the directory with bench.py and prob/; needs numpy and spams-bin.
"""
import json, subprocess, sys
import numpy as np

exe, peers, rounds = sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 3
prob = f"{peers}/prob"
members = np.load(f"{prob}/sub2k.npy")
print("| set, λ | K | ours | SPAMS | ratio (median of rounds) | relative sub-optimality |\n|---|---|---|---|---|---|")
for name, lam in (("raw49", "0.1"), ("pca36", "0.2")):
    for k in (256, 512, 1024):
        ours, theirs = [], []
        for _ in range(rounds):
            mine = ["taskset", "-c", "1", exe, f"{prob}/D_{name}_K{k}.npy", f"{prob}/test_{name}.npy", lam]
            mine += ["--repeats", "7", "--objectives", "/tmp/sparse_objectives.npy"]
            ours.append(json.loads(subprocess.check_output(mine))["patches_per_cpu_second"])
            other = ["taskset", "-c", "1", sys.executable, f"{peers}/bench.py", "spams_lars", name, str(k), lam]
            other += ["1", "20000", "3", "dt=f32", "stride=5"]
            theirs.append(json.loads(subprocess.check_output(other))["pps_cpu"])
        ratio = np.median(np.array(ours) / np.array(theirs))
        found = np.load("/tmp/sparse_objectives.npy")[members].mean()
        best = np.load(f"{prob}/opt_{name}_K{k}_lam{lam}.npy").mean()
        print(f"| {name}, {lam} | {k} | {np.median(ours) / 1e3:.0f}k | {np.median(theirs) / 1e3:.1f}k "
              f"| {ratio:.1f} | {found / best - 1:.1e} |", flush=True)
