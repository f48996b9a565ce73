#!/usr/bin/env python3
"""Five real boards (../shared/data/kamino): cameras of four of them, ours and OpenCV's, judged on the fifth.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install opencv-contrib-python-headless
    NELU3D_CORNERS=/tmp/k.json cargo test --release -p nelu3d-scan --test unit real_boards -- --nocapture 2>&1 | tee /tmp/k.log
    /tmp/venv/bin/python benches/camera/kamino.py /tmp/k.json /tmp/k.log

OpenCV gets the corners that ours found, and solves as many coefficients as ours chose. Errors are the RMS distance (px)
of the corners of the board that was left out from where the camera projects it at the pose that fits best, over those
within 4.5 robust standard deviations; in brackets the corners that count, of those there are (ours prints the error only).
"""
import json
import re
import sys

import cv2
import numpy as np

FLAGS = {0: cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
         4: cv2.CALIB_FIX_K3, 5: 0, 8: cv2.CALIB_RATIONAL_MODEL}


def board(rows):
    rows = np.array(rows, float)
    return np.concatenate([rows[:, :2], np.zeros((len(rows), 1))], 1).astype(np.float32), rows[:, 2:].astype(np.float32)


def left_out(k, d, rows):
    points, px = board(rows)
    keep = np.ones(len(points), bool)
    for _ in range(4):
        _, r, t = cv2.solvePnP(points[keep], px[keep], k, d)
        r, t = cv2.solvePnPRefineLM(points[keep], px[keep], k, d, r, t)
        off = np.linalg.norm(cv2.projectPoints(points, r, t, k, d)[0].reshape(-1, 2) - px, axis=1)
        keep = off <= 4.5 * np.median(off) / 1.1774
    return np.sqrt((off[keep] ** 2).mean()), keep.sum(), len(keep)


def main(corners, log):
    corners, log = json.load(open(corners)), open(log).read()
    sums = np.zeros(2)
    print("| left out | coefficients | f, ours, px | OpenCV | left out, ours, px | OpenCV |\n|---|---|---|---|---|---|")
    for name in sorted(corners):
        said = re.search(rf"without {name}: (\d) coefficients.*?f ([\d.]+ ± [\d.]+),.*?left out ([\d.]+) px", log)
        n, ours = int(said[1]), float(said[3])
        used = [board(corners[m]) for m in sorted(corners) if m != name]
        _, k, d, _, _ = cv2.calibrateCamera([u[0] for u in used], [u[1] for u in used], (1280, 1024), None, None,
                                            flags=FLAGS[n])
        theirs, kept, all_of = left_out(k, d, corners[name])
        sums += [ours ** 2, theirs ** 2]
        print(f"| {name} | {n} | {said[2]} | {k[0, 0]:.1f} | {ours:.3f} | {theirs:.3f} ({kept} of {all_of}) |")
    ours, theirs = np.sqrt(sums / len(corners))
    print(f"RMS: ours {ours:.3f} px, OpenCV {theirs:.3f} px")


if __name__ == "__main__":
    main(*sys.argv[1:])
