"""LookUp3D in numpy, as its authors decode: for blocks of pixels the argmin over the board positions of the squared distance
between the measured codeword and the table's, and the depth of that position. Against `nelu3d decode --method lookup3d
--interpolation none` in the same run, on the same table and scene.

    python benches/peer/lookup3d_numpy.py target/release/nelu3d RIG SCENE [--set NAME] [--all] [--runs 7]

Both decode the same pixels: those that nelu3d does not leave out as dark or clipped (--all: every pixel; then nelu3d is given
a scene that is bright everywhere, the board of the middle position). Same answer means: the same depth at every pixel that
both decode, but for ties, codewords equally far away to the last bits of a float. The time of nelu3d is its stage `decode`,
which goes over the whole picture, judges each pixel and computes its uncertainty and residual; the time of numpy is the
search and the look-up of the depth alone, of the decoded pixels only, gathered beforehand. Reading files and normalizing the
images is in neither. The best of RUNS runs each, a process of its own for each of nelu3d's, taken in turns; on one thread
processor time (numpy uses one), on all of them elapsed time.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image


def block_lookup(table, query, block=65536):
    """Nearest position of every pixel. table: (n, P, k), query: (n, k), float32."""
    n = len(query)
    index = np.zeros(n, np.int64)
    loss = np.zeros(n, np.float32)
    for start in range(0, n, block):
        part = slice(start, min(n, start + block))
        distance = np.sum((table[part] - query[part, None, :]) ** 2, axis=-1)
        index[part] = np.argmin(distance, axis=-1)
        loss[part] = np.min(distance, axis=-1)
    return index, loss


def decode(table, depth, query):
    index, loss = block_lookup(table, query)
    return np.take_along_axis(depth, index[:, None], axis=-1)[:, 0], loss


def linear(path, black_level, saturation):
    image = np.asarray(Image.open(path)).astype(np.float32)
    return (image - np.float32(black_level)) / np.float32(saturation - black_level)


def rig_toml(rig):
    import tomllib

    return tomllib.loads((rig / "rig.toml").read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("nelu3d")
    parser.add_argument("rig", type=Path)
    parser.add_argument("scene")
    parser.add_argument("--set")
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--runs", type=int, default=7)
    args = parser.parse_args()

    config = rig_toml(args.rig)
    sets = {s["name"]: s for s in config["pattern_sets"]}
    chosen = sets[args.set] if args.set else config["pattern_sets"][0]
    if config["camera"]["channels"].startswith("bayer"):
        raise SystemExit("a Bayer camera's images would have to be demosaicked here too; take a mono or rgb rig")
    scene = args.rig / "scenes" / args.scene
    if args.all:
        positions = sorted(p for p in (args.rig / "calibration").iterdir() if p.is_dir())
        scene = positions[len(positions) // 2]
    levels = (config["camera"].get("black_level", 0), config["camera"]["saturation"])
    white, black = (linear(scene / config["images"][name], *levels) for name in ("white", "black"))
    patterns = [linear(scene / name, *levels) for name in chosen["images"]]
    light = np.atleast_3d(white - black)
    with np.errstate(divide="ignore", invalid="ignore"):
        query = np.concatenate([np.atleast_3d(p - black) / light for p in patterns], axis=2)

    with tempfile.TemporaryDirectory() as work:
        work = Path(work)
        exported = work / "table.npy"
        command = [args.nelu3d, "table", "export", args.rig, "--set", chosen["name"], "-o", exported, "-q"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        table = np.load(exported)
        missing = np.isnan(table[..., :-1]).any(axis=-1)
        # numpy's argmin would choose NaN: a missing sample is put out of reach, once and outside of what is timed.
        codes = np.where(missing[..., None], np.float32(1e6), table[..., :-1])
        depth = table[..., -1]

        result = work / "result"
        command = [args.nelu3d, "decode", args.rig, scene, "--set", chosen["name"], "--method", "lookup3d"]
        command += ["--table", exported, "--interpolation", "none", "--max-residual", "0"]
        command += ["--min-component", "1", "-o", result, "--json", "-q"]

        def ours(*more):
            shutil.rmtree(result, ignore_errors=True)
            out = subprocess.run([str(c) for c in [*command, *more]], check=True, capture_output=True, text=True).stdout
            return next(s for s in json.loads(out)["summary"]["stages"] if s["name"] == "decode")

        ours()
        found = np.load(result / "depth.npy")
        # The pixels that nelu3d did not leave out for being dark or clipped.
        mask = np.isfinite(found)
        codes, depth, query = codes[mask], depth[mask], np.ascontiguousarray(query[mask])
        cpu, wall = np.full(2, np.inf), np.full(2, np.inf)
        for _ in range(args.runs):
            start = time.perf_counter(), time.process_time()
            theirs, _ = decode(codes, depth, query)
            times = time.perf_counter() - start[0], time.process_time() - start[1]
            cpu = np.minimum(cpu, [times[1], ours("--threads", "1")["cpu_secs"]])
            wall = np.minimum(wall, [times[0], ours()["wall_secs"]])

    difference = np.abs(theirs - found[mask])
    same = difference < 1e-3
    print(f"scene {scene.name}: {mask.sum()} of {mask.size} pixels, {codes.shape[1]} positions, {codes.shape[2]} channels")
    print(f"same depth (to 0.001 mm) at {same.mean() * 100:.4f} % of them")
    if not same.all():
        # Where they differ, both codewords must be equally close.
        at = np.flatnonzero(~same)
        distance = ((codes[at] - query[at, None, :]) ** 2).sum(-1)
        mine = np.abs(depth[at] - found[mask][at, None]).argmin(-1)
        excess = distance[np.arange(len(at)), mine] - distance.min(-1)
        print(f"where not, ours is farther away by at most {excess.max():.2e} (squared distance)")
    for label, kind, (numpy, nelu3d) in (("one thread ", "processor time", cpu), ("all threads", "elapsed", wall)):
        ratio = f"{numpy / nelu3d:6.1f} × ({kind})"
        print(f"{label}   numpy {numpy * 1e3:8.1f} ms   nelu3d {nelu3d * 1e3:8.1f} ms   {ratio}")


if __name__ == "__main__":
    main()
