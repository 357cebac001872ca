"""The tables and figures that documents show, each remade by one command.

    python -m tests.results [--recordings FOLDER] [NAME ...]

Without a name all are made. A result is `docs/results/NAME.json`: its tables, and by which commit, on which machine and
on which day they were made. A document shows a table between two comments, `<!-- result NAME TABLE -->` and
`<!-- end -->`, and what is between them is written here. A figure is `docs/results/NAME-FIGURE.png`. Tables of real
cameras need their recordings, one folder each below FOLDER; a result that lacks its data stays as it was, which is said
at the end.
"""

import argparse
import json
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any

import pandas as pd
from rich.console import Console

from scenarios.evaluation import Shipped
from scenarios.experiments.catalogue import CATALOGUE
from scenarios.experiments.runner import claim_table, find_experiment, run
from scenarios.sensor_pictures import make_gallery
from scenarios.sequences import GROUPS, load_sequence
from scenarios.study.report import StudyAnalysis
from scenarios.study.store import read_study
from tests import calibrate, camera_errors, odometries
from voxdepth.errors import no_such
from voxdepth.temporal.ablations import ABLATIONS
from voxdepth.tools.benchmark import FRAME, N_FRAMES, camera_of, measure
from voxdepth.tools.errors import ToolError
from voxdepth.tools.evaluate import requested_of
from voxdepth.tools.evaluation.methods import find_methods
from voxdepth.tools.evaluation.quantities import ERROR_IN_HOLES
from voxdepth.tools.evaluation.report import method_table
from voxdepth.tools.evaluation.shares import PixelKind
from voxdepth.tools.evaluation.suite import Evaluation, EvaluationSequence, Plan, evaluate
from voxdepth.tools.files import write
from voxdepth.tools.recorded import Opener, restrict_opencv
from voxdepth.tools.results.provenance import Provenance, source_commit
from voxdepth.tools.results.table import Table, Value
from voxdepth.tools.results.table import markdown as table_markdown

ROOT = Path(__file__).parents[1]
RESULTS, STUDIES = ROOT / "docs/results", ROOT / "docs/study"
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
SHOWN = re.compile(r"<!-- result (\S+) (\S+) -->\n(.*?)<!-- end -->", re.DOTALL)
"""A table in a document."""
SIZES = ((160, 96), (480, 270), (640, 360), (848, 480))
REAL = ("aloe", "cones", "d435-arm", "d435-hand", "kinect", "kitti", "motorcycle")
"""Recordings by the names of their folders; docs/corrector.md says what they are."""
ABLATED = ("cones", "d435-arm", "kitti")
"""Recordings by which parts are evaluated: of a pair, of a camera at stations, and of one that moves."""
REAL_FRAMES, ABLATION_FRAMES, CALIBRATION_FRAMES, RENDERED_FRAMES = 40, 12, 30, 30
UNSEEN_SEED = 2024
"""Of rendered sequences by which nothing was trained or tuned."""
BASELINES = ("raw", "realsense-left", "realsense", "ip-basic", "global-smoother", "telea", "navier-stokes")
WHOLE = "temporal"
PARTS = (
    *(f"{WHOLE}[without={part}]" for part in ABLATIONS),
    *(f"{WHOLE}[{setting}]" for setting in ("shadow_factor=1", "smoothing_window_px=1", "decimation=1")),
)
"""The default method without one of its parts."""


class MissingDataError(Exception):
    """What a result is made from is not here; the message says what."""


@dataclass(frozen=True)
class Data:
    """Where the data of results lie."""

    recordings: Path | None
    """Folder of the recordings of real cameras."""
    out: Path = ROOT / "build/results"
    """Folder for what is kept between two calls."""

    def of_camera(self, name: str) -> Path:
        """Return the folder of a recording."""
        if self.recordings is None or not (self.recordings / name).is_dir():
            raise MissingDataError(f"the recording {name} (--recordings FOLDER)")
        return self.recordings / name


Tables = Mapping[str, Table]
Make = Callable[[Data], Tables]


