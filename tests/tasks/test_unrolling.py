"""Unrolling: a known texture comes back from views inside the tube; what cannot be unrolled is refused in one line."""

import json

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.config.compose import compose_config
from rhs.estimation.views.features import write_image
from rhs.patrol.run import run_config
from rhs_tasks.unroll.folder import Folder, natural
from rhs_tasks.unroll.mosaic import Mosaic, Strip, correlation, follow, homography, shift_between
from rhs_tasks.unroll.settings import Unrolling

SMALL = ["experiment=unroll_tube", "source.length_m=0.75", "source.step_m=0.075", "source.image_width=240"]


def grains(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    """A texture without a seam between its last row and its first."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(np.random.default_rng(seed).standard_normal((rows, columns)), 3.0, mode=("wrap", "reflect"))
    return (128 + 40 * noise / noise.std()).astype(np.float32)


def test_the_texture_of_a_tube_comes_back(tmp_path):
    row = run_config(compose_config(SMALL), tmp_path)
    assert row["status"] == "ok", row["reason"]
    assert row["strips"] == 11 and row["strips_registered_share"] == 1.0
    assert row["mosaic_correlation"] > 0.95
    assert row["along_error_pct"] < 0.5
    assert json.loads((tmp_path / "row.json").read_text())["task"] == "unroll"
    for name in ("mosaic.png", "truth.png", "overview.png", "strips.csv", "config.yaml"):
        assert (tmp_path / name).stat().st_size > 100
    columns = (tmp_path / "strips.csv").read_text().splitlines()[0].split(",")
    assert {"along_m", "points", "residual_px", "agreement"} <= set(columns)


def test_a_lens_that_distorts_is_undone(tmp_path):
    """Corners of this picture lie more than 20 pixels from where a pinhole has them."""
    row = run_config(compose_config([*SMALL, "source.distortion=[-0.12,0.01,0.0,0.0]", "source.skew_px=2"]), tmp_path)
    assert row["mosaic_correlation"] > 0.93


def test_a_bend_that_nobody_told_of_is_found_in_the_views(tmp_path):
    """A tube that turns by 20.6 degrees on the way: taken for straight it does not unroll; told, or found from the views, it
    does. The direction found is within three degrees all along, the first section, which no view shows, included."""
    bent, rows = [*SMALL, "source.pieces=[0.2,0,0.8,30]"], {}
    for how in (["unroll.pieces=[0.2,0,0.8,30]"], [], ["unroll.bend=found"]):
        folder = tmp_path / str(len(rows))
        folder.mkdir()
        rows["".join(how)[:11] or "untold"] = run_config(compose_config([*bent, *how]), folder)
    told, untold, found = rows["unroll.piec"], rows["untold"], rows["unroll.bend"]
    assert told["mosaic_correlation"] > 0.93
    assert untold["mosaic_correlation"] < told["mosaic_correlation"] - 0.2
    assert found["mosaic_correlation"] > 0.9  # 0.92 or 0.93, by the last bits of sums
    assert found["bend_error_deg"] < 3.0 and untold["bend_error_deg"] > 15.0
    assert found["along_error_pct"] < 0.5


def test_pictures_of_a_folder_are_unrolled(tmp_path):
    """The same views as files, with the camera given by hand: nothing is known of the truth, the strips agree."""
    from pathlib import Path

    from rhs.api.contracts import SourceContext
    from rhs.config.registry import load

    source = load("source", "tube")(length_m=0.3, step_m=0.06, image_width=240).build(
        SourceContext(np.random.default_rng(0), None, Path(tmp_path)))
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    while (capture := source.lead()) is not None:
        write_image(pictures / f"view{capture.index}.png", capture.image)
    c = source.camera
    (tmp_path / "run").mkdir()
    words = [f"unroll.path={pictures}", f"unroll.intrinsics=[{c.fx},{c.fy},{c.cx},{c.cy}]"]
    row = run_config(compose_config(["experiment=unroll_tube", *words]), tmp_path / "run")
    assert row["status"] == "ok" and row["strips"] == 6 and row["world"] == "pictures"
    assert row["strip_agreement"] > 0.97 and "mosaic_correlation" not in row


def test_folders_that_are_not_pictures_are_refused_in_one_line(tmp_path):
    camera = [200.0, 200.0, 20.0, 15.0]

    def complaint(path, intrinsics=camera) -> str:
        with pytest.raises(ConfigError) as caught:
            Folder(Unrolling(path=str(path), intrinsics=intrinsics))
        assert "\n" not in str(caught.value)
        return str(caught.value)

    assert "found nothing there" in complaint(tmp_path / "nowhere")
    (tmp_path / "a.txt").write_text("x")
    assert "found 0 pictures (a.txt)" in complaint(tmp_path)
    for k in (1, 2):
        write_image(tmp_path / f"{k}.png", np.zeros((30, 40, 3), np.uint8))
    assert len(list(Folder(Unrolling(path=str(tmp_path), intrinsics=camera)))) == 2
    assert "do not fit pictures of 40x30" in complaint(tmp_path, [200.0, 200.0, 320.0, 240.0])
    write_image(tmp_path / "3.png", np.zeros((30, 41, 3), np.uint8))
    assert "3.png is 41x30" in complaint(tmp_path)
    (tmp_path / "3.png").write_bytes(b"no picture")
    assert "3.png cannot be read" in complaint(tmp_path)
    with pytest.raises(ConfigError, match="unroll.intrinsics"):
        Unrolling(path="x")
    with pytest.raises(ConfigError, match="expected pairs"):
        Unrolling(pieces=[1.0])


@pytest.mark.parametrize(("spoil", "complaint"), [
    (lambda folder: write_image(folder / "3.jpg", np.zeros((30, 41, 3), np.uint8)), "3.jpg is 41x30"),
    (lambda folder: (folder / "2.jpg").write_bytes(b"\xff\xd8\xff no picture"), "2.jpg cannot be read"),
    (lambda folder: (folder / "2.jpg").unlink(), "found 1 pictures"),
])
def test_a_spoilt_folder_is_refused_before_anything_ran(tmp_path, capfd, spoil, complaint):
    """In one line, with exit code 2, and without a run folder."""
    from rhs.cli.main import main

    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for k in (1, 2):
        write_image(pictures / f"{k}.jpg", np.zeros((30, 40, 3), np.uint8))
    spoil(pictures)
    words = ["experiment=unroll_tube", f"unroll.path={pictures}", "unroll.intrinsics=[20,20,20,15]"]
    assert main([*words, f"output={tmp_path / 'run'}"]) == 2
    said = capfd.readouterr().err
    assert complaint in said and said.count("\n") == 1
    assert not (tmp_path / "run" / "row.json").exists()


def test_picture_nine_comes_before_picture_ten(tmp_path):
    assert sorted([tmp_path / "v10.png", tmp_path / "v9.png"], key=natural)[0].name == "v9.png"


def test_a_mosaic_of_overlapping_strips_is_the_picture_they_were_cut_from():
    whole, mosaic = grains(100, 200), Mosaic(0.01, 1.0)
    for first in range(0, 160, 20):
        mosaic.put(Strip(first, whole[:, first : first + 40], np.ones((100, 40))), np.eye(3))
    assert mosaic.columns == 180
    assert np.allclose(mosaic.picture(), whole[:, :180], atol=1e-3)


def test_a_strip_in_the_wrong_place_is_found_also_across_the_seam():
    whole, mosaic = grains(100, 200), Mosaic(0.01, 1.0)
    mosaic.put(Strip(0, whole[:, :120], np.ones((100, 120))), np.eye(3))
    moved = np.roll(whole, 7, axis=0)[:, 45:105]  # shows columns 45.. seven rows further down, put at 40
    strip = Strip(40, moved, np.ones(moved.shape))
    assert shift_between(strip, mosaic, 0.1) == pytest.approx((0.05, -0.07), abs=0.011)
    here, there = follow(strip, *mosaic.part(40, 60))
    warp, agreed = homography(here, there, 30.0)
    assert agreed > 30
    assert warp[:2, 2] / warp[2, 2] == pytest.approx([5.0, -7.0], abs=0.2)
    before = mosaic.picture().copy()
    assert mosaic.put(strip, warp) > 0.99
    assert np.abs(mosaic.picture()[:, 50:90] - before[:, 50:90]).mean() < 2.0


def test_a_homography_that_would_tear_the_strip_is_not_taken():
    seen = np.random.default_rng(0).uniform(0, 100, (50, 2))
    assert np.array_equal(homography(seen, seen + [40.0, 0.0], 4.0)[0], np.eye(3))


def test_correlation_of_known_cases():
    a = np.array([1.0, 2.0, 3.0])
    assert correlation(a, 5 * a + 2) == pytest.approx(1.0)
    assert correlation(a, -a) == pytest.approx(-1.0)
    assert np.isnan(correlation(a, np.ones(3)))
