"""The package computes what the program computes, byte for byte, from folders and from arrays."""

import subprocess
import sys

import nelu3d
import numpy as np
import pytest

MAPS = ["depth", "normals", "sigma"]


def same(a, b):
    """Whether two arrays are equal to the last bit, NaN included."""
    return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()


def images(folder, rig):
    """The codes of a shot as the files have them."""
    from PIL import Image

    names = ["white.png", "black.png", *rig.pattern_sets["two"]]
    return {name.removesuffix(".png"): np.asarray(Image.open(folder / name)) for name in names}


def codes(rig):
    """The rig as arrays."""
    from PIL import Image

    root = rig.root
    mode = np.asarray(Image.open(root / "scenes" / "ball" / "white.png")).dtype
    sweep = {name: images(root / "calibration" / name, rig) for name in rig.positions}
    frames = {f"{i:03}": images(root / "sequences" / "hand" / f"{i:03}", rig) for i in range(4)}
    return mode, sweep, {"ball": images(root / "scenes" / "ball", rig)}, {"hand": frames}


@pytest.fixture(scope="module")
def arrays(rig):
    """The rig made of arrays."""
    tomllib = pytest.importorskip("tomllib")

    mode, sweep, scenes, sequences = codes(rig)
    assert mode == np.uint16 or mode == np.int32, mode
    to16 = lambda shots: {k: {n: a.astype(np.uint16) for n, a in v.items()} for k, v in shots.items()}
    described = tomllib.loads((rig.root / "rig.toml").read_text())
    return nelu3d.Rig.from_arrays(
        camera={"K": np.array(rig.camera["K"]), "dist_coeffs": np.array(rig.camera["dist_coeffs"])},
        patterns={"two": [name.removesuffix(".png") for name in rig.pattern_sets["two"]]},
        calibration=to16(sweep),
        scenes=to16(scenes),
        sequences={name: to16(frames) for name, frames in sequences.items()},
        board=described["board"],
        poses={p["position"]: (p["rotation"], p["translation"]) for p in described.get("poses", [])} or None,
        black_level=described["camera"]["black_level"],
        saturation=described["camera"]["saturation"],
    )


def test_calibrate_and_reconstruct_equal_the_program(rig, field, ball, program, tmp_path):
    answer = program("calibrate", rig.root, "-o", tmp_path / "f.safetensors")
    field.save(tmp_path / "own.safetensors")
    assert (tmp_path / "own.safetensors").read_bytes() == (tmp_path / "f.safetensors").read_bytes()
    assert answer["report"]["quality"] == field.report["quality"] == field.quality
    program("reconstruct", rig.root, "ball", "--field", tmp_path / "f.safetensors", "-o", tmp_path / "ball")
    for name in MAPS:
        assert same(getattr(ball, name), np.load(tmp_path / "ball" / f"{name}.npy")), name
    ball.save(tmp_path / "own", also=["stl"])
    for name in ["depth.npy", "normals.npy", "sigma.npy", "mesh.ply", "points.ply", "mask.png", "preview.png"]:
        assert (tmp_path / "own" / name).read_bytes() == (tmp_path / "ball" / name).read_bytes(), name
    assert (tmp_path / "own" / "mesh.stl").exists() and (tmp_path / "own" / "report.html").exists()


def test_recipe_paper_equals_the_program(rig, field, program, tmp_path):
    field.save(tmp_path / "f.safetensors")
    paper = nelu3d.reconstruct(rig, "ball", field, recipe="paper", paper={"start": "plane", "samples": 2048}, steps=20, device="cpu", accept=True)
    more = ["--recipe", "paper", "--start", "plane", "--samples", "2048", "--steps", "20", "--device", "cpu", "--accept"]
    program("reconstruct", rig.root, "ball", "--field", tmp_path / "f.safetensors", "-o", tmp_path / "p", *more)
    for name in MAPS:
        assert same(getattr(paper, name), np.load(tmp_path / "p" / f"{name}.npy")), name
    assert paper.diagnostics["iterations"] == 20


def test_decode_equals_the_program(rig, program, tmp_path):
    found = nelu3d.decode(rig, "ball", "gray", set="gray", depth=[600, 820])
    more = ["--set", "gray", "--method", "gray", "--depth", "600", "820", "-o", tmp_path / "gray"]
    program("decode", rig.root, "ball", *more)
    for name in MAPS:
        assert same(getattr(found, name), np.load(tmp_path / "gray" / f"{name}.npy")), name
    assert found.diagnostics["settings"]["method"] == "gray"


def test_sequence_equals_the_program(rig, field, program, tmp_path):
    field.save(tmp_path / "f.safetensors")
    program("sequence", rig.root, "hand", "--field", tmp_path / "f.safetensors", "-o", tmp_path / "s", "--keyframe", 2)
    frames = nelu3d.sequence(rig, "hand", field, keyframe=2)
    assert len(frames) == 4
    for i, frame in enumerate(frames):
        assert frame.scene == f"{i:03}"
        for name in MAPS:
            assert same(getattr(frame, name), np.load(tmp_path / "s" / f"{i:03}" / f"{name}.npy")), (i, name)
    assert list(frames) == []


