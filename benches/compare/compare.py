#!/usr/bin/env python3
"""Every method on every pattern set of a rig, one table.

    python3 benches/compare/compare.py NELU3D RIG SCENE [--steps N] [--samples N] [--only METHOD,...] [--out DIR]

NELU3D is the release binary, RIG a rig folder that can be written, SCENE one of its scenes with a truth. Fields are calibrated first (their time
is not in the table: a decoder's projector calibration is not either). Methods that the rig's images or its lack of a
projector do not allow are left out, with the reason. Errors are over the truth's whole mask, in mm and projector px; time is
that of all threads, from reading the images to the written result; needs Python's standard library only.
"""

import argparse
import json
import pathlib
import subprocess
import sys

DECODERS = ["gray", "phase", "mps", "zncc"]
LOOKUP = {"lookup3d": [], "lookup3d coarse to fine": ["--search", "coarse-to-fine"], "lookup3d-lowrank": []}


def run(command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    return None if done.returncode == 0 else done.stderr.strip().splitlines()[-1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("nelu3d")
    parser.add_argument("rig", type=pathlib.Path)
    parser.add_argument("scene")
    parser.add_argument("--sets", help="pattern sets, separated by commas (default: all)")
    parser.add_argument("--steps", type=int, default=1000, help="iterations of recipe paper and TurboSL")
    parser.add_argument("--samples", type=int, default=65536, help="samples per iteration of the same")
    parser.add_argument("--only", help="methods, separated by commas")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("compare-results"))
    args = parser.parse_args()
    only = args.only.split(",") if args.only else None
    truth = args.rig / "scenes" / args.scene / "truth"
    rig_toml = (args.rig / "rig.toml").read_text().splitlines()
    sets, inside = [], False
    for line in rig_toml:
        inside = line.strip() == "[[pattern_sets]]" or (inside and not line.startswith("["))
        if inside and line.startswith("name"):
            sets.append(line.split('"')[1])
    if args.sets:
        sets = [s for s in args.sets.split(",") if s in sets]
    has_projector = (args.rig / "projector.json").exists()
    args.out.mkdir(parents=True, exist_ok=True)

    print("| pattern set | method | MAE mm | median mm | RMSE mm | median px | coverage | CPU s | peak MB |")
    print("|---|---|---|---|---|---|---|---|---|")
    left_out = []
    for name in sets:
        # In the rig, where the decoders find it too: all methods look in the volume of the sweep.
        field = args.rig / "fields" / f"{name}.safetensors"
        problem = None if field.exists() else run([args.nelu3d, "calibrate", args.rig, "--set", name, "-q"])
        jobs = []
        trained = ["--steps", args.steps, "--samples", args.samples]
        if problem is None:
            jobs.append(("NeLU3D fast", ["reconstruct"]))
            jobs.append(("NeLU3D paper", ["reconstruct", "--recipe", "paper", *trained]))
        else:
            left_out.append((name, "NeLU3D", problem))
        jobs += [(label, ["decode", "--method", label.split()[0], *more]) for label, more in LOOKUP.items()]
        if has_projector:
            jobs += [(label, ["decode", "--method", label]) for label in DECODERS]
            jobs.append(("TurboSL", ["decode", "--method", "turbosl", *trained]))
        for label, command in jobs:
            if only and label not in only:
                continue
            result = args.out / f"{args.scene}-{name}-{label.replace(' ', '-')}"
            problem = run([args.nelu3d, command[0], args.rig, args.scene, "--set", name, *command[1:], "--truth", truth,
                           "-q", "-o", result])
            if problem is not None:
                left_out.append((name, label, problem))
                continue
            summary = json.loads((result / "result.json").read_text())
            whole = summary["metrics"]["whole"]
            depth_mm, px = whole["depth_mm"], (whole.get("disparity_px") or {}).get("median")
            print(f"| {name} | {label} | {depth_mm['mae']:.3f} | {depth_mm['median']:.3f} | {depth_mm['rmse']:.2f} | "
                  f"{'-' if px is None else format(px, '.3f')} | {100 * whole['coverage']:.1f} % | "
                  f"{summary['cpu_secs']:.2f} | {summary['peak_memory_bytes'] / 1e6:.0f} |")
            sys.stdout.flush()
    print("\nLeft out:\n")
    for name, label, problem in left_out:
        print(f"- {name}, {label}: {problem.removeprefix('nelu3d: ').split('; ')[0]}")


if __name__ == "__main__":
    main()
