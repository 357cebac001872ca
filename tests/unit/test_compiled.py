"""Compiled functions, and the folder that keeps them: a small package is compiled by processes of its own."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from tests.damage import DAMAGES
from voxdepth import compiled
from voxdepth.errors import ConfigError
from voxdepth.geometry import compose
from voxdepth.temporal.working_resolution import disparity_of

REPOSITORY = Path(__file__).parents[2]
STEPS = "STEP = 2.0\n"
LOOPS = """
from voxdepth.compiled import compiled
from .steps import STEP


@compiled("f8(f8)")
def next_to(x):
    return x + STEP


@compiled("f8(f8[::1])")
def sum_of_next(values):
    total = 0.0
    for x in values:
        total += next_to(x)
    return total
"""
CALL = """
import numpy as np
from loops import sum_of_next
from voxdepth.compiled import compile_all

compile_all()
compile_all()
print(sum_of_next(np.array([1.0, 2.0, 3.0])))
"""
CALL_AT_ONCE = """
import numpy as np
from loops import sum_of_next

try:
    sum_of_next(np.array([1, 2, 3]))
except TypeError:
    print(sum_of_next(np.array([1.0, 2.0, 3.0])))
"""
INTERRUPTED = """
import signal
from llvmlite.binding.executionengine import ExecutionEngine
import numpy as np
from loops import sum_of_next
from voxdepth.compiled import compile_all

find = ExecutionEngine._find_module_ptr  # LLVM calls functions that call it.


def interrupted(self, pointer):
    ExecutionEngine._find_module_ptr = find
    signal.raise_signal(signal.SIGINT)
    return find(self, pointer)


ExecutionEngine._find_module_ptr = interrupted
try:
    compile_all()
except KeyboardInterrupt:
    print(sum_of_next(np.array([1.0, 2.0, 3.0])))
"""
HELPED = """
import time
from pathlib import Path
import numpy as np
from loops import sum_of_next
from voxdepth import compiled

compiled.FUNCTIONS_PER_PROCESS, compiled.cpu_count = 1, lambda: 2
kept = Path.home() / ".cache" / "voxdepth"
with compiled._helpers(compiled._waiting):
    while len(list(kept.rglob("*.nb[ic]"))) < 4:
        time.sleep(0.05)
print(sum_of_next(np.array([1.0, 2.0, 3.0])))
"""
HELPLESS = """
import sys
from voxdepth import compiled

def no_process(*_, **__):
    raise BlockingIOError

