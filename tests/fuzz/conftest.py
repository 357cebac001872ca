"""Tells how much is fuzzed and by which seed, so that what was found can be found again."""

from tests.fuzz.fuzzing import EXAMPLES, SEED


def pytest_report_header() -> str:
    amount = "the usual number of" if EXAMPLES is None else f"{EXAMPLES}"
    return f"fuzzing: {amount} inputs for each test, seed {SEED}"
