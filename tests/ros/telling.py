"""Answers of the processes of these tests."""

import json
import sys
from typing import Any


def tell(**facts: Any) -> None:
    """Write a line of JSON to the standard output."""
    sys.stdout.write(json.dumps(facts) + "\n")
    sys.stdout.flush()
