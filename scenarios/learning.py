"""What learning environments take from the testbed: scenarios by name, and recordings of episodes."""

from pathlib import Path

from swarm.compose import MissionSetup

from .config import load_run
from .rerun.mission import MissionRecorder


def setup(name_or_path: str) -> tuple[MissionSetup, float]:
    """Return a scenario of a file or a shipped one, and the simulated time that its corrector takes for a frame [s]."""
    scenario = load_run(name_or_path, None, {}).scenario
    return scenario, scenario.latency_of_corrector_s


def recorder(folder: Path, task: MissionSetup, seed: int) -> MissionRecorder:
    """Return the recorder of an episode, whose file is named after its seed; the folder is made."""
    folder.mkdir(parents=True, exist_ok=True)
    name = f"episode-{seed}"
    return MissionRecorder(folder / f"{name}.rrd", task.rig, recording_id=name, title=name, image_every=1)
