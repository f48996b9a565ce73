"""The program: what the command ``nelu3d`` and ``python -m nelu3d`` run. Nothing here imports numpy."""

import sys

from nelu3d._nelu3d import main as run  # type: ignore  # a module without a stub of its own


def main() -> int:
    """Runs the program with the arguments of this process, and returns its exit code."""
    return run(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
