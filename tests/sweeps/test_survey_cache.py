"""Surveys that sweeps keep for later ones: the rows of runs that led their own, and nothing that is not theirs."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, environment, installed

from rhs.cli.commands import command
from rhs.config.compose import RunConfig, compose_config
from rhs.estimation.kept_views import KeptViews
from rhs.runfolder.row import canonical_hash, read_row
from rhs.sweeps import survey_cache

CHAIN = [word for word in CHOICE if not word.startswith(("localiser=", "odometry="))]
SWEEP = [*CHAIN, "localiser=fake", "odometry=fake", "planner.samples=5,6,7"]


def rhs(folder: Path, *words: str, site: Path = FAKES) -> str:
    env = environment(site, RHS_CACHE=str(folder / "cache"), RHS_CACHE_MB="100")
    return subprocess.run([sys.executable, "-m", "rhs", "-m", *words, "--jobs", "2"], cwd=folder, env=env, timeout=200,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True).stdout


def hashes(sweep: Path) -> dict[str, str]:
    return {path.parent.name: canonical_hash(read_row(path)) for path in sweep.glob("*/row.json")}


def named(config: RunConfig) -> str | None:
    return survey_cache.key_of(config, survey_cache.building_read(config))


def surveys(sweep: Path) -> set[str]:
    """The survey's rows of steps.csv, times and all: no two surveys take the same time."""
    return {"".join(line for line in path.read_text().splitlines() if ",survey," in line)
            for path in sweep.glob("*/steps.csv")}


@pytest.fixture(scope="module")
def first(tmp_path_factory) -> Path:
    """A folder with a sweep of three jobs, and the cache that it left."""
    folder = tmp_path_factory.mktemp("first")
    said = rhs(folder, *SWEEP, "output=a")
    assert "3 jobs: 3 ok" in said and "earlier" not in said, said
    assert len(list((folder / "cache" / "surveys").iterdir())) == 1
    return folder


def test_a_later_sweep_takes_the_survey_and_has_the_rows_of_jobs_that_lead_their_own(first):
    """A group of three takes it once; jobs that share nothing each."""
    said = rhs(first, *SWEEP[:-1], "planner.samples=5,6,8", "output=b")
    assert "3 jobs: 3 ok" in said and "1 of their surveys had been led by earlier sweeps" in said, said
    alone = rhs(first, *SWEEP[:-1], "planner.samples=9,10", "output=c", "share=false")
    assert "2 of their surveys had been led by earlier sweeps" in alone, alone
    anew = rhs(first, *SWEEP[:-1], "planner.samples=5,6,8,9,10", "output=d", "cache=false", "share=false")
    assert "5 jobs: 5 ok" in anew and "earlier" not in anew, anew
    assert surveys(first / "b") == surveys(first / "c") == surveys(first / "a") and len(surveys(first / "d")) == 5
    for run, name in hashes(first / "d").items():
        there = first / ("b" if (first / "b" / run).exists() else "c") / run
        assert canonical_hash(read_row(there / "row.json")) == name
        assert {path.name for path in there.iterdir()} == {path.name for path in (first / "d" / run).iterdir()}
        assert (there / "run.mcap").read_bytes() == (first / "d" / run / "run.mcap").read_bytes()


def test_a_file_that_was_changed_is_led_anew_and_replaced(first, tmp_path):
    kept = next((first / "cache" / "surveys").iterdir())
    cache = tmp_path / "cache" / "surveys"
    cache.mkdir(parents=True)
    (cache / kept.name).write_bytes(kept.read_bytes()[:-1] + b"!")
    said = rhs(tmp_path, *SWEEP, "output=s")
    assert "3 jobs: 3 ok" in said and "earlier" not in said, said
    assert hashes(tmp_path / "s") == hashes(first / "a") and (cache / kept.name).read_bytes()[-1:] != b"!"


def test_code_that_was_edited_leads_anew_but_for_parts_that_come_later(tmp_path):
    """A module that nobody names, which the source's module imports, and another package's planner."""
    site = shutil.copytree(FAKES, tmp_path / "site")
    (site / "helper.py").write_text("STEP = 1\n")
    parts = (site / "rhs_fakes" / "parts.py").read_text()
    (site / "late_package.py").write_text(parts.replace("from .", "from rhs_fakes."))
    room = site / "rhs_fakes" / "room.py"
    room.write_text(room.read_text().replace("import os\n", "import os\nimport helper\n", 1))
    points = site / "rhs_fakes-0.1.dist-info" / "entry_points.txt"
    points.write_text(points.read_text().replace("[rhs.planner]", "[rhs.planner]\nlate = late_package:FakePlanner"))
    words = [*(word for word in CHAIN if not word.startswith("planner=")), "localiser=fake", "odometry=fake", "planner=late"]

    def led_before(output: str) -> bool:
        said = rhs(tmp_path, *words, f"output={output}", site=site)
        assert "1 jobs: 1 ok" in said, said
        return "had been led by earlier sweeps" in said

    assert [led_before("a"), led_before("b")] == [False, True]
    (site / "late_package.py").write_text((site / "late_package.py").read_text() + "\n")
    assert led_before("c")
    (site / "helper.py").write_text("STEP = 2  # metres\n")
    assert [led_before("d"), led_before("e")] == [False, True]


def test_nothing_is_read_that_others_may_write_to(first, tmp_path, monkeypatch, caplog):
    """A pickle is code."""
    shutil.copytree(first / "cache", tmp_path / "cache")
    monkeypatch.setenv("RHS_CACHE", str(tmp_path / "cache"))
    kept = next((tmp_path / "cache" / "surveys").iterdir())
    with installed(FAKES):
        assert survey_cache.load(kept.stem) is not None
        kept.chmod(0o666)
        assert survey_cache.load(kept.stem) is None and "others may write to it" in caplog.text
        kept.chmod(0o600)
        kept.parent.chmod(0o777)
        assert survey_cache.load(kept.stem) is None
        kept.parent.chmod(0o700)
        assert survey_cache.load(kept.stem) is not None