def test_evaluate_equals_the_program(rig, ball, program, tmp_path):
    ball.save(tmp_path / "ball")
    truth = rig.root / "scenes" / "ball" / "truth"
    own = nelu3d.evaluate(tmp_path / "ball", truth)
    assert own == program("evaluate", tmp_path / "ball", "--truth", truth)["metrics"]
    depth = np.load(truth / "depth.npy")
    from PIL import Image

    depth[np.asarray(Image.open(truth / "mask.png")) == 0] = np.nan
    assert nelu3d.evaluate(ball, depth)["whole"]["depth_mm"] == own["whole"]["depth_mm"]
    assert own["body"]["depth_mm"]["mae"] < 1
    assert nelu3d.evaluate(ball, against=tmp_path / "ball")["depth_mm"]["mae"] == 0


def test_arrays_equal_files(rig, arrays, field, ball, tmp_path):
    assert arrays.positions == rig.positions and arrays.scenes == ["ball"] and arrays.sequences == ["hand"]
    for name, image in rig.read("ball").items():
        assert same(image, arrays.read("ball")[name.removesuffix(".png")]), name
    own = nelu3d.calibrate(arrays)
    assert own.quality == field.quality
    found = nelu3d.reconstruct(arrays, "ball", own)
    for name in MAPS:
        assert same(getattr(found, name), getattr(ball, name)), name
    found.save(tmp_path / "saved")
    assert same(np.load(tmp_path / "saved" / "depth.npy"), ball.depth)
    frames = [f.depth for f in nelu3d.sequence(arrays, "hand", own, keyframe=2)]
    files = [f.depth for f in nelu3d.sequence(rig, "hand", field, keyframe=2)]
    assert all(same(a, b) for a, b in zip(frames, files))


def test_strides_do_not_matter(rig, arrays, field):
    """Views of a stack, of a mirrored image, and of every second pixel are read as what they show."""
    _, _, scenes, _ = codes(rig)
    shot = {name: image.astype(np.uint16) for name, image in scenes["ball"].items()}
    stack = np.stack(list(shot.values()), axis=-1)
    wide = np.zeros((120, 320), np.uint16)
    wide[:, ::2] = shot["white"]
    views = {name: stack[..., i] for i, name in enumerate(shot)}
    views["white"] = wide[:, ::2]
    views["black"] = np.ascontiguousarray(shot["black"][::-1])[::-1]
    described = dict(camera=rig.camera, patterns=[n.removesuffix(".png") for n in rig.pattern_sets["two"]],
                     black_level=64, saturation=4095)
    plain = nelu3d.Rig.from_arrays(scenes={"ball": shot}, **described).read("ball")
    strided = nelu3d.Rig.from_arrays(scenes={"ball": views}, **described).read("ball")
    assert all(same(plain[name], strided[name]) for name in plain)
    floats = {name: image.astype(np.float32) for name, image in shot.items()}
    as_floats = nelu3d.Rig.from_arrays(scenes={"ball": floats}, **described).read("ball")
    assert all(np.allclose(plain[name], as_floats[name], atol=1e-6) for name in plain)


def test_field(field, ball, tmp_path):
    field.save(tmp_path / "f.safetensors")
    again = nelu3d.ColorField.load(tmp_path / "f.safetensors")
    assert again.k == field.k == 2 and again.form == "grid" and again.report is None
    low, high = field.bounds
    assert (low < high).all() and 550 < low[2] < 660 and 740 < high[2] < 850, field.bounds
    points = ball.vertices[::7]
    values = field(points)
    assert values.shape == (len(points), 2) and values.dtype == np.float32
    assert same(values, again(points.tolist()))
    assert np.isfinite(values).mean() > 0.99
    assert np.isnan(field([[0, 0, 10.0]])).all() and field([[0, 0, 10.0]], extrapolate=True).shape == (1, 2)
    # The codeword of a point is what its pixel saw.
    assert (points >= low - 1e-3).all() and (points <= high + 1e-3).all()


def test_maps_are_views_that_outlive_the_result(rig, field):
    found = nelu3d.reconstruct(rig, "ball", field)
    depth, copy = found.depth, found.depth.copy()
    assert depth.base is not None and not depth.flags.writeable
    with pytest.raises(ValueError):
        depth[0, 0] = 1
    del found
    assert same(depth, copy)
    assert depth.shape == (120, 160)


def test_mesh_and_status(ball):
    assert ball.vertices.shape[1] == ball.faces.shape[1] == 3
    assert ball.faces.dtype == np.uint32 and ball.faces.max() < len(ball.vertices)
    assert ((ball.status == 0) == np.isfinite(ball.depth)).all()
    assert ball.white.shape == ball.depth.shape
    assert ball.verdict in ("good", "doubtful")
    assert all({"code", "sentence", "remedy"} <= set(w) for w in ball.warnings + ball.notes)


def test_patterns():
    made = nelu3d.patterns(size=(320, 200), images=3)
    assert list(made) == ["sine_00", "triangle_00", "random_00"]
    assert all(p.shape == (200, 320) and p.dtype == np.float32 and 0 <= p.min() <= p.max() <= 1 for p in made.values())
    sine = nelu3d.patterns("sinusoid", size=(64, 4), axis="x", period_px=16.0, steps=1)["sine_00"]
    assert np.allclose(sine[0, :16], sine[0, 16:32], atol=1e-6) and np.ptp(sine[:, 3]) == 0
    assert nelu3d.patterns("gray", size=(64, 4), axis="x")["gray_x_00"].shape == (4, 64)


def test_import_is_quick():
    best = min(run_import() for _ in range(5))
    assert best < 0.2, f"import nelu3d takes {best:.3f} s"


def run_import():
    """Seconds of the import alone, in a fresh interpreter."""
    code = "import time; t = time.perf_counter(); import nelu3d; print(time.perf_counter() - t)"
    return float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
