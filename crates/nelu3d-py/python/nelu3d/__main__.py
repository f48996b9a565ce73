"""``python -m nelu3d``: the program, which lies among the scripts of the environment."""

import os
import shutil
import subprocess
import sys
import sysconfig


def main() -> int:
    """Runs the program with the arguments of this process, and returns its exit code."""
    name = "nelu3d.exe" if os.name == "nt" else "nelu3d"
    folders = [sysconfig.get_path("scripts")]
    if hasattr(sysconfig, "get_preferred_scheme"):
        folders.append(sysconfig.get_path("scripts", sysconfig.get_preferred_scheme("user")))
    found = (path for path in (os.path.join(f, name) for f in folders if f) if os.path.isfile(path))
    program = next(found, None) or shutil.which(name)
    if program is None:
        print("nelu3d: the program is not part of this installation; install the wheel, or use cargo", file=sys.stderr)
        return 1
    if os.name == "posix":
        os.execv(program, [program, *sys.argv[1:]])
    return subprocess.call([program, *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
