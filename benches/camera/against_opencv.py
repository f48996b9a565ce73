#!/usr/bin/env python3
"""Calibrates from a real sweep with `nelu3d camera` and with OpenCV on the same corners, and judges both on the board that
was left out.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install opencv-contrib-python-headless
    /tmp/venv/bin/python benches/camera/against_opencv.py target/release/nelu3d RIG [--model 4]

For each position: the RMS distance (px) of its corners from where the camera of the other positions projects the board,
at the pose that fits best. OpenCV gets the corners that ours found, and solves as many coefficients as ours chose.
"""
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

FLAGS = {0: cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
         4: cv2.CALIB_FIX_K3, 5: 0, 8: cv2.CALIB_RATIONAL_MODEL}


def board(rows):
    rows = np.array(rows, float)
    return np.concatenate([rows[:, :2], np.zeros((len(rows), 1))], 1).astype(np.float32), rows[:, 2:].astype(np.float32)


def left_out(k, d, rows):
    points, px = board(rows)
    _, r, t = cv2.solvePnP(points, px, k, d, flags=cv2.SOLVEPNP_ITERATIVE)
    r, t = cv2.solvePnPRefineLM(points, px, k, d, r, t)
    off = cv2.projectPoints(points, r, t, k, d)[0].reshape(-1, 2) - px
    return np.sqrt((off ** 2).sum(1).mean())


def main():
    nelu3d, rig, rest = sys.argv[1], Path(sys.argv[2]), sys.argv[3:]
    names = sorted(p.name for p in (rig / "calibration").iterdir())
    print("| left out | coefficients | f of ours, px | of OpenCV | left out: ours, px | OpenCV, px |\n|---|---|---|---|---|---|")
    sums = np.zeros(2)
    for name in names:
        with tempfile.TemporaryDirectory() as work:
            work = Path(work)
            out = subprocess.run([nelu3d, "camera", rig, "-o", work / "c.json", "--corners", work / "k.json", "--leave-out",
                                  name, "--keep-uncertain", "--json", "--quiet", *rest], capture_output=True, text=True)
            if out.returncode:
                print(f"| {name} | refused: {out.stderr.strip()} |")
                continue
            c = json.loads((work / "c.json").read_text())
            corners = json.loads((work / "k.json").read_text())
            n = json.loads(out.stdout)["report"]["coefficients"]
        sigma = json.loads(out.stdout)["report"]["pinhole_sigma_px"]
        size = (c["resx"], c["resy"])
        used = [board(corners[m]) for m in names if m != name and corners[m]]
        flags = FLAGS[n]
        _, k, d, _, _ = cv2.calibrateCamera([u[0] for u in used], [u[1] for u in used], size, None, None, flags=flags)
        ours = left_out(np.array(c["K"]), np.array(c["dist_coeffs"], float), corners[name])
        theirs = left_out(k, d, corners[name])
        sums += [ours ** 2, theirs ** 2]
        print(f"| {name} | {n} | {c['K'][0][0]:.1f} ± {sigma[0]:.1f} | {k[0, 0]:.1f} | {ours:.4f} | {theirs:.4f} |", flush=True)
    print(f"RMS over all: ours {np.sqrt(sums[0] / len(names)):.4f} px, OpenCV {np.sqrt(sums[1] / len(names)):.4f} px")


if __name__ == "__main__":
    main()
