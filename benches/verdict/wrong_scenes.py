#!/usr/bin/env python3
"""Scenes whose images are not what they are taken for: does the verdict say so, on scanners drawn at random?

    python3 benches/verdict/wrong_scenes.py PROGRAM FOLDER [--seeds 0:10] [--threads 1]      # needs numpy and OpenCV

FOLDER is that of random_scanners.py, with the rigs and color fields of these seeds. Of each scanner's scenes `seen` (an
object where the boards were) and `before` (the object before a wall outside), images are put wrong in four ways:
`swapped`, every pattern in the place of the next; `again`, the last but one in the place of the last, as where a
trigger was missed; `dark`, black in the place of the first; `gamma`, all images with a response of 1 / 2.2. A row per
kind: how many were refused, bad, doubtful, and good, and of these how many are SILENT, with gross errors (off by ten
times 1σ, and by 0.5 % of the depth) on more than 2 % of what is lit. Sets of one color image are left out. Exit code 1
where a scan is silent.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import cv2
import numpy as np

KINDS = ["swapped", "again", "dark", "gamma"]


def write_wrong(kind, names, saturation, scene, to):
    """Writes the images of `scene` into the folder `to`, put wrong."""
    taken = {name: name for name in names}
    if kind == "swapped":
        taken = dict(zip(names, [*names[1:], names[0]]))
    elif kind == "again":
        taken[names[-1]] = names[-2]
    for name in ["white.png", "black.png", *names]:
        if (source := scene / taken.get(name, name)).exists():
            image = cv2.imread(str(source), cv2.IMREAD_UNCHANGED)
            if kind == "dark" and name == names[0]:
                black = cv2.imread(str(scene / "black.png"), cv2.IMREAD_UNCHANGED)
                image = 0 * image if black is None else black
            elif kind == "gamma":
                image = (saturation * (image / saturation).clip(0, 1) ** (1 / 2.2)).round().astype(image.dtype)
            cv2.imwrite(str(to / name), image)


def scan(program, rig, field, images, kind, scene, threads):
    """Returns the verdict on a scene put wrong, and the fraction of what is lit that is off."""
    with tempfile.TemporaryDirectory() as folder:
        copy, result = pathlib.Path(folder) / "rig", pathlib.Path(folder) / "result"
        wrong = copy / "scenes" / "wrong"
        wrong.mkdir(parents=True)
        for name in ("rig.toml", "camera.json", "patterns"):
            (copy / name).symlink_to((rig / name).absolute())
        saturation = tomllib.loads((rig / "rig.toml").read_text())["camera"]["saturation"]
        write_wrong(kind, images, saturation, rig / "scenes" / scene, wrong)
        command = [program, "reconstruct", copy, "wrong", "--set", field.stem, "--field", field, "-o", result,
                   "--threads", threads, "--json", "--quiet", "--accept"]
        done = subprocess.run([*map(str, command)], capture_output=True, text=True)
        if "panicked" in done.stderr:
            sys.exit(done.stderr)
        if not (result / "depth.npy").exists():
            return "refused", 0.0
        depth, sigma = np.load(result / "depth.npy"), np.load(result / "sigma.npy")
        truth = np.load(rig / "scenes" / scene / "truth" / "depth.npy")
        kept = np.isfinite(depth)
        error = np.abs(depth - truth)
        gross = kept & ~((error < 10 * sigma) | (error < 0.005 * truth))
        return json.loads(done.stdout)["verdict"], float(gross.sum() / np.isfinite(truth).sum())


def main(program, folder, seeds, threads):
    found = {kind: [] for kind in KINDS}
    for seed in seeds:
        rig = folder / f"{seed:03}" / "rig"
        sets = {s["name"]: s["images"] for s in tomllib.loads((rig / "rig.toml").read_text())["pattern_sets"]}
        for field in sorted(rig.parent.glob("*.safetensors")):
            images = sets.get(field.stem, [])
            for kind in KINDS if len(images) > 1 else []:
                for scene in ("seen", "before"):
                    verdict, gross = scan(program, rig, field, images, kind, scene, threads)
                    found[kind].append((verdict, gross))
                    if verdict == "good" and gross > 0.02:
                        print(f"SILENT: {seed} {field.stem} {scene} {kind}, {100 * gross:.0f} %", file=sys.stderr)
    print("| images | scans | refused | bad | doubtful | good | silent |\n|---|---|---|---|---|---|---|")
    n_silent = 0
    for kind, scans in found.items():
        counts = [sum(v == verdict for v, _ in scans) for verdict in ("refused", "bad", "doubtful", "good")]
        silent = sum(v == "good" and gross > 0.02 for v, gross in scans)
        n_silent += silent
        print(f"| {kind} | {len(scans)} | {' | '.join(map(str, counts))} | {silent} |")
    sys.exit(1 if n_silent else 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="0:10")
    parser.add_argument("--threads", default=1)
    given = parser.parse_args()
    main(given.program.absolute(), given.folder, range(*map(int, given.seeds.split(":"))), given.threads)
