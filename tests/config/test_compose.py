"""What may be typed, and what is refused: every refusal is one line that names the key and what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.built_parts import build_parts
from installing import CHOICE, FAKES, installed

from rhs.api import settings
from rhs.api.errors import ConfigError
from rhs.config import hydra_glue, parts
from rhs.config.compose import (
    Composer,
    Core,
    RunConfig,
    compose_config,
    config_hash,
    from_plain,
    identity,
    to_plain,
)
from rhs.config.overrides import parse, plain_words
from rhs.runfolder.row import machine_dependent


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


COMPOSER = Composer()


def compose(*words: str) -> RunConfig:
    return COMPOSER.config(plain_words(parse([*CHOICE, *words])))


def refusal(*words: str) -> str:
    with pytest.raises(ConfigError) as caught:
        compose(*words)
    text = str(caught.value)
    assert "\n" not in text
    assert caught.value.exit_code == 2
    return text


def test_nothing_typed_gives_the_defaults_of_the_classes():
    config = compose()
    assert (config.task.name, config.world, config.seed, config.task.settings.places.every) == ("patrol", "square", 0, 3)
    assert config.planner.name == "fake"
    assert config.planner.settings.samples == 100


@pytest.mark.parametrize(("word", "value"), [
    ("planner.samples=7", 7), ("planner.step_m=1", 1.0), ("planner.smooth=false", False), ("planner.mode=no", "no"),
    ("planner.mode=012", "012"), ("planner.mode=12:30", "12:30"), ("planner.mode='123'", "123"),
    ("planner.weights=[1,2.5]", [1.0, 2.5]), ("planner.limit=2", 2.0), ("planner.limit=null", None),
    ("planner.norm=l1", "l1"), ("planner={samples: 7}", 7),
])
def test_a_value_arrives_as_it_was_typed(word, value):
    key = word.partition("=")[0].removeprefix("planner.") if "." in word.partition("=")[0] else "samples"
    got = getattr(compose(word).planner.settings, key)
    assert got == value
    assert type(got) is type(value)


@pytest.mark.parametrize(("word", "says"), [
    ("sed=3", "unknown key sed; did you mean seed?"),
    ("planner.samles=3", "unknown key planner.samles; did you mean planner.samples?"),
    ("plannner=fake", "unknown key plannner; did you mean planner?"),
    ("planner=fak", "planner=fak: there is no such planner; did you mean fake? (there is"),
    ("planner.samples=-5", "planner.fake.samples=-5 is outside the allowed range [1, 1000000]"),
    ("planner.samples=0", "[1, 1000000]"),
    ("planner.samples=906970164", "[1, 1000000]"),
    ("planner.samples=1e3", "planner.samples=1000.0: expected int"),
    ("planner.samples=012", "expected int"),
    ("planner.step_m=0", "[0.01, 10] m"),
    ("planner.step_m=nan", "planner.fake.step_m=nan is outside"),
    ("planner.step_m=inf", "planner.fake.step_m=inf is outside"),
    ("planner.step_m=-inf", "planner.fake.step_m=-inf is outside"),
    ("planner.smooth=5", "planner.smooth=5: expected bool: true or false"),
    ("planner.smooth=yes", "planner.smooth=yes: expected bool"),
    ("planner.weights=[1,a]", "planner.weights[1]=a: expected float"),
    ("planner.norm=l3", "planner.norm=l3: expected l1 | l2"),
    ("planner.mode=123", "expected text, found a number; quote it"),
    ("seed=-1", "seed=-1 is outside the allowed range [0,"),
    ("seed=1.5", "seed=1.5: expected int"),
    ("seed=true", "seed=true: expected int"),
    ("task=patrole", "task=patrole: there is no such task; did you mean patrol"),
    ("start=[1,2]", "start: task=patrol has no such setting; task=localise and task=planning have"),
    ("places=3", "places=3: places is a group of settings; write places.NAME=VALUE"),
    ("places.every=0", "places.every=0 is outside"),
    ("obstacles=[[1,2,3]]", "expected 4 finite numbers"),
    ("obstacle_count=-1", "obstacle_count=-1 is outside"),
    ("obstacles=[[1,2,nan,1]]", "expected 4 finite numbers"),
    ("obstacles=[[1,2,-1,1]]", "obstacles.width_m=-1.0 is outside"),
    ("planner.samples.deep=3", "planner.samples is a single value"),
    ("world=???", "world has no value; give it one on the command line: world=VALUE"),
    ("world=${world}", "interpolation"),
    ("world=${nowhere}", "nowhere"),
    ("seed", "write key=value"),
    ("=3", "write key=value"),
    ("seed=", "expected int"),
    ("~seed", "cannot be taken away"),
    ("+new=1", "unknown key new"),
    ("seed=1,2", "several values need --multirun"),
    ("hydra.ouput_subdir=x", "did you mean hydra.output_subdir?"),
    ("hydra/launcher=joblib", "--jobs N"),
    ("planner=null", "there is no such planner"),
    ("planner=[fake]", "choose one planner by name"),
    ("planner.name=prm", "a part is chosen by planner=prm"),
    ("experiment=nothing_like_it", "there is no such experiment"),
    ("planner=../planner/fake", "there is no such planner"),
    ("planner=nameless", "not_a_class from rhs-fakes 0.1) is not a dataclass"),
    ("planner=broken", "(rhs_fakes.broken:Broken from rhs-fakes 0.1) cannot be imported: ModuleNotFoundError"),
    ("planner=exits", "cannot be imported: SystemExit: 3"),
])
def test_a_bad_word_is_refused_in_one_line(word, says):
    assert says in refusal(word)


@pytest.mark.parametrize("target", ["os.system", "logging.os.system", "pandas.read_pickle", "pathlib.Path.unlink"])
@pytest.mark.parametrize("how", ["planner._target_={}", "+planner._target_={}", "_target_={}", "planner={{_target_: {}}}"])
def test_no_config_can_name_code(how, target):
    assert "unknown key" in refusal(how.format(target))


def test_one_bad_value_is_refused_alike_from_yaml_override_and_python(tmp_path):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "bad.yaml").write_text("# @package _global_\nplanner:\n  samples: -5\n")
    typed = refusal("planner.samples=-5")
    with pytest.raises(ConfigError) as from_yaml:
        compose_config([*CHOICE, "experiment=bad"], folders=(tmp_path,))
    assert str(from_yaml.value) == f"{tmp_path}/experiment/bad.yaml:3: {typed}"
    plain = to_plain(compose())
    plain["planner"]["samples"] = -5
    with pytest.raises(ConfigError) as read_back:
        from_plain(plain)
    assert str(read_back.value) == typed



def test_an_experiment_without_its_first_line_says_which(tmp_path):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "bare.yaml").write_text("world: square_small\n")
    with pytest.raises(ConfigError, match="experiment=bare: its file must begin with the line `# @package _global_`"):
        compose_config([*CHOICE, "experiment=bare"], folders=(tmp_path,))


@pytest.mark.parametrize(("text", "says"), [
    ("planner:\n  samples: 1\n  samples: 2\n", "x.yaml:4: the key 'samples' stands twice"),
    ("planner:\n\tsamples: 1\n", "(indent with spaces, not tabs)"),
    ("planner: {samples: 1\n", "x.yaml:"),
    ("planner:\n  samples: !!python/object/apply:os.system ['touch canary']\n", "x.yaml:3: asks for a Python object"),
    ("planner:\n  samples: 012\n", "x.yaml:3: planner.samples=012: expected int"),
    ("planner:\n  samples: 1e3\n", "x.yaml:3: planner.samples=1000.0: expected int"),
    ("planner:\n  smooth: no\n", "x.yaml:3: planner.smooth=no: expected bool"),
    ("planner:\n  samles: 3\n", "x.yaml:3: unknown key planner.samles; did you mean planner.samples?"),
    ("planner:\n  name: prm\n", "in a YAML file this is chosen by"),
    ("- a\n- b\n", "expected `key: value` lines"),
])
def test_a_bad_yaml_file_is_refused_by_file_and_line(tmp_path, text, says):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "x.yaml").write_text("# @package _global_\n" + text)
    with pytest.raises(ConfigError) as caught:
        compose_config([*CHOICE, "experiment=x"], folders=(tmp_path,))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not Path("canary").exists()


@pytest.mark.parametrize("text", ["planner:\n  samples: 5\n  mode: no\n", "\ufeffplanner:\n  samples: 5\n  mode: no\n",
                                  "planner:\r\n  samples: 5\r\n  mode: no\r\n"])
def test_byte_order_marks_and_line_ends_change_nothing(tmp_path, text):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "x.yaml").write_bytes(("# @package _global_\n" + text if text[0] != "\ufeff" else
                                                      "\ufeff# @package _global_\n" + text[1:]).encode())
    planner = compose_config([*CHOICE, "experiment=x"], folders=(tmp_path,)).planner.settings
    assert (planner.samples, planner.mode) == (5, "no")


def test_a_sensor_that_lacks_what_a_part_needs_is_refused_with_what_to_type():
    text = refusal("sensor=fake_mono")
    assert text.startswith("odometry=fake needs depth, which sensor=fake_mono does not provide; type ")
    assert "odometry=fake_blind" in text
    assert "sensor=fake" in text
    text = refusal("sensor=fake_mono", "odometry=fake_blind")
    assert text.startswith("mapper=fake needs scan, which sensor=fake_mono does not provide; type ")
    assert "odometry=fake_eye" in text
    assert compose("sensor=fake_mono", "odometry=fake_eye").sensor.name == "fake_mono"


def test_a_kind_misspelt_in_a_file_is_taken_for_that_kind(tmp_path):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "e.yaml").write_text("# @package _global_\nplaner:\n  samples: 7\n")
    with pytest.raises(ConfigError, match="e.yaml:2: unknown key planer; did you mean planner"):
        compose_config([*CHOICE, "experiment=e"], folders=(tmp_path,))


def test_an_experiment_chooses_parts_over_the_stack_and_words_choose_over_both(tmp_path):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "e.yaml").write_text(
        "# @package _global_\ndefaults:\n  - override /sensor: fake_mono\n  - override /odometry: fake_eye\n"
        "planner:\n  samples: 7\n")
    parts_by_word = [word for word in CHOICE if not word.startswith(("sensor=", "odometry="))]
    config = compose_config([*parts_by_word, "experiment=e"], folders=(tmp_path,))
    assert (config.sensor.name, config.odometry.name, config.planner.settings.samples) == ("fake_mono", "fake_eye", 7)
    config = compose_config([*parts_by_word, "experiment=e", "sensor=fake", "planner.samples=8"], folders=(tmp_path,))
    assert (config.sensor.name, config.odometry.name, config.planner.settings.samples) == ("fake", "fake_eye", 8)


def test_a_plugin_for_a_newer_program_is_refused_with_both_versions():
    text = refusal("planner=newer")
    assert "was written for plugin API 99; this rhs has 1" in text


def test_a_plugin_whose_library_is_missing_is_refused_with_the_command_to_install_it():
    assert refusal("planner=wanting").endswith("type: pip install some-planning-library")


def test_a_config_written_and_read_back_is_the_same():
    config = compose("seed=5", "planner.step_m=0.1", "obstacles=[[1,2,0.5,0.5]]", "mission.turn=arc")
    again = from_plain(to_plain(config))
    assert again == config
    assert config_hash(again) == config_hash(config)


def test_the_hash_knows_numbers_and_not_where_they_are_kept(tmp_path):
    base = config_hash(compose())
    assert config_hash(compose(f"output={tmp_path}", "recording=off", "video=true", "overwrite=true")) == base
    assert config_hash(compose("seed=1")) != base
    assert config_hash(compose("planner.samples=101")) != base


def test_the_generator_of_a_part_depends_on_seed_and_name_alone():
    draws = {name: parts.generator(0, name).random(4) for name in ("sensor", "planner")}
    assert not np.allclose(draws["sensor"], draws["planner"])
    np.testing.assert_array_equal(parts.generator(0, "sensor").random(4), draws["sensor"])
    assert not np.allclose(parts.generator(1, "sensor").random(4), draws["sensor"])


def test_parts_are_built_from_their_settings_with_generators_of_their_own(tmp_path):
    built = build_parts(compose("planner.samples=7", "seed=2"), "a world", tmp_path)
    assert built.planner.settings.samples == 7
    assert built.source.context.world == "a world"
    assert built.planner.context.camera is built.source.camera
    assert built.planner.context.rng.random() != built.sensor.rng.random()
    assert {"driving", "scan"} <= built.provides


def test_another_hydra_in_the_same_process_is_left_alone(tmp_path):
    import hydra

    (tmp_path / "mine.yaml").write_text("a: 1\n")
    with hydra.initialize_config_dir(str(tmp_path), version_base="1.3"):
        compose_config(CHOICE)
        assert hydra.compose("mine").a == 1


def test_an_experiment_may_change_the_cores_own_settings_and_a_word_has_the_last_say(tmp_path):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "e.yaml").write_text("# @package _global_\nmission:\n  turn: arc\n  step_m: 0.1\n")
    config = compose_config([*CHOICE, "experiment=e", "mission.step_m=0.15"], folders=(tmp_path,))
    assert (config.task.settings.mission.turn, config.task.settings.mission.step_m) == ("arc", 0.15)


def test_a_stack_may_change_the_cores_own_settings(tmp_path):
    """An earlier order of composing lost what a stack said of the patrol."""
    (tmp_path / "stack").mkdir()
    (tmp_path / "stack" / "calm.yaml").write_text(
        "# @package _global_\ndefaults:\n  - /odometry: fake\n  - /loop_closer: fake\n  - /mapper: fake\n"
        "  - /localiser: fake\nmission:\n  step_m: 0.1\n")
    config = compose_config([*CHOICE, "stack=calm"], folders=(tmp_path,))
    assert config.task.settings.mission.step_m == 0.1


@pytest.mark.parametrize("word", ["world=square", "localiser=odometry_only", "planner.start_radius_m=0.2",
                                  "mission.kidnap=true", "obstacles=[[1,1,1,1]]"])
def test_what_is_typed_for_a_drive_is_refused_where_a_recording_is_read(word):
    words = ["source=replay", "source.path=log.clf", "sensor=laser"]
    assert compose_config(words).source.name == "replay"
    with pytest.raises(ConfigError, match=r"is a recording, which nobody drives"):
        compose_config([*words, word])


@pytest.mark.parametrize(("words", "named"), [
    (["world=square"], True), (["source=replay", "source.path=log.clf", "sensor=laser"], False)])
def test_a_row_names_the_parts_that_drive_where_something_is_driven(words, named):
    row = identity(compose_config(words))
    assert "odometry" in row and all((kind in row) == named for kind in ("planner", "localiser", "replan"))


def test_the_building_of_a_recording_that_is_localised_is_its_given_map():
    words = ["task=localise", "source=replay", "source.path=log.clf", "sensor=laser", "localiser=particle_filter_scan"]
    by_world, by_map = (compose_config([*words, f"{key}=square"]) for key in ("world", "map"))
    assert by_world.task.settings.map == "square" and config_hash(by_world) == config_hash(by_map)
    with pytest.raises(ConfigError, match="nothing for world to do"):
        compose_config([*words, "map=square", "world=square"])


@pytest.mark.parametrize("words", [
    (), ("planner.samples=7", "seed=3"), ("planner.weights=[1,2.5]",), ("planner.limit=null", "planner.mode=12:30"),
    ("planner={samples: 7, smooth: false}",), ("places.every=5", "planner.step_m=1"), ("planner.mode=${world}",),
])
def test_values_put_in_by_hand_are_those_that_omegaconf_would_put_in(words):
    """Most jobs of a sweep change single values only; composing them leaves OmegaConf out."""
    options = [word for word in plain_words(parse([*CHOICE, *words])) if word.is_group]
    values = [word for word in plain_words(parse([*CHOICE, *words])) if not word.is_group]
    quick = hydra_glue.compose(options, schema=settings.defaults(Core))
    whole = hydra_glue.compose(options, schema=settings.defaults(Core))
    assert quick.plain is not None
    whole.__dict__["plain"] = None
    assert hydra_glue.with_values(quick, values) == hydra_glue.with_values(whole, values)


def test_a_second_name_of_a_part_is_told_beside_it_and_changes_no_hash():
    typed = identity(compose_config(["loop_closer=monocular"]))
    spelled = identity(compose_config(["loop_closer=pose_graph", "loop_closer.scan_every_m=0",
                                       "loop_closer.advanced.depth_share=0.06",
                                       "loop_closer.advanced.odometry_probability=0.99"]))
    assert typed.pop("presets") == "loop_closer=monocular" and typed == spelled and typed["loop_closer"] == "pose_graph"
    assert machine_dependent("presets")  # as it was typed: the same run by other words is equal
