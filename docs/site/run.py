#!/usr/bin/env python3
"""Runs what the documents say: every block of commands or of Python below a line `<!-- run -->`.

    python3 docs/site/run.py [--program PATH] [PAGE …]

A page's blocks run in their order, in one folder of their own; Python's share one interpreter, as in a notebook. The
first that fails ends the run with its page and line. Pictures that they write are kept with --keep DIR.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^<!-- run -->\n```(\w+)\n(.*?)^```$", re.M | re.S)


def run(page: Path, program: Path, keep: Path | None) -> int:
    """Runs the blocks of a page, and returns their number."""
    text = page.read_text()
    blocks = [(m[1], m[2], text[: m.start()].count("\n") + 2) for m in BLOCK.finditer(text)]
    if len(blocks) != text.count("<!-- run -->"):
        sys.exit(f"{page}: a line `<!-- run -->` stands above no block")
    environment = {**os.environ, "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}", "MPLBACKEND": "agg"}
    with tempfile.TemporaryDirectory() as folder:
        python = ""
        for language, code, line in blocks:
            if language == "python":
                # Cells share their names: all that came before runs again only if nothing else came between.
                python += code
                continue
            flush(python, page, folder, environment)
            python = ""
            done = subprocess.run(["bash", "-euo", "pipefail", "-c", code], cwd=folder, env=environment)
            if done.returncode:
                sys.exit(f"{page}:{line}: these commands failed")
        flush(python, page, folder, environment)
        if keep:
            keep.mkdir(parents=True, exist_ok=True)
            for picture in Path(folder).glob("*.png"):
                shutil.copy(picture, keep)
    return len(blocks)


def flush(code: str, page: Path, folder: str, environment: dict[str, str]) -> None:
    """Runs Python."""
    if code and subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment).returncode:
        sys.exit(f"{page}: its Python failed")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--program", type=Path, default=Path(shutil.which("nelu3d") or ROOT / "target/release/nelu3d"))
    options.add_argument("--keep", type=Path)
    options.add_argument("pages", nargs="*", type=Path)
    chosen = options.parse_args()
    pages = chosen.pages or sorted(p for p in (ROOT / "docs").rglob("*.md") if "<!-- run -->" in p.read_text())
    for page in pages:
        print(f"{page}: {run(page, chosen.program.resolve(), chosen.keep)} blocks", flush=True)


if __name__ == "__main__":
    main()
