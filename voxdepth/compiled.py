"""Loops over pixels that Numba compiles, and the folder that keeps what has been compiled.

Compiled functions take arguments of fixed types, and run without Python's lock. What has not been compiled on a machine
is compiled by several processes, which find one another's work in the folder.
"""

import hashlib
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, update_wrapper
from importlib import import_module
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from subprocess import DEVNULL, Popen
from threading import Lock
from typing import Any, TypeVar, cast

import numba
import numba.extending
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, UserProvidedCacheLocator

from .errors import ConfigError
from .interrupts import kept_back

READABLE_IMAGE = numba.types.Array(numba.float32, 2, "C", readonly=True)
"""Type of an image of floats that is only read; the caller may have locked it."""
READABLE_ROW = numba.types.Array(numba.float32, 1, "C", readonly=True)
"""Type of a row of such an image."""
READABLE_MATRIX = numba.types.Array(numba.float64, 2, "C", readonly=True)
"""Type of a matrix that is only read."""
FLOAT_IMAGE = numba.float32[:, ::1]
BYTE_IMAGE = numba.uint8[:, ::1]
FLOAT_ROW, BYTE_ROW = numba.float32[::1], numba.uint8[::1]
FUNCTIONS_PER_PROCESS, MAX_PROCESSES = 10, 8
"""Least number of functions for each process that compiles, since it starts for a second, and the most processes."""
CODE_SETTINGS = ("BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE")
"""Settings of Numba that change compiled code; beside them, Numba tells kept code of processors apart by itself."""
Function = TypeVar("Function", bound=Callable[..., Any])
_LOGGER = logging.getLogger(__name__)
_LOCK = Lock()
_waiting: "list[Compiled]" = []
"""Functions that have not been compiled yet, in the order of their definition."""


class SealedFiles(IndexDataCacheFile):  # type: ignore[misc]
    """The index and the code that Numba keeps of a function, each file with its digest at the end.

    A file without it, as after a loss of power, counts as missing, and the function is compiled again: Numba itself
    would fail on it for ever, and LLVM crash. Files are renamed in one step, so that another process reads whole ones.
    """

    def _load_index(self) -> Any:
        return super()._load_index() if _is_sealed(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        if not _is_sealed(self._data_path(name)):
            raise FileNotFoundError(f"{self._data_path(name)} is damaged")  # Numba compiles where there is none.
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, path: str) -> Iterator[BytesIO]:
        content = BytesIO()
        yield content
        with super()._open_for_write(path) as file:
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())


