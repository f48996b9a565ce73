"""Results show themselves in a notebook, offline; the examples run; the stubs are right."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def test_results_show_themselves(ball, field):
    html = ball._repr_html_()
    assert html.startswith("<iframe") and "srcdoc=" in html and "http" not in html.replace("http-equiv", "")
    page = ball.page()
    assert "<canvas" in page and "data:image/png;base64" in page and "vertex_data" in page
    assert ball._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    assert "dB" in field._repr_html_() and "ball" in repr(ball) and "small" in repr(field)


def test_the_researchers_script(tmp_path):
    pytest.importorskip("matplotlib")
    script = EXAMPLES / "compare.py"
    lines = [line for line in script.read_text().splitlines() if line and not line.startswith(("#", '"""'))]
    assert len(lines) <= 25, len(lines)
    done = subprocess.run([sys.executable, script, "5"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "fast" in done.stdout and "paper" in done.stdout, done.stdout
    assert (tmp_path / "compare.png").stat().st_size > 20_000


def test_the_notebook(tmp_path):
    pytest.importorskip("nbconvert")
    pytest.importorskip("ipykernel")
    book = json.loads((EXAMPLES / "first-scan.ipynb").read_text())
    assert all(not cell.get("outputs") for cell in book["cells"]), "the notebook is stored without outputs"
    command = [sys.executable, "-m", "nbconvert", "--execute", "--to", "html", "--output-dir", tmp_path]
    done = subprocess.run([*command, EXAMPLES / "first-scan.ipynb"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    html = (tmp_path / "first-scan.html").read_text()
    assert "srcdoc=" in html and "data:image/png;base64" in html


def test_stubs_agree_with_the_module(tmp_path):
    """mypy's stubtest compares names, arguments, and defaults."""
    pytest.importorskip("mypy")
    allow = tmp_path / "allow.txt"
    # Classes that cannot be made have no __init__ to compare; the program's entry has no stub.
    allow.write_text("nelu3d\\.__main__\nnelu3d\\._nelu3d.*\nnelu3d\\.\\w+\\.__new__\nnelu3d\\.\\w+\\.__init__\n")
    command = [sys.executable, "-m", "mypy.stubtest", "nelu3d", "--allowlist", allow, "--ignore-unused-allowlist"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
