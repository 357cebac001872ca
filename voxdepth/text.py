"""Text that a person wrote, or named: byte order marks, encodings and line ends, and TOML.

Every file that a person edits is decoded here, so that it means the same whichever editor or shell wrote it. A
`ValueError` says what is wrong and what to do; who knows the path adds it.
"""

import codecs
import tomllib
from typing import Any

MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",  # Before UTF-16, whose mark it begins with.
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
"""Encodings by the mark of the byte order that a text begins with; without one it is UTF-8."""
DEEPEST = 50
"""Levels of tables and arrays that TOML may have: on more, functions that recurse would fail."""


def decoded(data: bytes, *, has_names: bool = False) -> str:
    r"""Decode a text with any mark of the byte order and any line ends, which become `\n`.

    Args:
        data: The content of a file: UTF-8, or UTF-16 or UTF-32 with a mark.
        has_names: Whether it names files, which are any bytes: those that are no UTF-8 become what `os.fsdecode` makes
            of them, so that the files are found.

    Raises:
        ValueError: It is of another encoding, or no text.
    """
    mark = next((mark for mark in MARKS if data.startswith(mark)), b"")
    body = data[len(mark) :]
    try:
        text = body.decode(MARKS.get(mark, "utf-8"), "surrogateescape" if has_names else "strict")
    except UnicodeDecodeError as error:
        line = body[: error.start].count(b"\n") + 1
        raise ValueError(
            f"the byte {body[error.start]:#04x} in line {line} is no {error.encoding.upper()}: save it as UTF-8"
        ) from error
    if "\0" in text:
        raise ValueError("it has zero bytes, as UTF-16 without a mark of the byte order: save it as UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parsed_toml(data: bytes) -> dict[str, Any]:
    """Parse the content of a TOML file, see `decoded`.

    Raises:
        ValueError: It is no text, no TOML, or nests deeper than any file of ours.
    """
    try:
        content = tomllib.loads(decoded(data))
    except RecursionError as error:
        raise ValueError("its tables or arrays are too deep") from error
    level: list[Any] = [content]
    for _ in range(DEEPEST):
        level = [value for one in level for value in (one.values() if isinstance(one, dict) else one)]
        level = [value for value in level if isinstance(value, dict | list)]
    if level:
        raise ValueError(f"it nests tables and arrays more than {DEEPEST} deep: no file of ours does")
    return content
