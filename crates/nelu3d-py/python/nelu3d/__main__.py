"""The program: what the command ``nelu3d`` and ``python -m nelu3d`` run. Nothing here imports numpy."""

import sys

from nelu3d import _nelu3d


def main() -> int:
    """Runs the program with the arguments of this process, and returns its exit code."""
    return _nelu3d.main(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
