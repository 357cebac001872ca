"""An arm that cannot fly is refused before anything flies."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from scenarios.errors import ScenarioError
from scenarios.study.design import load_study
from scenarios.study.executors import Serial
from scenarios.study.run import run_study
from tests.studies import arm, fake, study, unseen
from voxdepth.devices import cuda_devices

NEEDS_A_FILE = """
from pathlib import Path

class Mine:
    uses_gray = False
    latency_s = 0.01

    def __init__(self, intrinsics):
        self.weights = Path("weights.bin").read_bytes()

    def process(self, frame):
        raise NotImplementedError

    def reset(self):
        pass
"""
FAILS_AT_A_FRAME = NEEDS_A_FILE.replace('self.weights = Path("weights.bin").read_bytes()', "pass")
NEEDS_A_DEVICE = FAILS_AT_A_FRAME.replace("raise NotImplementedError", 'raise OSError("no such camera: /dev/npu0")')
NO_CONTROLLER = "def create(role, config):\n    return open('route.txt')\n"
CANNOT_BE_IMPORTED = "import a_package_that_nobody_has\n"


@pytest.mark.parametrize(
    ("module", "code", "values", "message"),
    [
        ("needs_a_file", NEEDS_A_FILE, {"corrector": "needs_a_file:Mine"}, r"needs_a_file:Mine.*weights\.bin"),
        ("fails_at_once", FAILS_AT_A_FRAME, {"corrector": "fails_at_once:Mine"}, "fails_at_once:Mine.*frame at 0"),
        ("needs_a_device", NEEDS_A_DEVICE, {"corrector": "needs_a_device:Mine"}, "needs_a_device:Mine.*npu0"),
        (
            "no_controller",
            NO_CONTROLLER,
            {"changes": {"mission.controller": "no_controller:create"}},
            r"no_controller:create.*route\.txt",
        ),
    ],
)
def test_code_that_cannot_fly_is_refused_with_its_arm_before_the_first_flight(
    module: str, code: str, values: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(f"{module}.py").write_text(code)
    with pytest.raises(ScenarioError, match=f"arm 'odd' cannot fly: .*{message}"):
        run_study(study(arm("fine"), arm("odd", **values)), tmp_path / "out", Serial(fake), unseen)
    assert not (tmp_path / "out").exists(), "a study that was not begun leaves nothing that keeps it from being mended"


@pytest.mark.skipif(bool(cuda_devices()), reason="this machine has the device")
def test_a_device_that_is_not_there_is_refused_with_its_arm(tmp_path: Path) -> None:
    gpu = {"name": "voxdepth", "config": {"device": "cuda"}}
    with pytest.raises(ScenarioError, match=r"arm 'odd' cannot fly: device = 'cuda'"):
        run_study(study(arm("fine"), arm("odd", corrector=gpu)), tmp_path / "out", Serial(fake), unseen)
    assert not (tmp_path / "out").exists()


def test_code_that_cannot_be_imported_is_refused_with_the_file_of_the_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("no_import.py").write_text(CANNOT_BE_IMPORTED)
    odd = study(arm("odd")).model_dump(mode="json", exclude_defaults=True)
    odd["arms"][0]["corrector"] = "no_import:Mine"
    Path("odd.toml").write_text(tomli_w.dumps(odd))
    with pytest.raises(ScenarioError, match=r"odd\.toml: arms\.0\.corrector.*a_package_that_nobody_has"):
        load_study("odd.toml")
