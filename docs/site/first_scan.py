#!/usr/bin/env python3
"""The pictures of docs/first-scan.md, from the rehearsal on that page.

    python3 docs/site/first_scan.py PROGRAM FOLDER     # needs numpy, Pillow, and matplotlib

Runs the rehearsal's commands in FOLDER (what is there is kept), and writes docs/first-scan-{place,board,sweep,scene,result}.png.
"""

import pathlib
import subprocess
import sys
import tomllib

import matplotlib
import numpy as np
from PIL import Image

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

DOCS = pathlib.Path(__file__).resolve().parent.parent
COMMANDS = [
    "simulate demo -o virtual",
    "capture my-rig --rehearse virtual",
    "calibrate my-rig -o field.safetensors",
    "reconstruct my-rig vase --field field.safetensors -o result",
]


def tone(path, black, white):
    """An image as it looks: light of codes, brightened as screens expect it."""
    codes = np.asarray(Image.open(path), dtype=float)
    return np.clip((codes - black) / (white - black), 0, 1) ** (1 / 2.2)


def save(figure, name):
    figure.savefig(DOCS / f"first-scan-{name}.png", dpi=100, bbox_inches="tight", pil_kwargs={"optimize": True})
    plt.close(figure)


def row(name, pictures):
    """A row of pictures with titles."""
    figure, axes = plt.subplots(1, len(pictures), figsize=(2.6 * len(pictures), 2.3))
    for ax, (title, picture) in zip(np.atleast_1d(axes), pictures):
        ax.imshow(picture, cmap="gray", vmin=0, vmax=1)
        ax.set_title(title, fontsize=8)
        ax.axis("off")
    figure.tight_layout(pad=0.4)
    save(figure, name)


def place(spec):
    """The set-up from above: the camera's and the light's cones, the board at every position, the object."""
    camera, light, sweep = spec["camera"], spec["light"], spec["sweep"]
    figure, ax = plt.subplots(figsize=(6.4, 2.9))
    far = 1.12 * sweep["last_mm"]

    def cone(at, towards, half, label, color):
        middle = np.arctan2(towards[0] - at[0], towards[1] - at[1])
        length = far - at[1]
        corners = [at] + [(at[0] + length * np.tan(middle + s * half), far) for s in (-1, 1)]
        ax.fill([c[1] for c in corners], [c[0] for c in corners], color=color, alpha=0.15, lw=0)
        ax.plot(at[1], at[0], "o", color=color, ms=9)
        ax.annotate(label, (at[1], at[0]), (8, 8), textcoords="offset points", fontsize=8, color=color)

    cone((0, 0), (0, 1), np.arctan(camera["width"] / 2 / camera["fx"]), "camera", "tab:blue")
    at, target = light["position_mm"], light["target_mm"]
    cone((at[0], at[2]), (target[0], target[2]), np.arctan(light["width"] / 2 / light["fx"]), "projector", "tab:orange")
    left, _, right, _ = spec["board"]["extent_mm"]
    for z in np.linspace(sweep["first_mm"], sweep["last_mm"], sweep["positions"]):
        ax.plot([z, z], [left, right], color="0.45", lw=0.7)
    ax.annotate(f"the board at {sweep['positions']} positions", (sweep["first_mm"], right), (-10, 6),
                textcoords="offset points", fontsize=8, color="0.3", ha="right")
    thing = spec["scenes"][0]["objects"][0]["position_mm"]
    ax.plot(thing[2], thing[0], "s", color="tab:green", ms=10)
    ax.annotate("the object, later", (thing[2], thing[0]), (0, -44), textcoords="offset points", fontsize=8, color="tab:green",
                ha="center")
    ax.set(xlabel="distance from the camera, mm", ylabel="to the right, mm", aspect="equal", ylim=(-200, 270))
    ax.tick_params(labelsize=7)
    save(figure, "place")


def main(program, folder):
    program = pathlib.Path(program).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for command in COMMANDS:
        words = command.split()
        made = folder / (words[1] if words[0] == "capture" else words[-1])
        if not made.exists():
            subprocess.run([program, *words, "--quiet"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    rig, spec = folder / "my-rig", tomllib.loads((folder / "virtual" / "simulation.toml").read_text())
    facts = tomllib.loads((rig / "rig.toml").read_text())["camera"]
    levels = facts["black_level"], facts["saturation"]
    place(spec)
    positions = sorted(p for p in (rig / "calibration").iterdir() if p.is_dir())
    chosen = [positions[0], positions[len(positions) // 2], positions[-1]]
    look = lambda shot, name: tone(shot / name, *levels)
    row("sweep", [(f"position {p.name}: {n[:-4]}", look(p, n)) for p in chosen for n in ("white.png", "sine_00.png")][:6])
    scene = rig / "scenes" / "vase"
    names = ["white.png", "black.png", "sine_00.png", "triangle_00.png", "random_00.png"]
    row("scene", [(n[:-4], look(scene, n)) for n in names])
    subprocess.run([program, "board", "charuco", "-o", folder / "board.png", "--force", "--quiet"], check=False, stdout=subprocess.DEVNULL)
    for source, name, width in ((folder / "board.png", "board", 320), (folder / "result" / "preview.png", "result", 960)):
        picture = Image.open(source).convert("RGB")
        if picture.width > width:
            picture = picture.resize((width, round(picture.height * width / picture.width)), Image.LANCZOS)
        picture.save(DOCS / f"first-scan-{name}.png", optimize=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], pathlib.Path(sys.argv[2]))
