#!/usr/bin/env python3
"""Decodes a Gray-coded scene with OpenCV and with nelu3d, compares the columns, and prints the seconds of both.

    nelu3d simulate benches/peer/gray44.toml -o /tmp/gray44
    python3 benches/peer/gray_opencv.py /tmp/gray44 ball --nelu3d target/release/nelu3d

Needs numpy and opencv-contrib-python (its module structured_light). The set must be Gray code along x, then along y, most
significant bit first, with inverses, as `nelu3d patterns` and `nelu3d simulate` write it: that is OpenCV's order too.

OpenCV decodes one pixel a call (getProjPixel), which from Python is mostly the call; its only whole-image function
(decode) takes two cameras and goes on to a disparity map. Both are timed: the first for the columns, the second, given
the same images as both cameras, as the C++ time of two decodings.

Same answer: our columns are computed back from depth.npy with projector.json, so they have passed through sub-pixel refinement
and triangulation. A column of OpenCV is a whole pixel, so a correct answer differs by up to half a pixel, and by up to one
where a pixel looks at the border of two columns; the share within each is printed.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time
import tomllib

import cv2
import numpy as np


def distort(c, x, y):
    k1, k2, p1, p2, k3 = (list(c) + [0.0] * 5)[:5]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)


def columns_of(depth, camera, projector):
    """Projector pixels of a depth map: (height, width, 2)."""
    h, w = depth.shape
    k = np.array(camera["K"])
    px = np.stack(np.meshgrid(np.arange(w, dtype=float), np.arange(h, dtype=float)), -1).reshape(-1, 1, 2)
    xy = cv2.undistortPoints(px, k, np.array(camera["dist_coeffs"])).reshape(h, w, 2)
    points = np.concatenate([xy, np.ones((h, w, 1))], -1) * depth[..., None]
    r, t = np.array(projector["R"]), np.array(projector["T"])
    q = points @ r.T + t
    x, y = distort(projector["dist_coeffs"], q[..., 0] / q[..., 2], q[..., 1] / q[..., 2])
    k = np.array(projector["K"])
    return np.stack([k[0, 0] * x + k[0, 2], k[1, 1] * y + k[1, 2]], -1)


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("rig", type=pathlib.Path)
    args.add_argument("scene")
    args.add_argument("--set", default="gray44")
    args.add_argument("--nelu3d", default="nelu3d")
    args.add_argument("--threshold", type=int, default=5, help="OpenCV's white threshold, codes")
    args = args.parse_args()

    rig = tomllib.loads((args.rig / "rig.toml").read_text())
    chosen = next(s for s in rig["pattern_sets"] if s["name"] == args.set)
    names = [n for pair in zip(chosen["images"], chosen["inverse"]) for n in pair]
    scene = args.rig / "scenes" / args.scene
    projector = json.loads((args.rig / "projector.json").read_text())
    camera = json.loads((args.rig / rig["camera"]["intrinsics"]).read_text())

    start = time.perf_counter()
    images = [cv2.imread(str(scene / n), cv2.IMREAD_GRAYSCALE) for n in names]
    white = cv2.imread(str(scene / rig["images"]["white"]), cv2.IMREAD_GRAYSCALE)
    black = cv2.imread(str(scene / rig["images"]["black"]), cv2.IMREAD_GRAYSCALE)
    reading = time.perf_counter() - start

    code = cv2.structured_light.GrayCodePattern.create(projector["resx"], projector["resy"])
    assert code.getNumberOfPatternImages() == len(images), "the set is not OpenCV's Gray code of this projector"
    code.setWhiteThreshold(args.threshold)
    lit = white.astype(int) - black > 5

    start = time.perf_counter()
    theirs = np.full(white.shape + (2,), np.nan)
    for y, x in zip(*np.nonzero(lit)):
        failed, px = code.getProjPixel(images, int(x), int(y))
        if not failed:
            theirs[y, x] = px
    by_pixel = time.perf_counter() - start

    code.setBlackThreshold(5)
    start, start_cpu = time.perf_counter(), time.process_time()
    code.decode([images, images], None, [black, black], [white, white], cv2.structured_light.DECODE_3D_UNDERWORLD)
    both, both_cpu = time.perf_counter() - start, time.process_time() - start_cpu

    with tempfile.TemporaryDirectory() as folder:
        command = [args.nelu3d, "decode", args.rig, args.scene, "--set", args.set, "--method", "gray", "-q"]
        start = time.perf_counter()
        subprocess.run([str(c) for c in command] + ["-o", f"{folder}/r"], check=True, stdout=subprocess.DEVNULL)
        whole = time.perf_counter() - start
        result = json.loads(pathlib.Path(folder, "r", "result.json").read_text())
        depth = np.load(f"{folder}/r/depth.npy")
    stages = {s["name"]: s for s in result["stages"]}
    ours = columns_of(depth, camera, projector)

    common = np.isfinite(theirs[..., 0]) & np.isfinite(depth)
    off = np.abs(ours - theirs)[common]
    print(f"{rig['name']}/{args.scene}: {white.shape[1]} x {white.shape[0]} px, {len(names) + 2} images")
    print(f"decoded: OpenCV {np.isfinite(theirs[..., 0]).sum()}, nelu3d {np.isfinite(depth).sum()}, both {common.sum()} px")
    for axis, name in enumerate(["column", "row"]):
        shares = ", ".join(f"{(off[:, axis] <= d).mean():.4%} within {d} px" for d in (0.5, 1.0, 1.5))
        print(f"same {name}: {shares}; median difference {np.median(off[:, axis]):.3f} px")
    read = stages["read the scene"]
    work = [stages[n] for n in ("normalize", "decode")]
    wall, cpu = sum(s["wall_secs"] for s in work), sum(s["cpu_secs"] for s in work)
    print("seconds (wall)                                  OpenCV     nelu3d")
    print(f"read the images                               {reading:8.3f}   {read['wall_secs']:8.3f}")
    print(f"decode, OpenCV in C++ (half of two cameras)   {both / 2:8.3f}   {wall:8.3f}")
    print(f"  the same in processor time, all threads     {both_cpu / 2:8.3f}   {cpu:8.3f}")
    print(f"decode, OpenCV from Python (pixel by pixel)   {by_pixel:8.3f}   {wall:8.3f}")
    print(f"read + decode (C++)                           {reading + both / 2:8.3f}   {read['wall_secs'] + wall:8.3f}")
    print(f"nelu3d's whole command, with triangulation, mesh, report: {whole:.3f}")


if __name__ == "__main__":
    main()
