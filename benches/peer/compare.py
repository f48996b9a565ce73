"""Points per CPU second of `nelu3d bench step` next to PyTorch's, on one thread, in turns within the same minutes.

    cargo build --release
    pip install torch numpy
    python benches/peer/compare.py [--rounds 3] [--nelu3d target/release/nelu3d]

Prints the best of the rounds for each, and the ratio of the two.
"""

import argparse
import json
import pathlib
import subprocess
import sys


def ours(program):
    out = subprocess.run(
        [program, "bench", "step ", "--seconds", "1", "--threads", "1", "--json", "--quiet"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    return {step["name"]: step["points_per_cpu_sec"] for step in json.loads(out)["steps"]}


def theirs():
    script = pathlib.Path(__file__).with_name("surface_step.py")
    out = subprocess.run(
        [sys.executable, str(script), "--threads", "1", "--steps", "4"], check=True, capture_output=True, text=True
    ).stdout
    reports = [json.loads(line) for line in out.splitlines()]
    return {report["step"]: report["points_per_cpu_second"] for report in reports}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--nelu3d", default="target/release/nelu3d")
    arguments = parser.parse_args()
    best = {}
    for _ in range(arguments.rounds):
        for side, rates in (("nelu3d", ours(arguments.nelu3d)), ("PyTorch", theirs())):
            for name, rate in rates.items():
                best[name, side] = max(best.get((name, side), 0), rate)
    print("| step | nelu3d, points per CPU second | PyTorch | ratio |\n|---|---|---|---|")
    for name in sorted({name for name, _ in best}):
        a, b = best[name, "nelu3d"], best[name, "PyTorch"]
        print(f"| {name} | {a:,.0f} | {b:,.0f} | {a / b:.1f} |")


if __name__ == "__main__":
    main()
