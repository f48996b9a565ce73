#!/usr/bin/env python3
"""Calibrates virtual cameras from sweeps by hand and compares them with the truth; scans with both.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install numpy tomli_w opencv-contrib-python-headless
    /tmp/venv/bin/python benches/camera/virtual.py target/release/nelu3d [--scan] [--facing] [--seeds 1,2,3] [--keep DIR] \
        [PRESET ...]

Rigs are the presets `shapes`, `color` and `dlp` (markers, charuco, markers) with the board held by hand at 40 positions,
tilted by up to 40 degrees and partly outside the picture. Errors: of the focal lengths (percent of them), of the
principal point (px), of the distortion (largest over the picture, shifts, magnification and a turn apart, px), and the
RMS of the first four over their stated standard deviations.

--scan also calibrates a field and scans the first scene with the true camera and with the one found: body MAE (mm).
--keep makes the rigs in DIR, or takes those that are there.
--facing takes the presets' own stages, whose boards face the camera, and prints what is said.
"""
import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import cv2
import numpy as np
import tomli_w

SWEEP = {"kind": "handheld", "positions": 40, "first_mm": 600.0, "last_mm": 800.0, "position_sigma_mm": 15.0,
         "tilt_sigma": 0.3, "depths": "scattered", "max_tilt": 0.698, "min_in_view": 0.6, "write_poses": False}


def run(*args, check=True):
    return subprocess.run([str(a) for a in args], check=check, capture_output=True, text=True)


def load(path):
    c = json.loads(Path(path).read_text())
    return np.array(c["K"]), np.array(c["dist_coeffs"], float), (c["resx"], c["resy"])


def distortion_error(truth, found):
    """Pixels of the picture through the true lens to directions, and back through the one found."""
    (k, d, (w, h)), (kf, df, _) = truth, found
    px = np.stack(np.meshgrid(np.linspace(0, w - 1, 17), np.linspace(0, h - 1, 13)), -1).reshape(-1, 1, 2)
    term = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12)
    rays = cv2.undistortPointsIter(px, k, d, None, None, term) if hasattr(cv2, "undistortPointsIter") else \
        cv2.undistortPoints(px, k, d, criteria=term)
    rays = np.concatenate([rays.reshape(-1, 2), np.ones((len(px), 1))], 1)
    back = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), kf, df)[0].reshape(-1, 2)
    p = px.reshape(-1, 2)
    off = back - p
    one, zero = np.ones(len(p)), np.zeros(len(p))
    a = np.concatenate([np.stack([one, zero, p[:, 0], zero, -p[:, 1]], 1),
                        np.stack([zero, one, zero, p[:, 1], p[:, 0]], 1)])
    b = np.concatenate([off[:, 0], off[:, 1]])
    left = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
    return np.hypot(left[:len(p)], left[len(p):]).max()


def body_mae(nelu3d, rig, scene, camera, work):
    """Calibrates a field and scans with a camera file."""
    (rig / "camera.json").write_text(camera)
    run(nelu3d, "calibrate", rig, "-o", work / "f.safetensors", "--quiet")
    run(nelu3d, "reconstruct", rig, scene, "--field", work / "f.safetensors", "-o", work / "result", "--quiet",
        "--truth", rig / "scenes" / scene / "truth")
    answer = json.loads((work / "result" / "result.json").read_text())
    depth = answer["metrics"]["body"]["depth_mm"]
    return {key: round(depth[key], 4) for key in ("mae", "median", "bias") if key in depth} or depth


def main():
    args = sys.argv[1:]
    nelu3d = args.pop(0)
    scan, facing = "--scan" in args, "--facing" in args
    seeds = [1, 2, 3]
    if "--seeds" in args:
        i = args.index("--seeds")
        seeds = [int(s) for s in args[i + 1].split(",")]
        del args[i:i + 2]
    keep = None
    if "--keep" in args:
        i = args.index("--keep")
        keep = Path(args[i + 1])
        del args[i:i + 2]
    presets = [a for a in args if not a.startswith("--")] or ["shapes", "color", "dlp"]
    print("| rig | seed | coefficients | f, % | center, px | distortion, px | error / σ | RMS, px |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    ratios = []
    for preset in presets:
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder)
            rigs = (keep or work) / preset
            base = rigs / "base"
            if not base.exists():
                run(nelu3d, "simulate", preset, "-o", base, "--quiet")
            if facing:
                out = run(nelu3d, "camera", base, "-o", work / "own.json", "--quiet", check=False)
                print(f"{preset}, its own stage: exit code {out.returncode}: {out.stderr.strip()}", flush=True)
                continue
            spec = tomllib.loads((base / "simulation.toml").read_text())
            for seed in seeds:
                rig = rigs / f"{'scan' if scan else 'sweep'}{seed}"
                own = dict(spec, seed=seed, sweep=SWEEP, sequences=[], scenes=spec["scenes"][:1] if scan else [])
                if not scan:
                    # One pattern is enough for what takes only white images.
                    own["pattern_sets"] = [dict(s, patterns=s["patterns"][:1]) for s in spec.get("pattern_sets", [])][:1]
                (work / "spec.toml").write_text(tomli_w.dumps(own))
                if not rig.exists():
                    run(nelu3d, "simulate", work / "spec.toml", "-o", rig, "--quiet")
                    (rig / "truth.json").write_text((rig / "camera.json").read_text())
                truth_text = (rig / "truth.json").read_text()
                truth = load(rig / "truth.json")
                out = run(nelu3d, "camera", rig, "-o", work / "own.json", "--force", "--json", "--quiet", check=False)
                if out.returncode:
                    print(f"{preset} {seed}: {out.stderr}", flush=True)
                    continue
                report = json.loads(out.stdout)["report"]
                found = load(work / "own.json")
                t = [truth[0][0, 0], truth[0][1, 1], truth[0][0, 2], truth[0][1, 2]]
                e = np.array(report["pinhole_px"]) - t
                z = e / np.array(report["pinhole_sigma_px"])
                ratios += list(z)
                print(f"| {preset} | {seed} | {report['coefficients']} | "
                      f"{100 * e[0] / t[0]:+.4f}, {100 * e[1] / t[1]:+.4f} | {e[2]:+.2f}, {e[3]:+.2f} | "
                      f"{distortion_error(truth, found):.3f} | {np.sqrt(np.mean(z ** 2)):.2f} | "
                      f"{report['rms_px']:.4f} |", flush=True)
                if scan:
                    scene = own["scenes"][0]["name"]
                    a = body_mae(nelu3d, rig, scene, truth_text, work)
                    b = body_mae(nelu3d, rig, scene, (work / "own.json").read_text(), work)
                    print(json.dumps({"true camera": a, "own camera": b}), flush=True)
    if ratios:
        z = np.abs(ratios)
        print(f"errors over their standard deviations: RMS {np.sqrt(np.mean(z ** 2)):.2f}, "
              f"{100 * np.mean(z < 1):.0f} % within one, {100 * np.mean(z < 2):.0f} % within two")


if __name__ == "__main__":
    main()
