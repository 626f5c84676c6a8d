"""What is written as PNG is read back by Pillow, exactly."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from langwm_data.png import encode_png, image_address

RNG = np.random.default_rng(0)


def read(data):
    return np.asarray(Image.open(io.BytesIO(data)))


@pytest.mark.parametrize(
    "image",
    [
        RNG.integers(0, 256, (7, 5, 3), dtype=np.uint8),
        RNG.integers(0, 256, (7, 10, 3), dtype=np.uint8)[:, ::2],
        RNG.integers(0, 256, (7, 5), dtype=np.uint8),
        RNG.integers(0, 2**16, (7, 5), dtype=np.uint16),
    ],
    ids=["colour", "not contiguous", "gray", "16 bits"],
)
def test_pillow_reads_the_same_pixels(image):
    np.testing.assert_array_equal(read(encode_png(image)), image)


def test_an_address_holds_the_whole_picture():
    image = RNG.integers(0, 256, (4, 3, 3), dtype=np.uint8)
    kind, _, text = image_address(image).partition(",")
    assert kind == "data:image/png;base64"
    np.testing.assert_array_equal(read(base64.b64decode(text)), image)


@pytest.mark.parametrize("image", [np.zeros((2, 2), np.float32), np.zeros((2, 2, 4), np.uint8)])
def test_what_would_be_written_wrongly_is_our_mistake(image):
    with pytest.raises(AssertionError):
        encode_png(image)
