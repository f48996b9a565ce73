"""Two recipes on one virtual scanner, compared with the ground truth: python compare.py [iterations of `paper`]."""
import sys

import matplotlib.pyplot as plt
import nelu3d
import numpy as np

rig = nelu3d.simulate("demo", "compare-rig")
field = nelu3d.calibrate(rig)
truth = rig.root / "scenes" / "vase" / "truth"
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
found = {
    "fast": nelu3d.reconstruct(rig, "vase", field),
    "paper": nelu3d.reconstruct(rig, "vase", field, recipe="paper", steps=steps, accept=True),
}
figure, axes = plt.subplots(1, 3, figsize=(12, 3.2), layout="constrained")
axes[0].imshow(found["fast"].white, cmap="gray")
axes[0].set_title("flash")
for ax, (name, result) in zip(axes[1:], found.items()):
    body = nelu3d.evaluate(result, truth)["body"]
    print(f"{name:6} MAE {body['depth_mm']['mae']:.3f} mm, coverage {body['coverage']:.1%}, {result.verdict}")
    error = result.depth - np.load(truth / "depth.npy")
    image = ax.imshow(error, cmap="RdBu", vmin=-1, vmax=1)
    ax.set_title(f"{name}: MAE {body['depth_mm']['mae']:.3f} mm")
figure.colorbar(image, ax=axes, label="depth − truth, mm")
figure.savefig("compare.png", dpi=120)
