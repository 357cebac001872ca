"""Text of people: it means the same in every encoding with a mark and any line ends, or is refused with a remedy."""

import codecs
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.recording import Recording
from tests.sequences import CAMERA, SHAPE, toml_of, write_images
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.errors import DatasetError, VoxDepthError, printable
from voxdepth.text import DEEPEST, decoded, parsed_toml
from voxdepth.tools.errors import ToolError
from voxdepth.tools.files import read_toml

Writer = Callable[[str], bytes]
WRITERS: dict[str, Writer] = {
    "Notepad": lambda text: codecs.BOM_UTF8 + text.replace("\n", "\r\n").encode(),
    "PowerShell 5": lambda text: codecs.BOM_UTF16_LE + text.replace("\n", "\r\n").encode("utf-16-le"),
    "big end first": lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
    "UTF-32": lambda text: text.encode("utf-32"),
    "old Mac": lambda text: text.replace("\n", "\r").encode(),
    "Linux": str.encode,
}
REFUSED: dict[str, tuple[Writer, str]] = {
    "Latin-1": (lambda text: f"# Küche\n{text}".encode("latin-1"), "the byte 0xfc in line 1 is no UTF-8: save it as"),
    "UTF-16 without a mark": (lambda text: text.encode("utf-16-le"), "zero bytes, as UTF-16 .* save it as UTF-8"),
    "cut short": (lambda text: codecs.BOM_UTF16_LE + text.encode("utf-16-le")[:-1], "is no UTF-16-LE: save it as"),
}
JSON = '{"width": 8, "height": 6,\n "intrinsic_matrix": [9, 0, 0, 0, 9, 0, 4, 3, 1]}\n'
ROWS = "timestamp_s,r11,r12,r13,tx_m,r21,r22,r23,ty_m,r31,r32,r33,tz_m\n0.5,1,0,0,0,0,1,0,0,0,0,1,0\n"


@pytest.mark.parametrize("writer", WRITERS)
def test_a_text_is_the_same_whoever_wrote_it(writer: str) -> None:
    text = "# Küche, 台所\nfx_px = 7.0\n\n[a]\nb = 'ç'\n"
    assert decoded(WRITERS[writer](text)) == text
    assert parsed_toml(WRITERS[writer](text)) == {"fx_px": 7.0, "a": {"b": "ç"}}
    assert decoded(WRITERS[writer]("")) == ""


@pytest.mark.parametrize("case", REFUSED)
def test_another_encoding_is_refused_with_the_place_and_the_remedy(case: str, tmp_path: Path) -> None:
    written, message = REFUSED[case]
    (tmp_path / "mine.toml").write_bytes(written("fx_px = 7.0\n"))
    with pytest.raises(ToolError, match=rf"mine\.toml is not valid TOML: .*{message}"):
        read_toml(tmp_path / "mine.toml")


def test_deep_toml_is_refused() -> None:
    assert parsed_toml(f"a = {'[' * (DEEPEST - 1)}{']' * (DEEPEST - 1)}".encode())
    for text in (f"a = {'[' * DEEPEST}{']' * DEEPEST}", f"a = {'[' * 9999}{']' * 9999}"):
        with pytest.raises(ValueError, match="deep"):
            parsed_toml(text.encode())


def tum(folder: Path, written: Writer) -> Dataset:
    write_images(folder, {"rgb/a.png": np.zeros(SHAPE, np.uint8), "depth/a.png": np.full(SHAPE, 9000, np.uint16)})
    for name in ("rgb", "depth"):
        (folder / f"{name}.txt").write_bytes(written(f"# Küche\n0.5 {name}/a.png\n"))
    (folder / "calibration.toml").write_bytes(written(toml_of(CAMERA) + "units_per_m = 5000\n"))
    return open_dataset(folder)


def export(folder: Path, written: Writer) -> Dataset:
    write_images(folder, {"color/a1.png": np.zeros(SHAPE, np.uint8), "depth/a1.png": np.full(SHAPE, 1800, np.uint16)})
    (folder / "camera_intrinsic.json").write_bytes(written(JSON))
    (folder / "calibration.toml").write_bytes(written("baseline_m = 0.07\n"))
    return open_dataset(folder)


def recording(folder: Path, written: Writer) -> Dataset:
    depth_m, gray = np.full(SHAPE, 1.8, np.float32), np.zeros(SHAPE, np.uint8)
    write_images(folder, {"depth_raw/000000.tiff": depth_m, "gray_left/000000.png": gray})
    (folder / "calibration.toml").write_bytes(written(toml_of(CAMERA)))
    (folder / "frames.csv").write_bytes(written(ROWS))
    return open_dataset(folder)


@pytest.mark.parametrize("kind", [tum, export, recording])
@pytest.mark.parametrize("writer", WRITERS)
def test_every_file_of_a_dataset_is_read_whoever_wrote_it(
    kind: Callable[[Path, Writer], Dataset], writer: str, tmp_path: Path
) -> None:
    frame = kind(tmp_path, WRITERS[writer])[0]
    np.testing.assert_allclose(frame.depth_m, 1.8, rtol=1e-6)


def test_a_recording_with_its_truth_takes_a_calibration_of_notepad(tmp_path: Path) -> None:
    recording(tmp_path, str.encode)
    (tmp_path / "config.toml").write_text("")
    (tmp_path / "calibration.toml").write_bytes(WRITERS["Notepad"](toml_of(replace(CAMERA, fx_px=7.0))))
    assert Recording.open(tmp_path).intrinsics.fx_px == 7


@pytest.mark.parametrize("case", REFUSED)
def test_a_description_of_another_encoding_is_refused_with_its_file(case: str, tmp_path: Path) -> None:
    written, message = REFUSED[case]
    export(tmp_path, str.encode)
    for name, text in (("calibration.toml", "baseline_m = 0.07\n"), ("camera_intrinsic.json", JSON)):
        kept = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(written(text))
        with pytest.raises(DatasetError, match=rf"{name}.*{message}"):
            open_dataset(tmp_path)
        (tmp_path / name).write_bytes(kept)


def test_names_of_files_that_are_no_utf_8_are_found_and_printed(tmp_path: Path) -> None:
    name = os.fsdecode(b"k\xfcche")
    dataset = tum(tmp_path / name, str.encode)
    assert len(dataset) == 1
    for kind in ("rgb", "depth"):
        (tmp_path / name / f"{kind}/a.png").rename(tmp_path / name / kind / f"{name}.png")
        (tmp_path / name / f"{kind}.txt").write_bytes(b"0.5 " + kind.encode() + b"/k\xfcche.png\r\n")
    assert open_dataset(tmp_path / name)[0].stamp_s == 0.5
    (tmp_path / name / "rgb" / f"{name}.png").unlink()
    with pytest.raises(DatasetError) as caught:
        open_dataset(tmp_path / name)[0]
    assert r"k\udcfcche" in str(caught.value) and str(caught.value).isprintable()
    assert printable(name) == r"k\udcfcche" == str(VoxDepthError(name))
