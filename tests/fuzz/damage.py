"""Damage to bytes."""

from collections.abc import Callable, Sequence

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
