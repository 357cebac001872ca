"""What learning environments take from the testbed: scenarios by name."""

from swarm.config import MissionSetup

from .config import load_run


def setup(name_or_path: str) -> tuple[MissionSetup, float]:
    """Return a scenario of a file or a shipped one, and the simulated time that its corrector takes for a frame [s]."""
    scenario = load_run(name_or_path, None, {}).scenario
    return scenario, scenario.latency_of_corrector_s
