"""Everything that nelu3d claims of a GPU, on this machine's, as one Markdown table.

    cargo build --release --features nelu3d-cli/gpu
    pip install torch numpy          # for the PyTorch column; left out where torch has no device
    python benches/gpu/run.py [--device gpu] [--dlp ../shared/data/dlp] [--film ../shared/data/film]

Runs the built program: ceilings and phases of a training step (`nelu3d bench`), calibration, recipe `fast`, recipe `paper`, a
2-megapixel virtual scene, and a film sequence, each on the device and on the CPU in turns, next to the same training step in
PyTorch (`benches/peer/surface_step.py`) on the same device. Where the rig `dlp` is not there it is left out, loudly; in the
place of `film` there is a preset. `--small` is for software drivers: few iterations, scaled up, and marked so.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
ITERATIONS = 10_000


def run(program, *arguments):
    """The answer of a command, and the seconds it took."""
    start = time.perf_counter()
    done = subprocess.run([program, *map(str, arguments), "--json", "--quiet"], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"nelu3d {' '.join(map(str, arguments))}: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout), time.perf_counter() - start


def torch_step(device, samples):
    """Seconds of a step in PyTorch; None without torch or such a device."""
    script = HERE.parent / "peer" / "surface_step.py"
    command = [sys.executable, script, "--device", device, "--rays", samples // 32, "--steps", 5, "full"]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode:
        print(f"LEFT OUT: PyTorch: {(done.stderr.strip().splitlines() or ['?'])[-1]}", file=sys.stderr)
        return None
    return json.loads(done.stdout.splitlines()[-1])["seconds_per_step"]


def stage(result, name):
    """Seconds of a result's stage."""
    with open(result / "result.json") as file:
        stages = json.load(file)["stages"]
    return sum(s["wall_secs"] for s in stages if name in s["name"])


