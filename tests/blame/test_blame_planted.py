"""A fault planted in one link of the chain, and who is blamed for it. In the fakes' empty room, which is quick."""

import csv
import json
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from installing import CHOICE, FAKES, installed

import rhs
from rhs.api.belief import moved
from rhs.api.geometry import se2
from rhs.api.records import Belief, Motion, Path, PlanReason, Tracking
from rhs.base.errors import ConfigError
from rhs.config import registry
from rhs.runfolder.row import read_row

NOTHING: frozenset[str] = frozenset()
LINKS = ["odometry", "closing", "localise", "plan"]


@pytest.fixture(autouse=True)
def fakes():
    with installed(FAKES):
        yield
    registry._by_hand.clear()
    registry.forget()


@dataclass
class Plain:
    """A part that is its own settings."""

    needs: ClassVar[frozenset[str]] = NOTHING
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context):
        return type(self)()


@dataclass
class BentOdometry(Plain):
    """Turns a little too far with every view."""

    count: ClassVar[int] = 0

    def update(self, observation):
        self.count = self.count + 1
        step = np.eye(4) if self.count == 1 else se2(*observation.wheel) @ se2(0.0, 0.0, 0.15)
        return Motion(step, 1e-6 * np.eye(6), Tracking.OK)

    def revise(self):
        return None


@dataclass
class HalfLocaliser(Plain):
    """Counts half of every motion."""

    def learn(self, views, grid):
        pass

    def start(self, belief):
        self.belief = belief

    def update(self, observation, motion):
        half = motion.previous_from_body.copy()
        half[:2, 3] *= 0.5
        self.belief = moved(self.belief, Motion(half, motion.covariance, motion.status))
        return Belief(self.belief.map_from_body, self.belief.covariance)


@dataclass
class LostPlanner(Plain):
    """Finds no way to the first place."""

    def plan(self, problem):
        if problem.goal_m[0] > 2.5:
            return Path(PlanReason.DISCONNECTED, np.empty((0, 2)))
        return Path(PlanReason.OK, np.stack([problem.start_m, problem.goal_m]))


FAULTS = {"odometry": ("odometry", BentOdometry), "localise": ("localiser", HalfLocaliser),
          "plan": ("planner", LostPlanner)}


def blamed(folder, kind, cls, seed=0):
    rhs.register(kind, "wrong", cls)
    words = [word for word in CHOICE if not word.startswith(f"{kind}=")]
    row = rhs.run(["task=blame", *words, f"{kind}=wrong", f"links=[{','.join(LINKS)}]", f"seed={seed}", "gate.act=off",
                   "mission.views_max=60", f"output={folder}", "processes=2"], quiet=True)
    assert row["status"] == "ok", row["reason"]
    return row, json.loads((folder / "blame.json").read_text())


@pytest.mark.parametrize("link", FAULTS)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_link_with_the_planted_fault_is_named(link, seed, tmp_path):
    row, told = blamed(tmp_path / "run", *FAULTS[link], seed=seed)
    assert row["blame_link"] == told["link"] == link and f"{link} cost" in row["blame"]
    for measure, shares in told["shares"].items():
        if None not in (told['loss'][measure], *shares.values()):
            assert sum(shares.values()) == pytest.approx(told["loss"][measure] - told["rest"][measure], abs=1e-9)


def test_the_row_is_that_of_the_patrol_with_nothing_replaced_and_counterfactuals_say_so(tmp_path):
    words = [*CHOICE, "recording=off", "pictures=off"]
    plain = rhs.run([*words, f"output={tmp_path / 'plain'}"], quiet=True)
    links = "links=[odometry,closing,localise,plan]"  # the fakes' room is not the world's
    row = rhs.run(["task=blame", *words, links, "exact=true", f"output={tmp_path / 'blame'}"], quiet=True)
    for name in ("places_visited", "patrol_rmse_m", "path_length_m", "patrol_steps", "ate_rmse_m", "success"):
        assert row[name] == plain[name]
    with (tmp_path / "blame" / "counterfactuals.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [line["oracles"] for line in table][:2] == ["nothing", "odometry"] and len(table) == 16 == row["blame_runs"]
    assert not (tmp_path / "blame" / "counterfactuals").exists()


@dataclass
class CarriedSource(Plain):
    """The fakes' room, whose robot can be put elsewhere."""

    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "driving", "command", "wheel", "teleport"})
    image_width: int = 32
    views: int = 6
    delay_s: float = 0.0

    def build(self, context):
        from rhs_fakes.room import Room

        class Carried(Room):
            def teleport(self, world_from_body):
                self.pose = world_from_body

        return Carried(self, context)


@dataclass
class QuietSensor(Plain):
    """The fakes' sensor, whose noise can be switched off."""

    noise: bool = True
    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "scan", "wheel", "command"})

    def build(self, context):
        from rhs_fakes.room import Wheel

        sensor = Wheel(context)
        sensor.rng = sensor.rng if self.noise else Silent()
        return sensor


class Silent:
    def standard_normal(self, count):
        return np.zeros(count)


