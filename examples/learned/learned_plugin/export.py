"""The network as ONNX with weights of 16 bits."""

import io
import warnings
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch.onnx import symbolic_helper

from voxdepth.networks import Network

from .network import INPUTS, Corrector

OPSET = 17
SIZES_PX, LARGEST_DIFFERENCE = ((64, 96), (192, 320)), 1e-4
"""Heights and widths at which PyTorch and ONNX Runtime are compared, and how far they may differ."""
SMALLEST_HALVED = 64
"""Tensors of fewer numbers keep 32 bits."""


def exported(network: Corrector) -> bytes:
    """Round the weights to 16 bits, in place, and return the ONNX file; it takes images (1, INPUTS, h, w).

    Raises:
        RuntimeError: ONNX Runtime gives other results than PyTorch.
    """
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.numel() >= SMALLEST_HALVED:
                parameter.copy_(parameter.half().float())
    buffer = io.BytesIO()
    torch.onnx.register_custom_op_symbolic("aten::pixel_unshuffle", _space_to_depth, OPSET)
    with warnings.catch_warnings():  # Of the exporter about itself, and about sizes that are constants on purpose.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network, (torch.rand(1, INPUTS, *SIZES_PX[0]),), buffer, dynamo=False, opset_version=OPSET,
            input_names=["images"], dynamic_axes={"images": {2: "height", 3: "width"}},
        )  # fmt: skip
    model = onnx.load_model_from_string(buffer.getvalue())
    for weights in list(model.graph.initializer):  # They become 32 bits where they are used, which happens once.
        numbers, name = numpy_helper.to_array(weights), weights.name
        if numbers.dtype == np.float32 and numbers.size >= SMALLEST_HALVED:
            weights.CopyFrom(numpy_helper.from_array(numbers.astype(np.float16), f"{name}.half"))
            cast = onnx.helper.make_node("Cast", [f"{name}.half"], [name], to=onnx.TensorProto.FLOAT)
            model.graph.node.insert(0, cast)
    onnx.checker.check_model(model)
    content: bytes = model.SerializeToString()
    if not (apart := difference(network, content)) <= LARGEST_DIFFERENCE:
        raise RuntimeError(f"ONNX Runtime and PyTorch differ by {apart:.1e}, expected at most {LARGEST_DIFFERENCE:g}")
    return content


@symbolic_helper.parse_args("v", "i")
def _space_to_depth(graph: Any, image: Any, side: int) -> Any:
    """Return `pixel_unshuffle` of a channel as one operator, faster than the transpositions that PyTorch writes."""
    return graph.op("SpaceToDepth", image, blocksize_i=side)


def difference(network: Corrector, content: bytes) -> float:
    """Return the largest difference between the outputs of PyTorch and those of ONNX Runtime."""
    runtime, generator, largest = Network(content), torch.Generator().manual_seed(0), 0.0
    for size in SIZES_PX:
        images = torch.rand(1, INPUTS, *size, generator=generator)
        images[:, :2] *= images[:, :1] > 0.3  # Some pixels have no measurement.
        with torch.no_grad():
            expected = network(images)
        for one, other in zip(expected, runtime.run(images.numpy()), strict=True):
            largest = max(largest, float(np.abs(one.numpy() - other).max()))
    return largest
