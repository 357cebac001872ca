"""The name of a corrector, as a field of a configuration."""

from typing import Annotated

from pydantic import AfterValidator

from .registry import require_known


def _known(name: str) -> str:
    require_known(name)
    return name


CorrectorName = Annotated[str, AfterValidator(_known)]
"""A name that `create_corrector` knows; any other is a `ConfigError`, which a model reports as its own."""
