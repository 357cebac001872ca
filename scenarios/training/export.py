"""A trained network as ONNX with weights of 16 bits, and its card."""

import hashlib
import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import tomli_w
import torch
from onnx import numpy_helper
from torch import nn
from torch.onnx import symbolic_helper

from voxdepth.networks import FORMAT, Network
from voxdepth.tools.files import write

from ..errors import ScenarioError

OPSET = 17
LARGEST_DIFFERENCE = 1e-4
"""Largest difference between the outputs of PyTorch and of ONNX Runtime, in units of the mean disparity or depth."""
SIZES_PX = ((64, 96), (192, 320))
"""Heights and widths at which both are compared."""
EMPTY_SHARE = 0.3
"""Share of the pixels without depth in that comparison."""
SMALLEST_HALVED = 64
"""Tensors of fewer numbers stay as they are."""


def rounded(network: nn.Module) -> None:
    """Round the weights to 16 bits, in place, so that the exported network has the same ones."""
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.numel() >= SMALLEST_HALVED:
                parameter.copy_(parameter.half().float())


def exported(network: nn.Module, channels: int) -> bytes:
    """The ONNX file of a network that takes images of shape (1, channels, h, w)."""
    buffer = io.BytesIO()
    torch.onnx.register_custom_op_symbolic("aten::pixel_unshuffle", _space_to_depth, OPSET)
    with warnings.catch_warnings():  # Of the exporter about itself, and about sizes that are constants on purpose.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network, (torch.rand(1, channels, *SIZES_PX[0]),), buffer, dynamo=False, opset_version=OPSET,
            input_names=["images"], dynamic_axes={"images": {2: "height", 3: "width"}},
        )  # fmt: skip
    model = onnx.load_model_from_string(buffer.getvalue())
    _halve(model.graph)
    onnx.checker.check_model(model)
    content: bytes = model.SerializeToString()
    return content


@symbolic_helper.parse_args("v", "i")  # type: ignore[untyped-decorator]
def _space_to_depth(graph: Any, image: Any, side: int) -> Any:
    """`pixel_unshuffle` of one channel as one operator, which is faster than the transpositions that PyTorch writes."""
    return graph.op("SpaceToDepth", image, blocksize_i=side)


def _halve(graph: onnx.GraphProto) -> None:
    """Store the weights in 16 bits, and convert them to 32 bits where they are used, which happens once."""
    for weights in list(graph.initializer):
        numbers = numpy_helper.to_array(weights)
        if numbers.dtype == np.float32 and numbers.size >= SMALLEST_HALVED:
            name = weights.name
            weights.CopyFrom(numpy_helper.from_array(numbers.astype(np.float16), f"{name}.half"))
            graph.node.insert(0, onnx.helper.make_node("Cast", [f"{name}.half"], [name], to=onnx.TensorProto.FLOAT))


def difference(network: nn.Module, content: bytes, channels: int, seed: int) -> float:
    """The largest difference between the outputs of a module and those of its ONNX file."""
    runtime, generator = Network(content), torch.Generator().manual_seed(seed)
    largest = 0.0
    for size in SIZES_PX:
        images = torch.rand(1, channels, *size, generator=generator)
        images[:, :2] *= images[:, :1] > EMPTY_SHARE
        with torch.no_grad():
            expected = network(images)
        expected = expected if isinstance(expected, tuple) else (expected,)
        for one, other in zip(expected, runtime.run(images.numpy()), strict=True):
            largest = max(largest, float(np.abs(one.numpy() - other).max()))
    return largest


def write_network(folder: Path, name: str, network: nn.Module, channels: int) -> tuple[bytes, dict[str, Any]]:
    """Write `name.onnx`; return it, and what its card states of it.

    Raises:
        ScenarioError: ONNX Runtime gives other results than PyTorch.
        ToolError: The folder cannot be written.
    """
    rounded(network)
    content = exported(network, channels)
    apart = difference(network, content, channels, seed=0)
    if not apart <= LARGEST_DIFFERENCE:
        raise ScenarioError(f"ONNX Runtime and PyTorch differ by {apart:.1e}, expected at most {LARGEST_DIFFERENCE:g}")
    write(folder / f"{name}.onnx", content)
    return content, {
        "format": FORMAT,
        "sha256": hashlib.sha256(content).hexdigest(),
        "bytes": len(content),
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "largest_difference_to_pytorch": float(f"{apart:.1e}"),
        "licence": "MIT, as the project",
    }


def write_card(folder: Path, name: str, facts: Mapping[str, Any]) -> None:
    """Write the card `name.toml`.

    Raises:
        ToolError: The folder cannot be written.
    """
    write(folder / f"{name}.toml", tomli_w.dumps(facts).encode())
