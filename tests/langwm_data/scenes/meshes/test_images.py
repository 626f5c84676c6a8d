import struct
import zlib

import cv2
import numpy as np
import pytest

from langwm_data.scenes.meshes import images
from langwm_data.scenes.meshes.images import image_size, texture_png


def picture(height, width, channels=3, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, channels), np.uint8)


def encoded(image, kind=".png"):
    return cv2.imencode(kind, image)[1].tobytes()


def decoded(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


def test_a_small_texture_keeps_its_pixels():
    image = picture(20, 30)
    assert (decoded(texture_png(encoded(image), "x.png")) == image).all()


def test_alpha_is_kept_only_where_something_is_cut_out():
    image = picture(20, 30, 4)
    assert (decoded(texture_png(encoded(image), "x.png")) == image).all()
    image[..., 3] = 255
    assert decoded(texture_png(encoded(image), "x.png")).shape == (20, 30, 3)


def test_gray_and_deep_pictures_become_colour():
    gray = picture(8, 9, 1)
    assert (decoded(texture_png(encoded(gray), "x.png")) == np.repeat(gray, 3, axis=2)).all()
    deep = gray.astype(np.uint16) * 257
    assert (decoded(texture_png(encoded(deep), "x.png")) == np.repeat(gray, 3, axis=2)).all()


def test_large_textures_are_shrunk_and_keep_their_mean():
    image = picture(600, 1200)
    small = decoded(texture_png(encoded(image), "x.png"))
    assert small.shape == (256, 512, 3)
    assert small.mean() == pytest.approx(image.mean(), abs=1)


@pytest.mark.parametrize("kind", [".png", ".jpg"])
def test_the_head_states_the_size_that_opencv_decodes(kind):
    assert image_size(encoded(picture(33, 47), kind), "x") == (47, 33)


def huge_png():
    head = struct.pack(">IIBBBBB", 2**20, 2**20, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + b"IHDR" + head + struct.pack(">I", zlib.crc32(b"IHDR" + head))
    return b"\x89PNG\r\n\x1a\n" + chunk


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"GIF89a", "a texture that is neither PNG nor JPEG"),
        (huge_png(), r"a texture of 1048576 x 1048576 pixels; at most 67108864 in all are read"),
        (huge_png()[:20], "a texture that breaks off in its head"),
        (b"\xff\xd8\xff\xe0\x00", "a texture that breaks off in its head"),
        (encoded(picture(9, 9))[:60], "a damaged texture"),
    ],
)
def test_what_is_no_texture_is_refused(data, sentence):
    with pytest.raises(ValueError, match=f"^x.png: {sentence}"):
        texture_png(data, "x.png")


def test_a_texture_of_too_many_bytes_is_refused(monkeypatch):
    monkeypatch.setattr(images, "MAX_BYTES", 5)
    with pytest.raises(ValueError, match=r"x.png: \d+ bytes of texture; at most 5 are read"):
        texture_png(encoded(picture(9, 9)), "x.png")
