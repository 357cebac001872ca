"""Correctors by name: ours all work, those of other distributions are found and loaded on request."""

import re
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import date
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest

from tests.plugins import offer
from voxdepth.errors import ConfigError, CorrectorUnavailableError
from voxdepth.paper.config import VoxDepthConfig, authors_config
from voxdepth.registry import (
    BUILTIN_NAMES,
    config_of,
    corrector_names,
    create_bare,
    create_corrector,
    latency_s,
    require_known,
    resolve_config,
    title,
)
from voxdepth.temporal.config import TemporalConfig
from voxdepth.types import Frame, Intrinsics, Source

CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80, baseline_m=0.1)


def holed_frame(stamp_s: float) -> Frame:
    rng = np.random.default_rng(round(stamp_s * 10))
    depth_m = rng.uniform(2, 3, CAMERA.shape).astype(np.float32)
    depth_m[10:20, 30:40] = 0
    return Frame(stamp_s=stamp_s, gray=rng.integers(0, 256, CAMERA.shape, np.uint8), depth_m=depth_m)


@pytest.mark.parametrize("name", BUILTIN_NAMES)
def test_only_the_methods_of_voxdepth_take_a_configuration(name: str) -> None:
    configs = {"temporal": TemporalConfig(), "voxdepth": VoxDepthConfig(), "voxdepth-authors": authors_config()}
    own = configs.get(name)
    assert config_of(name) == own
    if own is None:
        with pytest.raises(ConfigError, match=f"'{name}' takes no configuration; .*one of: voxdepth, "):
            create_corrector(name, CAMERA, TemporalConfig())


def test_a_configuration_or_single_values_of_one_reach_their_corrector() -> None:
    frame = holed_frame(0.0)
    for name, config in (("temporal", {"fill": "none"}), ("voxdepth", VoxDepthConfig(median_size_px=1))):
        own, changed = create_corrector(name, CAMERA), create_corrector(name, CAMERA, config)
        assert (own.process(frame).depth_m > 0).sum() > (changed.process(frame).depth_m > 0).sum()


