#!/usr/bin/env python3
"""Makes a rig of a public real capture: the Gray code captures of kamino410/procam-calibration, or your own taken with it.

    git clone --depth 1 https://github.com/kamino410/procam-calibration
    python3 benches/samples/procam.py procam-calibration/sample_data kamino --square-mm 75 --board 8x10
    nelu3d check kamino && nelu3d calibrate kamino --set rows

The repository has the MIT license (Copyright (c) kamino410); nothing of it is part of nelu3d. Its folders capture_*
hold graycode_00.png, …: OpenCV's order, which is each bit of the columns and then of the rows, the finest last, as an
image and its inverse, then white and black. Images are copied as they are; each board is a scene, too. Intrinsics come
from calibration_result.xml; without it, `nelu3d camera` finds them. Needs nothing but Python.
"""

import argparse
import json
import shutil
import struct
import sys
import xml.etree.ElementTree as xml
from pathlib import Path


def size_of(png: Path) -> tuple[int, int, bool]:
    """Returns width and height of a PNG file, px, and whether it is gray."""
    head = png.read_bytes()[:26]
    if head[:8] != b"\x89PNG\r\n\x1a\n":
        sys.exit(f"{png}: is no PNG file; give the folder with the captures as they were downloaded")
    width, height = struct.unpack(">II", head[16:24])
    return width, height, head[25] == 0


def names(columns: int, rows: int) -> list[str]:
    """Returns our names of the images, in their order."""
    bits = lambda n: max(1, (n - 1).bit_length())
    axes = [("x", bits(columns)), ("y", bits(rows))]
    coded = [f"gray_{axis}{inverse}_{i:02}.png" for axis, n in axes for i in range(n) for inverse in ("", "_inv")]
    return [*coded, "white.png", "black.png"]


def matrix(root: xml.Element, name: str) -> list[float]:
    """Returns the numbers of one of OpenCV's matrices."""
    found = root.find(f"{name}/data")
    return [float(v) for v in found.text.split()] if found is not None else []


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("captures", type=Path, help="folder with capture_0, capture_1, …")
    options.add_argument("rig", type=Path, help="rig folder to make")
    options.add_argument("--projector", default="1024x768", help="size of the projected images, px")
    options.add_argument("--board", default="8x10", help="squares of the chessboard across and down")
    options.add_argument("--square-mm", type=float, required=True, help="side of a square")
    chosen = options.parse_args()
    captures = sorted(chosen.captures.glob("capture_*"))
    if not captures:
        sys.exit(f"{chosen.captures}: has no folder capture_*; give the repository's sample_data")
    if chosen.rig.exists():
        sys.exit(f"{chosen.rig}: exists; name a new folder")
    images = names(*map(int, chosen.projector.split("x")))
    for position, capture in enumerate(captures):
        files = sorted(capture.glob("graycode_*.png"))
        if len(files) != len(images):
            sys.exit(f"{capture}: has {len(files)} images, but {chosen.projector} takes {len(images)}; give --projector")
        for folder in (chosen.rig / "calibration" / f"{position:03}", chosen.rig / "scenes" / f"board{position}"):
            folder.mkdir(parents=True)
            for file, name in zip(files, images):
                shutil.copyfile(file, folder / name)
    width, height, gray = size_of(files[-1])
    sets = []
    for name, axes in (("rows", "y"), ("both", "xy")):
        listed = [n for axis in axes for n in images if n.startswith(f"gray_{axis}_") and "_inv_" not in n]
        inverse = [n.replace(n[:6], n[:6] + "_inv") for n in listed]
        sets.append(f"[[pattern_sets]]\nname = \"{name}\"\nimages = {json.dumps(listed)}\ninverse = {json.dumps(inverse)}\n")
    columns, rows = chosen.board.split("x")
    (chosen.rig / "rig.toml").write_text(
        f'format = 1\nname = "{chosen.captures.resolve().parent.name}"\n\n'
        f'[camera]\nchannels = "{"mono" if gray else "rgb"}"\nblack_level = 0\nsaturation = 255\n\n' + "\n".join(sets)
        + f'\n[board]\nkind = "chessboard"\ncolumns = {columns}\nrows = {rows}\nsquare_mm = {chosen.square_mm}\n'
    )
    result = chosen.captures / "calibration_result.xml"
    if not result.exists():
        print(f"{chosen.rig}: has no camera.json yet; `nelu3d camera {chosen.rig}` makes it")
        return
    root = xml.parse(result).getroot()
    k = matrix(root, "cam_int")
    camera = {"resx": width, "resy": height, "K": [k[:3], k[3:6], k[6:]], "dist_coeffs": matrix(root, "cam_dist")}
    (chosen.rig / "camera.json").write_text(json.dumps(camera) + "\n")


if __name__ == "__main__":
    main()
