"""Standard output and error of a command: they may be closed, on a full disk, or a pipe that nobody reads any more."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

STANDARD_ERROR = 2
"""Largest descriptor of a standard stream."""


class Lossy(io.RawIOBase):
    """A stream that drops everything from its first error on, which it keeps.

    Args:
        raw: Where the bytes go.
    """

    def __init__(self, raw: Any) -> None:
        self._raw = raw
        self.error: OSError | None = None

    def writable(self) -> bool:
        """Return True."""
        return True

    def isatty(self) -> bool:
        """Return whether the bytes go to a terminal."""
        return bool(self._raw.isatty())

    def fileno(self) -> int:
        """Return the descriptor that the bytes go to."""
        return int(self._raw.fileno())

    def write(self, data: Any) -> int | None:
        """Write bytes, and return how many were written or dropped."""
        if self.error is None:
            try:
                written: int | None = self._raw.write(data)
                return written
            except OSError as error:
                self.error = error
        return len(data)


@contextmanager
def standard_streams(failed: int) -> Iterator[None]:
    """Let the block do its work whatever becomes of what it prints: files are written where messages cannot be.

    At the end one line says that output was lost, and the exit code is `failed` where it would have been 0; not where
    the reader of a pipe wanted no more, as in `| head -1`. A stream that was closed is the null device from now on,
    in child processes, too: else the next file that is opened would get its number, and what is printed with it.
    Characters that a stream cannot show become question marks. A stream that is no file, as in tests, stays.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= STANDARD_ERROR:
        os.set_inheritable(number, True)
    os.close(number)
    lossy: dict[str, Lossy] = {}
    streams = {"stdout": sys.stdout, "stderr": sys.stderr}
    before = {name: each for name, each in streams.items() if each is None or isinstance(each, io.TextIOWrapper)}
    for name, stream in before.items():
        lossy[name] = Lossy(_raw(name, stream))
        setattr(sys, name, _text(lossy[name], stream))
    code: Any = 0
    try:
        yield
    except SystemExit as end:
        code = end.code
    finally:
        if "stdout" in lossy:
            sys.stdout.flush()
            if (error := lossy["stdout"].error) is not None and not isinstance(error, BrokenPipeError):
                sys.stderr.write(f"voxdepth: cannot write to standard output: {error.strerror}\n")
                code = code or failed
        for name, stream in before.items():
            getattr(sys, name).flush()
            setattr(sys, name, stream)
    sys.exit(code)


def _raw(name: str, stream: io.TextIOWrapper | None) -> Any:
    """Return what a stream writes its bytes to; of one that was closed, the null device that has its number now."""
    if stream is None:
        return open(("stdout", "stderr").index(name) + 1, "wb", buffering=0, closefd=False)
    return getattr(stream.buffer, "raw", stream.buffer)  # There is no buffer between with python -u.


def _text(raw: Lossy, stream: io.TextIOWrapper | None) -> io.TextIOWrapper:
    """Return a stream of text like the one in whose place it comes."""
    encoding = "utf-8" if stream is None else stream.encoding
    by_line = getattr(stream, "line_buffering", False) or getattr(stream, "write_through", False)
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding=encoding, errors="replace", line_buffering=by_line)