@pytest.mark.parametrize(
    ("name", "config", "message"),
    [
        ("temporal", VoxDepthConfig(), "TemporalConfig, got .* VoxDepthConfig"),
        ("voxdepth", TemporalConfig(), "VoxDepthConfig, got .* TemporalConfig"),
        ("voxdepth", {"window_frames": 0}, "'voxdepth': window_frames: "),
        ("temporal", {"fill": date(2020, 1, 1)}, "date"),
        ("raw", {}, "'raw' takes no configuration"),
    ],
)
def test_a_wrong_configuration_is_refused(name: str, config: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        create_corrector(name, CAMERA, config)


def test_every_corrector_has_a_simulated_latency() -> None:
    assert latency_s("raw") == 0
    assert all(0 < latency_s(name) < 0.1 for name in BUILTIN_NAMES if name != "raw")


@pytest.mark.parametrize("ask", [latency_s, lambda name: create_corrector(name, CAMERA)])
def test_an_unknown_name_is_answered_with_all_names(ask: Callable[[str], object]) -> None:
    with pytest.raises(ConfigError, match=r"there is no corrector 'magic'; choose one of: raw, .*temporal"):
        ask("magic")


@pytest.fixture
def foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A distribution that offers a corrector that works, two that do not, and one under a name of ours."""
    info = tmp_path / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[voxdepth.correctors]\ntheirs = theirs_good:make\nbroken = theirs_bad:make\ngone = theirs_good:nothing\n"
        "raw = theirs_bad:make\n"
    )
    (tmp_path / "theirs_good.py").write_text(
        "from voxdepth.baselines.single_frame import Raw\n\n\nclass Theirs(Raw):\n    pass\n\n\n"
        "def make(intrinsics):\n    return Theirs()\n"
    )
    (tmp_path / "theirs_bad.py").write_text("raise RuntimeError('no licence')\n")
    monkeypatch.syspath_prepend(tmp_path)
    for module in ("theirs_good", "theirs_bad"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    return tmp_path


def test_another_distribution_adds_a_corrector(foreign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert {"theirs", "broken", "gone"} <= set(corrector_names())
    assert corrector_names().count("raw") == 1
    require_known("theirs")
    assert config_of("theirs") is None
    assert "theirs_good" not in sys.modules, "naming it does not load it"
    with pytest.raises(ConfigError, match="'theirs' has no latency"):
        latency_s("theirs")
    monkeypatch.setattr(sys.modules["theirs_good"].make, "latency_s", 0.25, raising=False)
    assert latency_s("theirs") == 0.25
    assert type(create_corrector("theirs", CAMERA).bare).__name__ == "Theirs"
    for config in (TemporalConfig(), {}):
        with pytest.raises(ConfigError, match="'theirs' takes no configuration"):
            create_corrector("theirs", CAMERA, config)


def test_our_names_win(foreign: Path) -> None:
    assert type(create_bare("raw", CAMERA)).__module__ == "voxdepth.baselines.single_frame"
    assert "theirs_bad" not in sys.modules


@pytest.mark.parametrize(
    ("name", "reason"),
    [("broken", "line 1: RuntimeError: no licence"), ("gone", "AttributeError: module 'theirs_good' has no")],
)
def test_a_corrector_that_cannot_be_loaded_is_named(foreign: Path, name: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=f"'{name}' cannot be loaded: {reason}"):
        create_corrector(name, CAMERA)


def test_the_registry_alone_imports_no_library_and_no_baseline() -> None:
    code = (
        "import sys, voxdepth.registry as r; r.corrector_names(); "
        "print([m for m in sys.modules if m in ('cv2', 'warp', 'pydantic') or m.startswith('voxdepth.baselines')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_example_of_a_plugin_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    offer("median_plugin", tmp_path, monkeypatch)
    corrector = create_corrector("wide-median", CAMERA)
    depth_m = np.ones(CAMERA.shape, np.float32)
    depth_m[3, 3] = 0
    frame = Frame(stamp_s=0.0, gray=np.zeros(CAMERA.shape, np.uint8), depth_m=depth_m)
    corrected = corrector.process(frame)
    corrector.reset()
    assert not corrector.uses_gray
    assert (corrected.depth_m == 1).all()
    assert corrected.source[3, 3] == Source.INPAINTED
    assert latency_s("wide-median") == 0.001


def test_a_frame_that_raised_an_error_may_come_again(monkeypatch: pytest.MonkeyPatch) -> None:
    corrector = create_bare("temporal", CAMERA)
    corrector.process(holed_frame(0.0))
    with monkeypatch.context() as broken:
        broken.setattr(type(corrector), "_align", lambda self, frame: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            corrector.process(holed_frame(1.0))
    corrector.process(holed_frame(1.0))


@pytest.mark.parametrize("name", ["temporal", "voxdepth"])
def test_a_corrector_that_another_thread_uses_is_refused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    corrector = create_bare(name, CAMERA)
    started, go_on = Event(), Event()

    def slow(self: Any, frame: Frame) -> None:
        started.set()
        assert go_on.wait(30)

    monkeypatch.setattr(type(corrector), "_align", slow)
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(corrector.align, holed_frame(0.0))
        assert started.wait(30)
        with pytest.raises(
            CorrectorUnavailableError, match="another thread is using this corrector: make one for each stream"
        ):
            corrector.process(holed_frame(1.0))
        go_on.set()
        first.result()


def test_what_an_error_quotes_of_a_file_cannot_break_its_line_or_control_a_terminal() -> None:
    with pytest.raises(ConfigError) as reported:
        resolve_config("temporal", {"é\n\x1b[2J\u2028": 1})
    assert r"é\n\x1b[2J\u2028" in str(reported.value) and str(reported.value).isprintable()


@pytest.mark.parametrize(
    ("given", "reported"),
    [
        ({"fil": "none"}, "unknown key 'fil' (did you mean fill"),
        ({"shadow_facto": 1.0}, "unknown key 'shadow_facto' (did you mean shadow_factor?); `voxdepth config"),
        ({"zzz": 1}, "unknown key 'zzz'; `voxdepth config temporal` prints all"),
    ],
)
def test_a_mistyped_key_is_reported_with_those_that_may_be_meant(given: dict[str, Any], reported: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(reported)):
        resolve_config("temporal", given)


@pytest.mark.parametrize(
    ("text", "shown"),
    [("voxdepth", "VoxDepth (the paper)"), ("temporal[fill=all]", "temporal[fill=all] (ours)"),
     ("temporal-like", "temporal-like")],
)  # fmt: skip
def test_people_read_whose_the_methods_are(text: str, shown: str) -> None:
    assert title(text) == shown
