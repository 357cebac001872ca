"""Damage to bytes and to folders."""

import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from hypothesis import strategies as st

Damage = Callable[[bytes], bytes]
LONG = 1 << 20


def _flipped(bits: Sequence[int]) -> Damage:
    def flip(data: bytes) -> bytes:
        changed = bytearray(data)
        for bit in bits if data else ():
            changed[bit // 8 % len(data)] ^= 1 << bit % 8
        return bytes(changed)

    return flip


def _replaced(place: int, length: int, by: bytes) -> Damage:
    def replace(data: bytes) -> bytes:
        start = place % (len(data) + 1)
        return data[:start] + by + data[start + length :]

    return replace


def _swapped_lines(first: int, second: int) -> Damage:
    def swap(data: bytes) -> bytes:
        lines = data.splitlines(keepends=True) or [b""]
        a, b = first % len(lines), second % len(lines)
        lines[a], lines[b] = lines[b], lines[a]
        return b"".join(lines)

    return swap


PLACES = st.integers(0, 2**24)
damages: st.SearchStrategy[Damage] = st.one_of(
    st.lists(PLACES, min_size=1, max_size=12).map(_flipped),
    st.builds(_replaced, PLACES, st.sampled_from([0, 1, 4, 64, LONG]), st.binary(max_size=8)),
    st.builds(
        _replaced, PLACES, st.just(0), st.sampled_from([b"\0" * 512, b"\xff" * 512, b"\n\n", "é漢".encode(), b"["])
    ),
    st.builds(_replaced, PLACES, st.just(4), st.sampled_from([b"\xff\xff\xff\x7f", b"\xff" * 8, b"\0\0\0\0", b"-1  "])),
    st.builds(_swapped_lines, PLACES, PLACES),
    st.sampled_from([b"", b"\0", b"\n", b"{}", b"x" * 1_000]).map(lambda content: lambda _: content),
)
"""Other bytes in place of given ones: bits that changed; pieces cut, inserted or overwritten; lines swapped."""


def _rewritten(damage: Damage) -> Callable[[Path], None]:
    return lambda path: _write(path, damage(path.read_bytes())) if path.is_file() else None


def _write(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def _removed(path: Path) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def _as_folder(path: Path) -> None:
    _removed(path)
    path.mkdir()


def _as_pipe(path: Path) -> None:
    _removed(path)
    os.mkfifo(path)


def _as_link(target: str) -> Callable[[Path], None]:
    def link(path: Path) -> None:
        _removed(path)
        path.symlink_to(target)

    return link


def _unreadable(path: Path) -> None:
    path.chmod(0)


def _renamed(path: Path) -> None:
    path.rename(path.with_name(f"{path.name} [bold]é"))


path_damages: st.SearchStrategy[Callable[[Path], None]] = st.one_of(
    damages.map(_rewritten),
    damages.map(_rewritten),
    damages.map(_rewritten),
    st.sampled_from(
        [
            _removed,
            _as_folder,
            _as_pipe,
            _unreadable,
            _renamed,
            *map(_as_link, ("/dev/zero", "nowhere", ".", "/", "/dev/tty")),
        ]
    ),
)
"""What can happen to a file or a folder: mostly other bytes; or it is gone, or something else."""


def apply(damage: Callable[[Path], None], folder: Path, choice: int) -> None:
    """Damage one of the files and folders below a folder, or the folder's only file."""
    paths = sorted(path for path in folder.rglob("*") if not path.is_symlink())
    plain = [path for path in paths if path.is_file()]
    chosen = plain if choice % 8 else paths
    if chosen:
        damage(chosen[choice // 8 % len(chosen)])
