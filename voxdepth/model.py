"""The base of every configuration model: frozen, typed strictly, unknown keys are errors."""

from pydantic import BaseModel, ConfigDict


class Model(BaseModel):
    """A configuration whose field docstrings are its help texts."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )
