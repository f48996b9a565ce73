#!/usr/bin/env python3
"""A rig of many pixels: another one's images, scaled up.

    python3 benches/fast/resampled.py RIG OUT [--scale 10] [--positions 12] [--scenes pawn]

The images of RIG (`../shared/data/dlp`, 640 x 480 px, say) are resampled by cubic interpolation to SCALE times their
width and height, and get white noise of 0.2 % of full scale of their own, since what was noise is smooth then. Every
n-th position is taken, so that POSITIONS are left, and the ground truth's nearest pixel. What is measured on it tells
time and memory, not accuracy: no detail is there that the small images did not have. Needs numpy and OpenCV.
"""

import argparse
import json
import pathlib
import shutil

import cv2
import numpy as np


def scaled(path, to, scale, random):
    """Scales one image and adds noise."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    full = np.iinfo(image.dtype).max if image.max() > 4095 or image.dtype == np.uint8 else 4095
    large = cv2.resize(image.astype(np.float32), None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    large += random.standard_normal(large.shape, dtype=np.float32) * (0.002 * full)
    to.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(to), large.round().clip(0, full).astype(image.dtype), [cv2.IMWRITE_PNG_COMPRESSION, 1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rig", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--scale", type=int, default=10)
    parser.add_argument("--positions", type=int, default=12)
    parser.add_argument("--scenes", default="pawn")
    args = parser.parse_args()
    rig, out, scale = args.rig, args.out, args.scale
    random = np.random.default_rng(0)
    out.mkdir(parents=True)
    shutil.copy(rig / "rig.toml", out)
    if (rig / "patterns").exists():
        shutil.copytree(rig / "patterns", out / "patterns")
    camera = json.loads((rig / "camera.json").read_text())
    camera["resx"], camera["resy"] = camera["resx"] * scale, camera["resy"] * scale
    for row in range(2):
        k = camera["K"][row]
        # The middle of the first pixel is at 0.
        camera["K"][row] = [v * scale for v in k[:2]] + [(k[2] + 0.5) * scale - 0.5]
    (out / "camera.json").write_text(json.dumps(camera, indent=1))
    positions = sorted(p for p in (rig / "calibration").iterdir() if p.is_dir())
    take = np.linspace(0, len(positions) - 1, min(args.positions, len(positions))).round().astype(int)
    for position in (positions[i] for i in take):
        for image in sorted(position.glob("*.png")):
            scaled(image, out / "calibration" / position.name / image.name, scale, random)
    for name in args.scenes.split(","):
        scene = rig / "scenes" / name
        for image in sorted(scene.glob("*.png")):
            scaled(image, out / "scenes" / name / image.name, scale, random)
        truth = out / "scenes" / name / "truth"
        truth.mkdir()
        depth = np.load(scene / "truth" / "depth.npy")
        np.save(truth / "depth.npy", cv2.resize(depth, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST))
        mask = cv2.imread(str(scene / "truth" / "mask.png"), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(truth / "mask.png"), cv2.resize(mask, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST))


if __name__ == "__main__":
    main()
