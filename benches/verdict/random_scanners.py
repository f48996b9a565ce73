#!/usr/bin/env python3
"""Scanners drawn at random: what do calibration and scans say, and is it true?

    python3 benches/verdict/random_scanners.py PROGRAM FOLDER [--seeds 0:20] [--threads 1]      # needs tomli_w
    python3 benches/verdict/random_scanners.py PROGRAM FOLDER --from-projector [--without-sweep]

For every seed a scanner is drawn and simulated into FOLDER/SEED/rig: 150 mm to 3 m away, field of view 14° to 55°,
mono, RGB, or mosaic of 8 to 12 bits, light from any side (a projector, gamma 1 to 2.2, or film), three kinds of
boards, 4 to 16 positions by hand or 6 to 25 on a stage, and two of ten sets of patterns. Each set is calibrated, and
three scenes are scanned with it: `seen`, an object where the boards were; `outside`, a wall well behind them; and
`before`, the object before that wall. A row per scan: coverage, errors against the truth and claimed 1σ, mm, errors
within 1σ, and the verdict.

A row is SILENT where the verdict is good, and the median error of the body exceeds three times the claimed 1σ
(`seen`), or more than 2 % of the wall has a depth of which less than half lie within 1σ (`outside`), or more than 2 %
of object and wall are gross errors (`before`). Started again, rigs are kept and everything else is done anew. Exit code
1 where a row is silent.

With `--from-projector` the field is that of the scanner's own projector, blur and response from its sweep or
`--without-sweep` from the scene, and only `seen` is scanned; scanners with film have none.
"""

import argparse
import json
import math
import pathlib
import random
import subprocess
import sys

import tomli_w


