#!/usr/bin/env python3
"""Error maps of several results side by side, in one PNG.

    python benches/compare/pictures.py OUT.png TRUTH LABEL=RESULT [LABEL=RESULT ...]     errors against a truth folder
    python benches/compare/pictures.py OUT.png - LABEL=RESULT [LABEL=RESULT ...]         depths, where there is no truth

Red is farther than the truth, blue nearer, full color at 2 mm; gray has no depth where the truth has one. Depths are shaded by
their normals. Needs numpy and pillow.
"""

import pathlib
import sys

import numpy as np
from PIL import Image, ImageDraw

FULL_MM = 2.0


def error_picture(depth, truth, mask):
    error = np.clip((depth - truth) / FULL_MM, -1, 1)
    strength = np.abs(error)[..., None]
    color = np.where(error[..., None] > 0, [200, 30, 30], [30, 60, 200])
    picture = 255 * (1 - strength) + color * strength
    picture = np.where(np.isnan(error)[..., None], [120, 120, 120], picture)
    return np.where(mask[..., None], picture, 20)


def shaded(result):
    normals = np.load(result / "normals.npy")
    light = np.clip(-normals @ np.array([0.4, 0.3, 0.87]), 0, 1)
    seen = np.isfinite(light)
    picture = np.where(seen, 30 + 220 * np.nan_to_num(light), 20)
    return np.repeat(picture[..., None], 3, axis=2)


def main():
    out, truth = pathlib.Path(sys.argv[1]), sys.argv[2]
    results = [argument.split("=", 1) for argument in sys.argv[3:]]
    tiles = []
    if truth != "-":
        wanted = np.load(pathlib.Path(truth) / "depth.npy")
        mask = np.array(Image.open(pathlib.Path(truth) / "mask.png").convert("L")) > 127
    for label, folder in results:
        folder = pathlib.Path(folder)
        if truth == "-":
            seen = np.isfinite(np.load(folder / "depth.npy"))
            tiles.append((label, shaded(folder), seen))
        else:
            tiles.append((label, error_picture(np.load(folder / "depth.npy"), wanted, mask), mask))
    anywhere = np.any([seen for _, _, seen in tiles], axis=0)
    rows, columns = np.flatnonzero(anywhere.any(1)), np.flatnonzero(anywhere.any(0))
    box = slice(max(rows[0] - 8, 0), rows[-1] + 9), slice(max(columns[0] - 8, 0), columns[-1] + 9)
    pictures = []
    for label, picture, _ in tiles:
        image = Image.fromarray(picture[box].astype(np.uint8))
        image.thumbnail((360, 480))
        framed = Image.new("RGB", (image.width, image.height + 16), (255, 255, 255))
        framed.paste(image, (0, 16))
        ImageDraw.Draw(framed).text((4, 3), label, fill=(0, 0, 0))
        pictures.append(framed)
    width, height = max(p.width for p in pictures), max(p.height for p in pictures)
    across = 3 if len(pictures) in (5, 6) else min(len(pictures), 4)
    sheet = Image.new("RGB", (across * (width + 6), -(-len(pictures) // across) * (height + 6)), (255, 255, 255))
    for i, picture in enumerate(pictures):
        sheet.paste(picture, (i % across * (width + 6), i // across * (height + 6)))
    sheet.save(out, optimize=True)


if __name__ == "__main__":
    main()
