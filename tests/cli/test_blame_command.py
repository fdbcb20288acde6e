"""`python -m rhs blame RUN`: the configuration of a run, taken apart; old words in it; what is refused."""

import pytest

from rhs.api.settings import plain
from rhs.base.errors import ConfigError
from rhs.cli.blame import config_of
from rhs.cli.main import main
from rhs.cli.say import of_blame
from rhs.config.compose import compose_config, write_config
from rhs.config.dictionary import columns


@pytest.fixture
def run(tmp_path):
    write_config(compose_config(["world=square_small", "planner=rrt", "seed=3", "mission.margin_m=0.07"]), tmp_path)
    return tmp_path


def test_it_is_the_run_with_task_blame_and_the_words_over_it(run):
    config = config_of([str(run), "links=[map,plan]", "planner.goal_bias=0.2"])
    assert (config.task.name, config.world, config.seed) == ("blame", "square_small", 3)
    assert plain(config.task.settings)["mission"]["margin_m"] == 0.07 and config.task.settings.links == ["map", "plan"]
    assert config.planner.name == "rrt" and config.planner.settings.goal_bias == 0.2


def test_a_word_of_an_earlier_version_is_understood(run):
    file = run / "config.yaml"
    file.write_text(file.read_text().replace("renderer: raster", "renderer: tiny"))
    assert config_of([str(run)]).source.settings.renderer == "tinyrenderer"


def test_what_is_no_patrol_is_refused(tmp_path, run):
    for words, says in (([], "which run"), (["links=[map]"], "which run"), ([str(tmp_path / "no")], "no run folder")):
        with pytest.raises(ConfigError, match=says):
            config_of(words)
    write_config(compose_config(["task=planning", "world=map1"]), run)
    with pytest.raises(ConfigError, match="takes patrols apart"):
        config_of([str(run)])


def test_the_shares_fit_a_terminal_and_say_how_far_they_may_be_off():
    row = {"blame": "of 1 missed place map cost 1", "blame_measure": "places", "blame_off_by": 0.125}
    for link in ("odometry", "closing", "map", "localise", "rest"):
        row |= {f"blame_{measure}_{link}": 0.25 for measure in ("places", "belief", "ate", "way", "time")}
    first, places, *_, off_by, said = of_blame(row).splitlines()
    assert first.split() == ["cost", "of", "odometry", "closing", "map", "localise", "rest"]
    assert places.split() == ["places", "missed", *5 * ["0.25"]] and said == row["blame"]
    assert off_by == "(places missed: each may be off by 0.12)"
    assert max(map(len, of_blame(row).splitlines())) <= 110


def test_every_column_stands_apart_from_its_meaning(capsys):
    assert main(["help", "columns"]) == 0
    told = {line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("  ") and line.split()}
    assert set(columns()) <= told
