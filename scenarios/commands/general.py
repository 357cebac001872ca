"""The command that lists what is available."""


def list_() -> None:
    """List scenarios, sequences, studies, correctors, sensor models and renderers."""
    from rich.console import Console
    from rich.table import Table

    from sim.depth_noise import SENSOR_MODEL_NAMES
    from sim.render import RENDERER_NAMES
    from voxdepth.registry import corrector_names
    from voxdepth.tools.options import NAMES_HELP

    from ..config import load_run
    from ..files import shipped_names
    from ..sequences import load_sequence

    table = Table("scenario", "drones", "what it is")
    for name in shipped_names("scenarios"):
        scenario = load_run(name, 0, {}).scenario
        table.add_row(name, str(scenario.mission.drones), scenario.description)
    sequences = Table("sequence", "image", "what it is")
    for name in shipped_names("sequences"):
        sequence = load_sequence(name, 0, {}).sequence
        sequences.add_row(name, f"{sequence.rig.width_px}x{sequence.rig.height_px}", sequence.description)
    console = Console()
    console.print(table)
    console.print(sequences)
    console.print(f"studies:     {', '.join(shipped_names('studies'))}")
    console.print(f"sensor models: {', '.join(SENSOR_MODEL_NAMES)}")
    console.print(f"correctors:  {', '.join(corrector_names())}; {NAMES_HELP}")
    console.print(f"renderers:   {', '.join(RENDERER_NAMES)}")
