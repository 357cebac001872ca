"""Code of users that they name as `module:factory`: where it lies, how it is loaded, and what is wrong with it."""

import ast
import hashlib
import logging
import os
import pkgutil
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

import numpy as np

from .errors import PluginError
from .types import CorrectedDepth, Frame, Intrinsics, Source

FAULTS = (Exception, SystemExit)
"""What the code of users may raise by mistake."""
KINDS = {
    "depth_m": (np.float32, "float32"),
    "confidence": (np.floating, "floats"),
    "source": (np.uint8, "uint8"),
}
"""Types of the images of a `CorrectedDepth`, and what they are called."""
_LOGGER = logging.getLogger(__name__)


def load(kind: str, name: str, signature: str, code: str | None = None) -> Callable[..., Any]:
    """Import the module of `module:factory`, perhaps from the current folder, and return its factory.

    The import runs the code of the module. A scenario or a study from somebody else may name any that is installed, so
    one that is not in the current folder is logged before that. The current folder is searched last: its scripts take
    the place of no package.

    Args:
        kind: What is loaded, as in `controller`.
        name: The name, as `module:factory` unless `code` is given.
        signature: How the factory is called and what it returns, for errors.
        code: The code of an entry point of that name, as `module:factory`.

    Raises:
        PluginError: There is no such module or more than one, it raises an error, or it has no callable of that name.
    """
    if code is None:
        if not all(name.partition(":")):
            raise PluginError(f"a {kind} must be 'module:factory', as in 'mine:create', got {name!r}")
        _search_here()
        _require_unhidden(kind, name)
        _announce(name)
    try:
        factory = pkgutil.resolve_name(code or name)
    except FAULTS as error:
        raise PluginError(
            f"the {kind} {name!r} cannot be loaded: {_error_text(error, source_of(code or name))}; its module must lie "
            f"in the folder {Path.cwd()} or in one that PYTHONPATH names, or be installed, and have {signature}"
        ) from error
    if not callable(factory):
        raise PluginError(f"the {kind} {name!r} must be {signature}, got {factory!r}")
    made: Callable[..., Any] = factory
    return made


def source_of(name: str) -> Path | None:
    """Return the file of the module of `module:factory`; None if it has none. The packages around it are imported."""
    _search_here()
    try:
        found = find_spec(name.partition(":")[0])
    except FAULTS:  # The packages around a module are imported, and may fail.
        return None
    return Path(found.origin) if found is not None and found.has_location and found.origin else None


def digest_of(file: Path) -> str:
    """Return the SHA-256 of a source file with the modules beside it that it imports, in a package with all."""
    is_package = file.with_name("__init__.py").exists()
    files = set(file.parent.glob("*.py")) if is_package else _imported(file, {file})
    content = b"".join(os.fsencode(path.name) + b"\0" + path.read_bytes() + b"\0" for path in sorted(files))
    return hashlib.sha256(content).hexdigest()


def _imported(file: Path, known: set[Path]) -> set[Path]:
    """Add the modules of the same folder that a module imports, and those that they import, to the known ones."""
    for beside in _named_beside(file):
        if beside not in known and _hiding(beside.stem, beside) is None:
            known.add(beside)
            _imported(beside, known)
    return known


