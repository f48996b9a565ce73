"""Files of a result, opened by the programs that they are for: the same bounding box, in millimeters, in each.

Readers that are not installed are skipped, one by one: pip install trimesh networkx lxml pye57 open3d-cpu tifffile OpenEXR
"""

import numpy as np
import pytest

FORMATS = ["obj", "stl", "glb", "3mf", "textured-obj", "textured-glb", "pcd", "e57", "tiff", "exr"]
# .glb is in meters, y up, as glTF demands: half a turn about x, and a thousandth.
FROM_GLB = np.array([1000.0, -1000.0, -1000.0])


@pytest.fixture(scope="module")
def folder(ball, tmp_path_factory):
    """The ball in every format."""
    folder = tmp_path_factory.mktemp("files") / "ball"
    ball.save(folder, also=FORMATS)
    return folder


@pytest.fixture(scope="module")
def box(ball):
    """Corners of the surface's bounding box, mm."""
    return np.stack([ball.vertices.min(0), ball.vertices.max(0)])


def box_of(points):
    """Corners of the bounding box of n x 3 points, NaN aside."""
    points = np.asarray(points, float).reshape(-1, 3)
    points = points[np.isfinite(points).all(1)]
    return np.stack([points.min(0), points.max(0)])


@pytest.mark.parametrize("name", ["mesh.ply", "mesh.obj", "mesh.stl", "mesh.glb", "mesh.3mf", "textured.obj", "textured.glb"])
def test_trimesh_has_the_same_box(folder, box, ball, name):
    trimesh = pytest.importorskip("trimesh")
    if name.endswith("3mf"):
        pytest.importorskip("networkx")
        pytest.importorskip("lxml")
    mesh = trimesh.load(folder / name, force="mesh", process=False)
    assert len(mesh.faces) == len(ball.faces)
    found = box_of(mesh.vertices * FROM_GLB if name.endswith("glb") else mesh.vertices)
    assert np.allclose(found, box, atol=1e-3), (name, found, box)
    if name == "mesh.3mf":
        assert mesh.units in ("millimeter", "mm"), mesh.units


@pytest.mark.parametrize("name", ["textured.glb", "textured.obj"])
def test_the_flash_lies_where_the_camera_saw_it(folder, ball, name):
    """The picture's value at a vertex is that of the vertex's own pixel."""
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("PIL")
    mesh = trimesh.load(folder / name, force="mesh", process=False)
    material = mesh.visual.material
    picture = np.asarray((getattr(material, "baseColorTexture", None) or material.image).convert("L"), float)
    assert picture.shape == ball.depth.shape
    # trimesh counts v from below, whatever the file does.
    u, v = mesh.visual.uv.T
    x, y = u * picture.shape[1] - 0.5, (1 - v) * picture.shape[0] - 0.5
    assert np.allclose(x, np.round(x), atol=0.02) and np.allclose(y, np.round(y), atol=0.02)
    shown = picture[np.round(y).astype(int), np.round(x).astype(int)]
    # The order of vertices is the mesh's or, in .obj, may be another: lit pixels are bright either way.
    assert shown.mean() > 2 * picture[~np.isfinite(ball.depth)].mean()


def test_open3d_has_the_same_box(folder, box, ball):
    open3d = pytest.importorskip("open3d")
    for name in ["mesh.ply", "mesh.obj", "mesh.stl", "mesh.glb", "textured.obj"]:
        mesh = open3d.io.read_triangle_mesh(str(folder / name))
        found = np.asarray(mesh.vertices)
        found = box_of(found * FROM_GLB if name.endswith("glb") else found)
        assert np.allclose(found, box, atol=1e-3), (name, found, box)
    for name in ["points.ply", "points.pcd"]:
        cloud = open3d.io.read_point_cloud(str(folder / name))
        points = np.asarray(cloud.points)
        assert np.isfinite(points).all(1).sum() == np.isfinite(ball.depth).sum(), name
        found = box_of(points)
        # Every pixel with a depth has a point; vertices of the mesh are those that have a neighbor.
        assert np.allclose(found, box, atol=2), (name, found, box)
        assert cloud.has_normals() and cloud.has_colors(), name
    tensors = open3d.t.io.read_point_cloud(str(folder / "points.pcd"))
    sigma = tensors.point["sigma"].numpy().ravel()
    assert np.array_equal(sigma, ball.sigma.ravel(), equal_nan=True) or len(sigma) == np.isfinite(ball.depth).sum()


def test_points_ply_has_sigma(folder, ball):
    trimesh = pytest.importorskip("trimesh")
    cloud = trimesh.load(folder / "points.ply")
    raw = cloud.metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(np.asarray(raw["sigma"]).ravel(), ball.sigma[np.isfinite(ball.depth)])


def test_e57_is_in_meters_with_rows_and_columns(folder, ball):
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(folder / "points.e57"))
    scan = file.read_scan(0, colors=True, row_column=True, ignore_missing_fields=True)
    rows, columns = scan["rowIndex"], scan["columnIndex"]
    depth = np.full(ball.depth.shape, np.nan, np.float32)
    depth[rows, columns] = 1000 * scan["cartesianZ"]
    assert np.allclose(depth, ball.depth, atol=1e-3, equal_nan=True)
    assert {"colorRed", "colorGreen", "colorBlue"} <= set(scan)


def test_depth_pictures_have_the_same_bits(folder, ball):
    Image = pytest.importorskip("PIL.Image")
    depth = np.asarray(Image.open(folder / "depth.tiff"))
    assert depth.dtype == np.float32 and depth.tobytes() == ball.depth.tobytes()
    tifffile = pytest.importorskip("tifffile")
    assert tifffile.imread(folder / "depth.tiff").tobytes() == ball.depth.tobytes()


def test_exr_depth_has_the_same_bits(folder, ball):
    openexr = pytest.importorskip("OpenEXR")
    with openexr.File(str(folder / "depth.exr")) as file:
        depth = file.channels()["Z"].pixels
    assert depth.dtype == np.float32 and np.array_equal(depth, ball.depth, equal_nan=True)


def test_unknown_formats_are_named(ball, tmp_path):
    import nelu3d

    with pytest.raises(nelu3d.Error, match="also: \"dwg\" is no format; give some of obj, stl, glb, 3mf"):
        ball.save(tmp_path / "x", also=["dwg"])
    assert not (tmp_path / "x").exists()
