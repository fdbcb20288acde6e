"""Images of bags in the encodings of cheap cameras and of image_transport: Bayer mosaics and depth packed by RVL."""

from __future__ import annotations

import struct
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs_sources.bags.messages import color_of, depth_of, shift_of
from rhs_sources.bags.rvl import unpacked_rvl
from rhs_sources.replay_images import UnreadableImage


def packed(depth):
    """RVL as Wilson's paper writes it, pixel by pixel; width and height before it, as image_transport does."""
    nibbles = []

    def number(value):
        while True:
            low, value = value & 7, value >> 3
            nibbles.append(low | 8 if value else low)
            if not value:
                return

    flat, at, last = depth.ravel().astype(int).tolist(), 0, 0
    while at < len(flat):
        end = next((k for k in range(at, len(flat)) if flat[k]), len(flat))
        number(end - at)
        stop = next((k for k in range(end, len(flat)) if not flat[k]), len(flat))
        number(stop - end)
        for value in flat[end:stop]:
            step = value - last
            number(2 * step if step >= 0 else -2 * step - 1)
            last = value
        at = stop
    nibbles += [0] * (-len(nibbles) % 8)
    words = [sum(nibble << (28 - 4 * k) for k, nibble in enumerate(nibbles[i: i + 8])) for i in range(0, len(nibbles), 8)]
    return struct.pack(f"<II{len(words)}I", depth.shape[1], depth.shape[0], *words)


def bytes_of(data):
    return np.frombuffer(data, np.uint8)


@pytest.mark.parametrize(("encoding", "order"), [("yuv422", "UYVY"), ("uyvy", "UYVY"), ("yuv422_yuy2", "YUYV"),
                                                 ("yuyv", "YUYV")])
def test_two_pixels_that_share_their_colour_are_red_and_half_as_bright(encoding, order):
    """BT.601, 16 to 235: red is Y 81, U 90, V 240; another 81 - 29 of brightness beside it takes away 1.164 * 29."""
    values = {"U": [90], "V": [240], "Y": [81, 52]}
    row = [values[letter].pop(0) for letter in order]
    message = SimpleNamespace(encoding=encoding, height=2, width=2, step=4, is_bigendian=0,
                              data=np.array(row * 2, np.uint8))
    np.testing.assert_allclose(color_of(message, "/image")[0], [[255, 0, 0], [221, 0, 0]], atol=3)
    message.width = 1
    with pytest.raises(ConfigError, match="expected an even number"):
        color_of(message, "/image")


@pytest.mark.parametrize(("encoding", "order"), [("nv12", (90, 240)), ("nv21", (240, 90))])
def test_four_pixels_that_share_their_colour_are_red_and_a_cut_image_is_lost(encoding, order):
    """Rows of brightness that end in padding, then one of colour, U and V by turns or V and U."""
    rows = np.array([[81, 52, 0], [81, 81, 0], [*order, 0]], np.uint8)
    message = SimpleNamespace(encoding=encoding, height=2, width=2, step=3, is_bigendian=0, data=rows.ravel())
    np.testing.assert_allclose(color_of(message, "/image"), [[[255, 0, 0], [221, 0, 0]], [[255, 0, 0]] * 2], atol=3)
    message.data = message.data[:6]
    with pytest.raises(UnreadableImage, match="half as much again"):
        color_of(message, "/image")


@pytest.mark.parametrize(("encoding", "wanted"), [("rgb16", [200, 100, 50]), ("bgr16", [50, 100, 200])])
def test_of_16_bits_a_colour_the_upper_8_are_kept(encoding, wanted):
    pixels = (np.array([[[200, 100, 50]]], np.uint16) << 8) + 255
    message = SimpleNamespace(encoding=encoding, height=1, width=1, step=6, is_bigendian=0,
                              data=pixels.view(np.uint8).ravel())
    assert color_of(message, "/image").tolist() == [[wanted]]

