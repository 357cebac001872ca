"""A corrector and its configuration, as a field of a scenario, a study arm or a learning task."""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from pydantic import Field, field_validator, model_serializer, model_validator

from .errors import ConfigError
from .model import Model, changed, explained
from .registry import create_corrector, require_known, resolve_config
from .types import DepthCorrector, Intrinsics

CorrectorFactory = Callable[[Intrinsics], DepthCorrector]
"""Makes a corrector for a camera."""
BEFORE_KEY = re.compile(r",(?=[\w.]+=)")
"""A comma between two settings."""


class CorrectorSpec(Model):
    """A corrector by name, with the values of its configuration that differ from the defaults.

    A text is a corrector with its default configuration but perhaps some settings, see `parse_corrector`. Without a
    setting it is written as a text again, so that configurations that never set `config` keep their text.
    """

    name: str
    """Name that `create_corrector` knows."""
    config: dict[str, Any] = Field(default_factory=dict)
    """Values of the corrector's own configuration, over its defaults key by key. They are validated when this is
    loaded."""

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        name, config = parse_corrector(value)
        return {"name": name, "config": config}

    @field_validator("name")
    @classmethod
    def _require_known(cls, name: str) -> str:
        require_known(name)
        return name

    @model_validator(mode="after")
    def _require_valid_config(self) -> "CorrectorSpec":
        self.resolved_config()
        return self

    @model_serializer
    def _bare_or_table(self) -> str | dict[str, Any]:
        return {"name": self.name, "config": self.config} if self.config else self.name

    def __str__(self) -> str:
        """Return the text that `of` takes, as in `temporal[fill=all]`."""
        settings = ",".join(f"{key}={value}" for key, value in _settings(self.config))
        return f"{self.name}[{settings}]" if settings else self.name

    @classmethod
    def of(cls, text: str) -> "CorrectorSpec":
        """Return the corrector that a text names; a wrong name, key or value is a `ConfigError`."""
        with explained(cls, ConfigError):
            return cls.model_validate(text)

    def resolved_config(self) -> Any:
        """Return the whole configuration of the corrector, or None where only the name is given."""
        return resolve_config(self.name, self.config) if self.config else None

    def create(self, intrinsics: Intrinsics) -> DepthCorrector:
        """Create the corrector for one camera."""
        return create_corrector(self.name, intrinsics, self.resolved_config())


def _settings(config: Mapping[str, Any], table: str = "") -> Iterator[tuple[str, str]]:
    """Yield the keys of a configuration, with dots, and their values as `parse_corrector` reads them, sorted."""
    for key, value in sorted(config.items()):
        if isinstance(value, Mapping):
            yield from _settings(value, f"{table}{key}.")
        else:
            is_plain = isinstance(value, str) and _value_of(value) == value
            yield f"{table}{key}", value if is_plain else json.dumps(value)


def _value_of(text: str) -> Any:
    """Return the value of a setting: JSON, or else the text itself."""
    with suppress(ValueError):
        return json.loads(text)
    return text


def parse_corrector(text: str) -> tuple[str, dict[str, Any]]:
    """Split a corrector with settings, as in `temporal[fill=all]`, into its name and its configuration.

    Without a setting the configuration is empty. Dots lead to keys of tables, as in
    `voxdepth[voxels.depth_m=20,window_frames=8]`. A value that is not JSON is a text. Neither the name nor a key is
    looked up.

    Raises:
        ConfigError: The text has another form, or a setting twice.
    """
    name, bracket, settings = text.partition("[")
    if not bracket:
        return name, {}
    config: dict[str, Any] = {}
    keys: set[str] = set()
    for setting in BEFORE_KEY.split(settings.removesuffix("]")):
        key, equals, value = setting.partition("=")
        if not (key and equals and value and settings.endswith("]")):
            raise ConfigError(f"expected a corrector with a setting as in temporal[fill=all], got {text!r}")
        if key in keys:
            raise ConfigError(f"expected every setting once, got {key} twice in {text!r}")
        keys.add(key)
        given = _value_of(value)
        for part in reversed(key.split(".")):
            given = {part: given}
        config = changed(config, given)
    return name, config
