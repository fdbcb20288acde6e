"""Clouds in .bin files as data sets write them: which way their points lie there is told by the points."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.replayed import refused, views

RINGS, BEAMS = 16, 360


def cloud(order: str) -> np.ndarray:
    """(N, 3) metres of a scanner in a room of 20 x 12 x 3 m: ring by ring, or as its 16 lasers fire."""
    rise = np.radians(np.linspace(-15.0, 15.0, RINGS))[:, None]
    around = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)[None]
    way = np.stack([np.cos(rise) * np.cos(around), np.cos(rise) * np.sin(around), np.sin(rise) + 0.0 * around], axis=-1)
    walls = np.where(way > 0, [12.0, 7.0, 2.0], [-8.0, -5.0, -1.0])
    reach = np.where(np.abs(way) > 1e-6, walls / np.where(way == 0.0, 1.0, way), np.inf).min(axis=-1)
    points = (way * reach[..., None]).astype("<f4")
    fired = np.arange(RINGS).reshape(2, -1).T.ravel()
    return points.reshape(-1, 3) if order == "rings" else points[fired].transpose(1, 0, 2).reshape(-1, 3)


def written(points, form):
    rng = np.random.default_rng(0)
    n = len(points)
    shade, ring, time = rng.integers(0, 255, n), np.arange(n) % RINGS, np.linspace(-0.05, 0.05, n)
    if form == "nclt":
        table = np.zeros(n, [("p", "<u2", 3), ("rest", "u1", 2)])
        table["p"] = np.rint((points * [1, -1, -1] + 100.0) / 0.005)
        table["rest"] = rng.integers(0, 255, (n, 2))
        return table.tobytes()
    if form == "ouster":
        return np.rec.fromarrays([*points.T, shade.astype("<f4"), np.arange(n, dtype="<u4"), ring.astype("<u2")]).tobytes()
    columns = {"kitti": [points, shade], "points": [points], "nuscenes": [points, shade, ring],
               "boreas": [points, shade, ring, time], "robotcar": [points, shade]}[form]
    table = np.column_stack(columns).astype("<f4")
    return (table.T if form == "robotcar" else table).tobytes()


@pytest.mark.parametrize("order", ["rings", "fired"])
@pytest.mark.parametrize(("form", "said"), [
    ("kitti", ""), ("points", "12 bytes a point"), ("nuscenes", "20 bytes"), ("boreas", "24 bytes"), ("ouster", "22 bytes"),
    ("nclt", "NCLT's, whose z pointed down"), ("robotcar", "four rows"),
])
def test_points_are_read_as_they_lie_and_that_is_said(tmp_path, caplog, form, said, order):
    points = cloud(order)
    for k in range(2):
        (tmp_path / f"{k:06d}.bin").write_bytes(written(points, form))
    seen = views(tmp_path)[1][1][0].extras["cloud"]
    np.testing.assert_allclose(seen, points, atol=0.003 if form == "nclt" else 0.0)
    assert said in caplog.text and bool(said) == bool(caplog.text)


def test_names_of_nuscenes_end_in_two_endings_and_tell_the_time(tmp_path):
    for k in range(2):
        name = f"n015-2018-07-24-11-22-45+0800__LIDAR_TOP__{1532402927647951 + 50000 * k}.pcd.bin"
        (tmp_path / name).write_bytes(written(cloud("rings"), "nuscenes"))
    assert views(tmp_path)[1][1][0].stamp_s == pytest.approx(1532402927.697951, abs=1e-6)


def test_doubles_are_refused_with_what_to_type(tmp_path):
    np.column_stack([cloud("rings"), np.ones(RINGS * BEAMS)]).astype("<f8").tofile(tmp_path / "000000.bin")
    assert "4 float64 a point; write float32" in refused(tmp_path)


def test_a_flat_lasers_cloud_is_refused_with_what_to_type(tmp_path):
    flat = cloud("rings") * [1.0, 1.0, 0.0]
    (tmp_path / "000000.bin").write_bytes(written(flat, "kitti"))
    assert "in one plane" in refused(tmp_path) and "sensor=laser" in refused(tmp_path)


def test_a_folder_of_nclt_names_its_clouds_and_its_flat_laser_is_no_cloud(tmp_path):
    (tmp_path / "velodyne_sync").mkdir()
    for k in range(2):
        (tmp_path / f"velodyne_sync/{1326030975726043 + 200000 * k}.bin").write_bytes(written(cloud("rings"), "nclt"))
    (tmp_path / "hokuyo_30m.bin").write_bytes(bytes(100))
    assert f"type source.path={tmp_path / 'velodyne_sync'}" in refused(tmp_path)
    assert "NCLT's scans of a flat laser: write a CARMEN log" in refused(tmp_path / "hokuyo_30m.bin")
