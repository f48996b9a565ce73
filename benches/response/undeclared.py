#!/usr/bin/env python3
"""Cameras that are not linear, and nobody said so: is each of them named?

    python3 benches/response/undeclared.py PROGRAM FOLDER [--presets demo,shapes,...] [--curves 2.2,srgb,phone,1.4]

Needs numpy and OpenCV. Simulates every preset, bends the codes of its sweep and its scenes alike (at the bits that the
camera has, and `8:` of a curve at 8 bits), and prints for every pattern set and scene the verdicts, the median error of
the body and the claimed 1σ, mm. A row is SILENT where the error exceeds three times the 1σ and nothing warns. Exit code
1 where there is such a row, or a warning with the curve `1`, which is linear.
"""

import argparse
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tomllib

import cv2
import numpy as np

from webcam import curve


def run(program, *args):
    done = subprocess.run([program, *map(str, args), "--json", "--quiet"], capture_output=True, text=True)
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError:
        return {"verdict": "refused: " + done.stderr.strip().split("; ")[0][-80:], "warnings": [], "summary": {}}


def bent(rig, target, codes, eight):
    text = (rig / "rig.toml").read_text()
    camera = tomllib.loads(text)["camera"]
    black, saturation = camera["black_level"], camera["saturation"]
    for file in [*rig.glob("calibration/*/*.png"), *rig.glob("scenes/*/*.png")]:
        image = cv2.imread(str(file), -1)
        light = (image.astype(np.float64) - black) / (saturation - black)
        # A curve of light below none is that above it, mirrored.
        value = np.sign(light) * codes(np.minimum(np.abs(light), 1))
        out = target / file.relative_to(rig)
        out.parent.mkdir(parents=True, exist_ok=True)
        if eight:
            cv2.imwrite(str(out), np.clip(np.round(value * 255), 0, 255).astype(np.uint8))
        else:
            code = np.clip(np.round(value * (saturation - black) + black), 0, saturation)
            cv2.imwrite(str(out), code.astype(image.dtype))
    for name in ("camera.json", "projector.json"):
        if (rig / name).exists():
            shutil.copy(rig / name, target / name)
    if eight:
        text = re.sub(r"^black_level = .*", "black_level = 0.0", text, flags=re.M)
        text = re.sub(r"^saturation = .*", "saturation = 255.0", text, flags=re.M)
    (target / "rig.toml").write_text(text)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--presets", default="demo,shapes,color,lcd")
    parser.add_argument("--curves", default="1,2.2,srgb,phone,1.4,8:2.2")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    wrong = 0
    print("| preset | curve | set | scene | calibrate | reconstruct | median error, mm | claimed 1σ, mm | |\n" + "|---" * 9 + "|")
    for preset in args.presets.split(","):
        rig = args.folder / pathlib.Path(preset).stem
        if not rig.exists():
            run(args.program, "simulate", preset, "-o", rig)
        sets = [s["name"] for s in tomllib.loads((rig / "rig.toml").read_text())["pattern_sets"]]
        for name in args.curves.split(","):
            target = args.folder / "bent"
            shutil.rmtree(target, ignore_errors=True)
            bent(rig, target, curve(name.removeprefix("8:")), name.startswith("8:"))
            for chosen in sets:
                calibrated = run(args.program, "calibrate", target, "--set", chosen, "--accept")
                for scene in sorted(p.name for p in (rig / "scenes").iterdir()):
                    truth = rig / "scenes" / scene / "truth"
                    truth = truth if truth.exists() else rig / "ground_truth" / "scenes" / scene
                    answer = run(args.program, "reconstruct", target, scene, "--set", chosen, "--truth", truth, "--accept")
                    said = [a["verdict"] + "".join(f" `{w['code']}`" for w in a["warnings"]) for a in (calibrated, answer)]
                    metrics = (answer.get("summary") or {}).get("metrics")
                    body = metrics["body"] if metrics else None
                    error = (body["depth_mm"]["median"], body["sigma"]["median_mm"]) if body and body["sigma"] else None
                    warned = any(s != "good" for s in said)
                    silent = error and error[0] > 3 * error[1] and not warned
                    false = warned and float(name.removeprefix("8:") == "1")
                    wrong += bool(silent or false)
                    numbers = "{:.3g} | {:.3g}".format(*error) if error else "– | –"
                    mark = "**SILENT**" if silent else "**FALSE**" if false else ""
                    print(f"| {preset} | {name} | {chosen} | {scene} | {said[0]} | {said[1]} | {numbers} | {mark} |", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
