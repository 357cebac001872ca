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
from voxdepth.tools.environment import configured, settle
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
    "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "true",
    "TOKIO_WORKER_THREADS": "many",
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
            "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION",
            "TOKIO_WORKER_THREADS",
        } <= lost
        assert os.environ["MATPLOTLIBRC"] == os.devnull


def test_a_warning_is_no_error_of_a_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "warnoptions", ["error"])
    with mock.patch.dict(os.environ), warnings.catch_warnings(record=True) as reported:
        warnings.simplefilter("error")
        settle()
        warnings.warn("reported", UserWarning, stacklevel=1)
        warnings.warn("not told", DeprecationWarning, stacklevel=1)
    assert [str(each.message) for each in reported] == ["reported"]
    assert sys.warnoptions == []


@pytest.mark.parametrize("value", ["yes", "", "-1", "1.0"])
def test_a_variable_that_is_kept_and_is_no_number_is_refused(value: str) -> None:
    reported = rf"^the variable NUMBA_BOUNDSCHECK must be 0 or 1, got '{value}': correct or unset it$"
    with mock.patch.dict(os.environ, NUMBA_BOUNDSCHECK=value), pytest.raises(ToolError, match=reported):
        settle()


def test_a_new_process_of_a_command_takes_no_script_of_the_current_folder_for_a_package(tmp_path: Path) -> None:
    names = ("types", "random", "numpy", "signal")
    for name in names:
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the script of the user')\n")
    program = f"from importlib.util import find_spec; print(*(find_spec(name).origin for name in {names}))"
    with mock.patch.dict(os.environ):
        settle()
        done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert str(tmp_path) not in done.stdout


@pytest.mark.parametrize("error", [UnicodeDecodeError("utf-8", b"\xe9", 0, 1, "why"), TypeError("5\nis no table")])
def test_a_configuration_on_which_a_library_fails_is_refused_in_one_line(error: Exception) -> None:
    reported = r"^Plots does not load with its configuration \(.*\): mend or move ~/.plots$"
    with pytest.raises(ToolError, match=reported), configured("Plots", "~/.plots"):
        raise error


@pytest.mark.slow
def test_damaged_configurations_of_matplotlib_and_dask_are_refused(tmp_path: Path) -> None:
    for name in ("here/matplotlibrc", "home/.config/matplotlib/stylelib/mine.mplstyle", "home/.config/dask/mine.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"size: [\xe9")
    # A run imports what draws its pictures before it flies.
    run, study = "import scenarios.runner", "from scenarios.study.executors import *; [*Processes(1, 1.0).run([])]"
    for program, folder, library in (
        (run, "here", "Matplotlib"),
        (run, "home", "Matplotlib"),
        (study, "home", "Dask"),
    ):
        process = [sys.executable, "-P", "-c", program]
        environment = os.environ | {"HOME": str(tmp_path / "home"), "PYTHONPATH": str(REPOSITORY)}
        done = subprocess.run(
            process, env=environment, cwd=tmp_path / folder, capture_output=True, text=True, check=False
        )
        assert f"ToolError: {library} does not load with its configuration" in done.stderr.splitlines()[-1], done.stderr


def test_a_folder_that_may_not_be_looked_into_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "exists", refuse)
    with mock.patch.dict(os.environ), pytest.raises(ToolError, match="current folder may not be looked into: change"):
        settle()


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
