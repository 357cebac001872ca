"""Whether results depend on the processor: all workloads under settings of its features, each in a new process.

    python -m tests.portable [--setting NAME ...] [--workload NAME ...] [--short]

The first setting changes nothing. What differs from it under another one is printed with its size, and a workload that
is promised equal and differs ends this with exit status 1. Settings that the processor lacks are named and left out.
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.outputs import Difference, compute, difference, kept
from voxdepth.errors import ConfigError, VoxDepthError

ROOT = Path(__file__).parents[1]
SETTINGS: Mapping[str, Mapping[str, str]] = {
    "as it is": {},
    "OpenBLAS Prescott": {"OPENBLAS_CORETYPE": "Prescott"},
    "OpenBLAS Nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "OpenBLAS Sandybridge": {"OPENBLAS_CORETYPE": "Sandybridge"},
    "OpenBLAS Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "OpenBLAS Zen": {"OPENBLAS_CORETYPE": "Zen"},
    "OpenBLAS SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},
    "NumPy x86-64-v3": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"},
    "NumPy x86-64-v2": {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"},
    "OpenCV SSE4": {"OPENCV_CPU_DISABLE": "AVX512-SKX,AVX2,FMA3,FP16,AVX", "OPENCV_IPP": "sse42"},
    "OpenCV without IPP": {"OPENCV_IPP": "disabled"},
    "Numba x86-64": {"NUMBA_CPU_NAME": "x86-64"},
    "libm without FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F"},
    "one thread": dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
}
"""Features of the processor that libraries may use, by the environment that says so when they are loaded."""
NEEDS = {"OpenBLAS SkylakeX": "AVX512_SKX", "OpenBLAS Haswell": "AVX2", "OpenBLAS Zen": "AVX2"}
"""The feature without which the processor cannot run what a setting asks for, by its name in NumPy."""
EXPECTED: Mapping[str, str] = {
    "corrector ip-basic": "OpenCV's bilateral filter",
    "corrector learned": "ONNX Runtime",
}
"""Workloads that may depend on the processor, with the cause; docs/limits.md says by how much."""
NOT_PROMISED = ("libm without FMA",)
"""Settings of processors that are older than 2015: what differs is shown."""
SHORT_SETTINGS = ("as it is", "OpenBLAS Prescott", "NumPy x86-64-v2")
SHORT_WORKLOADS = ("sensor raster", "corrector temporal", "corrector voxdepth", "flight pillars", "recording of paper")


def environment(setting: str) -> dict[str, str]:
    """The environment of a process under a setting: this one without any other setting."""
    others = {name for changes in SETTINGS.values() for name in changes}
    return {name: value for name, value in os.environ.items() if name not in others} | dict(SETTINGS[setting])


def has(setting: str) -> bool:
    """Whether the processor can run under a setting."""
    from numpy._core._multiarray_umath import __cpu_features__  # The list that NumPy's own dispatch goes by.

    return setting not in NEEDS or bool(__cpu_features__.get(NEEDS[setting], False))


def computed(settings: Sequence[str], workloads: Sequence[str], folder: Path, processes: int) -> None:
    """Compute workloads under settings, some at a time, into a folder for each setting."""
    with ThreadPoolExecutor(processes) as pool:
        running = [
            pool.submit(compute, ROOT, folder / setting, workloads, environment(setting)) for setting in settings
        ]
    for one in running:
        one.result()


def differences(settings: Sequence[str], workloads: Sequence[str], processes: int) -> dict[str, list[Difference]]:
    """What differs from the first setting under each other one."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        computed(settings, workloads, folder, processes)
        first, *others = settings
        return {
            other: [
                found
                for workload in workloads
                if (found := difference(workload, kept(folder / first, workload), kept(folder / other, workload)))
            ]
            for other in others
        }


def chosen(names: Sequence[str], known: Sequence[str], what: str) -> list[str]:
    """Some names of a table, or all of it; an unknown one is a `ConfigError`."""
    for name in names:
        if name not in known:
            raise ConfigError(f"there is no {what} {name!r}: expected one of {', '.join(known)}")
    return list(names or known)


def report(settings: Sequence[str], workloads: Sequence[str], processes: int) -> bool:
    """Print what differs; return whether every workload that is promised equal is."""
    found = differences(settings, workloads, processes)
    for setting, those in found.items():
        print(f"{setting}: {len(workloads) - len(those)} of {len(workloads)} workloads are equal to the bit")
        for one in sorted(those, key=lambda each: -each.size):
            print(f"  {one}{f' (expected: {EXPECTED[one.workload]})' if one.workload in EXPECTED else ''}")
    differing = {one.workload for those in found.values() for one in those}
    broken = {one.workload for setting in found if setting not in NOT_PROMISED for one in found[setting]}
    print(f"equal under all {len(settings)} settings: {len(workloads) - len(differing)} of {len(workloads)} workloads")
    return broken <= set(EXPECTED)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare workloads under settings; return the exit status."""
    from tests.workloads import WORKLOADS

    parser = argparse.ArgumentParser(prog="python -m tests.portable", description=__doc__.splitlines()[0])
    parser.add_argument("--setting", action="append", default=[], help="a setting beside the first one; default: all")
    parser.add_argument("--workload", action="append", default=[], help="a workload; default: all of them")
    parser.add_argument("--short", action="store_true", help="the settings and workloads of make test")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="processes at a time")
    given = parser.parse_args(arguments)
    first = next(iter(SETTINGS))
    requested = list(SHORT_SETTINGS[1:]) if given.short and not given.setting else given.setting
    try:
        settings = chosen(requested, list(SETTINGS), "setting")
        workloads = chosen(given.workload or (SHORT_WORKLOADS if given.short else ()), list(WORKLOADS), "workload")
        for setting in (each for each in settings if not has(each)):
            unsupported = f"{setting} needs {NEEDS[setting]}, which this processor does not have"
            if given.setting:
                raise ConfigError(f"{unsupported}: leave it out, or run it on another machine")
            print(f"left out: {unsupported}")
        able = [first, *(setting for setting in settings if has(setting) and setting != first)]
        return 0 if report(able, workloads, given.processes) else 1
    except VoxDepthError as error:
        print(f"portable: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
