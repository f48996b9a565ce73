"""3D scanning with a camera and any light source that throws a pattern, without a projector model.

::

    import nelu3d

    rig = nelu3d.simulate("demo", "demo-rig")          # or nelu3d.Rig.open("my-rig")
    field = nelu3d.calibrate(rig)                      # the board sweep becomes a color field
    vase = nelu3d.reconstruct(rig, "vase", field)      # the captures become a surface
    vase.depth, vase.sigma                             # mm, numpy
    nelu3d.evaluate(vase, "demo-rig/scenes/vase/truth")

Lengths are millimeters, angles radians; the camera's frame is x right, y down, z forward; maps are height × width.
Long functions take ``progress``, a function of (stage, done, total), and stop at Ctrl-C. What cannot be done raises
``nelu3d.Error`` with one sentence: where, what is wrong, what to do. What can be doubted issues a
``nelu3d.ScanWarning``; what is bad raises ``nelu3d.Refused`` unless ``accept=True``.
"""

from nelu3d._nelu3d import (
    ColorField,
    Error,
    Reconstruction,
    Refused,
    Rig,
    ScanWarning,
    Sequence,
    __version__,
    calibrate,
    decode,
    evaluate,
    patterns,
    reconstruct,
    sequence,
    simulate,
)

__all__ = [
    "ColorField",
    "Error",
    "Reconstruction",
    "Refused",
    "Rig",
    "ScanWarning",
    "Sequence",
    "__version__",
    "calibrate",
    "decode",
    "evaluate",
    "patterns",
    "reconstruct",
    "sequence",
    "simulate",
]
