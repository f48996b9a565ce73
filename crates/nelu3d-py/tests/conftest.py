"""What the tests share: a small virtual rig, its field, and the program that came with the package."""

import json
import shutil
import subprocess
import sysconfig
from pathlib import Path

import nelu3d
import pytest

SMALL = Path(__file__).resolve().parents[2] / "nelu3d-cli" / "tests" / "program" / "common" / "small.toml"

MORE = """
[[pattern_sets]]
name = "gray"
patterns = [{ family = "gray", axis = "x" }]

[[sequences]]
name = "hand"
fps = 30.0
frames = 4
black = true

[[sequences.objects]]
position_mm = [-5.0, 0.0, 710.0]
shape = { kind = "sphere", radius_mm = 45.0 }
motion = { velocity_mm_per_sec = [60.0, 0.0, 0.0] }
"""


@pytest.fixture(scope="session")
def rig(tmp_path_factory):
    """A rig of 160 x 120 pixels with a sweep of eight positions, a ball, and a ball that moves."""
    folder = tmp_path_factory.mktemp("small")
    # Tables of a kind need not stand together.
    (folder / "small.toml").write_text(SMALL.read_text() + MORE)
    return nelu3d.simulate(folder / "small.toml", folder / "rig")


@pytest.fixture(scope="session")
def field(rig):
    """The color field of the rig's first set."""
    return nelu3d.calibrate(rig)


@pytest.fixture(scope="session")
def ball(rig, field):
    """The ball by recipe fast."""
    return nelu3d.reconstruct(rig, "ball", field)


@pytest.fixture(scope="session")
def program():
    """Runs the command that the wheel brought, and returns its answer."""
    path = shutil.which("nelu3d", path=sysconfig.get_path("scripts"))
    assert path, "the wheel brought no command"

    def run(*args):
        done = subprocess.run([path, *map(str, args), "--quiet", "--json"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    run.path = path
    return run