def test_a_part_that_cannot_go_on_in_another_process_costs_time_and_no_row(tmp_path):
    words = [*CHAIN, "odometry=faulty", "odometry.how=handle", "odometry.at=1", "localiser=fake", "planner.samples=5"]
    assert "1 jobs: 1 ok" in rhs(tmp_path, *words, "output=a")
    said = rhs(tmp_path, *words, "output=b")
    assert "1 jobs: 1 ok" in said and hashes(tmp_path / "a") == hashes(tmp_path / "b"), said
    assert "it is led anew" in next((tmp_path / "b").glob("*/job.log")).read_text()


def test_the_key_is_that_of_all_the_survey_depends_on_and_of_nothing_else(tmp_path):
    world = tmp_path / "room.yaml"
    with installed(FAKES):
        def key(*words: str) -> str | None:
            return named(compose_config([*CHOICE, "recording=light", "pictures=off", *words]))

        one = key()
        assert one and one == key("planner.samples=5") == key("mission.arrive_m=0.5") == key("output=elsewhere")
        assert len({one, key("seed=1"), key("source.views=7"), key("world=home"), key("recording=off")}) == 5
        world.write_text("like: square_small\n")
        before = key(f"world={world}")
        assert before == key(f"world={world}") != one
        world.write_text("like: square_small\ncamera_height_m: 0.9\n")
        assert key(f"world={world}") not in (before, one)
        assert key("mission.survey=explore") is key("pictures=on") is key("task=survey") is None


def test_a_part_registered_by_hand_is_known_too_little():
    """Only where the survey asks it."""
    from rhs.config import registry

    with installed(FAKES):
        words = [*CHOICE[:2], "recording=light", "pictures=off"]
        for kind in ("odometry", "planner"):
            registry.register(kind, "by_hand", registry.load(kind, "fake"))
        rest = [word for word in CHOICE[2:] if not word.startswith(("odometry=", "planner="))]
        assert named(compose_config([*words, *rest, "planner=by_hand", "odometry=fake"]))
        assert named(compose_config([*words, *rest, "planner=fake", "odometry=by_hand"])) is None


def test_of_a_full_folder_those_go_first_that_were_used_longest_ago(tmp_path, monkeypatch):
    monkeypatch.setenv("RHS_CACHE", str(tmp_path))
    folder = survey_cache.cache_folder()
    folder.mkdir(parents=True)
    for name, used in (("a", 300), ("b", 100), ("c", 200)):
        path = folder / f"{name}.survey"
        path.write_bytes(b"x" * 1_000_000)
        os.utime(path, (used, used))
    assert survey_cache.clear(2.5) == (1, 1.0) and not (folder / "b.survey").exists()
    assert survey_cache.clear(2.0) == (0, 0.0) and survey_cache.kept() == (2, 2.0)
    survey_cache.clear(1.0)
    assert [path.name for path in folder.iterdir()] == ["a.survey"]


def test_the_command_says_what_is_kept_and_clears_it(first, tmp_path, monkeypatch, capsys):
    shutil.copytree(first / "cache", tmp_path / "cache")
    monkeypatch.setenv("RHS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("RHS_CACHE_MB", "50")
    assert command(["cache"])() == 0  # type: ignore[misc]
    count = survey_cache.kept()[0]
    assert count >= 1 and f"{count} surveys, 0 of 50 MB, in {tmp_path / 'cache' / 'surveys'}" in capsys.readouterr().out
    assert command(["cache", "clear"])() == 0  # type: ignore[misc]
    assert f"{count} surveys deleted" in capsys.readouterr().out and survey_cache.kept()[0] == 0


@pytest.mark.parametrize(("words", "message"), [
    (["cache", "clean"], "cache clean: expected nothing more, or clear"),
    (["-m", "seed=1,2", "cache=maybe"], "cache=maybe: expected true or false")])
def test_what_is_no_word_of_it_is_refused(words, message):
    told = subprocess.run([sys.executable, "-m", "rhs", *words], capture_output=True, text=True, timeout=60)
    assert told.returncode == 2 and message in told.stderr


def test_a_size_that_is_none_is_refused():
    told = subprocess.run([sys.executable, "-m", "rhs", "-m", "seed=1,2"], capture_output=True, text=True, timeout=60,
                          env={**os.environ, "RHS_CACHE_MB": "much"})
    assert told.returncode == 2 and "RHS_CACHE_MB=much: expected megabytes" in told.stderr


def test_views_are_the_same_from_another_file():
    from rhs.api.records import View
    from rhs.testing.room import HALL, SHORT, drive

    views, seen = KeptViews(), [view for _, view in drive(HALL, SHORT)][:3]
    for k, one in enumerate(seen):
        views.append(View(k, float(k), one.camera, None, None, None, None, None, None))  # type: ignore[arg-type]
    other = pickle.loads(pickle.dumps(views))  # noqa: S301
    assert len(other) == 3 and [view.stamp_s for view in other] == [0.0, 1.0, 2.0]
    assert other[2].camera == seen[2].camera


def test_what_is_solid_is_solid_in_another_process():
    from rhs.worlds.world import load_world
    from rhs_sources.simulator_solid import Solid

    solid = Solid(load_world("square_small"))
    x_m, y_m, _ = solid.world.start
    before = solid.distance_m(x_m, y_m)
    other = pickle.loads(pickle.dumps(solid))  # noqa: S301
    solid.close()
    assert other.distance_m(x_m, y_m) == before and 0.0 < before < 3.0
    other.close()
