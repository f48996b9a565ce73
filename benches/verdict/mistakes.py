#!/usr/bin/env python3
"""The mistakes of people with scanners, one after the other on the demo rig: is each of them seen?

    python3 benches/verdict/mistakes.py PROGRAM FOLDER [NAME ...]      # needs numpy and OpenCV

Simulates the preset `demo` with scenes after bumps of projector and camera into FOLDER, makes every mistake in a copy
of it, and prints a table: what `calibrate` and `reconstruct` say, the median error of the body against the truth, and
the 1σ that was claimed. NAME picks the mistakes whose names contain it. A row is SILENT where the error exceeds three
times the claimed 1σ and nothing warns; that is an error unless the report says that it was not checked. Exit code 1
where there is such a row, or a warning about the rig without a mistake.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import cv2
import numpy as np

BLACK, SATURATION = 64.0, 4095.0
PATTERNS = ["sine_00.png", "triangle_00.png", "random_00.png"]
ALL = ["white.png", "black.png", *PATTERNS]


def read(path):
    return (cv2.imread(str(path), -1).astype(np.float64) - BLACK) / (SATURATION - BLACK)


def write(path, linear):
    codes = np.clip(np.round(linear * (SATURATION - BLACK) + BLACK), 0, 4095)
    cv2.imwrite(str(path), codes.astype(np.uint16))


def images(folder, change, names=ALL):
    for name in names:
        write(folder / name, change(read(folder / name), name))


def positions(rig):
    return sorted((rig / "calibration").iterdir())


def scene(rig):
    return rig / "scenes" / "vase"


def camera(rig, change):
    file = rig / "camera.json"
    intrinsics = json.loads(file.read_text())
    change(intrinsics)
    file.write_text(json.dumps(intrinsics))


def scale_camera(focal, center):
    def change(intrinsics):
        for i in range(2):
            intrinsics["K"][i][i] *= focal
            intrinsics["K"][i][2] *= center
    return lambda rig: camera(rig, change)


def no_distortion(rig):
    camera(rig, lambda c: c.update(dist_coeffs=[0, 0, 0, 0, 0]))


def board(scale_x, scale_y):
    def make(rig):
        file = rig / "rig.toml"
        head, tail = file.read_text().split("[board]")
        scaled = lambda m: f"[{float(m[1]) * scale_x}, {float(m[2]) * scale_y}]"
        file.write_text(head + "[board]" + re.sub(r"\[(-?[\d.]+), (-?[\d.]+)\]", scaled, tail))
    return make


def one_pattern(rig):
    file = rig / "rig.toml"
    file.write_text(re.sub(r'images = \[[^]]*\]', f'images = ["{PATTERNS[0]}"]', file.read_text(), count=1))


def swap(folder):
    a, b = folder / PATTERNS[0], folder / PATTERNS[1]
    first, second = a.read_bytes(), b.read_bytes()
    a.write_bytes(second)
    b.write_bytes(first)


def lag(rig):
    for name in PATTERNS:
        files = [p / name for p in positions(rig)]
        contents = [f.read_bytes() for f in files]
        for file, content in zip(files[1:], contents):
            file.write_bytes(content)


def same_position(rig):
    first, *others = positions(rig)
    for position in others:
        for name in ALL:
            shutil.copy(first / name, position / name)


def one_depth(rig):
    """Eight positions at one depth: copies of one, with the sensor's noise anew."""
    first, *others = positions(rig)
    noise = np.random.default_rng(1)
    for i, position in enumerate(others):
        if i >= 7:
            shutil.rmtree(position)
            continue
        for name in ALL:
            v = read(first / name)
            write(position / name, v + noise.normal(size=v.shape) * np.sqrt(np.maximum(v, 0) / 1e4 + 4e-7))


def shifted(v, px):
    move = np.float64([[1, 0, px], [0, 1, 0]])
    return cv2.warpAffine(v, move, v.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def srgb(v):
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)


def jpeg(v):
    code = cv2.imencode(".jpg", np.clip(srgb(v) * 255, 0, 255).astype(np.uint8), [1, 85])[1]
    w = cv2.imdecode(code, 0) / 255.0
    return np.where(w <= 0.04045, w / 12.92, ((w + 0.055) / 1.055) ** 2.4)


def everywhere(change, names=ALL):
    return lambda rig: [images(p, change, names) for p in positions(rig)]


