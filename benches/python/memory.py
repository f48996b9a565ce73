#!/usr/bin/env python3
"""What a rig of arrays costs beside the arrays: peak memory of the process before and after, 31 megapixels an image.

    python benches/python/memory.py [number of images]

Images are views of one stack, as a camera's driver or a .npy file gives them. Reading a scene makes 32-bit floats of
all of its images, which is what a reconstruction works on, and holds one image's codes at a time beside them.
"""

import sys

import nelu3d
import numpy as np

WIDTH, HEIGHT = 6464, 4852


def peak_mb() -> float:
    """Peak memory of this process, MB."""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 12
    one = WIDTH * HEIGHT * 2 / 2**20
    stack = np.full((HEIGHT, WIDTH, n), 1000, np.uint16)
    names = ["white", "black", *(f"p{i}" for i in range(n - 2))]
    before = peak_mb()
    K = [[5000, 0, WIDTH / 2], [0, 5000, HEIGHT / 2], [0, 0, 1]]
    scene = {name: stack[..., i] for i, name in enumerate(names)}
    rig = nelu3d.Rig.from_arrays(camera={"K": K}, patterns=names[2:], scenes={"cup": scene}, saturation=4095)
    made = peak_mb()
    print(f"{n} images of {WIDTH} x {HEIGHT} px, uint16: {n * one:.0f} MB in numpy")
    print(f"Rig.from_arrays: peak {before:.0f} -> {made:.0f} MB: {made - before:.1f} MB more")
    rig.read("cup")
    read = peak_mb()
    print(f"reading all as 32-bit floats ({2 * n * one:.0f} MB): {read - made:.0f} MB more: {read - made - 2 * n * one:.0f} MB beside them")


if __name__ == "__main__":
    main()