def _named_beside(file: Path) -> Iterator[Path]:
    """Yield the files of the same folder whose names a module imports."""
    for node in ast.walk(ast.parse(file.read_bytes())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        yield from filter(Path.exists, (file.with_name(f"{name.partition('.')[0]}.py") for name in names))


def _hiding(module: str, file: Path) -> str | None:
    """Return where the module of a name is found that comes before a file of that name; None if none does."""
    try:
        found = find_spec(module)
    except FAULTS:
        return None
    if found is None or found.origin is None or (found.has_location and file.samefile(found.origin)):
        return None
    return found.origin if found.has_location else f"Python's own {module}"


class Plugin:
    """An object that a factory of a user made: every fault of its code is a `PluginError` that names its file.

    Args:
        kind: What it is, as in `controller`.
        name: Its name.
        method: The method that it must have.
        signature: How the factory is called and what it returns, for errors.
        make: Makes it.
    """

    def __init__(self, kind: str, name: str, method: str, signature: str, make: Callable[[], Any]) -> None:
        self._file = source_of(name)
        self._title = f"the {kind} {name!r}" + (f" ({self._file})" if self._file else "")
        try:
            self.made = self.run("when it is made", make)
        except PluginError as error:
            raise PluginError(f"{error}; expected {signature}") from error.__cause__
        if not callable(getattr(self.made, method, None)):
            raise self.faulty(f"expected {signature}, got {type(self.made).__name__} without {method}")

    def run(self, when: str, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call its code and return what that returns."""
        try:
            return call(*arguments)
        except FAULTS as error:
            raise PluginError(f"{self._title} failed {when}: {_error_text(error, self._file)}") from error

    def faulty(self, fault: str) -> PluginError:
        """Return the error about what it returned."""
        return PluginError(f"{self._title} is faulty: {fault}")


class PluginCorrector:
    """A corrector of a user, whose results are checked.

    Args:
        code: Its code, as `module:factory`.
        factory: Makes it.
        intrinsics: Intrinsics of its camera.
    """

    def __init__(self, code: str, factory: Callable[[Intrinsics], Any], intrinsics: Intrinsics) -> None:
        self._plugin = Plugin("corrector", code, "process", CORRECTOR, lambda: factory(intrinsics))
        self._shape = intrinsics.shape
        self.bare = self._plugin.made
        self.uses_gray = bool(getattr(self.bare, "uses_gray", True))

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame."""
        when = f"for a frame at {frame.stamp_s} s"
        corrected: CorrectedDepth = self._plugin.run(when, self.bare.process, frame)
        if fault := fault_of(corrected, self._shape):
            raise self._plugin.faulty(f"{when}, {fault}")
        return corrected

    def reset(self) -> None:
        """Forget the stream."""
        self._plugin.run("when it is reset", getattr(self.bare, "reset", lambda: None))

    def close(self) -> None:
        """End the threads of the corrector, if it has some."""
        self._plugin.run("when it is closed", getattr(self.bare, "close", lambda: None))


def fault_of(corrected: object, shape: tuple[int, ...]) -> str | None:
    """Return what was expected of the correction of a frame of a shape, and what came; None if all is well."""
    if isinstance(corrected, CorrectedDepth):
        return next(_faults(corrected, shape), None)
    return f"expected a CorrectedDepth, got {type(corrected).__name__}; CorrectedDepth.of makes one"


def _faults(corrected: CorrectedDepth, shape: tuple[int, ...]) -> Iterator[str]:
    """Yield what is wrong; later checks rely on earlier ones."""
    for name, (kind, words) in KINDS.items():
        image: Any = getattr(corrected, name)
        if not isinstance(image, np.ndarray):
            yield f"expected {name} as {words} of shape {shape}, got {type(image).__name__}"
        elif image.shape != shape or not np.issubdtype(image.dtype, kind):
            yield f"expected {name} as {words} of shape {shape}, got {image.dtype} of shape {image.shape}"
    depth_m, confidence, source = corrected.depth_m, corrected.confidence, corrected.source
    if not np.isfinite(depth_m).all():
        yield f"expected finite depths (0 = invalid), got {np.count_nonzero(~np.isfinite(depth_m))} others"
    if (depth_m < 0).any():
        yield f"expected depths of at least 0 m (0 = invalid), got {depth_m.min()} m"
    if not ((confidence >= 0) & (confidence <= 1)).all():
        yield f"expected confidence in 0..1, got {confidence.min()} to {confidence.max()}"
    if source.max(initial=0) > max(Source):
        yield f"expected sources in 0..{int(max(Source))}, got {source.max()}"


CORRECTOR = "a factory(intrinsics) that returns a DepthCorrector"
"""How the factory of a corrector is called."""


def _search_here() -> None:
    """Put the current folder at the end of the path: at its front, a script there would replace a package."""
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)


def _require_unhidden(kind: str, name: str) -> None:
    """Raise a `PluginError` if the current folder has a module of that name, but another one would be imported."""
    module = name.partition(":")[0]
    path = Path.cwd().joinpath(*module.split("."))
    for file in filter(Path.exists, (path.with_suffix(".py"), path / "__init__.py")):
        if (other := _hiding(module, file)) is not None:
            raise PluginError(f"the {kind} {name!r} could be {file} or {other}, which has the same name: rename yours")


def _error_text(error: BaseException, file: Path | None) -> str:
    """Return an error with the last line of the user's file on the way to it."""
    if isinstance(error, SyntaxError):
        return f"{error.filename}, line {error.lineno}: {type(error).__name__}: {error.msg}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(file)]
    return f"{f'line {lines[-1]}: ' if lines else ''}{type(error).__name__}: {error}"


@cache
def _announce(name: str) -> None:
    """Log code that is not in the current folder, and what it does not import from beside it.

    That is once, and not in a worker, whose parent loads it first.
    """
    file = source_of(name)
    if parent_process() is not None:
        return
    if file is None or not file.is_relative_to(Path.cwd()):
        _LOGGER.warning("this runs the code of %s: stop it if you do not know that", name)
    if file is not None:
        with suppress(SyntaxError, OSError):  # The import tells of them.
            for beside in sorted(set(_named_beside(file))):
                if (other := _hiding(beside.stem, beside)) is not None:
                    _LOGGER.warning("%s imports %s, not %s, which has the same name", file.name, other, beside.name)
