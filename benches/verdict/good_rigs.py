#!/usr/bin/env python3
"""How often a sound scanner is called doubtful: presets × seeds × pattern sets × scenes, and any rigs beside them.

    python3 benches/verdict/good_rigs.py PROGRAM FOLDER [--seeds 1,2,3] [--presets demo,dlp] [--rigs RIG ...]

Simulates every preset with every seed into FOLDER (rigs that are there are used again), calibrates every set, and
reconstructs every scene. Prints one line a rig and set, and how many of the verdicts were not `good`. Other rigs are
not written to: their fields and results go to FOLDER. Exit code 1 if there was an alarm.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import time
import tomllib

PRESETS = ["demo", "shapes", "color", "dlp", "lcd", "film-triton", "film-chronos"]


def run(program, *args):
    """Returns the program's JSON answer; what it says on standard error where it fails."""
    done = subprocess.run([program, *map(str, args), "--json", "--quiet"], capture_output=True, text=True)
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError:
        return {"verdict": "failed", "warnings": [{"code": done.stderr.strip()[-200:]}]}


def simulate(program, folder, preset, seed):
    """Makes the rig of a preset with a seed, without its sequences; returns its folder."""
    rig = folder / f"{preset}-{seed}"
    if (rig / "rig.toml").exists():
        return rig
    first = folder / f"{preset}.toml"
    if not first.exists():
        made = folder / f"{preset}-preset"
        subprocess.run([program, "simulate", preset, "-o", made, "--quiet"], check=True)
        text = (made / "simulation.toml").read_text()
        first.write_text(text.split("[[sequences]]")[0])
        subprocess.run(["rm", "-rf", made], check=True)
    lines = [f"seed = {seed}" if line.startswith("seed = ") and i < 5 else line
             for i, line in enumerate(first.read_text().splitlines())]
    spec = folder / f"{preset}-{seed}.toml"
    spec.write_text("\n".join(lines) + "\n")
    subprocess.run([program, "simulate", spec, "-o", rig, "--quiet"], check=True)
    return rig


def verdict(answer):
    codes = ", ".join(w["code"] for w in answer["warnings"])
    return answer["verdict"] if answer["verdict"] == "good" else f"{answer['verdict']} ({codes})"


def judge(program, rig, name, folder):
    """Yields what is judged and the verdict, for every set of a rig and every scene."""
    sets = [s["name"] for s in tomllib.loads((rig / "rig.toml").read_text())["pattern_sets"]]
    scenes = sorted(p.name for p in (rig / "scenes").iterdir() if (p / "white.png").exists() or any(p.glob("white.*")))
    for set_name in sets:
        field = folder / "fields" / f"{name}-{set_name}.safetensors"
        field.parent.mkdir(exist_ok=True)
        answer = run(program, "calibrate", rig, "--set", set_name, "-o", field, "--accept")
        yield f"{name} {set_name}", verdict(answer)
        for scene in scenes:
            out = folder / "results" / f"{name}-{scene}-{set_name}"
            answer = run(program, "reconstruct", rig, scene, "--set", set_name, "--field", field, "-o", out, "--accept")
            yield f"{name} {set_name} {scene}", verdict(answer)
            subprocess.run(["rm", "-rf", out], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--presets", default=",".join(PRESETS))
    parser.add_argument("--rigs", nargs="*", type=pathlib.Path, default=[])
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    verdicts = alarms = rigs = 0
    presets = [p for p in args.presets.split(",") if p]
    jobs = [(p, int(s)) for s in args.seeds.split(",") for p in presets] + [(r, None) for r in args.rigs]
    for what, seed in jobs:
        start = time.time()
        rig = what if seed is None else simulate(args.program, args.folder, what, seed)
        name = rig.name
        rigs += 1
        for about, said in judge(args.program, rig, name, args.folder):
            verdicts += 1
            alarms += said != "good"
            print(f"| {about} | {said} |", flush=True)
        print(f"# {name}: {time.time() - start:.0f} s; {alarms} of {verdicts} so far", file=sys.stderr, flush=True)
        if seed is not None:
            subprocess.run(["rm", "-rf", rig], check=True)
    print(f"\n{alarms} alarms in {verdicts} verdicts on {rigs} rigs")
    return 1 if alarms else 0


if __name__ == "__main__":
    sys.exit(main())
