"""Twins of the loops over the images of the default method: the same steps as NumPy expressions over whole images."""

from typing import NamedTuple

import cv2
import numpy as np

from voxdepth.geometry import inverse_rigid
from voxdepth.temporal.confidence import ERROR_PX, INPAINTED_ERROR_PX, SURFACE_PROBABILITY
from voxdepth.temporal.forward_warp import HOLE_PX, Warped
from voxdepth.temporal.fusion import MAX_MAGNIFICATION, Comparison, Fused, PixelClass, TemporalFusionConfig
from voxdepth.temporal.measurement import Measurement
from voxdepth.temporal.memory import WEIGHT_UNIT, Memory
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatArray, FloatImage, GrayImage, MaskImage


def mask(where: MaskImage) -> GrayImage:
    return np.where(where, 255, 0).astype(np.uint8)


def disparity(depth_m: FloatImage, focal_baseline_px_m: float) -> FloatImage:
    with np.errstate(divide="ignore", over="ignore"):
        disparity_px = np.float32(focal_baseline_px_m) / depth_m
    return np.where((disparity_px > 0) & (disparity_px <= 1000), disparity_px, np.float32(0))


def depth(disparity_px: FloatImage, focal_baseline_px_m: float) -> FloatImage:
    valid = disparity_px >= np.float32(1e-4)
    return np.where(valid, np.float32(focal_baseline_px_m) / np.where(valid, disparity_px, 1), 0).astype(np.float32)


# measurement


