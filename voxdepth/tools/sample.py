"""The recording that comes with the library, so that there is something to try it on."""

from pathlib import Path

SAMPLE = "sample"
"""The word for it on the command line."""
FOLDER = Path(__file__).parents[1] / SAMPLE


def recording(text: str) -> Path:
    """Return the place of a recording that a user names: a path, or the word `sample` where nothing is called so."""
    path = Path(text)
    return FOLDER if text == SAMPLE and not path.exists() else path