def performance(_: Data) -> Tables:
    """How long a frame takes."""
    methods: dict[str, list[Value]] = {}
    steps: dict[str, list[Value]] = {}
    for width_px, height_px in SIZES:
        times_s = measure(camera_of(width_px, height_px), N_FRAMES)
        medians_ms = {name: 1e3 * median(of[FRAME]) for name, of in times_s.items()}
        first_ms = next(iter(medians_ms.values()))
        for name, median_ms in medians_ms.items():
            methods.setdefault(name, []).extend([f"{median_ms:.1f}", f"{median_ms / first_ms:.2f}"])
        for step, of_step in times_s[WHOLE].items():
            steps.setdefault(step, []).append(f"{1e3 * median(of_step):.2f}")
    sizes = [f"{width_px}x{height_px}" for width_px, height_px in SIZES]
    headings = [f"{size} {what}" for size in sizes for what in ("[ms]", "ratio")]
    return {
        "methods": Table.of(
            f"Median time of a frame, {N_FRAMES} frames, and its ratio to the first method",
            ["method", *headings],
            [[name, *row] for name, row in methods.items()],
        ),
        "steps": Table.of(
            f"Median time of each step of {WHOLE}",
            ["step", *(f"{size} [ms]" for size in sizes)],
            [[step, *row] for step, row in steps.items()],
        ),
    }


def real(data: Data) -> Tables:
    """How many pixels of real cameras are filled right, beside the best baseline."""
    evaluation = _evaluated(_recorded(data, REAL), [*BASELINES, WHOLE], REAL_FRAMES, data)
    rows: list[list[Value]] = []
    of_kinds: dict[str, list[PixelKind]] = {}
    for shares in evaluation.shares:
        for kind in shares.kinds.values():
            other = _best_other(kind)
            lead = _points(kind, WHOLE, other)
            rows.append([f"{shares.recording}, {kind.title}", *_two_shares(kind, other), lead])
            of_kinds.setdefault(kind.title, []).append(kind)
    summary: list[list[Value]] = []
    for title, kinds in of_kinds.items():
        means = {name: sum(kind.share(name).value for kind in kinds) / len(kinds) for name in (WHOLE, *BASELINES)}
        best = max(BASELINES, key=lambda name: means[name])
        summary.append([title, f"{100 * means[WHOLE]:.1f}", f"{100 * means[best]:.1f} `{best}`"])
    headings = ["pixels", "default [%]", "best baseline [%]"]
    title = f"Share of pixels within 5 % of the reference, {REAL_FRAMES} frames of each recording"
    return {
        "summary": Table.of(f"{title}, mean over {len(REAL)} recordings", headings, summary),
        "leads": Table.of(title, [*headings, "lead in points, 95 % interval"], rows),
    }


def ablations(data: Data) -> Tables:
    """What each part of the default method is worth on real cameras."""
    evaluation = _evaluated(_recorded(data, ABLATED), [WHOLE, *PARTS], ABLATION_FRAMES, data)
    rows = [[_part(name), *(_points(shares.overall, name, WHOLE) for shares in evaluation.shares)] for name in PARTS]
    return {
        "parts": Table.of(
            f"Change in points of the pixels within 5 % of the reference, {ABLATION_FRAMES} frames, 95 % interval",
            ["without", *(shares.recording for shares in evaluation.shares)],
            rows,
        )
    }


def calibration(data: Data) -> Tables:
    """Whether the confidence is the share that is right, by recordings that it was not fitted to."""
    folders = [data.of_camera(name) for name in REAL]
    fills, measured = calibrate.tables_of(folders, CALIBRATION_FRAMES)
    return {"fills": fills, "measured": measured}


def rendered(data: Data) -> Tables:
    """How many pixels of rendered sequences in holes are right, and how large the errors of the network are."""
    tables = {}
    for word in ("reference", "artefacts"):
        requested = [Shipped(load_sequence(name, 0, {})) for name in GROUPS[word]]
        evaluation = _evaluated(requested, [*BASELINES, WHOLE], RENDERED_FRAMES, data)
        rows = [
            [shares.recording, *_two_shares(shares.overall, _best_other(shares.overall))]
            for shares in evaluation.shares
        ]
        title = f"Share of the pixels in holes within 5 % of the truth, {RENDERED_FRAMES} frames of each sequence"
        tables[word] = Table.of(title, ["sequence", "default [%]", "best baseline [%]"], rows)
    unseen = [Shipped(load_sequence(name, UNSEEN_SEED, {})) for name in GROUPS["reference"]]
    evaluation = _evaluated(unseen, [WHOLE, f"{WHOLE}[fill=all]", "learned"], RENDERED_FRAMES, data)
    return {**tables, "learned": method_table(evaluation, ERROR_IN_HOLES)}


