"""map_server files: what the ROS semantics say of single pixels, and exact round trips."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.grid import OccupancyGrid
from rhs.worlds.maps import load_map, save_map, writing_in


def write_map(folder, pixels, **keys):
    """A map_server pair with a PNG (or the named image) of (H, W) or (H, W, C) uint8 pixels, first row on top."""
    import cv2

    values = {"image": "m.png", "resolution": 0.5, "origin": "[0, 0, 0]", "negate": 0, "occupied_thresh": 0.65,
              "free_thresh": 0.196} | keys
    assert cv2.imwrite(str(folder / values["image"]), np.asarray(pixels, np.uint8))
    path = folder / "m.yaml"
    path.write_text("".join(f"{k}: {v}\n" for k, v in values.items()) + "# a comment line\n")
    return path


def test_round_trip_keeps_the_three_classes_exactly(tmp_path):
    rng = np.random.default_rng(0)
    probability = rng.choice([0.02, 0.1, 0.24, 0.3, 0.5, 0.64, 0.66, 0.99, np.nan], size=(13, 7)).astype(np.float32)
    grid = OccupancyGrid(probability, 0.05, (-1.25, 3.5))
    text, image = save_map(tmp_path / "map.v2", grid)
    back = load_map(text)
    assert (text.name, image.name) == ("map.v2.yaml", "map.v2.pgm")
    assert back.resolution_m == 0.05 and back.origin_m == (-1.25, 3.5)
    assert np.array_equal(back.free(), grid.free()) and np.array_equal(back.occupied(), grid.occupied())
    assert np.array_equal(np.isnan(back.probability), ~(grid.free() | grid.occupied()))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["map.v2.pgm", "map.v2.yaml"]


@pytest.mark.parametrize("name", ["m.pgm", "m.png", "m.bmp"])
def test_the_first_image_row_is_the_highest_y(tmp_path, name):
    grid = load_map(write_map(tmp_path, [[0, 254], [254, 254], [254, 254]], image=name))
    assert grid.occupied().tolist() == [[False, False], [False, False], [True, False]]
    assert grid.cells([(0.25, 1.25)]).tolist() == [[2, 0]]


def test_trinary_thresholds_are_strict_and_205_is_unknown(tmp_path):
    # occupancy of 205 is 50/255 = 0.19608: not below 0.196, but below nav2's old 0.25
    pixels = [[254, 205, 100, 89, 0]]
    found = load_map(write_map(tmp_path, pixels)).probability[0]
    assert np.array_equal(found, [0, np.nan, np.nan, 1, 1], equal_nan=True)
    assert load_map(write_map(tmp_path, pixels, free_thresh=0.25)).probability[0, 1] == 0.0


@pytest.mark.parametrize(("pixels", "unknown"), [
    ([[254, 205, 0]], True), ([[255, 205, 0]], False), ([[254, 205, 90]], False)])
def test_what_navs_map_saver_calls_unknown_is_not_free_by_its_own_free_thresh(tmp_path, caplog, pixels, unknown):
    """Nav2 writes free_thresh: 0.25 beside grey 205; other pictures are read by what their file says."""
    found = load_map(write_map(tmp_path, pixels, free_thresh=0.25)).probability[0]
    assert np.isnan(found[1]) == unknown and (unknown or found[1] == 0.0)
    assert ("taken for unknown, as map_saver writes it" in caplog.text) == unknown


def test_negate_makes_white_occupied(tmp_path):
    assert load_map(write_map(tmp_path, [[254, 0]], negate=1)).probability.tolist() == [[1.0, 0.0]]


def test_scale_is_a_ramp_between_the_thresholds(tmp_path):
    pixels = np.array([[255, 128, 0]])
    grid = load_map(write_map(tmp_path, pixels, mode="scale", occupied_thresh=0.9, free_thresh=0.1))
    middle = np.rint(100 * ((1 - 128 / 255) - 0.1) / 0.8) / 100
    assert grid.probability[0] == pytest.approx([0.0, middle, 1.0])


def test_scale_takes_transparent_as_unknown(tmp_path):
    rgba = np.zeros((1, 2, 4))
    rgba[0, :, 3] = 255, 10
    grid = load_map(write_map(tmp_path, rgba, mode="scale"))
    assert grid.probability[0, 0] == 1.0 and np.isnan(grid.probability[0, 1])


@pytest.mark.parametrize(("form", "most", "kind"), [
    ("P5", 100, "u1"), ("P2", 100, "u1"), ("P5", 1, "u1"), ("P5", 2000, ">u2"), ("P2", 2000, ">u2"), ("P5", 65535, ">u2")])
def test_white_is_what_a_pgm_says_it_is(tmp_path, form, most, kind):
    """Of a map whose white is 100 all that is free was a wall; netpbm writes such."""
    pixels = np.round(np.array([1.0, 0.5, 0.0]) * most).astype(kind)
    body = pixels.tobytes() if form == "P5" else (" ".join(map(str, pixels)) + "\n").encode()
    (tmp_path / "m.pgm").write_bytes(f"{form}\n# by hand\n3 1\n{most}\n".encode() + body)
    (tmp_path / "m.yaml").write_text("image: m.pgm\nresolution: 0.5\norigin: [0, 0, 0]\n")
    middle = 1.0 if most == 1 else np.nan  # half of one is rounded down
    np.testing.assert_array_equal(load_map(tmp_path / "m.yaml").probability[0], [0.0, middle, 1.0])


def test_an_alpha_channel_that_is_opaque_changes_nothing(tmp_path):
    """As brightness it made the unknown free: (3 * 205 + 255) / 4 is 85 % bright."""
    rgba = np.full((1, 3, 4), 255)
    rgba[0, :, :3] = np.array([254, 205, 0])[:, None]
    assert np.array_equal(load_map(write_map(tmp_path, rgba)).probability[0], [0.0, np.nan, 1.0], equal_nan=True)


def test_raw_is_percent_up_to_100_and_unknown_above(tmp_path):
    grid = load_map(write_map(tmp_path, [[0, 37, 100, 101, 255]], mode="raw"))
    assert np.allclose(grid.probability[0], [0, 0.37, 1.0, np.nan, np.nan], equal_nan=True)


@pytest.mark.parametrize(("pixels", "said"), [([[0, 37, 100, 255]], True), ([[0, 100, 205, 255]], False),
                                              ([[0, 255, 0, 255]], False)])
def test_a_map_of_percents_that_does_not_say_raw_is_said(tmp_path, caplog, pixels, said):
    load_map(write_map(tmp_path, pixels))
    assert ("if it is one write mode: raw" in caplog.text) == said
    caplog.clear()
    load_map(write_map(tmp_path, pixels, mode="raw"))
    assert "mode: raw" not in caplog.text


def test_a_quarter_turn_moves_every_cell_where_geometry_says(tmp_path):
    # origin (10, 20) turned by 90 degrees: the image's x axis points along +y, its y axis along -x
    path = write_map(tmp_path, [[254, 254, 0]], origin=f"[10, 20, {np.pi / 2}]")
    grid = load_map(path)
    assert grid.shape == (3, 1) and grid.origin_m == pytest.approx((9.5, 20.0))
    assert grid.occupied()[:, 0].tolist() == [False, False, True]


def test_a_slanted_map_keeps_its_obstacle_in_place_and_knows_nothing_outside(tmp_path):
    """Every point of the pixel stands in an occupied cell, and every occupied cell meets the pixel (both have a diagonal of
    sqrt 2)."""
    pixels = np.full((20, 20), 254)
    pixels[20 - 1 - 5, 14] = 0  # [14, 15] x [5, 6] in half metres of the image frame
    grid = load_map(write_map(tmp_path, pixels, origin="[1, 2, 0.5]"))
    c, s = np.cos(0.5), np.sin(0.5)
    inside = 0.5 * (np.array([14.0, 5.0]) + np.random.default_rng(0).uniform(0.0, 1.0, (2000, 2)))
    there = inside @ np.array([[c, s], [-s, c]]) + (1.0, 2.0)
    assert grid.occupied()[tuple(grid.cells(there).T)].all()
    middle = np.array([7.25, 2.75]) @ np.array([[c, s], [-s, c]]) + (1.0, 2.0)
    assert np.linalg.norm(grid.centres(np.argwhere(grid.occupied())) - middle, axis=1).max() < 0.5 * np.sqrt(2.0)
    assert np.isnan(grid.probability[0, 0])


@pytest.mark.parametrize("yaw", [0.3, np.pi / 4, 2.0, 3.14, -1.0])
def test_turning_a_map_frees_nothing(tmp_path, yaw):
    """Points of a random map: in a free cell of the turned map only what is free in the image; unknown stays unknown or
    becomes occupied; and every point in an occupied pixel is in an occupied cell."""
    rng = np.random.default_rng(5)
    pixels = rng.choice([254, 205, 0], (30, 40), p=[0.8, 0.1, 0.1])
    straight = load_map(write_map(tmp_path, pixels, origin="[0, 0, 0]"))
    grid = load_map(write_map(tmp_path, pixels, origin=f"[3, -2, {yaw}]"))
    points = rng.uniform(0.0, (20.0, 15.0), (50_000, 2))
    c, s = np.cos(yaw), np.sin(yaw)
    before = straight.probability[tuple(straight.cells(points).T)]
    after = grid.probability[tuple(grid.cells(points @ np.array([[c, s], [-s, c]]) + (3.0, -2.0)).T)]
    assert (after[before == 1.0] == 1.0).all()
    assert (before[after == 0.0] == 0.0).all() and (after == 0.0).any()
    assert not (after[np.isnan(before)] == 0.0).any()


def test_comments_bom_and_windows_lines_are_read(tmp_path):
    path = write_map(tmp_path, [[254, 0]])
    plain = load_map(path).probability
    path.write_bytes(b"\xef\xbb\xbf# head\r\n" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert np.array_equal(load_map(path).probability, plain)


def test_comments_in_the_head_of_a_pgm_are_read(tmp_path):
    """map_saver writes one: `# CREATOR: map_saver.cpp 0.050 m/pix`."""
    text = write_map(tmp_path, [[0, 254]], image="m.pgm")
    (tmp_path / "m.pgm").write_bytes(b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n2 1 # wide, high\n255\n\x00\xfe")
    assert load_map(text).probability.tolist() == [[1.0, 0.0]]


@pytest.mark.parametrize(("word", "found"), [("no", 1.0), ("false", 1.0), ("0", 1.0), ("yes", 0.0), ("true", 0.0)])
def test_negate_may_be_a_word(tmp_path, word, found):
    assert load_map(write_map(tmp_path, [[0]], negate=word)).probability.tolist() == [[found]]


def test_a_key_that_stands_twice_is_refused_with_its_line(tmp_path):
    text = write_map(tmp_path, [[0, 254]])
    text.write_text(text.read_text() + "resolution: 0.1\n")
    with pytest.raises(ConfigError, match=r"m\.yaml:8: .*'resolution' stands twice"):
        load_map(text)


def huge(kind: str) -> bytes:
    """The head of an image of 30,000 x 30,000 pixels, and hardly anything behind it."""
    side = 30_000
    if kind == "pgm":
        return b"P5\n# huge\n%d %d\n255\n\x00" % (side, side)
    if kind == "png":
        return b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + side.to_bytes(4) * 2 + b"\x08\x00\x00\x00\x00"
    return b"BM" + bytes(12) + (40).to_bytes(4, "little") + side.to_bytes(4, "little") * 2 + bytes(28)


@pytest.mark.parametrize("kind", ["pgm", "png", "bmp"])
def test_a_head_that_asks_for_too_many_cells_is_refused_before_anything_is_read(tmp_path, kind):
    text = write_map(tmp_path, [[0]], image=f"m.{kind}")
    (tmp_path / f"m.{kind}").write_bytes(huge(kind))
    with pytest.raises(ConfigError, match="30000 x 30000 cells are more than"):
        load_map(text)


@pytest.mark.parametrize("kind", ["pgm", "png", "bmp"])
def test_an_image_cut_short_is_refused_in_one_line(tmp_path, kind, capfd):
    text = write_map(tmp_path, np.full((9, 9), 254), image=f"m.{kind}")
    whole = (tmp_path / f"m.{kind}").read_bytes()
    for size in range(0, len(whole), 7):
        (tmp_path / f"m.{kind}").write_bytes(whole[:size])
        with pytest.raises(ConfigError, match="not an image"):
            load_map(text)
    assert "OpenCV" not in capfd.readouterr().err  # its own complaints, of many lines


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"resolution": 0}, "resolution"), ({"resolution": "nan"}, "resolution"), ({"resolution": "a"}, "resolution"),
        ({"origin": "[0, .inf, 0]"}, "origin"), ({"origin": 3}, "origin"), ({"mode": "binary"}, "mode"),
        ({"occupied_thresh": 1.5}, "occupied_thresh"), ({"free_thresh": 0.9}, "free_thresh"), ({"negate": 2}, "negate"),
    ],
)
def test_bad_keys_are_refused_by_name(tmp_path, keys, word):
    with pytest.raises(ConfigError, match=word):
        load_map(write_map(tmp_path, [[254, 0]], **keys))


def test_missing_files_and_bad_yaml_are_refused_in_words(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_map(tmp_path / "none.yaml")
    path = write_map(tmp_path, [[254]])
    (tmp_path / "m.png").write_bytes(b"not an image")
    with pytest.raises(ConfigError, match="not an image"):
        load_map(path)
    path.write_text("image: [unclosed\nx: 1\n")
    with pytest.raises(ConfigError, match="m.yaml:"):
        load_map(path)
    path.write_text("!!python/object/apply:os.system ['true']\n")
    with pytest.raises(ConfigError):
        load_map(path)


@pytest.mark.parametrize("name", ["/home/somebody/maps/m.png", r"C:\maps\m.png"])
def test_an_image_that_lies_beside_its_map_is_taken_for_one_of_another_machine(tmp_path, name, caplog):
    path = write_map(tmp_path, [[0, 254]])
    path.write_text(path.read_text().replace("image: m.png", f"image: {name}"))
    assert load_map(path).occupied().tolist() == [[True, False]]
    assert "taken is m.png beside it" in caplog.text


def test_writing_on_a_plan_is_left_out_where_that_is_asked_for(tmp_path):
    """A wall of 80 cells, two letters of 24 apart from it and one of 20 that touches it, 0.05 m a cell."""
    picture = np.full((40, 100), 255, np.uint8)
    picture[20, 10:90] = 0
    picture[5:11, 20:24] = picture[5:11, 40:44] = 0
    picture[15:20, 60:64] = 0
    grid = load_map(write_map(tmp_path, picture, resolution=0.05))
    assert writing_in(grid) == 2 and int(grid.occupied().sum()) == 80 + 24 + 24 + 20
    assert int(load_map(write_map(tmp_path, picture, resolution=0.05, marks_m=0.3)).occupied().sum()) == 80 + 24 + 24 + 20
    assert int(load_map(write_map(tmp_path, picture, resolution=0.05, marks_m=0.5)).occupied().sum()) == 80 + 20


@pytest.mark.parametrize("name", ["m.webp", "m.tif", "m.tiff", "m.gif"])
def test_other_pictures_that_plans_come_in_are_read(tmp_path, name):
    """A lossy one keeps which cells are free."""
    pixels = np.full((40, 60), 254)
    pixels[:, 30:] = 0
    free = load_map(write_map(tmp_path, np.dstack([pixels] * 3), image=name)).free()
    assert free.shape == (40, 60) and free[:, :28].all() and not free[:, 32:].any()


def test_heights_of_a_geotiff_are_no_plan(tmp_path):
    import cv2

    path = write_map(tmp_path, [[0]], image="m.tiff")
    cv2.imwrite(str(tmp_path / "m.tiff"), np.full((20, 20), 812.5, np.float32))
    with pytest.raises(ConfigError, match="its pixels are float32, as heights are; expected grey or colour"):
        load_map(path)


def webp(side: int, kind: str) -> bytes:
    """The first chunk of one, by the specification of the container."""
    head = {"VP8X": bytes(4) + (side - 1).to_bytes(3, "little") * 2,
            "VP8L": b"/" + (side - 1 | side - 1 << 14).to_bytes(4, "little"),
            "VP8 ": bytes(3) + bytes.fromhex("9d012a") + side.to_bytes(2, "little") * 2}[kind]
    return b"RIFF" + bytes(4) + b"WEBP" + kind.encode() + bytes(4) + head + bytes(30)


def tiff(side: int, order: str) -> bytes:
    number = {"II": "little", "MM": "big"}[order]
    entries = b"".join(tag.to_bytes(2, number) + (4).to_bytes(2, number) + (1).to_bytes(4, number) + side.to_bytes(4, number)
                       for tag in (256, 257))
    return order.encode() + (42).to_bytes(2, number) + (8).to_bytes(4, number) + (2).to_bytes(2, number) + entries + bytes(4)


@pytest.mark.parametrize("data", [*(webp(16000, kind) for kind in ("VP8X", "VP8L", "VP8 ")), tiff(16000, "II"),
                                  tiff(16000, "MM"), b"GIF89a" + (16000).to_bytes(2, "little") * 2])
def test_a_plan_of_too_many_cells_is_told_how_much_smaller_it_has_to_be(tmp_path, data):
    path = write_map(tmp_path, [[0]])
    (tmp_path / "m.png").write_bytes(data)
    with pytest.raises(ConfigError, match=r"16000 x 16000 cells are more .* scale it down 4 times \(4000 x 4000\)"):
        load_map(path)


def test_a_yaw_in_degrees_is_refused(tmp_path):
    path = write_map(tmp_path, np.full((4, 4), 254), origin="[0, 0, 90]")
    with pytest.raises(ConfigError, match="yaw of 90; expected radians: 1.5708 if these are degrees"):
        load_map(path)
