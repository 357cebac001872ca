"""Commands of the library: they correct recordings, measure speed, check the installation, and open recordings."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .errors import ToolError
from .options import (
    CORRECTOR_HELP,
    DEFAULT_CORRECTOR,
    Baseline,
    DepthTopic,
    GrayTopic,
    Start,
    UnitsPerM,
    Within,
    counter,
    parsed_size,
    require_installed,
)
from .sample import recording

if TYPE_CHECKING:
    from pydantic import BaseModel
    from rich.console import Console

    from ..corrector_spec import CorrectorSpec
    from ..datasets import Dataset
    from .correction import Correction

CORRECTED = Path("corrected")
"""Where results lie unless a place is named."""
Recorded = Annotated[
    Path,
    typer.Argument(
        metavar="PATH",
        parser=recording,
        help="Folder of the recorded sequence, or a bag; `sample` is twelve frames of a D435I that come with this.",
    ),
]
Poses = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Your own poses of the camera, a trajectory of TUM RGB-D: lines of a time, tx ty tz and qx qy qz qw.",
    ),
]
COMMENT_WIDTH = 110
NEW = Path(__file__).parent / "new"
"""Files of the library that `new` writes."""
HOW_TO = ": voxdepth "
"""Part of the lines of these files that say how they are used."""


def correct(
    folder: Recorded,
    out: Annotated[
        Path | None,
        typer.Option(help="New folder of the result, or a new .mcap file. Default: the folder corrected/NAME."),
    ] = None,
    corrector: Annotated[str, typer.Option(help=CORRECTOR_HELP)] = DEFAULT_CORRECTOR,
    config: Annotated[
        Path | None,
        typer.Option(help="TOML file of lines of `voxdepth config` to change, or a result's config.toml."),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE.rrd", help="Rerun recording to write or to replace.")
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Number of frames to correct. Default: all.")] = None,
    depth_topic: DepthTopic = None,
    gray_topic: GrayTopic = None,
    within: Within = 20.0,
    units_per_m: UnitsPerM = None,
    baseline: Baseline = None,
    start: Start = 0,
    poses: Poses = None,
    ply: Annotated[bool, typer.Option("--ply", help="Write points/NAME.ply, too.")] = False,
) -> None:
    """Correct the depth of a recorded sequence; the result appears when it is complete.

    Writes depth/NAME.png in 16 bits and millimetres (0 is invalid, farther than 65.535 m is 65535), confidence/NAME.png
    in 0..255, source/NAME.png (0 invalid, 1 sensor, 2 memory, 3 inpainted), frames.csv, report.json, config.toml with
    everything that the result depends on, and picture.png of the last frame before and after. A .mcap file has topics
    for gray, depth, source, confidence and camera_info below /voxdepth, with the stamps and frames of the input.
    """
    from dataclasses import replace
    from hashlib import sha256

    from ..datasets.files import read_bytes
    from ..errors import printable
    from ..units import MILLIMETRES
    from .correction import require_absent
    from .output import MCAP
    from .recorded import Opener, restrict_opencv

    out = out or CORRECTED / (folder.resolve().stem if folder.is_file() else folder.resolve().name)
    spec = _spec(corrector, config)
    _refuse_mixing(folder, out, record)
    if ply and out.suffix == MCAP:
        raise ToolError(f"--ply writes files into a folder, got --out {out}: name a folder")
    require_absent(out)
    if record is not None:
        require_installed("rerun")
    if out.suffix == MCAP:
        require_installed("rosbags")
    restrict_opencv()
    topics: dict[str, Any] = {"depth_topic": depth_topic, "gray_topic": gray_topic}
    dataset = Opener(baseline, within, start, poses, units_per_m=units_per_m, **topics)(folder)
    of_input: dict[str, Any] = {"start": start or None, "within_ms": within, **topics}
    if poses is not None:
        of_input |= {"poses": printable(poses.name), "poses_sha256": sha256(read_bytes(poses)).hexdigest()}
    correction = replace(_planned(folder, dataset, spec, frames, of_input), has_points=ply)
    if out.suffix != MCAP and (dataset.unit.units_per_m or 0) > MILLIMETRES:
        steps = f"1/{dataset.unit.units_per_m:g} m"
        typer.echo(f"depth in steps of {steps} is written in whole millimetres; --out FILE.mcap keeps it", err=True)
    _correct(correction, out, record)


def _correct(correction: "Correction", out: Path, record: Path | None) -> None:
    """Run a correction and print what it did."""
    import time

    from rich.console import Console

    from .output import PICTURE

    console, start_s = Console(), time.perf_counter()
    with counter(console, "correcting", correction.frames) as update:
        report = correction.run(out, record, update)
    rate = correction.frames / (time.perf_counter() - start_s)
    _print_report(console, report)
    typer.echo(f"{rate:.1f} frames per second; depth, confidence and report.json are in {out}")
    if (picture := out / PICTURE).exists():
        typer.echo(f"before and after: {picture}")
    if record is not None:
        typer.echo(f"look at it with: voxdepth view {record}")


def _refuse_mixing(folder: Path, out: Path, record: Path | None) -> None:
    from .files import resolved

    for option, path in (("--out", out), ("--record", record)):
        if path is not None and resolved(path).is_relative_to(resolved(folder)):
            raise ToolError(
                f"{option} {path} lies in the input {folder}, whose files would mix: name a place outside it"
            )
    if record is not None and resolved(record).is_relative_to(resolved(out)):
        raise ToolError(f"--record {record} lies in --out {out}, which must be new: name a place outside it")
    if record is not None and record.suffix != ".rrd":
        raise ToolError(f"--record must name an .rrd file, got {record}")


def _planned(
    folder: Path,
    dataset: "Dataset",
    spec: "CorrectorSpec",
    frames: int | None,
    of_input: Mapping[str, int | float | str | None],
) -> "Correction":
    """Resolve and check everything before anything is written; `of_input` is what was requested of the dataset."""
    from ..datasets.files import given_fields
    from ..errors import printable
    from ..registry import config_of
    from .correction import Correction
    from .results.provenance import CORRECTION, versions

    if len(dataset) < (frames or 1):
        raise ToolError(f"{folder} has {len(dataset)} frames, {frames or 1} were asked for")
    resolved = spec.resolved_config() or config_of(spec.name)
    made_from = {
        "corrector": spec.name,
        "folder": printable(folder.resolve().name),  # Without its path, since a folder may be moved.
        "format": dataset.format,
        "units_per_m": dataset.unit.units_per_m,
        **of_input,
        "intrinsics": given_fields(dataset.intrinsics),
        "versions": versions(CORRECTION),
        "config": None if resolved is None else resolved.model_dump(mode="json", exclude_none=True),
    }
    return Correction(
        made_from=made_from,
        dataset=dataset,
        frames=frames or len(dataset),
        corrector=spec.create(dataset.intrinsics),
    )


def _spec(corrector: str, config: Path | None) -> "CorrectorSpec":
    """Return a corrector with the configuration in its text or in a TOML file, perhaps that of an earlier result."""
    from ..corrector_spec import CorrectorSpec, parse_corrector
    from ..model import explained
    from ..registry import config_of, require_known, resolve_config
    from .files import read_toml, require_end

    name, given = parse_corrector(corrector)
    is_of_result = False
    if config is not None:
        if given:
            raise ToolError(f"--corrector {corrector} has a setting: write it to {config}, or leave out --config")
        if config_of(name) is None:
            raise ToolError(f"{config}: the corrector {name!r} takes no configuration; leave out --config")
        given = read_toml(config)
        if is_of_result := isinstance(given.get("config"), dict):
            made_by = given.get("corrector", name)
            if made_by != name:
                raise ToolError(f"{config} configures the corrector {made_by!r}: ask for that with --corrector")
            given = given["config"]
    require_known(name)
    with explained(CorrectorSpec, ToolError, f"{config or '--corrector'}: "):
        spec = CorrectorSpec(name=name, config=given)
    if config is not None and is_of_result:
        require_end(config, given, resolve_config(name, given))
    return spec


def _print_report(console: "Console", report: Mapping[str, Any]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from ..registry import title
    from .results.table import Column
    from .results.table import Table as ResultTable

    made_by = title(report["corrector"])
    heading = f"{report['folder']}, {report['format']}: {report['frames']} frames, corrector {made_by}"
    table = Table(title=escape(heading), title_justify="left", show_header=False)
    raw, corrected = report["coverage"]["raw"], report["coverage"]["corrected"]
    table.add_row("pixels with depth", f"{raw:.1%} raw, [bold]{corrected:.1%} corrected[/bold]")
    median_m = report["raw_median_m"]["p50"]
    table.add_row("median depth, raw", f"{median_m:.3g} m (if the scene is nearer or farther, state --units-per-m)")
    if n_empty := report["frames_without_depth"]:
        table.add_row("frames without any depth", f"{n_empty} of {report['frames']}")
    table.add_row("all pixels", ", ".join(f"{name} {share:.1%}" for name, share in report["pixel_shares"].items()))
    for fact, summary in report["facts"].items():
        table.add_row(_words(fact), ", ".join(f"{_words(name)} {value:g}" for name, value in summary.items()))
    console.print(table)
    if n_wrong := report["facts"].get("poses", {}).get("contradicted"):
        typer.echo(
            f"the images contradict the poses of {n_wrong} of {report['frames']} frames, which were not followed: "
            "expected poses of the camera in the world (T_world_cam, z forward, y down) in metres, not their inverse",
            err=True,
        )
    median, p95, longest = (Column(name, "ms", ".1f") for name in ("median", "95 %", "longest"))
    steps = report["wall"]["steps_s"].items()
    rows = [[step, *(1000 * spread[name] for name in ("p50", "p95", "max"))] for step, spread in steps]
    if rows:
        ResultTable.of("time per frame", ("step", median, p95, longest), rows).print(console)


def _words(name: str) -> str:
    return name.replace("_", " ")


def config(
    corrector: Annotated[
        str, typer.Argument(help="temporal (ours), voxdepth (the paper) or voxdepth-authors (its authors' code).")
    ] = DEFAULT_CORRECTOR,
) -> None:
    """Print all that can be configured of a corrector, with its values and what they mean, as a TOML file.

    Keep the lines that you change: voxdepth correct --config FILE takes the others from the corrector.
    """
    from ..registry import config_of, title

    model = config_of(corrector)
    if model is None:
        raise ToolError(f"the corrector {corrector!r} has nothing to configure")
    for line in (f"# {title(corrector)}", *_lines(model, "")):
        typer.echo(line)


def _lines(model: "BaseModel", table: str) -> Iterator[str]:
    """Yield the values of a model as TOML, each under its help text; tables come last, as they must."""
    import tomli_w
    from pydantic import BaseModel

    fields = type(model).model_fields
    values = {name: getattr(model, name) for name in fields}
    for name, value in values.items():
        if not isinstance(value, BaseModel):
            yield from _comment(fields[name].description)
            yield tomli_w.dumps({name: list(value) if isinstance(value, tuple) else value}).rstrip()
    for name, value in values.items():
        if isinstance(value, BaseModel):
            yield ""
            yield from _comment(fields[name].description)
            yield f"[{table}{name}]"
            yield from _lines(value, f"{table}{name}.")


def _comment(text: str | None) -> list[str]:
    import textwrap

    return [f"# {line}" for line in textwrap.wrap(" ".join((text or "").split()), COMMENT_WIDTH)]


def bench(size: Annotated[str, typer.Option(help="Image size.")] = "640x360") -> None:
    """Measure how fast the correctors are here, in all and step by step, beside librealsense or what equals it."""
    from rich.console import Console

    from .benchmark import N_FRAMES, camera_of, measure, tables
    from .results.provenance import CORRECTION, Provenance

    camera = camera_of(*parsed_size(size))
    made, console = Provenance.here(CORRECTION), Console()
    with console.status(f"correcting {N_FRAMES} frames of {size} with each method in turn"):
        latencies = measure(camera, N_FRAMES)
    console.print(*made.lines(), sep="\n", soft_wrap=True, highlight=False)
    for table in tables(size, latencies):
        table.print(console)


def view(
    path: Annotated[Path, typer.Argument(help="Folder of a run, or an .rrd file.")],
    web: Annotated[
        bool, typer.Option("--web", help="Serve to a browser on 127.0.0.1 instead of opening a window.")
    ] = False,
) -> None:
    """Open a recording in the Rerun viewer."""
    from .viewer import PARTIAL_RECORDING, RECORDING, open_viewer

    whole, partial = path / RECORDING, path / PARTIAL_RECORDING
    if partial.is_file() and not whole.exists():
        typer.echo(f"the run has not ended or was killed: {partial} holds what it recorded so far", err=True)
        whole = partial
    open_viewer(whole if path.is_dir() else path, web=web)


def new(
    kind: Annotated[str, typer.Argument(help="corrector; in the testbed also scenario, study or controller.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Its name, without .toml or .py.")],
) -> None:
    """Write a commented corrector, scenario, study or controller of your own, which runs as it is."""
    from importlib.util import find_spec

    from .extensions import extensions
    from .files import write

    folders = [NEW, *(extension.templates for extension in extensions() if extension.templates is not None)]
    templates = {path.stem: path for folder in folders for path in sorted(folder.glob("[!_]*.*"))}
    if (template := templates.get(kind)) is None:
        raise ToolError(f"expected a kind of {', '.join(templates)}, got {kind!r}")
    path = Path(f"{name.removesuffix(template.suffix)}{template.suffix}")
    if not path.stem.isidentifier() or str(path.parent) != ".":
        raise ToolError(f"NAME must consist of letters, digits and _, as in my_{kind}, got {name!r}")
    if path.exists() or (path.suffix == ".py" and find_spec(path.stem) is not None):
        raise ToolError(f"there is a {path} already, or another module of that name: choose another name")
    text = template.read_text(encoding="utf-8").replace("NAME", path.stem)
    write(path, text.encode())
    typer.echo(f"written to {path}")
    for line in text.splitlines():
        if HOW_TO in line:
            typer.echo(line.lstrip("# "))


def doctor() -> None:
    """Check the installation on this machine, suggest a remedy for each problem, and list what extras would add."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from .doctor import examine
    from .extensions import extensions

    findings = [*examine(), *(finding for extension in extensions() for finding in extension.checks())]
    table = Table("", "found", "what to do")
    for finding in findings:
        mark = "[green]ok[/green]" if finding.ok else "-" if finding.optional else "[red]no[/red]"
        table.add_row(f"{mark} {finding.what}", escape(finding.state), escape(finding.remedy))
    Console().print(table)
    if not all(finding.ok or finding.optional for finding in findings):
        raise typer.Exit(1)
