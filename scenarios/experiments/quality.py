"""Table psnr: how near to the truth the depth of each method is, beside the paper's numbers."""

import pandas as pd

from voxdepth.registry import title
from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES, SETTLED_PSNR, SETTLED_RMSE

from .experiment import Claim, Experiment, ExperimentResult, counted, most_hold, pivot
from .measures.epochs import corrected_percent
from .paper import M_RMSE, METHODS, OURS, PSNR_DB, SEQUENCES, beside, leads
from .plots import bars, picture

PSNR, MASKED, CORRECTED = "PSNR [dB]", "masked RMSE [m]", "frames corrected by a template [%]"


def answer(experiment: Experiment) -> ExperimentResult:
    """Evaluate VoxDepth, RealSense's hole filling and our reconstruction of GSmooth on all sequences."""
    shares = {name: corrected_percent(source, experiment.frames) for name, source in experiment.sources()}
    psnrs_db, masked_m = map(_by_method, experiment.evaluate(OURS, SETTLED_PSNR, SETTLED_RMSE))
    blocks = {
        PSNR: psnrs_db.join(beside(PSNR_DB, psnrs_db.index).add_suffix(" (paper)")),
        MASKED: masked_m,
        CORRECTED: pd.DataFrame.from_dict(shares, orient="index").assign(n=experiment.frames),
    }
    table = pd.concat(blocks, names=["metric", "sequence"]).reset_index()
    table["n"] = table.pop("n")  # is the last column
    return ExperimentResult(table=table, figure=draw(table))


def _by_method(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the values by sequence, a column for each method, and the largest `n` of all methods."""
    values = pivot(measured.reset_index(), "sequence", "method", "value")
    return values.assign(n=measured.groupby("sequence")["n"].max())


def draw(table: pd.DataFrame) -> bytes:
    """Return the figure as PNG. A PSNR has no zero that bars could begin at, so that gains over raw depth are shown."""
    psnrs_db, masked_m = (table[table["metric"] == name].set_index("sequence")[list(OURS)] for name in (PSNR, MASKED))
    gains_db = psnrs_db.drop(columns="raw").sub(psnrs_db["raw"], axis="index")
    gains_db.index = [f"{name}\nraw: {value:.1f} dB" for name, value in psnrs_db["raw"].items()]
    better = "PSNR of all surfaces: how much higher than that of the depth as measured? Higher is better"
    masked = "Error of the surfaces within 20 m that the right camera does not see. Lower is better"
    legend = {name: name if name == method else f"{name}: {title(method)}" for name, method in OURS.items()}
    return picture(
        f"How near to the truth is the depth, after the first {SETTLED_FRAMES} frames of each sequence? "
        "Pixels without depth get that of the nearest pixel that has one",
        [
            bars(gains_db.rename(columns=legend), better, "gain [dB]", "%+.1f"),
            bars(masked_m.rename(columns=legend), masked, "masked RMSE [m]", "%.2f"),
        ],
        columns=1,
        panel_in=(10.0, 3.4),
        shared_legend=True,
    )


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims about where VD is ahead of RS and GS, beside the paper's tables."""
    ours = {
        metric: own.set_index("sequence")[list(METHODS[:3])].astype(float) for metric, own in table.groupby("metric")
    }
    return _lead("the highest PSNR", ours[PSNR], PSNR_DB), _lead("the lowest masked error", -ours[MASKED], -M_RMSE)


def _lead(what: str, found: pd.DataFrame, printed: pd.DataFrame) -> Claim:
    """Return where VD is ahead here, and in the paper's table of those datasets that the sequences stand for."""
    ours, theirs = leads(found), leads(beside(printed, found.index))
    known = ours.index.intersection(theirs.index, sort=False)
    return Claim(
        f"of VD, RS and GS, VD has {what} in {counted(theirs)}",
        f"VD has it in {counted(ours)}",
        most_hold(ours[known] == theirs[known]),
        "VD leads or lags as in the paper in more than half of the datasets that the paper has, too",
    )


EXPERIMENT = Experiment(
    question="How near to the truth is the depth that each method gives?",
    answer=answer,
    claims=claims,
    notes=(
        f"The first {SETTLED_FRAMES} frames, in which the first template is made, are left out. The paper's numbers "
        "were measured on other data. PSNR (peak 65535 mm, surfaces within that) and masked RMSE (occluded pixels "
        "within 20 m) are after completion by the nearest valid, and n is pixels. The paper's masked RMSE has no unit: "
        "`rmse` is about it.",
    ),
    sequences=SEQUENCES,
    frames=100,
    least_frames=SETTLED_FRAMES + 1,
    width_px=640,
)
