#!/usr/bin/env python3
"""Bumps of projector and camera after the sweep: found, attributed, corrected?

    python3 benches/verdict/drift.py PROGRAM FOLDER

Simulates the preset `demo` into FOLDER with bumps of 0.3, 1, and 5 px along x, after each of which the board stands at
position 011 of the sweep, and then the vase alone is scanned. Prints what `check --drift` says, and the vase's median
error (body, mm) with the field as it was and with the corrected one.
"""

import json
import pathlib
import subprocess
import sys

BUMPS = [("none", "")] + [
    (f"{who} {px} px", f"[scenes.bump]\n{key} = [{px}, 0.0]\n")
    for who, key in (("projector", "light_px"), ("camera", "camera_px")) for px in (0.3, 1.0, 5.0)
]


def main(program, folder):
    def run(*args):
        done = subprocess.run([program, *map(str, args), "--quiet", "--json"], capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stderr)
        return json.loads(done.stdout)

    rig = folder / "rig"
    if not (rig / "rig.toml").exists():
        run("simulate", "demo", "-o", folder / "preset")
        head, vase = (folder / "preset" / "simulation.toml").read_text().split("[[scenes]]")
        vase = vase[vase.index("[[scenes.objects]]"):].split("[[sequences]]")[0]
        for i, (_, bump) in enumerate(BUMPS):
            head += f'[[scenes]]\nname = "board-{i}"\nboard = "011"\nobjects = []\n{bump}\n'
            head += f'[[scenes]]\nname = "vase-{i}"\n{bump}{vase}\n'
        (folder / "spec.toml").write_text(head)
        run("simulate", folder / "spec.toml", "-o", rig)
    run("calibrate", rig)
    print("| bump | found | shift, px | error before, mm | corrected, mm |\n|---|---|---|---|---|")
    for i, (name, _) in enumerate(BUMPS):
        def error(*more):
            answer = run("reconstruct", rig, f"vase-{i}", "--truth", rig / f"scenes/vase-{i}/truth", "--accept",
                         "-o", folder / "result", *more)
            return answer["summary"]["metrics"]["body"]["depth_mm"]["median"]
        field = folder / "corrected.safetensors"
        drift = run("check", rig, "--drift", f"board-{i}", "--correct", field)["drift"]
        print(f"| {name} | {drift['moved']} | {drift['shift_px']:.2f} | {error():.3f} | "
              f"{error('--field', field):.3f} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    pathlib.Path(sys.argv[2]).mkdir(parents=True, exist_ok=True)
    main(sys.argv[1], pathlib.Path(sys.argv[2]))
