"""What each degradation does to a view, by facts that can be checked on paper; and that nothing else is touched."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rhs.api.contracts import Degradation, Sensor
from rhs.api.errors import ConfigError, PluginError, RhsError
from rhs.api.geometry import BODY_FROM_OPTICAL, camera_from_fov, planar, se2
from rhs.api.records import Capture, Twist
from rhs.config import registry
from rhs.config.compose import compose_config, config_hash, from_plain, identity, to_plain
from rhs.config.degraded import Degraded
from rhs.testing import context

CAMERA = camera_from_fov(64, 48, 60.0, height_m=1.0)
GREY = np.full((48, 64, 3), 120, np.uint8)
NEUTRAL = {"blur": {"exposure_share": 0.0}, "rolling_shutter": {"readout_share": 0.0}, "low_light": {"dark_share": 0.0},
           "side_light": {"side_share": 0.0}, "exposure_steps": {"exposure_stops": 0.0}, "wrong_focal": {"focal_share": 0.0},
           "mounting": {"pitch_deg": 0.0}, "latency": {"delay_views": 0}, "dropped": {"drop_chance": 0.0},
           "wheel_slip": {"slip_share": 0.0}, "fog": {"extinction_per_m": 0.0}, "depth_noise": {"noise_times": 0.0}}
LEFT_RAD = 0.1


def part(name: str, tmp_path, seed: int = 0, **values) -> Degradation:
    settings = registry.load("degrade", name)(**values)
    return settings.build(replace(context(tmp_path, seed), camera=CAMERA))


def capture(image=GREY, index: int = 0, **values) -> Capture:
    return Capture(index, 0.1 * index, image, np.full((48, 64), 2.0, np.float32), **values)


def edge() -> np.ndarray:
    """Black on the left, white on the right."""
    image = np.zeros((48, 64, 3), np.uint8)
    image[:, 32:] = 255
    return image


@pytest.mark.parametrize("name", registry.names("degrade"))
def test_a_degradation_of_nothing_hands_on_the_very_capture(name, tmp_path):
    one = part(name, tmp_path, **NEUTRAL[name])
    given = capture(travel=np.array([0.1, 0.0, 0.2]))
    spoiled = one.degrade(given, se2(0.1, 0.0, 0.2))
    assert spoiled.image is given.image and spoiled.depth is given.depth and spoiled.travel is given.travel
    told = one.told(CAMERA)
    assert (told.fx, told.cx) == (CAMERA.fx, CAMERA.cx)
    np.testing.assert_allclose(told.body_from_camera, CAMERA.body_from_camera, atol=1e-15)


def test_an_edge_smears_sideways_by_the_pixels_the_camera_turned(tmp_path):
    share = 0.5
    spoiled = part("blur", tmp_path, exposure_share=share).degrade(capture(edge()), se2(0.0, 0.0, LEFT_RAD))
    row = spoiled.image[24, :, 0].astype(float)
    # the 10 % and the 90 % level of an edge drawn out to a ramp of L pixels are 0.8 L apart
    levels = np.interp([25.5, 229.5], row, np.arange(64))
    assert levels[1] - levels[0] == pytest.approx(0.8 * share * CAMERA.fx * np.tan(LEFT_RAD), abs=0.3)
    assert (spoiled.image == spoiled.image[:1]).all()  # and along the edge nothing changes
    straight = part("blur", tmp_path, exposure_share=share).degrade(capture(edge()), se2(0.3, 0.0, 0.0))
    assert (straight.image == edge()).all()


def test_a_rolling_shutter_leans_an_edge_by_what_was_turned_while_reading(tmp_path):
    spoiled = part("rolling_shutter", tmp_path, readout_share=1.0).degrade(capture(edge()), se2(0.0, 0.0, LEFT_RAD))
    where = (spoiled.image[..., 0] < 128).sum(axis=1)  # columns left of the edge, row by row
    # turning left moves the picture to the right; the lower rows are read later
    assert where[-1] - where[0] == pytest.approx(CAMERA.fx * np.tan(LEFT_RAD), abs=1.0)
    assert where[24] == 32


def test_a_view_blurs_not_where_nobody_knows_the_motion(tmp_path):
    with pytest.raises(RhsError, match="knows neither truth nor wheels"):
        part("blur", tmp_path).degrade(capture(), None)


def test_low_light_has_its_share_of_grey_and_the_noise_of_its_photons(tmp_path):
    full, share = 1000.0, 0.75
    dark = part("low_light", tmp_path, dark_share=share, full_well_e=full, read_noise_e=0.0).degrade(capture(), None).image
    assert dark.mean() == pytest.approx(120 * (1 - share), abs=0.3)
    electrons = 120 / 255 * (1 - share) * full
    assert dark.std() == pytest.approx(np.sqrt(electrons) * 255 / full, rel=0.05)
    bright = part("low_light", tmp_path, dark_share=share, full_well_e=full, gain=4.0).degrade(capture(), None).image
    assert bright.mean() == pytest.approx(120, abs=0.5) and bright.std() > 3 * dark.std()


def test_light_from_the_left_leaves_the_right_edge_its_share(tmp_path):
    image = part("side_light", tmp_path, side_share=0.5).degrade(capture(), None).image
    assert (image[:, 0] == 120).all() and (image[:, -1] == 60).all()
    assert (np.diff(image[0, :, 0].astype(int)) <= 0).all()


def test_exposure_stays_between_its_jumps_and_within_its_stops(tmp_path):
    one = part("exposure_steps", tmp_path, exposure_stops=1.0, exposure_chance=0.05)
    means = np.array([one.degrade(capture(index=k), None).image.mean() for k in range(400)])
    jumps = np.count_nonzero(np.diff(means))
    assert 8 <= jumps <= 36  # 20 expected, sigma 4.4
    assert means.min() >= 60 and means.max() <= 240 and means[0] == 120


def test_a_camera_is_told_wrong_by_what_was_typed(tmp_path):
    assert part("wrong_focal", tmp_path, focal_share=0.02).told(CAMERA).fx == pytest.approx(1.02 * CAMERA.fx)
    axis = part("mounting", tmp_path, pitch_deg=3.0).told(CAMERA).body_from_camera[:3, :3] @ [0.0, 0.0, 1.0]
    assert np.degrees(np.arctan2(axis[2], axis[0])) == pytest.approx(-3.0)  # it is believed to look down
    right = part("mounting", tmp_path, pitch_deg=0.0, roll_deg=2.0).told(CAMERA).body_from_camera[:3, :3] @ [1.0, 0.0, 0.0]
    assert np.degrees(np.arcsin(right[2])) == pytest.approx(-2.0)  # its right hand side lower
    np.testing.assert_allclose(CAMERA.body_from_camera[:3, :3], BODY_FROM_OPTICAL)


def test_late_views_come_with_the_wheels_of_now(tmp_path):
    one = part("latency", tmp_path, delay_views=2)
    given = [capture(np.full_like(GREY, k), k, travel=np.array([k, 0.0, 0.0])) for k in range(5)]
    spoiled = [one.degrade(view, None) for view in given]
    assert [int(view.image[0, 0, 0]) for view in spoiled] == [0, 0, 0, 1, 2]
    assert [(view.index, view.travel[0]) for view in spoiled] == [(k, k) for k in range(5)]


def test_wheels_count_too_much_for_whole_stretches(tmp_path):
    one = part("wheel_slip", tmp_path, slip_share=0.5, slip_chance=0.02, slip_views=10)
    ratio = np.array([one.degrade(capture(travel=np.array([0.1, 0.0, 0.02])), None).travel / [0.1, 1.0, 0.02]
                      for _ in range(2000)])[:, [0, 2]]
    assert np.allclose(np.unique(ratio.round(9)), [1.0, 1.5]) and (ratio[:, 0].round(9) == ratio[:, 1].round(9)).all()
    slipping = (ratio[:, 0] > 1.2).astype(int)
    begins, ends = np.flatnonzero(np.diff(slipping) == 1), np.flatnonzero(np.diff(slipping) == -1)
    assert len(begins) > 15 and set(ends - begins[:len(ends)]) == {10}


def test_fog_greys_the_far_and_loses_its_depth(tmp_path):
    given = capture()
    depth = np.full((48, 64), 1.0, np.float32)
    depth[:, 32:] = 10.0
    spoiled = part("fog", tmp_path, extinction_per_m=0.1, air_grey=200.0).degrade(replace(given, depth=depth), None)
    for half, metres in ((np.s_[:, :32], 1.0), (np.s_[:, 32:], 10.0)):
        through = np.exp(-0.1 * metres)
        assert spoiled.image[half].mean() == pytest.approx(120 * through + 200 * (1 - through), abs=0.6)
        assert np.isfinite(spoiled.depth[half]).mean() == pytest.approx(through**2, abs=0.05)


def test_depth_noise_is_so_many_times_a_kinects_and_leaves_the_picture(tmp_path):
    given = replace(capture(), depth=np.full((48, 64), 3.0, np.float32))
    spoiled = part("depth_noise", tmp_path, noise_times=4.0).degrade(given, None)
    told_m = 0.0012 + 0.0019 * (3.0 - 0.4) ** 2
    assert np.std(spoiled.depth - 3.0) == pytest.approx(4.0 * told_m, rel=0.05)
    assert abs(np.mean(spoiled.depth - 3.0)) < 0.01 and spoiled.image is given.image


class Line:
    """A source that drives ahead 0.1 m a view, 50 views led and then driven; no picture."""

    def __init__(self, known: bool = True):
        self.camera, self.facts, self.renderer, self.at, self.known = CAMERA, SimpleNamespace(name="line"), "paper", 0, known

    def lead(self):
        return self.drive(Twist(0.1, 0.0, 1.0)) if self.at < 50 else None

    def drive(self, command):
        self.at += 1
        return Capture(self.at, float(self.at), GREY, command=command, travel=np.array([0.1, 0.0, 0.0]))

    def truth(self):
        return se2(0.1 * self.at, 0.0, 0.0) if self.known else None


def test_dropped_views_lose_no_travel_and_no_command(tmp_path):
    source = Degraded(Line(), [("degrade=dropped", part("dropped", tmp_path, drop_chance=0.3))])
    led = list(iter(source.lead, None))
    assert 25 <= len(led) <= 45 and led[0].index == 1  # 35.3 expected, sigma 3.2; the first always arrives
    travelled = 0.0
    for view in [*led, source.drive(Twist(0.1, 0.0, 1.0))]:
        travelled += view.travel[0]
        assert travelled == pytest.approx(0.1 * view.index)
        assert view.command.duration_s * view.command.forward_mps == pytest.approx(view.travel[0])
    assert source.truth()[0, 3] == pytest.approx(travelled)  # the truth passes untouched, and so does all else
    assert source.renderer == "paper" and source.facts.name == "line"


class Looks(Degradation):
    """Keeps the motions it was told of."""

    def __init__(self):
        self.seen = []

    def degrade(self, capture, previous_from_body):
        self.seen.append(previous_from_body)
        return capture


@pytest.mark.parametrize("known", [True, False])
def test_the_motion_is_the_true_one_or_that_of_the_wheels(known):
    looks = Looks()
    source = Degraded(Line(known), [("degrade=looks", looks)])
    list(iter(source.lead, None))
    np.testing.assert_allclose([planar(seen) for seen in looks.seen], [[0, 0, 0]] + 49 * [[0.1, 0, 0]], atol=1e-12)


def test_no_degradation_no_trace_in_hash_and_row():
    plain, same = compose_config(["world=square_small"]), compose_config(["world=square_small", "degrade=null"])
    assert config_hash(plain) == config_hash(same) and "degrade" not in to_plain(plain) and "degrade" not in identity(plain)
    spoiled = compose_config(["world=square_small", "degrade=blur"])
    assert config_hash(spoiled) != config_hash(plain) and identity(spoiled)["degrade"] == "blur"


@pytest.mark.parametrize("words", [["degrade=blur+low_light"], ["degrade=[blur,low_light]"],
                                   ["degrade=blur", "degrade.gain=1"],
                                   ["degrade.exposure_share=0.2", "degrade.dark_share=0.8"]])
def test_several_degradations_however_they_are_typed(words):
    config = compose_config(words)
    assert identity(config)["degrade"] == "blur+low_light"
    assert config_hash(config) == config_hash(compose_config(["degrade=blur+low_light"]))
    assert config_hash(from_plain(to_plain(config))) == config_hash(config)


@pytest.mark.parametrize(("words", "says"), [
    (["degrade=blurr"], "did you mean blur?"), (["degrade=blur+blurr"], "did you mean blur?"),
    (["degrade.exposure_shar=0.1"], "did you mean degrade.exposure_share?"),
    (["degrade.exposure_share=1.5"], r"degrade.exposure_share=1.5 is outside"),
    (["degrade=blur+low_light", "degrade.gain=-1"], r"degrade.gain=-1.0 is outside"),
    (["degrade=blur", "task=planning", "world=map1"], "task=planning takes no views"),
    (["degrade=fog", "sensor=laser", "source=replay"], "sensor=laser does not look at")])
def test_what_makes_no_sense_is_refused_in_one_line(words, says):
    with pytest.raises(ConfigError, match=says):
        compose_config(words)


def test_a_degradation_that_is_named_twice_is_refused():
    with pytest.raises(ConfigError, match="degrade=blur.blur: blur stands there twice"):
        compose_config(["degrade=blur+blur"])


def test_two_degradations_with_one_setting_name_are_refused_together(monkeypatch):
    blur = registry.load("degrade", "blur")
    monkeypatch.setattr(registry, "_by_hand", dict(registry._by_hand))
    registry.register("degrade", "blur_too", blur)
    with pytest.raises(PluginError, match="blur and blur_too both have a setting exposure_share"):
        registry.load("degrade", "blur+blur_too")


def test_sensor_and_estimators_see_nothing_but_the_spoiled_view():
    """What a part is handed says nothing of degradations: neither the record of a view nor the contract of a sensor."""
    assert not [name for name in vars(Capture)["__dataclass_fields__"] if "degrad" in name]
    assert "previous_from_body" not in Sensor.sense.__annotations__
