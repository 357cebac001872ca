"""New virtual environments of any Python on this machine, which uv makes and fills."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path


def interpreter(version: str) -> str | None:
    """A Python of that version: this one, or one on the path or below pyenv; None if there is none."""
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    below = map(str, sorted(root.glob(f"versions/{version}.*/bin/python")))
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    for path in filter(None, (sys.executable, shutil.which(f"python{version}"), *below)):
        done = subprocess.run([path, "-c", code], capture_output=True, text=True, check=False)
        if done.stdout.strip() == version:
            return path
    return None


def new_environment(folder: Path, python: str, *what: str | Path) -> Path:
    """Make an environment in place of whatever the folder holds, and return its Python.

    What is installed is as for `uv pip install`. A `CalledProcessError` says that uv reported why it could not.
    """
    uv = (sys.executable, "-m", "uv", "--quiet")
    subprocess.run([*uv, "venv", "--clear", "--python", python, folder], check=True)
    subprocess.run([*uv, "pip", "install", "--python", folder, *what], check=True)
    return Path(sysconfig.get_path("scripts", "venv", {"base": str(folder)})) / "python"