def exposure(rig, scenes=False):
    for folder in [*positions(rig), *([scene(rig)] if scenes else [])]:
        images(folder, lambda v, n: v * 0.15 / max(v.mean(), 1e-3), PATTERNS)


def all_srgb(rig):
    for folder in [*positions(rig), scene(rig)]:
        images(folder, lambda v, n: srgb(v))


def white(folder, factor):
    images(folder, lambda v, n: v * factor, ["white.png"])


def bumped(name):
    """The captures of a scene that was simulated after a bump take the place of the scene's own."""
    def make(rig):
        shutil.rmtree(scene(rig))
        shutil.copytree(rig / "scenes" / name, scene(rig))
    return make


# Name; what is done to the rig; whether it is done to the sweep.
MISTAKES = [
    ("none", lambda rig: None, False),
    ("camera.json of another resolution (f × 2)", scale_camera(2, 2), True),
    ("f 10 % too long", scale_camera(1.1, 1), True),
    ("markers entered 10 % too large", board(1.1, 1.1), True),
    ("markers entered 10 % too large, `--step 6`", board(1.1, 1.1), True),
    ("print stretched 2 % along x", board(1.02, 1), True),
    ("distortion missing", no_distortion, True),
    ("board bent by 1 mm", "bend-1", True),
    ("board bent by 3 mm", "bend-3", True),
    ("a code that repeats along the ray", one_pattern, True),
    ("patterns lag one position", lag, True),
    ("sweep: one position's patterns swapped", lambda rig: swap(positions(rig)[5]), True),
    ("sweep: camera moved 2 px at one position",
     lambda rig: images(positions(rig)[5], lambda v, n: shifted(v, 2), PATTERNS), True),
    ("sweep: one white × 1.2", lambda rig: white(positions(rig)[5], 1.2), True),
    ("sweep: auto exposure of the patterns", exposure, True),
    ("sweep: sRGB", everywhere(lambda v, n: srgb(v)), True),
    ("sweep: JPEG", everywhere(lambda v, n: jpeg(v)), True),
    ("sweep and scene: auto exposure of the patterns", lambda rig: exposure(rig, True), True),
    ("sweep and scene: sRGB", all_srgb, True),
    ("24 × the same position", same_position, True),
    ("8 positions at one depth", one_depth, True),
    ("scene: sRGB", lambda rig: images(scene(rig), lambda v, n: srgb(v)), False),
    ("scene: mirrored", lambda rig: images(scene(rig), lambda v, n: v[:, ::-1]), False),
    ("scene: patterns swapped", lambda rig: swap(scene(rig)), False),
    ("scene: one image missing its light",
     lambda rig: shutil.copy(scene(rig) / "black.png", scene(rig) / PATTERNS[1]), False),
    ("scene: a pattern again in the place of the next",
     lambda rig: shutil.copy(scene(rig) / PATTERNS[0], scene(rig) / PATTERNS[1]), False),
    ("scene: white × 1.2", lambda rig: white(scene(rig), 1.2), False),
    ("scene: object outside the volume", bumped("outside"), False),
    ("scene: ambient light not in black (+3 %)",
     lambda rig: images(scene(rig), lambda v, n: v if n == "black.png" else v + 0.03), False),
    ("scene: exposure × 3", lambda rig: images(scene(rig), lambda v, n: v * 3), False),
    *[(f"{who} bumped by {px} px{', board in view' if board else ''}", bumped(f"{who}-{px}{board}"), False)
      for board in ("", "-board") for who, sizes in (("projector", (1, 5, 20)), ("camera", (1, 5))) for px in sizes],
]


def run(program, *args):
    done = subprocess.run([program, *map(str, args), "--json", "--quiet", "--accept"], capture_output=True, text=True)
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError:
        return {"verdict": "refused", "warnings": [], "notes": [], "error": done.stderr.strip().splitlines()[-1].split("; ", 1)[-1]}


def said(answer):
    codes = ", ".join(f"`{w['code']}`" for w in answer["warnings"])
    if "error" in answer:
        return f"refused: {answer['error']}"
    return f"{answer['verdict']}: {codes}" if codes else answer["verdict"]


