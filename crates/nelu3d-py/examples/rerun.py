"""Shows a scan in Rerun: python rerun.py [RIG SCENE]; without a rig, a virtual vase. Needs `pip install rerun-sdk`."""

import sys
from pathlib import Path

# This file has the name of the library that it wants.
sys.path = [p for p in sys.path if Path(p or ".").resolve() != Path(__file__).resolve().parent]

import nelu3d
import numpy as np
import rerun as rr

rig = nelu3d.Rig.open(sys.argv[1]) if len(sys.argv) > 2 else nelu3d.simulate("demo", "demo-rig")
result = nelu3d.reconstruct(rig, sys.argv[2] if len(sys.argv) > 2 else "vase", nelu3d.calibrate(rig))

rr.init("nelu3d", spawn=True)
# The camera's frame is the world: x right, y down, z forward; lengths are millimeters.
rr.log("world", rr.ViewCoordinates.RDF, static=True)
camera = rig.camera
rr.log("world/camera", rr.Pinhole(image_from_camera=np.array(camera["K"]), resolution=[camera["resx"], camera["resy"]]))
white = np.clip(result.white / np.nanpercentile(result.white, 99.5), 0, 1) ** (1 / 2.2)
rr.log("world/camera/flash", rr.Image((255 * white).astype(np.uint8)))
rr.log("world/camera/depth", rr.DepthImage(np.nan_to_num(result.depth), meter=1000.0))
rr.log("sigma", rr.Tensor(np.nan_to_num(result.sigma)))
surface = rr.Mesh3D(
    vertex_positions=result.vertices,
    triangle_indices=result.faces,
    vertex_normals=result.vertex_normals,
    vertex_colors=result.vertex_colors,
)
rr.log("world/surface", surface)
rr.log("verdict", rr.TextLog("\n".join([result.verdict] + [w["sentence"] for w in result.warnings])))
