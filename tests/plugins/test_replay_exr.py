"""Depth in OpenEXR files, by the extra that reads them (OpenCV's wheels do not)."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay
from rhs_sources.replay_images import read_depth, reads_exr

DEPTH = np.full((48, 64), 2.5, np.float32)
DEPTH[0] = 1e10  # how Blender writes the sky


@pytest.fixture
def layers(monkeypatch, tmp_path):
    """A stand-in for OpenEXR whose files hold these layers; the folder has a view."""
    held: dict[str, np.ndarray] = {}

    class File:
        def __init__(self, path, separate_channels):
            if not held:
                raise RuntimeError("no OpenEXR file")

        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        def channels(self):
            return {name: SimpleNamespace(pixels=pixels) for name, pixels in held.items()}

    module = ModuleType("OpenEXR")
    module.File, module.__spec__ = File, ModuleSpec("OpenEXR", None)
    monkeypatch.setitem(sys.modules, "OpenEXR", module)
    for place in ("rgb", "depth"):
        (tmp_path / place).mkdir()
    cv2.imwrite(str(tmp_path / "rgb/0.png"), np.full((48, 64, 3), 90, np.uint8))
    (tmp_path / "depth/0.exr").write_bytes(b"v/1\x01" + bytes(40))
    return held


@pytest.mark.parametrize("names", [("Z",), ("R", "G", "B"), ("ViewLayer.Combined.R", "ViewLayer.Depth.Z"), ("Depth.V", "A")])
def test_the_layer_of_depth_is_metres_and_what_is_endlessly_far_is_unknown(layers, tmp_path, names):
    """A file with colour too has its depth in the layer called so; three equal ones are one."""
    deep = [name for name in names if name.endswith(("Z", "V"))] or names
    layers.update({name: DEPTH if name in deep else 0.5 * DEPTH for name in names})
    (view, _), = open_recording(Replay(path=str(tmp_path), camera=[50.0, 50.0, 31.5, 23.5])).views
    assert np.isnan(view.depth[0]).all() and np.unique(view.depth[1:]).tolist() == [2.5]


def test_a_broken_file_and_one_of_several_layers_without_depth_are_refused(layers, tmp_path):
    for held in ({}, {"R": DEPTH, "G": 2 * DEPTH}):
        layers.clear()
        layers.update(held)
        with pytest.raises(ConfigError, match=r"0\.exr: found 44 bytes that are no image; expected a 16-bit depth image"):
            open_recording(Replay(path=str(tmp_path), camera=[50.0, 50.0, 31.5, 23.5]))


@pytest.mark.skipif(reads_exr(), reason="the extra is installed")
def test_without_the_extra_what_to_install_is_said(tmp_path):
    (tmp_path / "0.exr").write_bytes(b"v/1\x01" + bytes(40))
    with pytest.raises(ConfigError, match=r"0\.exr: found OpenEXR; type pip install OpenEXR \(the extra exr\)"):
        read_depth(tmp_path / "0.exr", scale=1.0, max_depth_m=20.0)
