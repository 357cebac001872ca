"""What a command writes depends on its arguments, the files that it names and the seed, whatever surrounds it."""

import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path
from unittest import mock

import matplotlib
import pytest

from tests.commands import invoke
from voxdepth import compiled
from voxdepth.tools.environment import settle
from voxdepth.tools.errors import ToolError

PROGRAM = """
import sys
from voxdepth.tools.cli import main

for command in {commands!r}:
    sys.argv = ["voxdepth", *command]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
"""
COMMANDS = (
    ("record", "sim-hover", "--frames", "2", "--size", "96x64", "--out", "sequence"),
    ("picture", "sequence", "--out", "sheet.png"),
    ("correct", "sequence", "--out", "corrected", "--record", "corrected.rrd", "--corrector", "own_method:Corrector"),
    ("correct", "sequence", "--out", "default"),
)
FOREIGN = {
    "RERUN": "off",
    "RERUN_STRICT": "1",
    "NUMBA_DISABLE_JIT": "1",
    "NUMBA_NUM_THREADS": "0",
    "NUMBA_OPT": "fast",
    "MPLBACKEND": "nonsense",
    "MATPLOTLIBRC": "style",
    "OPENCV_IO_MAX_IMAGE_PIXELS": "100",
    "PYTHONWARNINGS": "error",
    "PYTHONOPTIMIZE": "2",
    "PYTHONHASHSEED": "7",
    "PYTHONUTF8": "0",
    "PYTHONCOERCECLOCALE": "0",
    "LC_ALL": "C",
    "OMP_NUM_THREADS": "3",
    "GIT_DIR": "/nonexistent",
    "HOME": "/dev/null",
}
"""Variables that another program may need, or that a shell has by mistake."""
FILES = {
    "matplotlibrc": "text.usetex: True\naxes.facecolor: black\n",
    "style/matplotlibrc": "savefig.dpi: 20\n",
    **dict.fromkeys(("rerun.py", "cv2.py", "types.py", "rosbags.py"), "raise SystemExit('the script of the user')\n"),
}
"""Files of the current folder that no command names."""
REPOSITORY = Path(__file__).parents[2]


def files_below(folder: Path) -> dict[str, bytes]:
    """What commands have written, without the wall-clock times of a report and of a recording."""
    timed = ("report.json", "corrected.rrd")
    paths = [path for path in folder.rglob("*") if path.is_file() and path.name not in timed]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths if "__pycache__" not in path.parts}


def test_variables_and_files_around_a_command_change_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calm, foreign = tmp_path / "calm", tmp_path / "foreign"
    for name, text in FILES.items():
        (foreign / name).parent.mkdir(parents=True, exist_ok=True)
        (foreign / name).write_text(text)
    calm.mkdir()
    monkeypatch.chdir(calm)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for command in (("new", "corrector", "own_method"), *COMMANDS):
        assert invoke(*command).exit_code == 0, command
    (foreign / "own_method.py").write_bytes((calm / "own_method.py").read_bytes())
    kept = {"NUMBA_CACHE_DIR": str(compiled._user_cache()), "MPLCONFIGDIR": matplotlib.get_cachedir()}
    kept["PYTHONPATH"] = str(REPOSITORY)
    # As with an installed command, the current folder is not on the path from the beginning.
    process = [sys.executable, "-P", "-c", PROGRAM.format(commands=COMMANDS)]
    done = subprocess.run(
        process, env=os.environ | FOREIGN | kept, cwd=foreign, umask=0o077, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    written = files_below(foreign)
    assert {name: data for name, data in written.items() if name not in FILES} == files_below(calm)
    assert 2 * (foreign / "corrected.rrd").stat().st_size > (calm / "corrected.rrd").stat().st_size > 10_000


def test_the_settings_that_are_documented_stay() -> None:
    kept = {
        "NUMBA_CACHE_DIR": "cache", "NUMBA_CPU_NAME": "generic", "NUMBA_BOUNDSCHECK": "1", "OPENCV_CPU_DISABLE": "AVX2",
        "OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": "AVX2", "PYTHONPATH": "mine", "RUST_LOG": "debug",
    }  # fmt: skip
    with mock.patch.dict(os.environ, {**FOREIGN, **kept}, clear=True):
        settle()
        assert kept.items() <= os.environ.items()
        lost = FOREIGN.keys() - os.environ.keys()
        assert {
            "RERUN",
            "NUMBA_DISABLE_JIT",
            "NUMBA_OPT",
            "MPLBACKEND",
            "OPENCV_IO_MAX_IMAGE_PIXELS",
            "GIT_DIR",
        } <= lost
        assert os.environ["MATPLOTLIBRC"] == os.devnull


def test_a_warning_is_no_error_of_a_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "warnoptions", ["error"])
    with mock.patch.dict(os.environ), warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("error")
        settle()
        warnings.warn("told", UserWarning, stacklevel=1)
        warnings.warn("not told", DeprecationWarning, stacklevel=1)
    assert [str(each.message) for each in told] == ["told"]
    assert sys.warnoptions == []


def test_a_folder_that_configures_numba_or_is_gone_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / ".numba_config.yaml").write_text("disable_jit: [")
    monkeypatch.chdir(folder)
    with mock.patch.dict(os.environ):
        with pytest.raises(ToolError, match=r"^\.numba_config\.yaml in the current folder .*: use another folder$"):
            settle()
        shutil.rmtree(folder)
        with pytest.raises(ToolError, match="the current folder was deleted: change to another one"):
            settle()