def spec(program, folder):
    """The demo's spec, with scenes after bumps, and an object outside of the volume."""
    made = folder / "preset"
    subprocess.run([program, "simulate", "demo", "-o", made, "--quiet"], check=True, stdout=subprocess.DEVNULL)
    text = (made / "simulation.toml").read_text().split("[[sequences]]")[0]
    shutil.rmtree(made)
    head, vase = text.split("[[scenes]]")
    objects = vase[vase.index("[[scenes.objects]]"):]
    def add(name, more="", objects=objects):
        return f'[[scenes]]\nname = "{name}"\nblack = true\n{more}{objects}\n'
    scenes = add("vase") + add("outside", objects=re.sub(r"(position_mm = \[.*), .*\]", r"\1, 850.0]", objects))
    for board, stands in (("", ""), ("-board", 'board = "023"\n')):
        for px in (1, 5, 20):
            scenes += add(f"projector-{px}{board}", f"{stands}[scenes.bump]\nlight_px = [{px}.0, 0.0]\n")
        for px in (1, 5):
            scenes += add(f"camera-{px}{board}", f"{stands}[scenes.bump]\ncamera_px = [{px}.0, 0.0]\n")
    return head, scenes


def simulate(program, folder):
    """Makes the rig, and those of bent boards; returns their folders by name."""
    rigs = {}
    for name, more, some in (("good", "", None), ("bend-1", "1.0", 1), ("bend-3", "3.0", 1)):
        rigs[name] = folder / f"rig-{name}"
        if (rigs[name] / "rig.toml").exists():
            continue
        head, scenes = spec(program, folder)
        if more:
            scenes = "[[scenes]]" + scenes.split("[[scenes]]")[1] + f"[board_bend]\nsagitta_mm = {more}\n"
        file = folder / f"{name}.toml"
        file.write_text(head + scenes)
        subprocess.run([program, "simulate", file, "-o", rigs[name], "--quiet"], check=True, stdout=subprocess.DEVNULL)
    return rigs


def row(program, folder, rigs, name, make, in_sweep):
    """Makes a mistake; returns the table's row, and whether it is fine."""
    rig = folder / re.sub(r"\W+", "-", name)
    shutil.rmtree(rig, ignore_errors=True)
    source = rigs[make] if isinstance(make, str) else rigs["good"]
    shutil.copytree(source, rig, ignore=shutil.ignore_patterns("fields", "results"))
    if not isinstance(make, str):
        make(rig)
    field, calibrated = folder / "good.safetensors", None
    options = re.findall(r"`(.*)`", name)
    options = options[0].split() if options else []
    if in_sweep or not field.exists():
        field = folder / "mistaken.safetensors" if in_sweep else field
        calibrated = run(program, "calibrate", rig, "-o", field, *options)
    truth = scene(rig) / "truth"
    made = run(program, "reconstruct", rig, "vase", "--field", field, "-o", folder / "result", "--truth", truth)
    shutil.rmtree(rig)
    error = sigma = None
    if "error" not in made:
        body = made["summary"]["metrics"]["body"]
        error, sigma = body["depth_mm"]["median"], body["sigma"]["median_mm"]
    answers = [a for a in (calibrated, made) if a]
    seen = any(a["verdict"] != "good" for a in answers)
    silent = error is not None and error > 3 * sigma and not seen
    notes = {n["code"] for a in answers for n in a.get("notes", [])}
    # What nothing in the captures tells has to be said not to be checked.
    note = "drift-not-checked" if "bumped" in name else "scale-not-checked" if "10 %" in name else None
    unchecked = note if silent and note in notes else None
    number = lambda v: "–" if v is None else f"{v:.3g}"
    judged = "yes" if seen else f"not checked: `{unchecked}`" if unchecked else "**SILENT**" if silent else "no"
    tells = said(calibrated) if calibrated and in_sweep else "–"
    text = f"| {name} | {number(error)} | {number(sigma)} | {tells} | {said(made)} | {judged} |"
    return text, not (silent and not unchecked) and not (name == "none" and seen)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("names", nargs="*")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    program = os.path.abspath(args.program)
    rigs = simulate(program, args.folder)
    print("| mistake | median error, mm | claimed 1σ, mm | `calibrate` | `reconstruct` | seen |\n|---|---|---|---|---|---|")
    fine = True
    for name, make, in_sweep in MISTAKES:
        if name == "none" or not args.names or any(n in name for n in args.names):
            text, good = row(program, args.folder, rigs, name, make, in_sweep)
            print(text, flush=True)
            fine &= good
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
