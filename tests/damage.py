"""What may happen to a file: it is cut short, empty, or has a wrong byte."""

from collections.abc import Callable


def _with_a_wrong_byte(content: bytes, at: int) -> bytes:
    """The content with the lowest bit of one byte flipped."""
    changed = bytearray(content)
    changed[at] ^= 1
    return bytes(changed)


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "lacks the last byte": lambda content: content[:-1],
    "cut to a half": lambda content: content[: len(content) // 2],
    "a wrong byte in the middle": lambda content: _with_a_wrong_byte(content, len(content) // 2),
    "empty": lambda content: b"",
    "one byte left": lambda content: content[:1],
    "a wrong byte at the end": lambda content: _with_a_wrong_byte(content, -1),
}
"""The damages, by name."""
