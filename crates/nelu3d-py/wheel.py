#!/usr/bin/env python3
"""Builds the wheel of nelu3d: the extension module, which has the program in it, and what Python needs around it.

    python3 crates/nelu3d-py/wheel.py [--manylinux | --workspace] [-o DIR]

Needs Rust, and nothing else of Python. With --workspace the build is the one that `.ci/run --all` makes (all crates, with
the kernels for GPUs), so that nothing is built twice. With --manylinux the module is linked for glibc 2.17
(manylinux2014) by zig (`pip install ziglang cargo-zigbuild`): only the last step differs.

Elsewhere than on Linux, and from a source archive, `maturin` builds the wheel (pyproject.toml), as
.github/workflows/wheels.yml does.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
GLIBC = "x86_64-linux-gnu.2.17"
# Bytes that a wheel may have, so that `uvx nelu3d demo` starts soon.
LARGEST = 15_000_000
# So that the same content is the same file.
DATE = (1980, 1, 1, 0, 0, 0)


def run(*command: object, env: dict[str, str] | None = None) -> None:
    """Runs a command in the workspace, and ends this program if it fails."""
    print("+", *command, file=sys.stderr, flush=True)
    if subprocess.run([str(part) for part in command], cwd=ROOT, env=env).returncode:
        sys.exit(f"wheel.py: `{command[0]} {command[1]}` failed; what it said is above")


def profile(chosen: argparse.Namespace) -> tuple[str, str]:
    """Returns the option of cargo for what is built: the profile of the tests, or what is handed out."""
    return "--profile", "release" if chosen.workspace else "dist"


def build(chosen: argparse.Namespace) -> None:
    """Builds the extension module."""
    # Tests have dependencies that change what all is built from: with them, this is the build of the tests.
    all_of_it = ["--workspace", "--features", "nelu3d-cli/gpu,nelu3d-cli/gige,nelu3d-cli/usb3,nelu3d-capture/gige-emulator"]
    all_of_it += ["--lib", "--bins", "--tests", "--config", "profile.release.package.nelu3d-cli.opt-level=0"]
    module = ["-p", "nelu3d-py"]
    if not chosen.manylinux:
        run("cargo", "build", *profile(chosen), "--locked", *(all_of_it if chosen.workspace else module))
        return
    zig = shutil.which("cargo-zigbuild")
    if zig is None:
        sys.exit("wheel.py: --manylinux needs zig; install it by `pip install ziglang cargo-zigbuild`")
    with tempfile.TemporaryDirectory() as folder:
        # Cargo is not to know: with another linker in its settings it would build all libraries anew.
        linker = Path(folder) / "cc"
        linker.write_text(f'#!/bin/sh\nexec "{zig}" zig cc -- -target {GLIBC} "$@"\n')
        linker.chmod(linker.stat().st_mode | stat.S_IXUSR)
        # What was linked without it is linked again.
        os.utime(HERE / "src/lib.rs")
        path = f"{folder}{os.pathsep}{os.environ['PATH']}"
        run("cargo", "build", *profile(chosen), "--locked", *module, env={**os.environ, "PATH": path})


def stripped(path: Path, folder: Path) -> bytes:
    """Returns a library without the names of its functions, where `strip` is installed."""
    if shutil.which("strip") is None:
        return path.read_bytes()
    copy = folder / path.name
    subprocess.run(["strip", "-o", copy, path], check=True)
    return copy.read_bytes()


def metadata() -> tuple[str, str, str]:
    """Returns the version, and the wheel's METADATA and entry_points.txt, from Cargo.toml and pyproject.toml."""
    version = re.search(r'^version = "(.+)"', (ROOT / "Cargo.toml").read_text(), re.M)[1]
    project = (HERE / "pyproject.toml").read_text()
    one = lambda key: re.search(rf'^{key} = "(.+)"', project, re.M)[1]
    many = lambda key: re.findall(r'"(.+?)"', re.search(rf"^{key} = \[(.*?)\]", project, re.M | re.S)[1])
    lines = ["Metadata-Version: 2.4", f"Name: {one('name')}", f"Version: {version}", f"Summary: {one('description')}"]
    lines += [f"Classifier: {c}" for c in many("classifiers")] + [f"Requires-Dist: {d}" for d in many("dependencies")]
    lines += ["Provides-Extra: test"] + [f"Requires-Dist: {d} ; extra == 'test'" for d in many("test")]
    lines += [f"License-Expression: {one('license')}", f"Requires-Python: {one('requires-python')}"]
    lines += ["License-File: LICENSE-APACHE", "License-File: LICENSE-MIT", "Description-Content-Type: text/markdown"]
    commands = re.search(r"^\[project\.scripts\]\n((?:.+\n)+)", project, re.M)[1].replace('"', "")
    about = "\n".join(lines) + "\n\n" + (HERE / "README.md").read_text()
    return version, about, f"[console_scripts]\n{commands}"


def pack(output: Path, tag: str, built: Path) -> Path:
    """Packs the wheel (PyPA, binary distribution format) from what is in `built`, and returns where it is."""
    version, about, scripts = metadata()
    info, tag = f"nelu3d-{version}.dist-info", f"cp39-abi3-{tag}"
    with tempfile.TemporaryDirectory() as folder:
        module = stripped(built / "lib_nelu3d.so", Path(folder))
    files = {f"nelu3d/{p.name}": p.read_bytes() for p in sorted((HERE / "python" / "nelu3d").glob("*.py*")) if p.is_file()}
    files["nelu3d/py.typed"] = b""
    files["nelu3d/_nelu3d.abi3.so"] = module
    files[f"{info}/METADATA"] = about.encode()
    files[f"{info}/entry_points.txt"] = scripts.encode()
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: wheel.py\nRoot-Is-Purelib: false\nTag: {tag}\n".encode()
    for name in ("LICENSE-APACHE", "LICENSE-MIT"):
        files[f"{info}/licenses/{name}"] = (ROOT / name).read_bytes()
    record = ""
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        record += f"{name},sha256={digest},{len(content)}\n"
    files[f"{info}/RECORD"] = (record + f"{info}/RECORD,,\n").encode()
    output.mkdir(parents=True, exist_ok=True)
    path = output / f"nelu3d-{version}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as wheel:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, DATE)
            entry.external_attr = (stat.S_IFREG | (0o755 if name.endswith(".so") else 0o644)) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            wheel.writestr(entry, content)
    return path


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    how = options.add_mutually_exclusive_group()
    how.add_argument("--manylinux", action="store_true", help="link for glibc 2.17")
    how.add_argument("--workspace", action="store_true", help="all crates at once, with the kernels for GPUs")
    options.add_argument("-o", "--output", type=Path, default=TARGET / "wheels", help="folder of the wheel")
    chosen = options.parse_args()
    if sys.platform != "linux":
        sys.exit("wheel.py: builds for Linux; here `maturin build --profile dist` in crates/nelu3d-py does it")
    build(chosen)
    machine = os.uname().machine
    tag = f"manylinux2014_{machine}" if chosen.manylinux else f"linux_{machine}"
    path = pack(chosen.output, tag, TARGET / profile(chosen)[1])
    size = path.stat().st_size
    print(path, f"({size / 1e6:.1f} MB)", file=sys.stderr)
    if size > LARGEST:
        sys.exit(f"wheel.py: {path} has more than {LARGEST / 1e6:.0f} MB")
    print(path)


if __name__ == "__main__":
    main()
