"""Memory of images that nobody holds any more is used again, and that of others never."""

import numpy as np

from voxdepth.image_pool import ImagePool


def address(image: np.ndarray) -> int:
    return int(image.__array_interface__["data"][0])


def test_images_have_the_shape_and_type_and_may_be_written() -> None:
    image = ImagePool((3, 5), np.float32).image()
    image[...] = 7
    assert (image.shape, image.dtype) == ((3, 5), np.float32)


def test_memory_is_used_again_when_nobody_holds_the_image() -> None:
    pool = ImagePool((3, 5), np.float32)
    image = pool.image()
    before = address(image)
    del image
    assert address(pool.image()) == before


def test_memory_of_a_held_image_or_of_a_part_of_it_is_not_used_again() -> None:
    pool = ImagePool((3, 5), np.uint8)
    part = pool.image()[1:, ::2].T.view(np.int8)
    buffer = memoryview(pool.image()).cast("B")
    held = pool.image()
    held[...] = 1
    part[...] = 2
    for _ in range(10):
        pool.image()[...] = 3
    assert (held == 1).all() and (part == 2).all()
    assert len(buffer) == 15 and set(buffer) != {3}