def decimate(depth_m: FloatImage, focal_baseline_px_m: float) -> tuple[FloatImage, GrayImage]:
    """Disparity and validity of the whole blocks of two by two pixels."""
    four_m = np.stack([depth_m[row : depth_m.shape[0] // 2 * 2 : 2, col : depth_m.shape[1] // 2 * 2 : 2]
                       for row, col in ((0, 0), (0, 1), (1, 0), (1, 1))])  # fmt: skip
    four_px = disparity(four_m, focal_baseline_px_m)
    n_valid = np.count_nonzero(four_px, axis=0)
    mean_px = four_px.sum(axis=0) / np.maximum(n_valid, 1).astype(np.float32)
    near_px, far_px = four_px.max(axis=0), disparity(four_m.max(axis=0), focal_baseline_px_m)
    surface_px = np.where(near_px - mean_px < mean_px - far_px, near_px, far_px)
    validity = np.rint(255 * np.sqrt(n_valid / 4)).astype(np.uint8)
    return np.where(near_px - far_px < 1, mean_px, surface_px), validity


# fusion


def units(measurements: float) -> int:
    """A number of measurements as a weight."""
    return round(WEIGHT_UNIT * measurements)


def tolerance(memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> FloatImage:
    larger_px = np.maximum(measurement.disparity_px, memory.disparity_px)
    return np.float32(config.tolerance_px) + np.float32(config.relative_tolerance) * larger_px


def subtract(memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> tuple[GrayImage, FloatImage]:
    """Mask of the overlap, and the clipped difference there."""
    tolerance_px = tolerance(memory, measurement, config)
    overlap = (measurement.disparity_px > 0) & (memory.weight > 0)
    clipped_px = np.clip(measurement.disparity_px - memory.disparity_px, -tolerance_px, tolerance_px)
    return mask(overlap), np.where(overlap, clipped_px, np.float32(0))


def find_contradictions(
    memory: Memory, measurement: Measurement, overlap: GrayImage, bias_px: FloatImage, share: GrayImage,
    config: TemporalFusionConfig,
) -> tuple[GrayImage, GrayImage, GrayImage]:  # fmt: skip
    """Masks of the pixels that agree, that show a nearer surface, and a farther one."""
    difference_px = measurement.disparity_px - memory.disparity_px
    within = abs(difference_px) < tolerance(memory, measurement, config)
    unbiased = abs(bias_px) < np.float32(config.max_bias_px) / np.float32(255) * share.astype(np.float32)
    agreeing = (overlap > 0) & within & unbiased
    contradicting = (overlap > 0) & ~agreeing
    return mask(agreeing), mask(contradicting & (difference_px > 0)), mask(contradicting & (difference_px < 0))


def update_drift(
    before_px: FloatImage, mean_px: FloatImage, mean_count: FloatImage, config: TemporalFusionConfig
) -> tuple[FloatImage, FloatImage]:
    """The drift, and the factor of the memory's weight."""
    now_px = mean_px / np.maximum(mean_count / np.float32(255), np.float32(0.1))
    drift_px = before_px + np.float32(config.drift_gain) * (now_px - before_px)
    approach = np.maximum(drift_px, 0) / np.float32(config.max_drift_px)
    return drift_px, np.maximum(1 - np.square(approach), 0)


def sparse_median(image: GrayImage) -> int:
    return int(np.percentile(image[::4, ::4], 50, method="inverted_cdf"))


class Masks(NamedTuple):
    """What memory and measurement of each pixel are to each other. The masks are disjoint."""

    agreeing: MaskImage
    occluding: MaskImage
    free_space: MaskImage
    outlier: MaskImage
    new: MaskImage


def classify(
    weight: GrayImage, memory: Memory, measurement: Measurement, comparison: Comparison, config: TemporalFusionConfig
) -> Masks:
    known, valid = weight > 0, measurement.disparity_px > 0
    agreeing = comparison.agreeing > 0
    contradicting, min_share = known & valid & ~agreeing, 255 * config.min_coherence
    nearer = contradicting & (measurement.disparity_px > memory.disparity_px) & (comparison.nearer > min_share)
    farther = contradicting & (measurement.disparity_px < memory.disparity_px) & (comparison.farther > min_share)
    rejected, evident = contradicting & ~nearer & ~farther, weight >= units(config.min_evidence)
    return Masks(agreeing, nearer, farther, rejected & evident, valid & ~known | rejected & ~evident)


def fuse_pixels(
    memory: Memory, measurement: Measurement, comparison: Comparison, gray_change: GrayImage, max_gray_change: float,
    config: TemporalFusionConfig,
) -> tuple[Fused, Memory]:  # fmt: skip
    """The fused frame and the memory after it, whose drift is left as it is."""
    valid = measurement.disparity_px > 0
    disappeared = ~valid & (gray_change > np.float32(max_gray_change))
    weight = np.where(disappeared, np.uint8(0), memory.weight)
    pixels = classify(weight, memory, measurement, comparison, config)
    measured = pixels.new | pixels.occluding | pixels.free_space
    required = np.rint(WEIGHT_UNIT * np.minimum(config.min_evidence_per_frame * memory.age, config.min_evidence))
    hole = ~valid & (weight > 0) & (weight >= np.minimum(required, 255))

    total = measurement.weight.astype(np.float32) + comparison.memory_factor * weight.astype(np.float32)
    gain = measurement.weight.astype(np.float32) / np.maximum(total, 1)
    mean_px = memory.disparity_px + gain * (measurement.disparity_px - memory.disparity_px)
    kept_px = np.where(pixels.agreeing, mean_px, memory.disparity_px)

    grown = np.minimum(weight.astype(int) + measurement.weight, units(config.max_evidence))
    losses = [units(decay) for decay in (config.decay_occluded, config.decay_free_space, config.decay_outlier)]
    loss = np.select([pixels.occluding, pixels.free_space, pixels.outlier], losses, 0)
    decayed = np.where(pixels.agreeing, grown, np.maximum(weight.astype(int) - loss, 0)).astype(np.uint8)
    replaced = pixels.new | ((pixels.occluding | pixels.free_space) & (decayed == 0))
    updated_weight = np.where(replaced, measurement.weight, decayed)
    updated_px = np.where(replaced, measurement.disparity_px, kept_px)

    approach = np.ones_like(memory.disparity_px)
    np.divide(memory.disparity_px, memory.seen_px, where=memory.seen_px > 0, out=approach)
    classes = PixelClass.FUSED, PixelClass.MEASURED, PixelClass.REMEMBERED
    fused = Fused(
        disparity_px=np.select([measured, valid], [measurement.disparity_px, kept_px], np.float32(0)),
        pixel_class=np.select([pixels.agreeing, measured, pixels.outlier], classes, PixelClass.UNKNOWN),
        weight=np.where(measured, measurement.weight, decayed),
        remembered_px=np.where(hole, memory.disparity_px, 0),
        magnification=np.clip(np.square(approach), 1, MAX_MAGNIFICATION),
    )
    return fused, Memory(
        disparity_px=np.where(updated_weight > 0, updated_px, 0),
        weight=updated_weight,
        gray=np.where(pixels.agreeing | replaced, measurement.gray, memory.gray),
        seen_px=np.where(pixels.agreeing | replaced, updated_px, memory.seen_px),
        age=np.where(replaced, 1, np.minimum(memory.age.astype(int) + 1, 255)),
        drift_px=memory.drift_px,
        filled_px=memory.filled_px,
    )


def fuse(memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> tuple[Fused, Memory]:
    """All steps of the fusion."""
    gray_change = cv2.blur(cv2.absdiff(memory.gray, measurement.gray), (5, 5))
    overlap, difference_px = subtract(memory, measurement, config)
    bias_px, share = cv2.blur(difference_px, (5, 5)), cv2.blur(overlap, (5, 5))
    agreeing, *contradicting = find_contradictions(memory, measurement, overlap, bias_px, share, config)
    coarse = memory.drift_px.shape[::-1]
    count, total_px = (
        cv2.blur(cv2.resize(image, coarse, interpolation=cv2.INTER_AREA).astype(np.float32), (3, 3))
        for image in (overlap, difference_px)
    )
    drift_px, factor = update_drift(memory.drift_px, total_px, count, config)
    factor = cv2.resize(factor, overlap.shape[::-1], interpolation=cv2.INTER_LINEAR)
    comparison = Comparison(agreeing, *(cv2.blur(image, (5, 5)) for image in contradicting), factor)
    max_gray_change = max(config.max_gray_change_hole, 5.0 * max(1, sparse_median(gray_change)))
    fused, updated = fuse_pixels(memory, measurement, comparison, gray_change, max_gray_change, config)
    return fused, updated._replace(drift_px=drift_px)


# forward warp


def reprojection(resolution: WorkingResolution, T_target_source: FloatArray) -> FloatImage:
    """`(H | e)`, shape (3, 4)."""
    K, R, t = resolution.K, T_target_source[:3, :3], T_target_source[:3, 3]
    return np.column_stack([K @ R @ np.linalg.inv(K), K @ t / resolution.focal_baseline_px_m]).astype(np.float32)


def move(reprojection: FloatImage, disparity_px: FloatImage) -> tuple[FloatImage, FloatImage, FloatImage]:
    """Columns, rows and inverse depth ratios of the moved pixels; all are 0 behind the camera."""
    row, col = np.indices(disparity_px.shape, np.float32)
    x, y, ratio = (e * disparity_px + (a * col + c) + b * row for a, b, c, e in reprojection)
    in_front = ratio > np.float32(1e-3)
    inverse = np.where(in_front, np.float32(1) / np.where(in_front, ratio, 1), np.float32(0))
    return x * inverse, y * inverse, inverse


def splat(disparity_px: FloatImage, weight: GrayImage, forward: FloatImage) -> tuple[np.ndarray, FloatImage]:
    """Keys of the z-buffer, with a border of one pixel; and the disparity with holes marked."""
    height, width = disparity_px.shape
    x, y, inverse = move(forward, disparity_px)
    row, col = (np.clip(np.rint(at), -1, side).astype(int) + 1 for at, side in ((y, height), (x, width)))
    target_px = disparity_px * inverse
    fixed_point = np.where(target_px <= 1000, np.rint(target_px * np.float32(2**14)), 0).astype(np.uint32)
    keys = np.zeros((height + 2, width + 2), np.uint32)
    np.maximum.at(keys, (row, col), fixed_point * np.uint32(256) + weight)
    return keys, np.where(disparity_px > 0, disparity_px, HOLE_PX)


def read_keys(keys: np.ndarray) -> tuple[FloatImage, GrayImage]:
    fixed_point, weight = np.divmod(keys[1:-1, 1:-1], np.uint32(256))
    return fixed_point.astype(np.float32) / np.float32(2**14), np.where(fixed_point > 0, weight, 0).astype(np.uint8)


def trace_back(
    seen_px: FloatImage, seen_weight: GrayImage, closed_px: FloatImage, closed_weight: GrayImage, backward: FloatImage
) -> Warped:
    disparity_px = np.where(seen_px > 0, seen_px, closed_px)
    weight = np.where(seen_px > 0, seen_weight, closed_weight)
    x, y, _ = move(backward, disparity_px)
    return Warped(disparity_px, weight, x, y)


def resample(sampled_px: FloatImage, disparity_px: FloatImage, backward: FloatImage, forward: FloatImage) -> FloatImage:
    _, _, inverse = move(backward, disparity_px)
    ratio = (sampled_px - disparity_px * inverse) * forward[2, 3] + inverse
    resampled_px = sampled_px / np.maximum(ratio, np.float32(1e-3))
    is_same = (abs(resampled_px - disparity_px) < np.float32(0.6)) & (disparity_px > 0)
    return np.where(is_same, resampled_px, disparity_px)


def warp(
    disparity_px: FloatImage, weight: GrayImage, resolution: WorkingResolution, T_target_source: FloatArray
) -> Warped:
    """All steps of the forward warp."""
    forward = reprojection(resolution, T_target_source)
    backward = reprojection(resolution, inverse_rigid(T_target_source))
    keys, marked_px = splat(disparity_px, weight, forward)
    seen = read_keys(keys)
    closed = (cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) for image in seen)
    warped = trace_back(*seen, *closed, backward)
    sampled_px = cv2.remap(
        marked_px, warped.source_x, warped.source_y, cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=float(HOLE_PX),
    )  # fmt: skip
    return warped._replace(disparity_px=resample(sampled_px, warped.disparity_px, backward, forward))


def decimate_position(position: FloatImage) -> FloatImage:
    """Positions of the drift, whose pixel 0 lies between the pixels 0 and 1 of the memory."""
    height, width = position.shape[0] // 2, position.shape[1] // 2
    total = sum(
        (position[row : 2 * height : 2, col : 2 * width : 2] for row in (0, 1) for col in (0, 1)), np.float32(0)
    )
    return (total / np.float32(4) - np.float32(0.5)) / np.float32(2)


# confidence, smoothing and upsampling


def confidence(
    disparity_px: FloatImage,
    pixel_class: GrayImage,
    weight: GrayImage,
    magnification: FloatImage,
    inpainting_probability: FloatImage,
) -> FloatArray:
    """Confidence in double precision. The curves are read at quarters of a measurement."""
    n_measurements = (weight // 4) / 4
    known = [pixel_class == each for each in SURFACE_PROBABILITY]
    surface = np.select(known, [curve.at(n_measurements) for curve in SURFACE_PROBABILITY.values()], 1)
    error_px = np.select(known, [curve.at(n_measurements) for curve in ERROR_PX.values()], INPAINTED_ERROR_PX)
    error_px = error_px * np.where(pixel_class == PixelClass.REMEMBERED, magnification, 1)
    right = 1 - np.exp(-0.05 * np.maximum(disparity_px.astype(np.float64), 5) / error_px)
    return surface * inpainting_probability * right


def smooth(disparity_px: FloatImage, mean_px: FloatImage, mean_square_px2: FloatImage, noise_px2: float) -> FloatImage:
    variance_px2 = np.maximum(mean_square_px2 - np.square(mean_px), 0)
    gain = variance_px2 / (variance_px2 + np.float32(noise_px2))
    return np.where(disparity_px > 0, mean_px + gain * (disparity_px - mean_px), 0)