def two_megapixels(program, folder):
    """The preset `dlp` with a camera of 1632 x 1224 pixels."""
    run(program, "simulate", "dlp", "-o", folder / "preset")
    text = (folder / "preset" / "simulation.toml").read_text()
    width = int(re.search(r"^width = (\d+)$", text, re.M)[1])
    factor = 1632 / width
    for key in ["width", "height", "fx", "fy", "cx", "cy", "psf_sigma_px"]:
        scaled = lambda m: f"{key} = {round(float(m[1]) * factor) if key in ('width', 'height') else float(m[1]) * factor}"
        text = re.sub(rf"^{key} = ([\d.]+)$", scaled, text, count=1, flags=re.M)
    (folder / "two.toml").write_text(text)
    run(program, "simulate", folder / "two.toml", "-o", folder / "two")
    return folder / "two"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="gpu")
    parser.add_argument("--torch-device", default="cuda")
    parser.add_argument("--nelu3d", default="target/release/nelu3d")
    parser.add_argument("--dlp", default="../shared/data/dlp", type=pathlib.Path)
    parser.add_argument("--dlp-field", type=pathlib.Path, help="its field, where its sweep is not there")
    parser.add_argument("--film", default="../shared/data/film", type=pathlib.Path)
    parser.add_argument("--small", action="store_true", help="for software drivers")
    options = parser.parse_args()
    program, device = options.nelu3d, options.device
    iterations, samples = (10, 8192) if options.small else (ITERATIONS, 262_144)
    scale = ITERATIONS / iterations
    rows = []

    def row(*cells):
        """One row, also told at once: a lent machine may be gone before the table is whole."""
        rows.append(cells)
        print("| " + " | ".join(cells) + " |", file=sys.stderr, flush=True)

    found, _ = run(program, "devices")
    print(json.dumps(found, indent=1), file=sys.stderr)
    bench, _ = run(program, "bench", "--device", device, "--samples", samples, "--seconds", 0.3)
    torch = torch_step(options.torch_device, samples)
    ratio = f"{torch / bench['step_secs']:.1f}x PyTorch" if torch else "no PyTorch"
    row("a step of recipe `paper`", f"{1e3 * bench['step_secs']:.2f} ms, {bench['n_samples']} samples", ratio)
    row("its memory", f"{bench['memory_bytes'] / 1e6:.0f} MB", "target 1000 MB")
    row("ceilings", f"{bench['flops_per_sec'] / 1e12:.2f} TFLOP/s", f"{bench['bytes_per_sec'] / 1e9:.0f} GB/s")
    for p in bench["phases"]:
        row(f"phase {p['name']}", f"{1e3 * p['secs']:.3f} ms", f"{100 * p['share_of_ceiling']:.0f} % of {p['bound']}")

    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        # Label, rig, scene, field (None: calibrated here), whether recipe `paper` runs, too.
        rigs = [("dlp", options.dlp, "pawn", options.dlp_field, True)] if options.dlp.is_dir() else []
        if not rigs:
            print(f"LEFT OUT: {options.dlp} is not there", file=sys.stderr)
        if not options.small:
            rigs.append(("2 megapixels", two_megapixels(program, folder), None, None, False))
        for label, rig, scene, field, paper in rigs:
            scene = scene or sorted(p.name for p in (rig / "scenes").iterdir())[0]
            if field is None:
                field = folder / f"{label[0]}.safetensors"
                _, secs = run(program, "calibrate", rig, "-o", field)
                # A spline is fitted on the CPU whatever the device.
                row(f"{label}: calibrate, grid", f"{secs:.1f} s", "cpu")
            for d in [device, "cpu"] * (1 if options.small else 2):
                out = folder / f"fast-{d}"
                _, secs = run(program, "reconstruct", rig, scene, "--field", field, "--device", d, "-o", out)
                text = f"{secs:.2f} s, cost volume {stage(out, 'cost volume'):.2f} s, refinement {stage(out, 'refine'):.2f} s"
                row(f"{label} {scene}: fast", text, d)
            if paper:
                out = folder / "paper"
                arguments = ["--recipe", "paper", "--steps", iterations, "--samples", samples, "--device", device, "-o", out]
                truth = rig / "scenes" / scene / "truth"
                arguments += ["--truth", truth] if truth.is_dir() else []
                run(program, "reconstruct", rig, scene, "--field", field, *arguments)
                training = stage(out, "volume rendering") * scale
                text = f"{training:.1f} s of training" + (f" (scaled up from {iterations} iterations)" if scale > 1 else "")
                if truth.is_dir():
                    metrics = json.loads((out / "result.json").read_text())["metrics"]
                    mae, body = metrics["whole"]["depth_mm"]["mae"], metrics["body"]["depth_mm"]["median"]
                    text += f", MAE {mae:.3f} mm, body's median {body:.3f}"
                row(f"{label} {scene}: paper, {ITERATIONS} iterations", text, device)
                if torch:
                    row(f"the same in PyTorch, {ITERATIONS} steps", f"{torch * ITERATIONS:.0f} s", options.torch_device)
        film = options.film
        if not film.is_dir():
            print(f"{film} is not there: the preset `film-triton` in its place", file=sys.stderr)
            film = folder / "film"
            run(program, "simulate", "film-triton", "-o", film)
        field = folder / "film.safetensors"
        run(program, "calibrate", film, "-o", field)
        sequence = sorted(p.name for p in (film / "sequences").iterdir())[0]
        for d in [device, "cpu"]:
            out = folder / f"sequence-{d}"
            answer, secs = run(program, "sequence", film, sequence, "--field", field, "--device", d, "-o", out)
            row(f"{film.name} {sequence}", f"{len(answer['table']) / secs:.2f} frames/s", d)
        # Last, as the CPU takes minutes.
        for d in [device, "cpu"] if not options.small else []:
            _, secs = run(program, "calibrate", folder / "preset", "--form", "hash", "--device", d, "-o", field)
            row("preset dlp: calibrate, hash", f"{secs:.1f} s", d)

    print(f"{bench['device']}\n\n| what | measured | on, against |\n|---|---|---|")
    for row in rows:
        print("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