class ModuleLocator(UserProvidedCacheLocator):  # type: ignore[misc]
    """Locates the cache by the name of the module, not by its path: copies of a source share what is compiled."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)
        self._cache_path = str(Path(numba.config.CACHE_DIR) / function.__module__)


class ModuleCache(CompileResultCacheImpl):  # type: ignore[misc]
    """Where Numba keeps functions: by their modules, and where it would, if that cannot be."""

    _locator_classes = (ModuleLocator, *CompileResultCacheImpl._locator_classes)


class SealedCache(FunctionCache):  # type: ignore[misc]
    """What Numba keeps of a function, in `SealedFiles`."""

    _impl_class = ModuleCache

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = SealedFiles(locator.get_cache_path(), self._impl.filename_base, locator.get_source_stamp())


class Compiled:
    """A function that Numba compiles for arguments of fixed types; see `compiled`."""

    def __init__(self, function: Callable[..., Any], signature: Any, *, is_part: bool = False) -> None:
        if numba.config.DISABLE_JIT:
            raise ConfigError(
                "NUMBA_DISABLE_JIT is set, and the loops of VoxDepth run compiled only: unset it, or disable_jit in "
                ".numba_config.yaml"
            )
        self.dispatcher = numba.njit(
            nogil=True, error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=is_part
        )(function)
        if (folder := _folder(function.__module__.partition(".")[0])) is not None:
            with _numba_cache(folder):
                self.dispatcher._cache = SealedCache(function)
        self.signature = signature
        self._is_part = is_part
        self._is_compiled = False
        update_wrapper(self, function)
        _waiting.append(self)

    def __call__(self, *arguments: Any) -> Any:
        """Run the function. Arguments of other types are a `TypeError`, and so is a call of a part."""
        if self._is_part:
            name = self.dispatcher.__name__
            raise TypeError(f"Python cannot call the part {name}: decorate it with compiled, not compiled_part")
        if not self._is_compiled:
            compile_all()
        return self.dispatcher(*arguments)

    def __reduce__(self) -> str:
        """Find the function in its module, in another process, too."""
        return str(self.dispatcher.__qualname__)

    def compile(self) -> bool:
        """Compile the function, or read it from the disk; whether it had to be compiled."""
        if self._is_compiled:
            return False
        try:
            self.dispatcher.compile(self.signature)
        except OSError:  # It is compiled and then kept, for which the disk may be too full.
            if not self.dispatcher.overloads:
                raise
        self.dispatcher.disable_compile()
        self._is_compiled = True
        return not self.dispatcher.stats.cache_hits


@numba.extending.typeof_impl.register(Compiled)  # type: ignore[untyped-decorator]
def _type_of(function: Compiled, _: Any) -> Any:
    """Tell Numba that within compiled functions a compiled one is what Numba made of it, for its declared types."""
    function.compile()
    return numba.types.Dispatcher(function.dispatcher)


def compiled(signature: Any) -> Callable[[Function], Function]:
    """Decorate a function that Numba compiles for arguments of these types: `"void(f4[:, ::1], i8)"`, or a Numba type.

    That happens in `compile_all`, or else at the first call. Functions that a compiled one calls must be defined before
    it.
    """

    def decorate(function: Function) -> Function:
        return cast(Function, Compiled(function, signature))

    return decorate


def compiled_part(signature: Any) -> Callable[[Function], Function]:
    """Decorate a part of compiled functions; Python may not call it, which saves the code for that."""

    def decorate(function: Function) -> Function:
        return cast(Function, Compiled(function, signature, is_part=True))

    return decorate


def named_tuple(kind: type[Any], *types: Any) -> Any:
    """Return the Numba type of a `NamedTuple`, from those of its fields."""
    if len(set(types)) == 1:
        return numba.types.NamedUniTuple(types[0], len(types), kind)
    return numba.types.NamedTuple(types, kind)


def compile_all() -> None:
    """Compile the functions of all imported modules, or read them from the disk, where an earlier call left them."""
    with _LOCK, ExitStack() as helpers:
        has_said_so = False
        while _waiting:
            with kept_back() as hand_on:  # LLVM calls Python, and an exception there is lost, or crashes the process.
                had_to_compile = _waiting[0].compile()
            if had_to_compile and not has_said_so:
                _LOGGER.warning(
                    "compiling %d functions for this machine; this takes up to a minute, once", len(_waiting)
                )
                has_said_so = True
                helpers.enter_context(_helpers(_waiting))
            _waiting.pop(0)
            hand_on()


def help_compile(share: float, modules: Sequence[str]) -> None:
    """Compile the functions of modules for another process, from a share of their list on, and then those before."""
    for name in modules:
        import_module(name)
    first = int(share * len(_waiting))
    for function in _waiting[first:] + _waiting[:first]:
        function.compile()


@contextmanager
def _helpers(waiting: "Sequence[Compiled]") -> Iterator[None]:
    """Let other processes compile, too, for as long as this one does.

    It takes from the folder what they left there, and does without them where they cannot start or import a module.
    """
    n = min(_usable_processors(), len(waiting) // FUNCTIONS_PER_PROCESS, MAX_PROCESSES)
    modules = list(dict.fromkeys(function.__module__ for function in waiting))
    processes = []
    for k in range(1, n if all(_folder(name.partition(".")[0]) for name in modules) else 0):
        same_modules, call = f"import sys; sys.path[:] = {sys.path}", f"help_compile({k / n}, {modules})"
        command = [sys.executable, "-c", f"{same_modules}; from {__name__} import help_compile; {call}"]
        with suppress(OSError):  # The system may allow no more processes.
            processes.append(Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL))
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _usable_processors() -> int:
    """Return how many processors other interpreters may use, of which a container may allow fewer than there are.

    A program that embeds Python has no interpreter that could be started.
    """
    if not sys.executable:
        return 1
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


@contextmanager
def _numba_cache(folder: Path) -> Iterator[None]:
    """Let Numba keep the functions whose caches are made meanwhile in a folder."""
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def _is_sealed(path: str) -> bool:
    """Return whether a file can be read and ends with the digest of what comes before."""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    length = hashlib.sha256().digest_size
    return hashlib.sha256(content[:-length]).digest() == content[-length:]


@cache
def _folder(package: str) -> Path | None:
    """Return the folder for the functions of a package as it and this one are now; None if there is none to write to.

    Numba would notice a change of the file of a function only, not of a constant or a function of another file in it,
    nor of its settings: without bounds checks, functions with them would stay in use.
    """
    digest = hashlib.sha256(repr([getattr(numba.config, name) for name in CODE_SETTINGS]).encode())
    packages = sorted({package, __name__.partition(".")[0]})
    sources = [path for name in packages for path in sorted(_source_folder(name).rglob("*.py"))]
    for path in sources:
        digest.update(path.read_bytes())
    if (user_cache := _user_cache()) is None or not sources:  # A package in an archive has no files.
        return None
    folder = user_cache / f"{package}-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # The home is read-only.
        return None
    return folder if os.access(folder, os.W_OK) else None


def _source_folder(package: str) -> Path:
    spec = find_spec(package)
    assert spec is not None and spec.origin is not None
    return Path(spec.origin).parent


def _user_cache() -> Path | None:
    """Return `$NUMBA_CACHE_DIR`, or VoxDepth's folder in the user's caches; None if there is none.

    A folder of caches or a home that is no absolute path does not count: files would lie in the current folder.
    """
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR)
    caches = [Path(os.environ.get("XDG_CACHE_HOME", ""))]
    with suppress(RuntimeError):  # There is no home.
        caches.append(Path.home() / ".cache")
    return next((cache / "voxdepth" for cache in caches if cache.is_absolute()), None)