def odometry(_: Data) -> Tables:
    """How exact the motions of the camera are."""
    return {
        "compared": odometries.compared(),
        "poses": odometries.with_poses(),
        "projector": odometries.under_a_projector(),
    }


def cameras(data: Data) -> Tables:
    """Which errors the depth of rendered and of real cameras has."""
    real = {name: data.of_camera(name) for name in ("d435-arm", "kitti")}
    return {"errors": camera_errors.errors_of_cameras((*GROUPS["artefacts"], "sim-LN"), real)}


def scenes(data: Data) -> Tables:
    """How hard each kind of scene is to fly through."""
    data.out.mkdir(parents=True, exist_ok=True)
    return {"traversability": make_gallery(1, data.out / "scenes.jpg")}


def learned(data: Data) -> Tables:
    """How many pixels of real cameras the network fills right."""
    rows: list[list[Value]] = []
    evaluation = _evaluated(_recorded(data, REAL), [*BASELINES, WHOLE, "learned"], REAL_FRAMES, data)
    for shares in evaluation.shares:
        for kind in shares.kinds.values():
            best = next(method for method in kind.ranked if method in BASELINES)
            values = [f"{100 * kind.share(method).value:.1f}" for method in (WHOLE, "learned", best)]
            rows.append([f"{shares.recording}, {kind.title}", *values[:2], f"{values[2]} `{best}`"])
    title = f"Share of pixels within 5 % of the reference, {REAL_FRAMES} frames of each recording"
    return {"real": Table.of(title, ["pixels", "default [%]", "learned [%]", "best baseline [%]"], rows)}


def studies(_: Data) -> Tables:
    """The tables of the studies whose stores are in docs/study."""
    return {
        f"{path.name.partition('.')[0]}-{name}": table
        for path in sorted(STUDIES.glob("*.tar.xz"))
        for name, table in StudyAnalysis(read_study(path)).tables.items()
        if len(table)
    }


def experiments(data: Data) -> Tables:
    """Which claims of the paper hold on rendered sequences."""
    restrict_opencv()
    tables, claims = {}, []
    for name in CATALOGUE:
        experiment = find_experiment(name).with_options(out=data.out, report=lambda what: None)
        claims += [(name, claim) for claim in run(name, experiment, f"voxdepth experiment {name}", Console())]
        tables[name] = Table.of_frame(experiment.question, pd.read_csv(data.out / name / "table.csv"))
    return {"claims": claim_table(claims), **tables}


def experiment_pictures(data: Data) -> dict[str, bytes]:
    """The figures of the paper's experiments."""
    return {path.parent.name: path.read_bytes() for path in data.out.glob("*/figure.png")}


OF_FRAMES = (performance, real, learned, ablations, calibration, rendered, experiments, odometry, cameras)
OF_FLIGHTS = (scenes, studies)
MAKERS: dict[str, Make] = {make.__name__: make for make in (*OF_FRAMES, *OF_FLIGHTS)}


def study_pictures(_: Data) -> dict[str, bytes]:
    """The figures of the studies whose stores are in docs/study."""
    return {
        f"{path.name.partition('.')[0]}-{figure.name}": figure.png
        for path in sorted(STUDIES.glob("*.tar.xz"))
        for figure in StudyAnalysis(read_study(path)).figures
    }


PICTURES: dict[str, Callable[[Data], dict[str, bytes]]] = {
    "studies": study_pictures,
    "experiments": experiment_pictures,
}
"""Figures by the name of a result."""


def _recorded(data: Data, names: Sequence[str]) -> list[EvaluationSequence]:
    opener = Opener(None, 20.0, 0, units_per_m=None, depth_topic=None, gray_topic=None)
    folders = [data.of_camera(name) for name in names]
    return [requested for folder in folders for requested in requested_of(folder, opener)]


def _evaluated(requested: Sequence[EvaluationSequence], methods: Sequence[str], frames: int, data: Data) -> Evaluation:
    restrict_opencv()
    plan = Plan(sequences=requested, methods=find_methods(methods), frames=frames, out=data.out / "evaluation")
    evaluation = evaluate(plan, lambda what, done: print(f"\r{what}; {done} of {len(plan)} done", end="", flush=True))
    print()
    for failed in evaluation.failures:
        raise MissingDataError(f"{failed.method} on {failed.sequence}, which failed: {failed.error}")
    return evaluation


