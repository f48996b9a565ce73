#!/usr/bin/env python3
"""An 8-bit webcam with gamma and JPEG against a linear 12-bit camera, on the same scene.

    python3 benches/response/webcam.py PROGRAM FOLDER [--preset demo] [--gamma 2.2] [--quality 90]   # needs numpy and OpenCV

Simulates a preset, and the same scanner showing `nelu3d patterns superposition` before the same scene. Both are then
taken by a webcam: 8-bit codes that are light to the power of 1/gamma, JPEG files. `nelu3d capture --rehearse` takes the
webcam's rig through a late and unreliable display and camera, and measures the response (`--response measure`); its
noise is that of the images. Prints, for the linear camera, for the webcam with its response measured, stated as srgb,
and not stated at all: verdicts, median error of the body and claimed 1σ, mm, and coverage. Exit code 1 if the measured
one's median exceeds 1.5 times the linear camera's in any scene.
"""

import argparse
import json
import pathlib
import re
import shutil
import subprocess
import sys

import cv2
import numpy as np


def run(program, *args):
    done = subprocess.run([program, *map(str, args), "--json", "--quiet"], capture_output=True, text=True)
    if done.returncode and not done.stdout.strip().startswith("{"):
        sys.exit(f"{' '.join(map(str, args))}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def curve(name):
    """Codes of light, both of full scale."""
    if name == "srgb":
        return lambda v: np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)
    if name == "phone":
        srgb = curve("srgb")
        return lambda v: srgb(v) + 0.35 * srgb(v) * (1 - srgb(v)) * (srgb(v) - 0.35)
    return lambda v: np.maximum(v, 0) ** (1 / float(name))


def webcam(source, target, levels, codes, quality):
    """Writes what a webcam makes of the image of a linear camera; a JPEG file whatever its name says."""
    black, saturation = levels
    light = np.clip((cv2.imread(str(source), -1).astype(np.float64) - black) / (saturation - black), 0, 1)
    image = np.clip(np.round(codes(light) * 255), 0, 255).astype(np.uint8)
    target.parent.mkdir(parents=True, exist_ok=True)
    if quality:
        target.write_bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes())
    else:
        target.write_bytes(cv2.imencode(".png", image)[1].tobytes())


def superposed(program, folder, linear):
    """The scanner of a rig, showing the images whose light adds up; returns the folder of its captures."""
    rig = folder / "superposition"
    if not rig.exists():
        spec = (linear / "simulation.toml").read_text()
        sets = '[[pattern_sets]]\nname = "superposition"\n\n[[pattern_sets.patterns]]\nfamily = "superposition"\n\n'
        spec = re.sub(r"\[\[pattern_sets\]\]\n(?:(?!\[board\]).)*", lambda m: sets, spec, count=1, flags=re.S)
        spec = re.sub(r"^positions = \d+", "positions = 3", spec, count=1, flags=re.M)
        # Black is what the light source shows as black, as through the page.
        spec = re.sub(r'^black = "off"', 'black = "darkest"', spec, count=1, flags=re.M)
        file = folder / "superposition.toml"
        file.write_text(spec)
        run(program, "simulate", file, "-o", rig)
    return sorted((rig / "scenes").iterdir())[0]


def scans(program, rig, linear, accept):
    run(program, "check", rig)
    calibrated = run(program, "calibrate", rig, "--accept")
    for scene in sorted(p.name for p in (linear / "scenes").iterdir()):
        truth = linear / "scenes" / scene / "truth"
        truth = truth if truth.exists() else linear / "ground_truth" / "scenes" / scene
        yield scene, calibrated, run(program, "reconstruct", rig, scene, "--truth", truth, "--accept")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--preset", default="demo")
    parser.add_argument("--gamma", default="2.2", help="a number, srgb, or phone (sRGB with foot and shoulder)")
    parser.add_argument("--quality", type=int, default=90, help="of JPEG; 0: PNG files")
    args = parser.parse_args()
    folder = args.folder
    folder.mkdir(parents=True, exist_ok=True)
    linear = folder / "linear"
    if not linear.exists():
        run(args.program, "simulate", args.preset, "-o", linear)
    shown = superposed(args.program, folder, linear)
    toml = (linear / "rig.toml").read_text()
    levels = [float(re.search(rf"^{key} = ([\d.]+)", toml, re.M)[1]) for key in ("black_level", "saturation")]
    source = folder / "webcam"
    if source.exists():
        shutil.rmtree(source)
    for file in [*linear.glob("calibration/*/*.png"), *linear.glob("scenes/*/*.png")]:
        webcam(file, source / file.relative_to(linear), levels, curve(args.gamma), args.quality)
    for file in shown.glob("*.png"):
        webcam(file, source / "response" / file.name, levels, curve(args.gamma), args.quality)
    for name in ("camera.json", "patterns"):
        (shutil.copytree if (linear / name).is_dir() else shutil.copy)(linear / name, source / name)
    toml = re.sub(r"^black_level = .*", "black_level = 0.0", toml, flags=re.M)
    source.joinpath("rig.toml").write_text(re.sub(r"^saturation = .*", "saturation = 255.0", toml, flags=re.M))

    rigs = {"linear, 12 bits": linear}
    for name, option in (("measured", ["--response", "measure"]), ("stated as srgb", []), ("not stated", [])):
        rig = folder / name.replace(" ", "-")
        if rig.exists():
            shutil.rmtree(rig)
        answer = run(args.program, "capture", rig, "--rehearse", source, *option)
        if option:
            print(json.dumps(answer["response"], indent=1))
        if name == "stated as srgb":
            file = rig / "rig.toml"
            file.write_text(file.read_text().replace("[camera]\n", '[camera]\nresponse = "srgb"\n'))
        rigs[f"webcam, {name}"] = rig

    print("\n| camera | scene | calibrate | reconstruct | median error, mm | claimed 1σ, mm | coverage, % |\n|---|---|---|---|---|---|---|")
    errors = {}
    for name, rig in rigs.items():
        for scene, calibrated, answer in scans(args.program, rig, linear, True):
            said = [a["verdict"] + "".join(f" `{w['code']}`" for w in a["warnings"]) for a in (calibrated, answer)]
            metrics = answer["summary"]["metrics"]
            body = metrics["body"]
            errors[name, scene] = body["depth_mm"]["median"]
            print(f"| {name} | {scene} | {said[0]} | {said[1]} | {errors[name, scene]:.4f} | "
                  f"{body['sigma']['median_mm']:.4f} | {100 * metrics['whole']['coverage']:.1f} |")
    worst = max(errors["webcam, measured", s] / e for (n, s), e in errors.items() if n == "linear, 12 bits")
    print(f"\nmeasured: at worst {worst:.2f} times the median error of the linear camera")
    return 1 if worst > 1.5 else 0


if __name__ == "__main__":
    sys.exit(main())
