#!/usr/bin/env python3
"""Scans every board of a real sweep with the field of the others, and compares with their calibrated projector.

    python3 benches/real/leave_one_out.py PROGRAM RIG FOLDER [--sets both,rows] [--boards 0,1,2] [--projector]

RIG has a sweep `calibration/000 …`, and every position as a scene `board0 …` with its own plane as ground truth, as the
shared `kamino`. Prints a row per set and board. Results lie in FOLDER, in a folder named after the program's SHA-256;
what is there is not computed again.
`--projector` adds a row of a field that is computed from a projector calibrated from the same other boards (the set
must have Gray code along both axes somewhere in the rig). Nothing is written to RIG.
"""

import argparse
import hashlib
import json
import pathlib
import shutil
import subprocess


def run(program, cache, *args):
    """Returns the program's JSON answer, from `cache` if it is there."""
    if not cache.exists():
        done = subprocess.run([program, *map(str, args), "--json", "--quiet"], capture_output=True, text=True)
        if not done.stdout:
            raise SystemExit(f"{' '.join(map(str, args))}: {done.stderr.strip()[-400:]}")
        cache.write_text(done.stdout)
    return json.loads(cache.read_text())


def without(rig, board, folder):
    """Makes a rig of links in `folder`, without a position and without a projector."""
    if folder.exists():
        return folder
    (folder / "calibration").mkdir(parents=True)
    for name in ("camera.json", "patterns", "scenes"):
        (folder / name).symlink_to(rig / name)
    shutil.copy(rig / "rig.toml", folder / "rig.toml")
    for position in (rig / "calibration").iterdir():
        if position.name != f"{board:03}":
            (folder / "calibration" / position.name).symlink_to(position)
    return folder


def number(value, digits, times=1):
    """Writes a number; a dash for one that there is none of, as where nothing has a depth."""
    return "–" if value is None else f"{times * value:.{digits}f}"


def row(label, board, calibrated, scanned):
    """Prints a row of the table."""
    metrics = scanned["summary"]["metrics"]
    whole, body = metrics["whole"], metrics["body"]
    quality = calibrated["report"].get("quality")
    decibels = f"{quality['psnr_db']:.1f} ({quality['ceiling_db']:.1f})" if quality else "–"
    codes = ", ".join(f"`{w['code']}`" for w in calibrated["warnings"] + scanned["warnings"])
    sigma = body["sigma"]
    columns = [
        f"board {board}, {label}",
        decibels,
        number(whole["depth_mm"]["mae"], 3),
        number(body["depth_mm"]["median"], 3),
        number(whole["coverage"], 1, 100),
        number(whole["sigma"]["gross"], 2, 100),
        f"{number(sigma['within_1'], 0, 100)}, {number(sigma['within_2'], 0, 100)}",
        number(sigma["median_mm"], 2),
        f"{scanned['verdict']}{': ' if codes else ''}{codes}",
    ]
    print(f"| {' | '.join(columns)} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("rig", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--sets", default="both,rows")
    parser.add_argument("--boards", default="0,1,2,3,4")
    parser.add_argument("--projector", action="store_true")
    args = parser.parse_args()
    of_program = hashlib.sha256(pathlib.Path(args.program).read_bytes()).hexdigest()[:12]
    rig, folder = args.rig.resolve(), args.folder / of_program
    folder.mkdir(parents=True, exist_ok=True)
    print("| case | held out (noise allows), dB | MAE, mm | body median, mm | coverage, % | gross, % "
          "| within 1σ, 2σ (body), % | 1σ, mm | verdict |\n|---|---|---|---|---|---|---|---|---|")
    for chosen in args.sets.split(","):
        for board in map(int, args.boards.split(",")):
            kinds = [(chosen, rig, ("--leave-out", f"{board:03}"))]
            if args.projector:
                others = without(rig, board, folder / f"without-{board}")
                kinds.append((f"{chosen}, projector", others, ("--from-projector",)))
            for label, of, more in kinds:
                name = f"{label.replace(', ', '-')}-{board}"
                field, result = folder / f"{name}.safetensors", folder / name
                if "--from-projector" in more and not (of / "projector.json").exists():
                    run(args.program, of / "projector-answer.json", "projector", of)
                calibrated = run(args.program, folder / f"{name}-calibrate.json", "calibrate", of, "--set", chosen,
                                 "-o", field, "--accept", *more)
                scanned = run(args.program, folder / f"{name}-scan.json", "reconstruct", rig, f"board{board}", "--set",
                              chosen, "--field", field, "-o", result, "--seed", "0", "--accept", "--truth",
                              rig / "scenes" / f"board{board}" / "truth")
                row(label, board, calibrated, scanned)


if __name__ == "__main__":
    main()
