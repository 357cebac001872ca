"""Results about flights: how fast they are computed, how hard scenes are, and what studies found."""

from pathlib import Path

from scenarios.sensor_pictures import make_gallery
from scenarios.study.figures import by_arm
from scenarios.study.report import StudyAnalysis
from scenarios.study.store import read_study
from tests import proof, speeds
from voxdepth.tools.results.table import Column, Table, Value

from .data import ROOT, Data, Made

STUDIES = ROOT / "docs/study"
THREADED = ((160, 120, 1), (320, 180, 1), (480, 270, 3))
"""Sizes of images, and by how much they are reduced after matching."""


def missions(_: Data) -> Made:
    """How fast missions, studies and learning environments are."""
    flown = {name: speeds.flight_of_the_readme(recorded=name == "yes") for name in ("no", "yes")}
    readme = Table.of(
        "The first 15 s of voxdepth run city --seed 2, eight drones with the default",
        ["recorded", Column("real-time factor"), Column("CPU time of a simulated second", "s")],
        [[name, one.real_time_factor, one.busy_s] for name, one in flown.items()],
    )
    threads: list[list[Value]] = [
        [f"{width_px}x{height_px} / {decimate}", speeds.two_threads_against_one(width_px, height_px, decimate)]
        for width_px, height_px, decimate in THREADED
    ]
    studies: list[list[Value]] = [[drones, speeds.flown_by_two_workers(drones)] for drones in (1, 8)]
    return Made(
        {
            "flight": readme,
            "threads": Table.of(
                "How many times as fast two threads fly as one", ["images", Column("times as fast")], threads
            ),
            "parts": speeds.parts_of_a_tick(),
            "studies": Table.of(
                "What two workers of a study fly beside each other",
                ["drones", Column("real-time factor")],
                studies,
            ),
            "environments": speeds.steps_of_environments(),
        }
    )


def proven(_: Data) -> Made:
    """How much free space the images of a swarm prove."""
    return Made({"cells": proof.proven_by_images()})


def scenes(data: Data) -> Made:
    """How hard each kind of scene is to fly through."""
    data.out.mkdir(parents=True, exist_ok=True)
    return Made({"traversability": make_gallery(1, data.out / "scenes.jpg")})


def studies(_: Data) -> Made:
    """What the studies found whose stores are in docs/study."""
    analyses = {_name(path): StudyAnalysis(read_study(path)) for path in sorted(STUDIES.glob("*.tar.xz"))}
    tables: dict[str, Table] = {}
    pictures: dict[str, bytes] = {}
    for name, analysis in analyses.items():
        tables |= {f"{name}-{key}": table for key, table in analysis.tables.items() if len(table)}
        pictures |= {f"{name}-{figure.name}": figure.png for figure in analysis.figures}
    swarm, filled, one, slow = (analyses[f"correctors-{name}"].arms for name in ("swarm", "filled", "one", "paper"))
    filled = [arm for arm in filled if arm.name != "temporal"]
    groups = {"leader of eight, city": swarm, "leader of eight, filled": filled, "leader of three, paper": slow}
    groups |= {f"one drone, {name}": [arm for arm in one if arm.scenario == name] for name in ("city", "weak")}
    pictures["correctors"] = by_arm("Leaders and single drones by corrector", groups, "leader_collision").png
    return Made(tables, pictures)


def _name(path: Path) -> str:
    return path.name.partition(".")[0]
