"""How results are kept: a JSON file for each, which appears whole, and has its format and its digest at its end."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from pydantic import TypeAdapter
from pydantic_core import from_json, to_jsonable_python

from ...checksums import DamageError, digest_of
from ..files import write

FORMAT, DIGEST = "format", "sha256"
"""The last keys of a file: the version of its format, and the digest of all before."""
FIRST = 1
"""The version of a file that has none."""

Kind = TypeVar("Kind")


class Records(Generic[Kind]):
    """The files of results of one type.

    Args:
        kind: Type of the results: a data class or a model.
        version: Version of the format of their files.
        extra: What becomes of keys that the type lacks: `forbid` refuses the file, `ignore` drops them.
    """

    def __init__(
        self, kind: type[Kind], *, version: int = FIRST, extra: Literal["forbid", "ignore"] = "forbid"
    ) -> None:
        self._type: TypeAdapter[Kind] = TypeAdapter(kind)
        self._version = version
        self._extra = extra

    def encode(self, result: Kind) -> bytes:
        """Return the content of the file of a result."""
        return sealed_json(to_jsonable_python(result, inf_nan_mode="constants") | {FORMAT: self._version})

    def decode(self, data: bytes) -> Kind:
        """Return the result of a file.

        Raises:
            ValueError: It is no JSON, damaged, of another type, or of another version of the format.
        """
        content = unsealed_json(data)
        version = content.pop(FORMAT, FIRST)
        if version != self._version:
            raise ValueError(f"its format is version {version}, and this version of voxdepth reads {self._version}")
        return self._type.validate_json(json.dumps(content), extra=self._extra)

    def write(self, path: Path, result: Kind) -> None:
        """Write the file of a result in one step; a failure is a `ToolError`."""
        write(path, self.encode(result))


def sealed_json(content: Mapping[str, Any]) -> bytes:
    """Return JSON with its digest under the last key."""
    return f"{json.dumps({**content, DIGEST: _digest(content)}, indent=1)}\n".encode()


def unsealed_json(data: bytes) -> dict[str, Any]:
    """Return the content of JSON without its digest, or as it is if it has none.

    Raises:
        ValueError: It is no JSON object, or has another digest.
    """
    content = from_json(data)
    if not isinstance(content, dict):
        raise ValueError(f"expected a JSON object, got {type(content).__name__}")
    digest = content.pop(DIGEST, None)
    if digest not in (None, _digest(content)):
        raise DamageError(f"its content is not that of its {DIGEST}")
    return content


def _digest(content: Mapping[str, Any]) -> str:
    return digest_of(json.dumps(content).encode())
