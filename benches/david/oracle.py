#!/usr/bin/env python3
"""TurboSL's result on david next to what the authors' own run left (repository guge2/TurboSL).

    nelu3d decode DAVID david --method turbosl --depth 580 720 --unit-mm 125 --start random -o OUT [--stop-after N]
    python benches/david/oracle.py DAVID OUT
    python benches/david/oracle.py DAVID OUT --surface     any other result of the same images: no loss terms

DAVID is the rig folder with `reference/` in it. Says for every check what was found and what is asked for:

- loss terms and inv_s at 500, 1,000, 2,000, and 10,000 iterations (those that OUT has) within a factor of 1.5;
- normals within 10 degrees of the authors', median over pixels that both have;
- depth within 5 mm of the zero of the authors' signed distances, at 95 % of the pixels that both have.

Exits with 1 if a check fails. Needs numpy and pillow.
"""

import argparse
import csv
import json
import math
import pathlib
import sys

import numpy as np
from PIL import Image

STEPS = [500, 1000, 2000, 10000]
FACTOR = 1.5
UNIT_MM = 125.0
CENTER_MM = np.array([0.0, 15.0, 650.0])
SIDE = 3.0


def theirs_at(rows, step):
    """Returns the authors' loss terms at an iteration, as `result.json` names them."""
    row = next(r for r in rows if r["train/loss_mask"] and int(r["step"]) + 1 == step)
    value = lambda name: float(row["train/" + name])
    image = sum(value(f"loss_rgb_l1_{side}") + 10 * value(f"loss_rgb_mse_{side}") for side in ("cam", "proj"))
    return {
        "image": image,
        "mask": value("loss_mask"),
        "eikonal": value("loss_eikonal"),
        "sparsity": value("loss_sparsity"),
        "inv_s": value("inv_s"),
        "rays": value("num_rays"),
    }


def losses(reference, result):
    """Compares loss terms; returns whether all agree."""
    with open(reference / "metrics.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    records = {r["iteration"]: r for r in result["method"]["losses"]}
    agree = True
    for step in STEPS:
        # Ours are of every hundredth iteration, counted from 0, and of the last. At 1,000 the projector's loss sets in.
        ours = records.get(step) or records.get(step - 99 if step == 1000 else step + 1)
        if ours is None:
            print(f"{step:6} iterations: not reached")
            continue
        ours = {**ours, "inv_s": ours["inv_s_per_mm"] * result["method"]["unit_mm"]}
        for name, wanted in theirs_at(rows, step).items():
            ratio = ours[name] / wanted
            ok = 1 / FACTOR <= ratio <= FACTOR
            # The number of rays follows the budget of samples.
            judged = name != "rays"
            agree &= ok or not judged
            word = ("agrees" if ok else "DIFFERS") if judged else "-"
            print(f"{step:6} {name:9} ours {ours[name]:10.5f}  theirs {wanted:10.5f}  ratio {ratio:6.2f}  {word}")
    return agree


def undistorted(camera):
    """Returns the image-plane coordinates of every pixel (x, y at z = 1), by fixed-point iteration."""
    k, (k1, k2, p1, p2, k3) = np.array(camera["K"]), camera["dist_coeffs"]
    v, u = np.mgrid[: camera["resy"], : camera["resx"]].astype(float)
    xd, yd = (u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]
    x, y = xd.copy(), yd.copy()
    for _ in range(20):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = (
            (xd - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
            (yd - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial,
        )
    return x, y


def trilinear(grid, points):
    """Returns the grid's values at points of [0, 1]^3; NaN outside."""
    n = grid.shape[0]
    q = points * (n - 1)
    inside = np.all((q >= 0) & (q <= n - 1), axis=-1)
    i = np.clip(np.floor(q).astype(int), 0, n - 2)
    f = np.clip(q - i, 0, 1)
    out = np.zeros(points.shape[:-1])
    for corner in range(8):
        bits = np.array([corner >> a & 1 for a in range(3)])
        weight = np.prod(np.where(bits, f, 1 - f), axis=-1)
        j = i + bits
        out += weight * grid[j[..., 0], j[..., 1], j[..., 2]]
    return np.where(inside, out, np.nan)


def reference_depth(grid, x, y, near=560.0, far=740.0, step=1.0):
    """Returns the depth at which rays first enter the authors' body, mm; NaN where they do not."""
    depth = np.full(x.shape, np.nan)
    before = np.full(x.shape, np.nan)
    for z in np.arange(near, far, step):
        points = np.stack([x * z, y * z, np.full_like(x, z)], axis=-1)
        here = trilinear(grid, ((points - CENTER_MM) / UNIT_MM + SIDE / 2) / SIDE)
        entered = (before > 0) & (here <= 0) & np.isnan(depth)
        part = before / np.where(entered, before - here, 1)
        depth = np.where(entered, z - step + step * part, depth)
        before = here
    return depth


def surface(reference, rig, folder):
    """Compares depths and normals; returns whether they agree."""
    camera = json.loads((rig / "camera.json").read_text())
    ours, our_normals = np.load(folder / "depth.npy"), np.load(folder / "normals.npy")
    x, y = undistorted(camera)
    n = round(np.load(reference / "sdf_10000.npy").size ** (1 / 3))
    grid = np.load(reference / "sdf_10000.npy").reshape(n, n, n)
    rows, columns = np.nonzero(np.isfinite(ours))
    theirs = reference_depth(grid, x[rows, columns], y[rows, columns])
    both = np.isfinite(theirs)
    error = np.abs(ours[rows, columns] - theirs)[both]
    share = np.mean(error < 5.0)
    print(f"depth: {both.sum()} pixels of both ({rows.size} of ours); median difference {np.median(error):.2f} mm")
    print(f"depth: within 5 mm at {100 * share:.1f} % (95 asked for)  {'agrees' if share >= 0.95 else 'DIFFERS'}")
    # Their normals are a picture of the undistorted image, 0 where there is no object.
    picture = np.asarray(Image.open(reference / "normal_10000.png").convert("RGB")).astype(float) / 255 * 2 - 1
    k = np.array(camera["K"])
    u = np.rint(x[rows, columns] * k[0, 0] + k[0, 2]).astype(int)
    v = np.rint(y[rows, columns] * k[1, 1] + k[1, 2]).astype(int)
    inside = (u >= 0) & (v >= 0) & (u < picture.shape[1]) & (v < picture.shape[0])
    theirs = np.full((rows.size, 3), np.nan)
    theirs[inside] = picture[v[inside], u[inside]]
    length = np.linalg.norm(theirs, axis=1)
    cosine = np.sum(our_normals[rows, columns] * theirs / np.maximum(length, 1e-6)[:, None], axis=1)
    known = inside & (length > 0.8) & (length < 1.2) & both & np.isfinite(cosine)
    cosine = cosine[known]
    median = np.degrees(np.median(np.arccos(np.clip(cosine, -1, 1))))
    print(f"normals: {known.sum()} pixels; median difference {median:.1f} degrees (10)  ", end="")
    print("agrees" if median < 10 else "DIFFERS")
    return bool(share >= 0.95 and median < 10)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("rig", type=pathlib.Path)
    parser.add_argument("result", type=pathlib.Path)
    parser.add_argument("--surface", action="store_true")
    args = parser.parse_args()
    reference = args.rig / "reference"
    result = json.loads((args.result / "result.json").read_text())
    agree = args.surface or losses(reference, result)
    agree &= surface(reference, args.rig, args.result)
    sys.exit(0 if agree else 1)


if __name__ == "__main__":
    main()
