"""Compared with OpenCV, which is the decoder that most of the world uses for these files."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from langwm_data.png import encode_png
from langwm_data.shards.fast_png import decode_unfiltered

SIDES = st.integers(1, 40)
IMAGES = st.one_of(
    hnp.arrays(np.uint8, st.tuples(SIDES, SIDES, st.just(3))), hnp.arrays(np.uint16, st.tuples(SIDES, SIDES))
)
NOISE = np.random.default_rng(0).integers(0, 256, (128, 160, 3), np.uint8)


def opencv(data):
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return image[..., ::-1] if image.ndim == 3 else image


@settings(max_examples=60, deadline=None)
@given(IMAGES)
def test_what_the_generator_writes_is_read_as_opencv_reads_it(image):
    data = encode_png(image)
    read = decode_unfiltered(data, image.dtype.type)
    assert read is not None
    assert read.dtype == image.dtype
    assert read.flags.writeable
    assert read.flags.c_contiguous
    np.testing.assert_array_equal(read, opencv(data))


def test_pixels_in_several_chunks_are_joined():
    data = cv2.imencode(".png", NOISE[..., ::-1], (cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE))[1]
    data = data.tobytes()
    assert data.count(b"IDAT") > 1
    np.testing.assert_array_equal(decode_unfiltered(data, np.uint8), NOISE)


def test_rows_with_filters_and_other_formats_are_left_to_a_general_decoder():
    smooth = np.add.outer(np.arange(16), np.arange(16)).astype(np.uint16)
    filtered = cv2.imencode(".png", smooth, (cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB))[1].tobytes()
    assert decode_unfiltered(filtered, np.uint16) is None
    assert decode_unfiltered(encode_png(smooth), np.uint8) is None
    assert decode_unfiltered(encode_png(smooth.astype(np.uint8)), np.uint16) is None


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 255))
def test_a_changed_byte_never_changes_pixels_unnoticed(place, change):
    data = bytearray(encode_png(NOISE[:9, :7]))
    data[place % len(data)] ^= change
    read = decode_unfiltered(bytes(data), np.uint8)
    assert read is None or (read == NOISE[:9, :7]).all()


@pytest.mark.parametrize("length", [0, 8, 20, 33, 40, 200])
def test_a_file_that_is_cut_off_is_not_read(length):
    assert decode_unfiltered(encode_png(NOISE)[:length], np.uint8) is None