@dataclass
class Spun(Plain):
    """Wheels that count two thirds too much, and nothing else."""

    needs: ClassVar[frozenset[str]] = frozenset({"wheel"})

    def told(self, camera):
        return camera

    def degrade(self, capture, previous_from_body):
        return replace(capture, travel=5 / 3 * np.asarray(capture.travel))


@dataclass
class Spoilt(Spun):
    """The same of a degradation that spoils what is seen as well, and tells another camera."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "wheel"})

    def told(self, camera):
        return replace(camera, fx=2 * camera.fx)


@pytest.mark.parametrize(("cls", "link"), [(Spun, "drive"), (Spoilt, "sense")])
def test_a_degradation_is_taken_away_with_the_link_that_it_is_a_fault_of(cls, link, tmp_path):
    rhs.register("degrade", "spoilt", cls)
    rhs.register("source", "carried", CarriedSource)
    rhs.register("sensor", "quiet", QuietSensor)
    words = [word for word in CHOICE if word.partition("=")[0] not in ("source", "sensor")]
    row = rhs.run(["task=blame", *words, "source=carried", "sensor=quiet", "degrade=spoilt", "gate.act=off",
                   "links=[sense,drive]", "mission.views_max=60", f"output={tmp_path / 'run'}"], quiet=True)
    assert row["status"] == "ok", row["reason"]
    told = json.loads((tmp_path / "run" / "blame.json").read_text())
    other = "sense" if link == "drive" else "drive"
    assert row["blame_link"] == link and told["shares"]["ate"][link] > 0.2
    assert abs(told["shares"]["ate"][other]) < 0.01 and told["rest"]["ate"] < 0.01


def test_more_than_five_links_are_sampled_with_their_errors(tmp_path):
    for kind, name, cls in (("localiser", "half", HalfLocaliser), ("source", "carried", CarriedSource),
                            ("sensor", "quiet", QuietSensor)):
        rhs.register(kind, name, cls)
    words = [word for word in CHOICE if word.partition("=")[0] not in ("localiser", "source", "sensor")]
    links = ["sense", "odometry", "closing", "localise", "plan", "drive"]
    row = rhs.run(["task=blame", *words, "localiser=half", "source=carried", "sensor=quiet", f"links=[{','.join(links)}]",
                   "orders=3", "mission.views_max=60", f"output={tmp_path / 'run'}"], quiet=True)
    told = json.loads((tmp_path / "run" / "blame.json").read_text())
    assert row["blame_link"] == "localise" and row["blame_runs"] <= 3 * 7
    belief = told["shares"]["belief"]
    assert sum(belief.values()) == pytest.approx(told["loss"]["belief"] - told["rest"]["belief"], abs=1e-9)
    assert set(told["off_by"]["belief"]) == set(links) and told["off_by"]["belief"]["localise"] >= 0
    assert belief["localise"] > 0.9 * told["loss"]["belief"]


@pytest.mark.parametrize(("words", "says"), [
    (["links=[]"], "expected one or more"), (["links=[map,map]"], "different words"), (["links=[mapp]"], "map"),
    (["links=[sense]"], "no setting `noise`"), (["links=[drive]"], "cannot teleport"),
    (["slam=fake"], "nothing to replace")])
def test_what_cannot_be_blamed_is_refused(words, says, tmp_path):
    chosen = CHOICE if not words[0].startswith("slam") else [w for w in CHOICE if w.split("=")[0] in (
        "source", "sensor", "planner")]
    with pytest.raises(ConfigError, match=says):
        rhs.run(["task=blame", *chosen, *words, f"output={tmp_path / 'run'}"], quiet=True)


def test_a_counterfactual_that_fails_is_named(tmp_path):
    @dataclass
    class Raises(HalfLocaliser):
        def update(self, observation, motion):
            raise ValueError("out of luck")

    rhs.register("localiser", "raises", Raises)
    words = [word for word in CHOICE if not word.startswith("localiser=")]
    links = "links=[odometry,closing,localise]"  # the fakes' room is not the world's
    row = rhs.run(["task=blame", *words, "localiser=raises", links, f"output={tmp_path / 'run'}"], quiet=True)
    assert row["status"] == "failed" and "nothing replaced" in row["reason"] and "out of luck" in row["reason"]
    assert "localiser=raises" in row["reason"]
    assert 'raise ValueError("out of luck")' in (tmp_path / "run" / "traceback.txt").read_text()
    assert "Traceback" not in (tmp_path / "run" / "counterfactuals.csv").read_text()
    assert read_row(tmp_path / "run" / "row.json")["status"] == "failed"


def test_people_walk_in_the_counterfactuals_too(monkeypatch):
    from types import SimpleNamespace

    from rhs.blame import job
    from rhs.blame.settings import Blame
    from rhs.worlds.world import load_world

    monkeypatch.setattr(job, "BlameJob", lambda settings, context, world: world)
    context = SimpleNamespace(floor_plan=lambda: load_world("square_small"), seed=0)
    world = Blame(people=[[3.0, 1.0, 6.0, 1.0]], obstacles=[[5.0, 6.6, 0.3, 0.3]]).build(context)
    assert len(world.moving.people) == 1 and len(world.obstacles) == 1
