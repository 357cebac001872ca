"""Results of the paper's experiments."""

import pandas as pd

from scenarios.experiments.catalogue import CATALOGUE
from scenarios.experiments.experiment import Experiment
from scenarios.experiments.runner import FIGURE, TABLE, ExperimentRecord, answer, claim_table, find_experiment, kept
from voxdepth.tools.recorded import restrict_opencv
from voxdepth.tools.results.table import Table

from .data import Data, Made

TIMED = ("rq2", "rq3", "rq4", "window", "fps", "components")
"""Experiments that measure times."""


def experiments(data: Data) -> Made:
    """Which claims of the paper hold on rendered sequences."""
    records = {name: _answered(data, name) for name in CATALOGUE}
    tables = {name: Table.of_frame(of.question, pd.read_csv(data.out / name / TABLE)) for name, of in records.items()}
    claims = [(name, claim) for name, of in records.items() for claim in of.claims]
    pictures = {path.parent.name: path.read_bytes() for path in data.out.glob(f"*/{FIGURE}")}
    return Made({"claims": claim_table(claims), **tables}, pictures)


def time_experiments(data: Data) -> None:
    """Answer the experiments that measure times."""
    for name in TIMED:
        _answered(data, name)


def _answered(data: Data, name: str) -> ExperimentRecord:
    """Return the kept answer of an experiment, or that of now."""
    restrict_opencv()
    experiment: Experiment = find_experiment(name).with_options(out=data.out, report=lambda what: None)
    print(f"experiment {name}")
    return kept(name, experiment) or answer(name, experiment, f"voxdepth experiment {name}")
