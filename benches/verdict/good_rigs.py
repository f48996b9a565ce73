#!/usr/bin/env python3
"""How often a sound scanner is called doubtful: presets × pattern sets × scenes × seeds, and any rigs beside them.

    python3 benches/verdict/good_rigs.py PROGRAM FOLDER [--seeds 1,2,3] [--rigs RIG ...]

Runs the experiment good_rigs.toml, which lies beside this file, in FOLDER; started again, it goes on where it stopped.
Prints a row for every calibration and every scan: the verdict, and for scans the median error of the body and the 1σ
that was claimed, mm. A warning is a false alarm unless the error exceeds three times the 1σ in the scan (or, for
a calibration, in one of its scans); without a warning such a scan is silent. `--rigs` adds folders, with every set and
every scene of theirs; nothing is written to them. Exit code 1 if there was a false alarm.
"""

import argparse
import hashlib
import json
import pathlib
import subprocess
import sys
import tomllib


def run(program, *args):
    """Returns the program's JSON answer; what it says on standard error where it fails."""
    done = subprocess.run([program, *map(str, args), "--json", "--quiet"], capture_output=True, text=True)
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError:
        return {"verdict": "failed", "warnings": [{"code": done.stderr.strip()[-200:]}]}


def presets(program, folder, seeds):
    """Runs the experiment; returns (rig with seed, set, scene or none, answer)."""
    spec = pathlib.Path(__file__).with_name("good_rigs.toml")
    said = subprocess.run([program, "experiment", spec, "-o", folder, "--seeds", seeds],
                          check=True, capture_output=True, text=True).stdout
    own = hashlib.sha256(pathlib.Path(program).read_bytes()).hexdigest()
    for file in sorted((folder / "steps").glob("*.json")):
        step = json.loads(file.read_text())
        command, rig, *rest = step["arguments"]
        if command == "simulate" or step["program"] != own:
            continue
        rig = pathlib.Path(rig)
        seed = tomllib.loads((rig / "simulation.toml").read_text())["seed"]
        if str(seed) in seeds.split(","):
            scene = rest[0] if command == "reconstruct" else None
            yield f"{rig.name.rsplit('-', 1)[0]}, seed {seed}", rest[rest.index("--set") + 1], scene, step["answer"]
    for line in said.splitlines():
        if line.startswith("without a result: "):
            yield line.removeprefix("without a result: "), "", "?", {"verdict": "failed", "warnings": []}


def folders(program, folder, rigs):
    """Calibrates every set of every rig and reconstructs its scenes; yields the same."""
    for rig in rigs:
        sets = [s["name"] for s in tomllib.loads((rig / "rig.toml").read_text())["pattern_sets"]]
        scenes = sorted(p.name for p in (rig / "scenes").iterdir() if any(p.glob("white.*")))
        for chosen in sets:
            field = folder / "fields" / f"{rig.name}-{chosen}.safetensors"
            field.parent.mkdir(exist_ok=True, parents=True)
            answer = run(program, "calibrate", rig, "--set", chosen, "-o", field, "--accept")
            yield rig.name, chosen, None, answer
            for scene in scenes:
                truth = rig / "ground_truth" / "scenes" / scene
                truth = next((t for t in (truth, rig / "scenes" / scene / "truth") if t.exists()), None)
                out = folder / "results" / f"{rig.name}-{scene}-{chosen}"
                more = ("--truth", truth) if truth else ()
                yield rig.name, chosen, scene, run(
                    program, "reconstruct", rig, scene, "--set", chosen, "--field", field, "-o", out, "--accept", *more)


def body(answer):
    """Median error of the body and its claimed 1σ, mm; none without ground truth."""
    metrics = (answer.get("summary") or {}).get("metrics")
    if not metrics or not metrics["body"]["sigma"]:
        return None
    return metrics["body"]["depth_mm"]["median"], metrics["body"]["sigma"]["median_mm"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--rigs", nargs="*", type=pathlib.Path, default=[])
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    rows = list(presets(args.program, args.folder, args.seeds)) if args.seeds else []
    rows += folders(args.program, args.folder, args.rigs)
    rows.sort(key=lambda r: (r[0], r[1], r[2] or ""))

    def is_off(answer):
        error = body(answer)
        return error is not None and error[0] > 3 * error[1]

    off_fields = {(rig, chosen) for rig, chosen, scene, answer in rows if scene and is_off(answer)}
    alarms = false = silent = 0
    print("| rig | set | scene | median error, mm | claimed 1σ, mm | verdict | |\n|---|---|---|---|---|---|---|")
    for rig, chosen, scene, answer in rows:
        said = answer["verdict"]
        warned = said != "good"
        off = is_off(answer) if scene else (rig, chosen) in off_fields
        alarms += warned
        false += warned and not off
        silent += bool(scene) and off and not warned
        judged = ("right" if off else "**FALSE**") if warned else "**SILENT**" if scene and off else ""
        codes = ", ".join(f"`{w['code']}`" for w in answer["warnings"])
        error = body(answer) if scene else None
        numbers = "{:.3g} | {:.3g}".format(*error) if error else "– | –"
        print(f"| {rig} | {chosen} | {scene or '(sweep)'} | {numbers} | {said}{': ' if codes else ''}{codes} | {judged} |")
    rigs = len({r[0] for r in rows})
    print(f"\n{len(rows)} verdicts on {rigs} rigs: {alarms} warned, {false} of them falsely; {silent} silent")
    return 1 if false else 0


if __name__ == "__main__":
    sys.exit(main())