compiled.FUNCTIONS_PER_PROCESS, compiled.cpu_count, compiled.Popen = 1, lambda: 2, no_process
"""


class Package:
    """A package of two compiled functions and a constant, and the folder for caches of its user."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._loops = folder / "loops"
        self._loops.mkdir()
        (self._loops / "__init__.py").write_text(LOOPS)
        self.write_steps(STEPS)

    def write_steps(self, source: str) -> None:
        (self._loops / "steps.py").write_text(source)

    def run(self, code: str = CALL, **variables: str | Path) -> tuple[float, str]:
        """What a process with these variables of its environment has computed with the package, and what it said."""
        paths = {"HOME": self._folder / "home", "PYTHONPATH": os.pathsep.join([str(self._folder), str(REPOSITORY)])}
        kept = {name: value for name, value in os.environ.items() if name not in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR")}
        environment = kept | {name: str(value) for name, value in (paths | variables).items()}
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env=environment, text=True, capture_output=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        return float(done.stdout), done.stderr


def require_one_line(said: str) -> None:
    assert said == "compiling 2 functions for this machine; this takes up to a minute, once\n"


@pytest.fixture
def package(tmp_path: Path) -> Package:
    return Package(tmp_path)


def test_the_first_call_compiles_and_a_second_process_reads_from_the_disk_without_a_word(
    package: Package, tmp_path: Path
) -> None:
    result, said = package.run(CALL_AT_ONCE)
    assert result == 12
    require_one_line(said)
    (folder,) = (tmp_path / "home/.cache/voxdepth").iterdir()
    files = sorted(folder.rglob("*.nb*"))
    assert files
    before = [path.stat().st_mtime_ns for path in files]
    assert package.run() == (12, "")
    assert [path.stat().st_mtime_ns for path in sorted(folder.rglob("*.nb*"))] == before


@pytest.mark.slow
def test_a_copy_of_the_package_at_another_place_finds_what_is_compiled(package: Package, tmp_path: Path) -> None:
    package.run()
    (tmp_path / "copy").mkdir()
    copy = Package(tmp_path / "copy")
    assert copy.run(HOME=tmp_path / "home") == (12, "")


def test_what_a_helper_has_compiled_is_read_from_the_disk(package: Package) -> None:
    assert package.run(HELPED) == (12, "")


def test_without_a_second_process_one_compiles_all(package: Package) -> None:
    result, said = package.run(HELPLESS + CALL)
    assert result == 12
    require_one_line(said)


@pytest.mark.slow
def test_a_damaged_file_of_a_compiled_function_is_made_again(package: Package, tmp_path: Path) -> None:
    package.run()
    files = sorted((tmp_path / "home/.cache/voxdepth").rglob("*.nb*"))
    damaged = [damage(path.read_bytes()) for path, damage in zip(files, DAMAGES.values(), strict=False)]
    assert [path.suffix for path in files] == [".nbc", ".nbi"] * 2
    for path, content in zip(files, damaged, strict=True):
        path.write_bytes(content)
    result, said = package.run()
    assert result == 12
    require_one_line(said)
    assert package.run() == (12, "")


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_counts_as_missing(damage: str, suffix: str, tmp_path: Path) -> None:
    files = compiled.SealedFiles(str(tmp_path), "loop", "stamp")
    files.save("key", ("code", 7))
    assert files.load("key") == ("code", 7)
    (path,) = tmp_path.glob(f"*{suffix}")
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert files.load("key") is None
    files.save("key", ("code", 7))
    assert files.load("key") == ("code", 7)


@pytest.mark.parametrize("changed", ["loops", "voxdepth"])
def test_what_was_compiled_before_a_change_of_the_package_or_of_this_library_is_not_used(
    changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiled, "_source_folder", lambda package: tmp_path / package)
    monkeypatch.setattr(compiled, "_user_cache", lambda: tmp_path / "cache")
    before = compiled._folder.__wrapped__("loops")
    (tmp_path / changed).mkdir()
    (tmp_path / changed / "steps.py").write_text(STEPS)
    assert compiled._folder.__wrapped__("loops") != before


@pytest.mark.parametrize(("setting", "value"), [("BOUNDSCHECK", 1), ("OPT", 0), ("DEBUGINFO_DEFAULT", 1)])
def test_what_was_compiled_with_other_settings_of_numba_is_not_used(
    setting: str, value: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiled, "_user_cache", lambda: tmp_path)
    folder_of = compiled._folder.__wrapped__
    before = folder_of("voxdepth")
    monkeypatch.setattr(numba.config, setting, value)
    assert folder_of("voxdepth") != before


@pytest.mark.parametrize("home", ["relative", "./here", ".."])
def test_no_cache_lies_in_the_current_folder_where_a_home_or_a_place_of_caches_is_no_absolute_path(
    home: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", home)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert compiled._user_cache() == tmp_path / ".cache/voxdepth"
    monkeypatch.setenv("HOME", home)
    assert compiled._user_cache() is None
    assert compiled._folder.__wrapped__("voxdepth") is None


def test_the_functions_of_a_package_without_files_of_its_own_are_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiled, "_source_folder", lambda package: tmp_path / "packages.zip" / package)
    monkeypatch.setattr(compiled, "_user_cache", lambda: tmp_path)
    assert compiled._folder.__wrapped__("voxdepth") is None
    assert not list(tmp_path.iterdir())


def test_numba_that_may_not_compile_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    with pytest.raises(ConfigError, match=r"NUMBA_DISABLE_JIT is set.*unset it"):
        compiled.compiled("f8(f8)")(abs)


@pytest.mark.slow
def test_a_change_of_any_source_has_a_folder_of_its_own(package: Package, tmp_path: Path) -> None:
    package.run()
    package.write_steps("STEP = 20.0\n")
    result, said = package.run()
    assert result == 66
    require_one_line(said)
    package.write_steps(STEPS)
    assert package.run()[0] == 12
    names = [path.name for path in (tmp_path / "home/.cache/voxdepth").iterdir()]
    assert len(names) == 2
    assert all(name.startswith("loops-") for name in names)


@pytest.mark.slow
def test_without_a_folder_to_write_to_every_process_compiles(package: Package, tmp_path: Path) -> None:
    # Below a file there can be no folder, not even for a user who may write everywhere.
    (tmp_path / "file").touch()
    for _ in range(2):
        result, said = package.run(HOME=tmp_path / "file/home", XDG_CACHE_HOME=tmp_path / "file/cache")
        assert result == 12
        require_one_line(said)


@pytest.mark.slow
def test_an_interruption_while_llvm_calls_python_is_not_lost(package: Package) -> None:
    assert package.run(INTERRUPTED)[0] == 12
    assert package.run(INTERRUPTED) == (12, "")  # As well when the functions are read from the disk.


@pytest.mark.parametrize("T", [np.eye(4, dtype=np.float32), np.eye(4, dtype=np.int64), np.eye(5)[:4, :4], [[1.0]]])
def test_arguments_of_other_types_are_errors(T: object) -> None:
    np.testing.assert_array_equal(compose(np.eye(4), np.eye(4)), np.eye(4))
    with pytest.raises(TypeError):
        compose(T, np.eye(4))


def test_a_part_says_that_python_cannot_call_it() -> None:
    with pytest.raises(TypeError, match="the part disparity_of: decorate it with compiled"):
        disparity_of(1.0, 2.0)


def test_as_many_processes_compile_as_this_one_may_use_and_none_where_python_is_embedded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if sys.platform == "linux":
        monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 3, 5})
        assert compiled._usable_processors() == 3
    monkeypatch.setattr(sys, "executable", "")
    assert compiled._usable_processors() == 1