@pytest.mark.parametrize(("bits", "encoding"), [(10, "mono16"), (14, "16UC1"), (16, "mono16")])
def test_grey_images_of_16_bits_lose_the_lower_ones_of_those_that_are_used(caplog, bits, encoding):
    """Grey from black to white in 10, 14 or 16 bits is 0 to 255."""
    pixels = np.linspace(0, (1 << bits) - 1, 512).astype(np.uint16).reshape(2, 256)
    message = SimpleNamespace(encoding=encoding, height=2, width=256, step=512, is_bigendian=0,
                              data=pixels.view(np.uint8).ravel())
    shift = shift_of(message, "/image")
    image = color_of(message, "/image", shift)
    assert shift == bits - 8 and image.shape == (2, 256, 3) and (image[0, 0, 0], image[1, 255, 2]) == (0, 255)
    assert f"taken for grey ones of {bits} bits (of depth type source.depth_topic=/image)" in caplog.text
    message.data = np.full(1024, 8, np.uint8)[: 512 * 2]
    assert shift_of(message, "/image") and "thermal camera's" in caplog.text
    with pytest.raises(ConfigError, match="images are 32FC1; republish them as rgb8"):
        color_of(SimpleNamespace(encoding="32FC1"), "/image")


@pytest.mark.parametrize("form", ["bayer_rggb8; png compressed ", "bayer_rggb8; jpeg compressed "])
def test_a_mosaic_that_was_compressed_as_it_is_becomes_colour(form):
    """image_transport packs a mosaic without making colour of it: orange was a grey chequerboard."""
    mosaic = np.tile(np.array([[200, 100], [100, 20]], np.uint8), (16, 16))
    data = cv2.imencode(".png" if "png" in form else ".jpg", mosaic)[1].ravel()
    image = color_of(SimpleNamespace(format=form, data=data), "/image/compressed")
    np.testing.assert_allclose(image[8:24, 8:24], np.full((16, 16, 3), [200, 100, 20]), atol=5)
    coloured = cv2.imencode(".png", np.full((8, 8, 3), [20, 100, 200], np.uint8))[1].ravel()  # by whoever did
    assert color_of(SimpleNamespace(format=form, data=coloured), "/image/compressed")[4, 4].tolist() == [200, 100, 20]


def test_rvl_gives_every_pixel_back():
    """By hand: 1000 and 998 after one unknown pixel: runs of 1 and 2, steps 2000 (0, 2, 7, 3 by three bits, the lowest
    first: 8, A, F, 3) and 3 (-2 as 2 * 2 - 1)."""
    depth = np.array([[0, 1000, 998]], np.uint16)
    assert packed(depth) == struct.pack("<III", 3, 1, 0x128AF330)
    rng = np.random.default_rng(0)
    images = [depth, np.zeros((3, 4), np.uint16), np.full((2, 2), 65535, np.uint16),
              np.where(rng.random((30, 40)) < 0.3, 0, rng.integers(1, 65536, (30, 40))).astype(np.uint16)]
    for image in images:
        np.testing.assert_array_equal(unpacked_rvl(bytes_of(packed(image)), "/depth"), image)


def test_depth_of_image_transport_packed_by_rvl_is_metres_and_a_broken_one_is_refused():
    depth = np.array([[0, 1500], [2000, 2500]], np.uint16)
    data = struct.pack("<iff", 0, 0, 0) + packed(depth)
    message = SimpleNamespace(format="16UC1; compressedDepth RVL", data=bytes_of(data))
    metres = depth_of(message, "/depth", scale=0.0, max_depth_m=20.0)
    np.testing.assert_array_equal(metres, np.array([[np.nan, 1.5], [2.0, 2.5]], np.float32))
    whole = packed(np.arange(1, 401, dtype=np.uint16).reshape(20, 20))
    for data in (b"", whole[:8], whole[:60], struct.pack("<II", 100000, 100000) + whole[8:]):
        with pytest.raises(ConfigError, match="/depth: an RVL image"):
            unpacked_rvl(bytes_of(data), "/depth")


def mosaic(order, color):
    """A Bayer mosaic of one colour: `order` names the pixels of the first two by two."""
    values = [color["rgb".index(letter)] for letter in order]
    return np.tile(np.array(values, np.uint8).reshape(2, 2), (6, 8))


@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_bayer_mosaic_of_one_colour_is_that_colour(order):
    data = mosaic(order, (200, 100, 50))
    message = SimpleNamespace(encoding=f"bayer_{order}8", height=12, width=16, step=16, is_bigendian=0, data=data.ravel())
    np.testing.assert_array_equal(color_of(message, "/image")[3:-3, 3:-3], np.full((6, 10, 3), (200, 100, 50), np.uint8))
