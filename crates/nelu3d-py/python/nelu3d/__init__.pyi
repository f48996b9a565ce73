"""3D scanning with a camera and any light source that throws a pattern, without a projector model.

Lengths are millimeters, angles radians; the camera's frame is x right, y down, z forward; maps are height x width.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence as _Sequence
from os import PathLike
from typing import Any, Literal, Union, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
__version__: str

_Path = Union[str, PathLike[str]]
_Progress = Callable[[str, int, int], object]
_Map = NDArray[np.float32]
_Images = Mapping[str, ArrayLike]
_Shots = Union[Mapping[str, _Images], list[_Images]]
_Verdict = Literal["good", "doubtful", "bad"]
_Format = Literal["obj", "stl", "glb", "3mf", "textured-obj", "textured-glb", "pcd", "e57", "tiff", "exr"]
_Method = Literal["gray", "phase", "mps", "zncc", "turbosl", "lookup3d", "lookup3d-lowrank"]

class Error(Exception):
    """What went wrong, in one sentence: where, what, and what to do."""

class Refused(Error):
    """A result was judged bad; ``accept=True`` returns it all the same."""

    result: Union[ColorField, Reconstruction]
    """What was refused."""

class ScanWarning(UserWarning):
    """What speaks against a result, and what to do about it."""

@final
class Rig:
    """A camera and a light source that did not move: a folder on the disk, or arrays."""

    @staticmethod
    def open(path: _Path) -> Rig:
        """Opens a rig folder, or its rig.toml. No image is read yet."""

    @staticmethod
    def from_arrays(
        *,
        camera: Union[_Path, ArrayLike, Mapping[str, Any]],
        patterns: Union[_Sequence[str], Mapping[str, _Sequence[str]]],
        calibration: _Shots | None = None,
        scenes: Mapping[str, _Images] | None = None,
        sequences: Mapping[str, _Shots] | None = None,
        board: Mapping[str, Any] | None = None,
        poses: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
        channels: str | None = None,
        black_level: float = 0.0,
        saturation: float | None = None,
        response: str | None = None,
        white: str = "white",
        black: str = "black",
        name: str = "arrays",
    ) -> Rig:
        """Makes a rig of arrays: height x width (x 3) codes of type uint8, uint16, or float32.

        The arrays are not copied, whatever their strides; do not write to them while work goes on.

        :param camera: the camera matrix K (3 x 3, px), a dictionary {"K", "dist_coeffs"}, or the path of a camera file.
        :param patterns: names of the pattern images in their order, or a dictionary, set -> names.
        :param calibration: position -> image -> array, or a list of positions; images are ``white``, ``black``, and the
            patterns.
        :param scenes: scene -> image -> array.
        :param sequences: sequence -> frame -> image -> array, or lists of frames.
        :param board: the table [board] of rig.toml: {"kind": "charuco", "columns": ..., "rows": ..., "square_mm": ...,
            "marker_mm": ..., "dictionary": ...}.
        :param poses: position -> (rotation vector in radians, translation in mm) of the board in the camera's frame,
            where they are known.
        :param channels: "mono", "rgb", or "bayer-rggb" and the like; by default as the arrays are.
        :param black_level: code of no light.
        :param saturation: code that is clipped; by default 255, 65535, or 1.
        :param response: how codes follow light: "linear" (the default), "srgb", or the path of a measured curve.
        """

    @property
    def root(self) -> PathLike[str]:
        """Folder of the rig; of a rig of arrays, its name."""
    @property
    def name(self) -> str:
        """Name of the rig."""
    @property
    def camera(self) -> dict[str, Any]:
        """Intrinsics as in camera.json: resx, resy (px), K (3 x 3, px), dist_coeffs (OpenCV's)."""
    @property
    def pattern_sets(self) -> dict[str, list[str]]:
        """Names of the pattern sets, and the names of their images."""
    @property
    def positions(self) -> list[str]:
        """Names of the board positions; empty without a sweep."""
    @property
    def scenes(self) -> list[str]:
        """Names of the scenes."""
    @property
    def sequences(self) -> list[str]:
        """Names of the sequences."""
    def read(self, scene: str, set: str | None = None) -> dict[str, _Map]:
        """Reads a scene's images, linear in light: 0 is no light, 1 is clipped; height x width (x 3)."""
    def check(self, *, progress: _Progress | None = None) -> list[dict[str, str]]:
        """Returns everything that is wrong with the rig's folder: {"severity", "message"}."""

@final
class ColorField:
    """The calibrated color field c: the codeword of every point of the volume in which the board was."""

    @staticmethod
    def load(path: _Path) -> ColorField:
        """Loads a field from its file."""
    def save(self, path: _Path) -> None:
        """Writes the field, whole or not at all."""
    def __call__(self, points: ArrayLike, *, extrapolate: bool = False) -> _Map:
        """Evaluates c at points of the camera's frame, n x 3, mm.

        Returns n x k values of normalized intensity. Points outside the calibrated volume have NaN, unless
        ``extrapolate``.
        """
    @property
    def k(self) -> int:
        """Number of values of a codeword: images x channels."""
    @property
    def form(self) -> Literal["grid", "hash", "frequency"]:
        """Form in which c is stored."""
    @property
    def bounds(self) -> NDArray[np.float64]:
        """Corners of the smallest box around the calibrated volume, camera frame, mm: 2 x 3."""
    @property
    def quality(self) -> dict[str, Any] | None:
        """Quality at held-out board positions: psnr_db, ceiling_db (dB), depth_mm, pose_mm (mm), ..."""
    @property
    def metadata(self) -> dict[str, Any]:
        """What the field was made from: rig, set, images, noise, settings, codes of its warnings, ..."""
    @property
    def report(self) -> dict[str, Any] | None:
        """The report of the calibration, as ``nelu3d calibrate --json`` has it; None for a field that was loaded."""

@final
class Reconstruction:
    """The surface of a scene, with its uncertainty and whether to trust it.

    Arrays look at its memory, and cannot be written. In a notebook it shows itself: a picture, and the surface, which
    can be turned.
    """

    @property
    def depth(self) -> _Map:
        """Camera z of each pixel, mm; NaN where there is none. height x width."""
    @property
    def normals(self) -> _Map:
        """Unit normals that face the camera; NaN where there is no depth. height x width x 3."""
    @property
    def sigma(self) -> _Map:
        """One standard deviation of the depth, mm; NaN where there is none. height x width."""
    @property
    def residual(self) -> _Map:
        """RMS residual over the patterns, normalized intensity; NaN where there is no depth. height x width."""
    @property
    def ambient(self) -> _Map:
        """Fraction of the light that is ambient, 0 to 1; NaN where it is not known. height x width."""
    @property
    def white(self) -> _Map:
        """The white (flash) image, linear in light. height x width (x 3)."""
    @property
    def status(self) -> NDArray[np.uint8]:
        """0 has a depth; 1 outside the calibrated volume, 2 clipped, 3 dark, 4 ambiguous, 5 next to a depth jump."""
    @property
    def vertices(self) -> _Map:
        """Vertices of the mesh in the camera's frame, mm. n x 3."""
    @property
    def vertex_normals(self) -> _Map:
        """Unit normals of the mesh's vertices. n x 3, or 0 x 3."""
    @property
    def vertex_colors(self) -> NDArray[np.uint8]:
        """Colors of the mesh's vertices, sRGB. n x 3, or 0 x 3."""
    @property
    def faces(self) -> NDArray[np.uint32]:
        """Triangles of the mesh, as numbers of vertices. m x 3."""
    @property
    def verdict(self) -> _Verdict:
        """Whether to trust the surface."""
    @property
    def warnings(self) -> list[dict[str, Any]]:
        """What speaks against the surface: {"code", "verdict", "sentence", "evidence", "remedy"}."""
    @property
    def notes(self) -> list[dict[str, Any]]:
        """What is worth knowing and does not speak against the surface, as ``warnings``."""
    @property
    def diagnostics(self) -> dict[str, Any]:
        """Diagnostics of the method: settings, losses, counts."""
    @property
    def stages(self) -> list[dict[str, Any]]:
        """Seconds of each stage: {"name", "wall_secs", "cpu_secs"}."""
    @property
    def scene(self) -> str:
        """Name of the scene or frame."""
    def save(self, path: _Path, *, also: list[_Format] = ...) -> None:
        """Writes a result folder, as ``nelu3d reconstruct`` does, whole or not at all.

        :param also: formats besides those that every result has.
        """
    def page(self) -> str:
        """Returns a page with the surface, which can be turned, as HTML, without other files and network."""
    def _repr_html_(self) -> str: ...
    def _repr_png_(self) -> bytes: ...

@final
class Sequence(Iterator[Reconstruction]):
    """The frames of a sequence: each is computed when it is asked for."""

    def __next__(self) -> Reconstruction:
        """Computes the next frame. After an exception the iteration goes on with the frame after, which begins anew."""
    def __len__(self) -> int:
        """Number of frames."""

def calibrate(
    rig: Rig,
    *,
    set: str | None = None,
    accept: bool = False,
    device: str = "auto",
    progress: _Progress | None = None,
    **settings: Any,
) -> ColorField:
    """Calibrates a rig for one pattern set from its board sweep: the field that ``nelu3d calibrate`` writes.

    :param set: name of the pattern set; the rig's first by default.
    :param accept: return the field even if it is judged bad.
    :param device: "auto", "cpu", "gpu", or "gpu:N".
    :param settings: those of the program with underscores: form, frame, trajectory, hold_out, leave_out, ...
    """

def reconstruct(
    rig: Rig,
    scene: str,
    field: Union[ColorField, _Path, None] = None,
    *,
    set: str | None = None,
    accept: bool = False,
    device: str = "auto",
    progress: _Progress | None = None,
    **settings: Any,
) -> Reconstruction:
    """Reconstructs a scene: the surface that ``nelu3d reconstruct`` writes.

    :param field: a field, or its path; by default the one that the program has written for the rig and set.
    :param settings: those of the program with underscores: recipe ("fast", "paper"), effort, steps, seed, ...; those of
        recipe ``paper`` are a dictionary ``paper``.
    """

def decode(
    rig: Rig,
    scene: str,
    method: _Method,
    *,
    set: str | None = None,
    accept: bool = False,
    progress: _Progress | None = None,
    **settings: Any,
) -> Reconstruction:
    """Decodes a scene by a baseline: the surface that ``nelu3d decode`` writes."""

def sequence(
    rig: Rig,
    name: str,
    field: Union[ColorField, _Path, None] = None,
    *,
    set: str | None = None,
    keyframe: int = 30,
    motion: Literal["auto", "interpolate", "off"] = "auto",
    pattern_time: float | None = None,
    accept: bool = False,
    device: str = "auto",
    progress: _Progress | None = None,
    **settings: Any,
) -> Sequence:
    """Reconstructs a moving scene frame after frame, as ``nelu3d sequence`` does.

    :param keyframe: number of frames from one that begins anew to the next.
    :param pattern_time: when patterns are taken, in frames from their white image.
    """

def evaluate(
    result: Union[Reconstruction, _Path],
    truth: Union[_Path, ArrayLike, None] = None,
    *,
    against: Union[Reconstruction, _Path, None] = None,
    cad: _Path | None = None,
    progress: _Progress | None = None,
) -> dict[str, Any]:
    """Evaluates a result, as ``nelu3d evaluate --json`` does: mm, degrees, fractions.

    :param truth: a folder with depth.npy and mask.png, or an array of depths, height x width, mm, NaN = no surface.
    :param against: another result of the same camera.
    :param cad: a mesh of the part, mm.
    """

def patterns(
    family: str = "recommended", *, size: tuple[int, int], **settings: Any
) -> dict[str, _Map]:
    """Makes the images of a pattern family for a light source of ``size`` = (width, height) px.

    Returns name -> height x width (x 3), values in 0 ... 1, linear in light. Family "recommended" takes ``images`` (3,
    5, or 8) and ``axis`` ("x" or "y"); the others take their settings as in ``nelu3d patterns FAMILY``.
    """

def simulate(spec: _Path, output: _Path, *, progress: _Progress | None = None) -> Rig:
    """Simulates a scanner into the rig folder ``output``, with ground truth, and opens it.

    :param spec: name of a preset ("demo", "shapes", ...), or the path of a specification.
    """
