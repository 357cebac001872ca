"""The package as it is installed."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.commands import in_new_process
from tests.evaluation_clips import write_recording
from voxdepth.registry import installed_names
from voxdepth.types import Source

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
LARGEST_FILE_BYTES = 500_000
HEAVY = ("cv2", "numpy", "open3d", "pybullet", "rerun", "warp", "scipy", "matplotlib", "pydantic")


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['voxdepth', '--help']\n"
        "from voxdepth.tools.cli import create_app\ntry: create_app()()\nexcept SystemExit: pass"
    )
    check = f"{code}\nimport sys; print('LOADED', [m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip().splitlines()[-1] == "LOADED []"


def test_every_dependency_is_pinned_to_a_version_alone() -> None:
    pins = (ROOT / "constraints.txt").read_text().splitlines()
    names = {line.split("==")[0].lower().replace("_", "-") for line in pins}
    assert all(line.count("==") == 1 and "@" not in line and "/" not in line for line in pins)
    extras = PROJECT["project"]["optional-dependencies"]
    example = tomllib.loads((ROOT / "examples/learned/pyproject.toml").read_text())
    wanted = [*PROJECT["project"]["dependencies"], *(d for group in extras.values() for d in group)]
    wanted += example["project"]["dependencies"]
    for requirement in wanted:
        name = requirement.split(">")[0].split("[")[0].lower()
        if name != "voxdepth":
            assert name in names, f"{name} is missing in constraints.txt"


def test_the_library_works_without_the_simulator_and_imports_no_runtime_of_networks() -> None:
    code = (
        "import sys\nfor m in ('pybullet', 'open3d', 'rerun', 'typer', 'sim', 'swarm', 'scenarios'):\n"
        "    sys.modules[m] = None\n"
        "import numpy as np\nfrom voxdepth import Frame, Intrinsics, VoxDepth\n"
        "i = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80)\n"
        "v = VoxDepth(i)\n"
        "for k in range(4): r = v.process(Frame(stamp_s=k, gray=np.zeros((48, 64), np.uint8),"
        " depth_m=np.full((48, 64), 2, np.float32)))\n"
        "import voxdepth.baselines.learned\n"
        "print([m for m in ('torch', 'onnx', 'onnxruntime') if m in sys.modules], float(r.depth_m.mean()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().splitlines()[-1] == "[] 2.0"


def test_without_the_testbed_its_commands_say_how_to_get_it() -> None:
    commands = ("experiment", "run", "study")
    code = (
        "import sys\nsys.modules['scenarios'] = None\nfrom voxdepth.tools.cli import main\n"
        f"for command in {commands}:\n    sys.argv = ['voxdepth', command, 'city']\n"
        "    try: main()\n    except SystemExit as end: assert end.code == 2"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for command, line in zip(commands, done.stderr.splitlines(), strict=True):
        assert f"the library alone has no command '{command}'" in line
        assert "run make setup in a clone of the project's repository" in line


SIMULATOR = ("pybullet", "open3d", "gymnasium", "warp")
WITHOUT = """
import sys

class Hiding:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, *rest):
        return None if name.split(".")[0] in {absent!r} else self.finder.find_spec(name, *rest)

sys.meta_path[:] = map(Hiding, sys.meta_path)
"""


@pytest.mark.slow
@pytest.mark.parametrize("absent", [SIMULATOR, (*SIMULATOR, "sim", "swarm", "scenarios")], ids=["checkout", "wheel"])
def test_commands_of_the_library_work_where_nothing_of_the_simulator_is_installed(
    absent: tuple[str, ...], tmp_path: Path
) -> None:
    shutil.rmtree(write_recording(tmp_path / "walk") / "depth_true")
    message = {
        ("evaluate", "--data", "walk", "--methods", "raw,median", "--frames", "3"): "8 results",
        ("correct", "walk", "--out", "corrected"): "report.json are in corrected",
        ("bench", "--size", "160x120"): "machine:",
        ("doctor",): "without",
    }
    refused = {("view", "x.rrd"): "no recording at", ("evaluate", "sim-LN"): "testbed|pybullet"}
    *done, view, evaluate = in_new_process([*message, *refused], cwd=tmp_path, before=WITHOUT.format(absent=absent))
    for found, words in zip(done, message.values(), strict=True):
        assert found.returncode == 0, found
        assert words in found.stdout
    assert "walk-holes" in (tmp_path / "evaluation" / "report.html").read_text()
    for found, words in zip((view, evaluate), refused.values(), strict=True):
        assert found.returncode == 2, found
        assert re.search(words, found.stderr) and len(found.stderr.splitlines()) == 1, found.stderr


WITHOUT_WARP = """
import sys
sys.modules["warp"] = None  # An import of it fails.
import pkgutil
from importlib import import_module
import numpy as np
import voxdepth
from voxdepth import Frame, Intrinsics, VoxDepthConfig, VoxDepth
from voxdepth.devices import cuda_devices
from voxdepth.errors import ConfigError
from voxdepth.registry import create_corrector, installed_names

for module in pkgutil.walk_packages(voxdepth.__path__, "voxdepth."):
    if not module.name.startswith("voxdepth.paper.warp_"):
        import_module(module.name)
camera = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80, baseline_m=0.1)
gray = np.kron(np.random.default_rng(0).integers(0, 256, (12, 16), np.uint8), np.ones((4, 4), np.uint8))
for name in installed_names():
    corrector = create_corrector(name, camera)
    for k in range(16):
        depth_m = np.full(camera.shape, 2, np.float32)
        if k > 9:
            depth_m[20:24, 30:34] = 0
        source = corrector.process(Frame(stamp_s=0.1 * k, gray=gray, depth_m=depth_m)).source
    print(name, source[20:24, 30:34].max())
print(cuda_devices())
try:
    VoxDepth(camera, VoxDepthConfig(device="cuda"))
except ConfigError as error:
    print(error)
"""


@pytest.mark.slow
def test_without_warp_everything_but_cuda_works() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT_WARP], capture_output=True, text=True, check=True)
    *filled, devices, error = done.stdout.strip().splitlines()
    sources = dict(line.split() for line in filled)
    assert tuple(sources) == installed_names()
    assert {name for name, source in sources.items() if source == str(int(Source.INVALID))} == {"raw"}
    assert {name for name, source in sources.items() if source == str(int(Source.MEMORY))} - {"learned"} == {
        "voxdepth",
        "voxdepth-authors",
        "temporal",
    }
    assert devices == "()"
    assert error == "device = 'cuda' needs Warp: pip install 'voxdepth[cuda]', or choose 'cpu'"


def test_no_file_of_the_repository_is_large() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode != 0:
        pytest.skip("needs a clone of the repository")
    sizes = {name: (ROOT / name).stat().st_size for name in listed.stdout.split("\0") if (ROOT / name).is_file()}
    assert sizes and {name: size for name, size in sizes.items() if size > LARGEST_FILE_BYTES} == {}