def camera(r, width, height, focal):
    """A camera whose exposure uses a third to all of the scale on white paper."""
    sensor = r.choice(["mono", "mono", "mono", "rgb", "bayer-rggb", "bayer-gbrg"])
    bits = r.choice([8, 10, 12, 12])
    full_well = r.uniform(5e3, 15e3)
    electrons = full_well * r.uniform(0.4, 1.0) / 0.01
    spec = dict(
        width=width, height=height, fx=focal, fy=focal * r.uniform(0.998, 1.002),
        cx=width / 2 + r.uniform(-8, 8), cy=height / 2 + r.uniform(-8, 8),
        channels=sensor, bits=bits, black_level=float(r.choice([0, 2**bits // 64])), exposure_secs=0.01,
        full_well_electrons=full_well, electrons_per_sec=electrons, read_noise_electrons=r.uniform(2, 12),
        psf_sigma_px=r.uniform(0.3, 0.9), vignetting=float(r.choice([0, 4])))
    if r.random() < 0.8:
        spec["distortion"] = [r.uniform(-0.2, 0.1), r.uniform(-0.05, 0.08), r.uniform(-5e-4, 5e-4),
                              r.uniform(-5e-4, 5e-4), 0.0]
    if sensor != "mono" and r.random() < 0.7:
        near, far = r.uniform(0.02, 0.12), r.uniform(0.01, 0.05)
        spec["color_mixing"] = [[1.0, near, far], [near * 0.8, 1.0, near], [far, near * 1.1, 1.0]]
        spec["electrons_per_sec"] = [electrons * gain for gain in (0.85, 1.0, 0.75)]
    return spec


def placed_light(r, distance):
    """Where the light stands, and the axis along which its patterns vary for that baseline."""
    angle = math.radians(r.choice([0, 180, 0, 180, 90, 270, r.uniform(0, 360)]))
    baseline = distance * r.uniform(0.12, 0.5)
    place = dict(
        position_mm=[baseline * math.cos(angle), baseline * math.sin(angle), distance * r.uniform(-0.1, 0.15)],
        target_mm=[0.0, 0.0, distance], reference_mm=distance)
    return place, "x" if abs(math.cos(angle)) > 0.6 else "y"


def film(r, distance, view):
    """A film of random waves: its colors are the patterns."""
    mm = r.uniform(15, 40)
    across = mm * view[0] / distance
    return dict(
        kind="film", film_mm=mm, lamp_sigma_mm=r.uniform(0.03, 0.12), vignetting=4.0,
        flash_offset_mm=r.choice([[0.0, 0.0, 0.0], [distance * 0.005, 0.0, 0.0], [0.0, distance * 0.01, 0.0]]),
        film_half_size_mm=[across * 0.8, mm * view[1] / distance * 0.8], waves=r.choice([3, 4, 6, 10]),
        min_period_mm=across / r.uniform(12, 25), max_period_mm=across / 2.5, spread=r.uniform(0.2, 1.57),
        seed=r.randrange(1000))


def projector(r, distance, view):
    """A projector that lights the whole view and up to a half more."""
    width, height = r.choice([(640, 400), (854, 480), (1024, 768), (1280, 800), (912, 1140)])
    focal = min(side / (seen * r.uniform(1.15, 1.8)) for side, seen in zip((width, height), view)) * distance
    return dict(
        kind="projector", width=width, height=height, fx=focal, fy=focal * r.uniform(0.998, 1.002),
        cx=width / 2 + r.uniform(-10, 10), cy=height / 2 + r.uniform(0, height * 0.1),
        distortion=[r.uniform(-0.1, 0.1), 0.02, 0.0, 0.0, 0.0], roll=r.choice([0.0, 0.0, r.uniform(-0.05, 0.05)]),
        fill_factor=r.choice([1.0, 0.9, 0.8]), focus_mm=distance * r.uniform(0.9, 1.1),
        sharp_sigma_px=r.uniform(0.3, 0.9), aperture_mm=distance * r.uniform(0.004, 0.02),
        vignetting=float(r.choice([2, 4, 10])), black_leak=r.uniform(0, 0.01), gamma=r.choice([1.0, 1.0, 1.8, 2.2]),
        black=r.choice(["off", "darkest"]))


def pattern_sets(r, axis, pixels):
    """Two of ten sets for `pixels` of a projector along `axis`."""

    def smooth(finest, seed=0):
        return dict(family="random", axis=axis, min_period_px=pixels / finest, max_period_px=pixels / 2, seed=seed)

    triangle = dict(family="triangle", axis=axis, period_px=pixels / 3)
    sets = {
        "mixed3": [dict(family="sinusoid", axis=axis, period_px=pixels / r.uniform(20, 50), steps=1), triangle,
                   smooth(16)],
        "recommended5": [dict(family="sinusoid", axis=axis, period_px=pixels / 40, steps=3), triangle, smooth(16)],
        "random3": [smooth(24, seed) for seed in range(3)],
        "phase": [dict(family="phase", axis=axis, periods_px=[pixels / r.choice([24, 32]), float(pixels)],
                       steps=[3, 3])],
        "gray": [dict(family="gray", axis=axis, inverse=r.random() < 0.5)],
        "gray2": [dict(family="gray", axis="x", inverse=True), dict(family="gray", axis="y", inverse=True)],
        "alacarte3": [dict(family="alacarte", axis=axis, count=3, max_frequency=16)],
        "hilbert3": [dict(family="hilbert", axis=axis, count=3)],
        "mps": [dict(family="mps", axis=axis)],
        "sines_ramp": [dict(family="sinusoid", axis=axis, period_px=pixels / 8, steps=2),
                       dict(family="ramp", axis=axis)],
    }
    return [dict(name=name, patterns=sets[name]) for name in r.sample(sorted(sets), 2)]


def board(r, size):
    """A board `size` mm wide, of one of three kinds."""
    kind = r.choice(["charuco", "charuco", "chessboard", "markers"])
    columns, rows = r.choice([(8, 6), (9, 7), (7, 5), (12, 9)])
    if kind == "markers":
        edge, marker, margin = size / 2, size * 0.16, size * 0.02
        low, high = -edge + margin, edge - margin - marker
        places = [(low, low), (high, low), (low, high), (high, high), (low, -marker / 2), (high, -marker / 2),
                  (-marker / 2, low), (-marker / 2, high)]
        corners = [[[x, y], [x + marker, y], [x + marker, y + marker], [x, y + marker]] for x, y in places]
        return dict(kind=kind, dictionary="DICT_4X4_50", extent_mm=[-edge, -edge, edge, edge],
                    markers=[dict(id=i, corners_mm=c) for i, c in enumerate(corners)])
    square = size / columns
    if kind == "chessboard":
        columns += (columns + rows + 1) % 2
    spec = dict(kind=kind, columns=columns, rows=rows, square_mm=square,
                extent_mm=[-square * 0.4, -square * 0.4, square * (columns + 0.4), square * (rows + 0.4)])
    if kind == "charuco":
        spec |= dict(marker_mm=square * 0.75, dictionary="DICT_4X4_250")
    return spec


def sweep(r, distance, view, size, depth):
    """Boards by hand or on a stage over `depth` mm around the distance."""
    ends = dict(first_mm=distance - depth / 2, last_mm=distance + depth / 2)
    if r.random() < 0.5:
        spec = dict(kind="handheld", positions=r.choice([4, 5, 6, 8, 12, 16]), position_sigma_mm=min(view) * 0.06,
                    tilt_sigma=r.uniform(0.1, 0.3), depths=r.choice(["even", "scattered"]), max_tilt=0.6,
                    min_in_view=0.7, **ends)
        if r.random() < 0.3:
            spec["hands"] = dict(number=1, size_mm=size * 0.25)
        return spec
    return dict(
        kind="stage", positions=r.choice([6, 10, 15, 25]), rotation=[r.uniform(-0.1, 0.1) for _ in "xy"] + [0.0],
        slope=[r.uniform(-0.05, 0.05) for _ in "xy"], step_error_mm=r.choice([0.0, distance * 2e-5]),
        tilt_jitter=r.choice([0.0, 1e-4]), **ends)


def thing(r, distance, size, depth):
    """What is scanned: one of six shapes, and often a wall behind it."""
    gray = [r.uniform(0.3, 0.8)] * 3
    albedo = r.choice([
        dict(kind="constant", rgb=gray), dict(kind="constant", rgb=[r.uniform(0.25, 0.8) for _ in "rgb"]),
        {"kind": "waves", "from": [0.3] * 3, "to": [0.8, 0.7, 0.75], "period_mm": size * 0.2},
        {"kind": "wood", "from": [0.35, 0.25, 0.2], "to": [0.7, 0.6, 0.5], "ring_mm": size * 0.05},
        {"kind": "checker", "from": [0.3, 0.3, 0.35], "to": [0.75, 0.7, 0.7], "size_mm": size * 0.12}])
    material = r.choice([dict(kind="lambert")] * 3 + [
        dict(kind="glossy", roughness=r.uniform(0.25, 0.5), reflectance=0.04),
        dict(kind="translucent", mean_free_path_mm=size * 0.004, share=0.4)])
    profile = [(0, 0.12), (0.1, 0.13), (0.25, 0.22), (0.4, 0.17), (0.5, 0.08), (0.58, 0.12), (0.6, 0.12)]
    shape = r.choice([
        dict(kind="sphere", radius_mm=min(size * 0.27, depth * 0.3)),
        dict(kind="box", size_mm=[size * 0.4, size * 0.35, min(size * 0.3, depth * 0.4)]),
        dict(kind="torus", major_mm=size * 0.22, minor_mm=min(size * 0.09, depth * 0.2)),
        dict(kind="cylinder", radius_mm=min(size * 0.2, depth * 0.28), height_mm=size * 0.6),
        dict(kind="step", width_mm=size * 0.6, height_mm=size * 0.5, jump_mm=depth * 0.12),
        dict(kind="vase", profile_mm=[[height * size, radius * size] for height, radius in profile])])
    x, y = (r.uniform(-0.08, 0.08) * size for _ in "xy")
    tilt = [r.uniform(-0.4, 0.4), r.uniform(-0.4, 0.4), r.uniform(-0.3, 0.3)]
    tilt[0] += 1.2 * (shape["kind"] == "torus")
    y += size * 0.3 * (shape["kind"] == "vase")
    objects = [dict(position_mm=[x, y, distance - depth * 0.05], rotation=tilt, shape=shape, albedo=albedo,
                    material=material)]
    if r.random() < 0.6:
        objects.append(dict(
            position_mm=[0.0, 0.0, distance + depth * 0.36], rotation=[r.uniform(-0.1, 0.1) for _ in "xy"] + [0.0],
            shape=dict(kind="plane", width_mm=size * 1.1, height_mm=size), albedo=dict(kind="constant", rgb=gray)))
    return objects


def scanner(seed):
    """The simulation's specification for a seed."""
    r = random.Random(seed)
    distance = math.exp(r.uniform(math.log(150), math.log(3000)))
    width, height = r.choice([(400, 300), (480, 360), (360, 480), (512, 384), (560, 350)])
    focal = max(width, height) / 2 / math.tan(math.radians(r.uniform(14, 55)) / 2)
    view = [side / focal * distance for side in (width, height)]
    size = min(view) * r.uniform(0.55, 0.95)
    depth = min(min(view) * r.uniform(0.35, 0.9), distance * 0.5)
    spec = dict(name=f"random scanner {seed}", seed=seed, supersampling=2,
                ambient=r.choice([0.0, 0.0, r.uniform(0, 0.05)]),
                board_albedo=[r.uniform(0.03, 0.08), r.uniform(0.75, 0.9)], camera=camera(r, width, height, focal))
    place, axis = placed_light(r, distance)
    if r.random() < 0.15:
        spec["camera"]["channels"] = r.choice(["rgb", "bayer-rggb", "bayer-grbg"])
        spec["light"] = film(r, distance, view) | place
    else:
        spec["light"] = projector(r, distance, view) | place
        spec["pattern_sets"] = pattern_sets(r, axis, spec["light"]["width" if axis == "x" else "height"])
    if r.random() < 0.5:
        spec["interreflection"] = dict(bounces=2, paths_per_pixel=16)
    spec["board"] = board(r, size)
    spec["sweep"] = sweep(r, distance, view, size, depth)
    black = r.random() < 0.6
    wall = dict(position_mm=[0.0, 0.0, distance + depth * r.uniform(1.2, 2.0)], rotation=[0.05, -0.1, 0.0],
                shape=dict(kind="plane", width_mm=view[0] * 1.2, height_mm=view[1] * 1.1))
    objects = thing(r, distance, size * 0.8, depth)
    spec["scenes"] = [dict(name=name, black=black, objects=what)
                      for name, what in (("seen", objects), ("outside", [wall]), ("before", objects + [wall]))]
    return spec


def described(spec):
    """The scanner in a line."""
    c, light, swept = spec["camera"], spec["light"], spec["sweep"]
    return (f"{light['reference_mm']:.0f} mm, {c['width']} × {c['height']} {c['channels']} {c['bits']} bits, "
            f"{light['kind']}, {spec['board']['kind']}, {swept['positions']} {swept['kind']}, "
            f"{spec['scenes'][0]['objects'][0]['shape']['kind']}")


def run(program, threads, *args):
    """The program's JSON answer; what it says on standard error where it fails."""
    done = subprocess.run([program, *map(str, args), "--json", "--quiet", "--threads", threads], capture_output=True,
                          text=True)
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError:
        return {"verdict": "failed", "warnings": [], "why": done.stderr.strip()[-160:]}


def row(scene, answer):
    """What a scan's answer says, as cells, and whether it is silent."""
    metrics = (answer.get("summary") or {}).get("metrics")
    said = answer["verdict"] + "".join(f" `{w['code']}`" for w in answer["warnings"])
    # Nothing may be left of the body, or nothing of what has a 1σ.
    if not metrics or (metrics["body"]["sigma"] or {}).get("median_mm") is None:
        return ["–"] * 6 + [said], False
    whole, body = metrics["whole"], metrics["body"]
    error, sigma, within = body["depth_mm"]["median"], body["sigma"]["median_mm"], body["sigma"]["within_1"]
    wrong = {"seen": error > 3 * sigma, "outside": whole["coverage"] > 0.02 and within < 0.5,
             "before": whole["sigma"]["gross"] > 0.02}[scene]
    silent = wrong and answer["verdict"] == "good"
    cells = [f"{100 * whole['coverage']:.1f}", f"{whole['depth_mm']['mae']:.3g}", f"{error:.3g}", f"{sigma:.3g}",
             f"{100 * within:.0f}", f"{100 * whole['sigma']['gross']:.2f}"]
    return cells + [said + " **SILENT**" * silent], silent


def without_sweep(rig, folder):
    """Returns a folder of links to a rig, but for its sweep and all scenes but `seen`."""
    if not folder.exists():
        (folder / "scenes").mkdir(parents=True)
        for name in ("camera.json", "patterns", "projector.json", "rig.toml", "scenes/seen"):
            (folder / name).symlink_to((rig / name).resolve())
    return folder


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="0:20", help="first and, not included, last")
    parser.add_argument("--threads", default="1")
    parser.add_argument("--from-projector", action="store_true", help="fields of the scanners' own projectors")
    parser.add_argument("--without-sweep", action="store_true", help="with it: from the scene `seen` alone")
    args = parser.parse_args()
    source = ("--from-projector",) if args.from_projector else ()
    silent = rows = 0
    print("| scanner | set | scene | coverage, % | MAE, mm | body median, mm | 1σ, mm | within, % | gross, % | said |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for seed in range(*map(int, args.seeds.split(":"))):
        spec = scanner(seed)
        folder = args.folder / f"{seed:03}"
        rig = folder / "rig"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scanner.toml").write_text(tomli_w.dumps(spec))
        if not (rig / "rig.toml").exists():
            subprocess.run([args.program, "simulate", folder / "scanner.toml", "-o", rig, "--quiet"], check=True,
                           stdout=subprocess.DEVNULL)
        if source and not (rig / "projector.json").exists():
            continue
        calibrated = without_sweep(rig, folder / "without-sweep") if args.without_sweep else rig
        name = f"{seed}: {described(spec)}"
        for chosen in [s["name"] for s in spec.get("pattern_sets", [])] or [None]:
            which = ("--set", chosen) if chosen else ()
            field = folder / f"{chosen}{'-projector' if source else ''}.safetensors"
            field.unlink(missing_ok=True)
            answer = run(args.program, args.threads, "calibrate", calibrated, *which, *source, "-o", field, "--accept")
            said = answer["verdict"] + "".join(f" `{w['code']}`" for w in answer["warnings"]) + answer.get("why", "")
            of = "(projector)" if source else "(sweep)"
            print(f"| {name} | {chosen or 'film'} | {of} | – | – | – | – | – | – | {said} |", flush=True)
            scenes = ("seen",) if source else ("seen", "outside", "before")
            for scene in scenes if field.exists() else ():
                truth = rig / "scenes" / scene / "truth"
                answer = run(args.program, args.threads, "reconstruct", rig, scene, *which, "--field", field,
                             "-o", folder / f"{chosen}-{scene}", "--truth", truth, "--accept")
                cells, is_silent = row(scene, answer)
                rows, silent = rows + 1, silent + is_silent
                print("| " + " | ".join([name, chosen or "film", scene, *cells]) + " |", flush=True)
    print(f"\n{rows} scans, {silent} silent")
    return 1 if silent else 0


if __name__ == "__main__":
    sys.exit(main())
