import json
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from langwm_data.png import encode_png
from langwm_data.shards.sample import (
    CAPTION_KEY,
    DEPTH_KEY,
    FILE_KEYS,
    META_KEY,
    RGB_KEY,
    DatasetError,
    decode_sample,
    encode_sample,
    to_metres,
    to_millimetres,
)


def test_a_sample_comes_back_as_it_was(sample_at):
    sample = sample_at("train", 1)
    back = decode_sample({"__key__": sample.key, **encode_sample(sample)})
    assert back.key == sample.key
    assert back.caption == sample.caption
    np.testing.assert_array_equal(back.rgb, sample.rgb)
    np.testing.assert_array_equal(back.instance, sample.instance)
    np.testing.assert_array_equal(to_millimetres(back.depth), to_millimetres(sample.depth))
    assert back.meta == json.loads(json.dumps(sample.meta))
    assert (back.rgb.dtype, back.depth.dtype, back.instance.dtype) == (np.uint8, np.float32, np.uint16)


def test_files_are_what_other_readers_expect(sample_at):
    sample = sample_at("train", 1)
    files = encode_sample(sample)
    assert tuple(files) == FILE_KEYS
    bgr = cv2.imdecode(np.frombuffer(files[RGB_KEY], np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(bgr[..., 2], sample.rgb[..., 0])
    millimetres = cv2.imdecode(np.frombuffer(files[DEPTH_KEY], np.uint8), cv2.IMREAD_UNCHANGED)
    assert millimetres.dtype == np.uint16
    np.testing.assert_allclose(millimetres / 1000, sample.depth, atol=5e-4)


@settings(max_examples=50)
@given(hnp.arrays(np.uint16, (3, 4)))
def test_depth_in_millimetres_survives_the_way_through_metres(millimetres):
    np.testing.assert_array_equal(to_millimetres(to_metres(millimetres)), millimetres)


@given(st.floats(0, 65.5, width=32))
def test_stored_depth_is_right_to_half_a_millimetre(depth_m):
    (stored,) = to_metres(to_millimetres(np.array([depth_m], np.float32)))
    assert abs(stored - depth_m) < 0.00051


def test_depth_that_16_bits_cannot_hold_is_invalid():
    depth = np.array([65.535, 65.536, 1e6], np.float32)
    assert to_millimetres(depth).tolist() == [65535, 0, 0]


def test_same_keys_and_types_in_every_sample(sample_at):
    def shape(value):
        if isinstance(value, dict):
            return {k: shape(v) for k, v in value.items()}
        return type(value)

    metas = [json.loads(encode_sample(sample_at("train", n))[META_KEY]) for n in range(6)]
    assert all(shape(m) == shape(metas[0]) for m in metas)
    objects = [shape(o) for m in metas for o in m["objects"]]
    assert all(o == objects[0] for o in objects)
    assert all("null" not in json.dumps(m) for m in metas)


def test_a_missing_file_is_named(sample_at):
    files = encode_sample(sample_at("train", 1))
    del files[DEPTH_KEY]
    with pytest.raises(DatasetError, match=r"sample 'a' lacks depth\.png"):
        decode_sample({"__key__": "a", **files})


@pytest.mark.parametrize(
    "data", [b"", b"nonsense", cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes()]
)
def test_a_file_that_is_no_16_bit_png_is_refused(sample_at, data):
    files = encode_sample(sample_at("train", 1)) | {DEPTH_KEY: data}
    with pytest.raises(DatasetError, match=r"sample 'a': depth\.png is not a PNG of uint16"):
        decode_sample({"__key__": "a", **files})


def test_broken_json_is_refused(sample_at):
    files = encode_sample(sample_at("train", 1)) | {META_KEY: b"{"}
    with pytest.raises(DatasetError, match="sample 'a': json is not JSON"):
        decode_sample({"__key__": "a", **files})


def test_texts_that_are_none_are_refused(sample_at):
    files = encode_sample(sample_at("train", 1))
    with pytest.raises(DatasetError, match="sample 'a': json is not a JSON object"):
        decode_sample({"__key__": "a", **files, META_KEY: b"[]"})
    with pytest.raises(DatasetError, match="sample 'a': txt is not UTF-8"):
        decode_sample({"__key__": "a", **files, CAPTION_KEY: b"\xff"})


def test_a_picture_that_would_fill_the_memory_is_not_unpacked(sample_at):
    files = encode_sample(sample_at("train", 1))
    bomb = files[RGB_KEY][:16] + struct.pack(">II", 30_000, 30_000) + files[RGB_KEY][24:]
    with pytest.raises(DatasetError, match=r"rgb\.png is larger than 2048 pixels on a side"):
        decode_sample({"__key__": "a", **files, RGB_KEY: bomb})


def test_images_of_different_sizes_are_refused(sample_at):
    files = encode_sample(sample_at("train", 1))
    small = encode_png(np.zeros((4, 5), np.uint16))
    with pytest.raises(DatasetError, match=r"its images have sizes \(24, 32\), \(4, 5\) and \(24, 32\)"):
        decode_sample({"__key__": "a", **files, DEPTH_KEY: small})