def _best_other(kind: PixelKind) -> str:
    return next(method for method in kind.ranked if method != WHOLE)


def _two_shares(kind: PixelKind, other: str) -> list[str]:
    return [f"{100 * kind.share(WHOLE).value:.1f}", f"{100 * kind.share(other).value:.1f} `{other}`"]


def _points(kind: PixelKind, method: str, other: str) -> str:
    """The lead of a method over another one in points, with its interval."""
    value, low, high = (f"{100 * end:+.1f}" for end in kind.lead(method, other))
    return f"{value} ({low} to {high})"


def _part(name: str) -> str:
    """What a method lacks: a part by its name, or what a setting switches off."""
    return f"`{name.removeprefix(f'{WHOLE}[').removeprefix('without=').removesuffix(']')}`"


def to_json(name: str, tables: Tables) -> dict[str, Any]:
    """Return the content of a result's file: the tables that documents show."""
    here, shown = Provenance.here(), tables_shown(name)
    if missing := shown - set(tables):
        raise ToolError(f"a document shows {name} {missing.pop()}, which is none of its tables: {', '.join(tables)}")
    return {
        "command": f"make results NAME={name}",
        "commit": source_commit(),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": here.machine,
        "versions": here.versions,
        "tables": {
            key: {
                "title": table.title,
                "columns": table.headings,
                "right": [table.is_numeric(index) for index in range(len(table.columns))],
                "rows": table.texts,
            }
            for key, table in tables.items()
            if key in shown
        },
    }


def markdown(result: Mapping[str, Any], key: str) -> str:
    """Return a table of a result as documents show it."""
    table = result["tables"][key]
    lines = table_markdown(table["columns"], table["rows"], table["right"])
    made = f"`{result['command']}`, commit {result['commit']}, {result['date']}, {result['machine']}"
    return f"{lines}\n*{table['title']} ({made}).*\n"


def tables_shown(name: str) -> set[str]:
    """Return which tables of a result documents show."""
    texts = (path.read_text(encoding="utf-8") for path in DOCUMENTS)
    return {found[2] for text in texts for found in SHOWN.finditer(text) if found[1] == name}


def pictures_shown(name: str) -> set[str]:
    """Return which figures of a result documents show."""
    shown = re.compile(rf"\]\((?:docs/)?results/{name}-(\S+)\.png\)")
    return {found[1] for path in DOCUMENTS for found in shown.finditer(path.read_text(encoding="utf-8"))}


def with_tables(document: str, results: Mapping[str, Any]) -> str:
    """Return a document with the present tables of results; those of others stay."""

    def shown(found: re.Match[str]) -> str:
        name, key = found[1], found[2]
        if name not in results:
            return found[0]
        return f"<!-- result {name} {key} -->\n\n{markdown(results[name], key)}\n<!-- end -->"

    return SHOWN.sub(shown, document)


def main() -> None:
    """Make results, and write them into the documents."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", metavar="NAME", nargs="*", help=", ".join(MAKERS))
    parser.add_argument("--recordings", type=Path, metavar="FOLDER", help="folder of the recordings of real cameras")
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.names if name not in MAKERS]:
        parser.error(no_such("result", unknown[0], MAKERS))
    made, kept, data = {}, [], Data(arguments.recordings)
    for name in arguments.names or MAKERS:
        print(f"{name}: {MAKERS[name].__doc__}")
        start_s = time.perf_counter()
        try:
            made[name] = to_json(name, MAKERS[name](data))
        except MissingDataError as missing:
            kept.append(f"{name} stays as it was, without {missing}")
            continue
        print(f"{name}: {(time.perf_counter() - start_s) / 60:.1f} min")
        write(RESULTS / f"{name}.json", f"{json.dumps(made[name], indent=1)}\n".encode())
        if shown := pictures_shown(name):
            pictures = PICTURES[name](data)
            for key in shown:
                write(RESULTS / f"{name}-{key}.png", pictures[key])
    for path in DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        if (now := with_tables(text, made)) != text:
            write(path, now.encode())
            print(f"{path.relative_to(ROOT)} shows them")
    print("\n".join(kept))


if __name__ == "__main__":
    main()
