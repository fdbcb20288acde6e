"""When may a robot say that it knows where it is? While places confirm its pose since the last doubt, and only a
contradiction is a doubt.

One recognised place is not enough where paintings look alike, and a robot that turns on the spot sees the same look-alike
again and again. So after a doubt several places have to agree with its own motion over some way, and so have several that
speak against what it knows. A robot that saw every view go on from the one before was not carried anywhere: it does not lose
its place because nothing is recognised.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhs.api.geometry import planar, se2, wrap
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Scan
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.views.motion_consistency import Continuity
from rhs.estimation.views.place_database import PlaceAnswer, Recognised

from .advanced import ConfirmationRules

USUAL = ConfirmationRules()


class Confirmation:
    """Counts what speaks for the pose believed in. known: it was given where it is, or nothing is there to confirm it.

    confirmed: it may call itself sure. watched: since a place last confirmed, each view went on from the one before."""

    def __init__(self, known: bool, rules: ConfirmationRules = USUAL) -> None:
        self.confirmed, self.watched, self._rules = known, known, rules
        self._clear()

    def _clear(self) -> None:
        self._named, self._stale_m = False, 0.0  # a place was named where the robot believes to be, after the last
        # contradiction, and the way since then
        self._count, self._way_m = 0, 0.0
        self._silences, self._silent_m = 0, 0.0

    @property
    def held(self) -> bool:
        """Sure, and nobody can have carried it off unseen: what speaks against it has to be strong."""
        return self.confirmed and self.watched

    def doubt(self) -> None:
        """What was known is known no longer."""
        self.confirmed = False
        self._clear()

    def resume(self) -> None:
        """The doubt was none: what was known is known again."""
        self._clear()
        self.confirmed = self.watched = True

    def divided(self) -> None:
        """The belief is shared between places: it is not sure, and those that confirm it have to begin anew."""
        named, stale_m = self._named, self._stale_m
        self.doubt()
        self._named, self._stale_m = named, stale_m

    def travel(self, previous_from_body: np.ndarray, seen: Continuity) -> None:
        """The robot moved (4x4), and its view went on from the last or not. Way counts from the first confirmation on."""
        way_m = float(np.hypot(*planar(previous_from_body)[:2]))
        self._way_m += way_m if self._count else 0.0
        self._silent_m += way_m if self._silences else 0.0
        self._stale_m += way_m
        self.watched = self.watched and seen is Continuity.GOES_ON
        if seen is Continuity.BROKEN:
            self.doubt()

    def place_named(self, *, agrees: bool) -> None:
        """A place that explains much of the view was named: where the robot believes to be, or elsewhere. One named
        elsewhere does not overthrow what is confirmed, but those that confirm it have to begin anew."""
        self._named, self._stale_m = agrees, 0.0
        if not agrees:
            self._count, self._way_m = 0, 0.0
            return
        self._silences, self._silent_m, self.watched = 0, 0.0, True
        self._count += 1
        self.confirmed = self.confirmed or (self._count >= self._rules.confirmations and self._way_m >= self._rules.way_m)

    def silent(self) -> bool:
        """No place was recognised where one ought to be. Whether that speaks against the belief at once; to a robot that
        watched its way it does so only after some way."""
        held = self.held
        self._silences += 1
        if self._silences >= self._rules.silences and (not held or self._silent_m >= self._rules.silent_m):
            self.doubt()
        return not held

    def follow(self, expected: np.ndarray, believed: np.ndarray) -> None:
        """Doubt when the belief (3,) is not where the one before and the motion put it (3,)."""
        gap = believed - expected
        if np.hypot(gap[0], gap[1]) > self._rules.jump_m or abs(wrap(gap[2])) > np.radians(self._rules.jump_deg):
            self.doubt()

    @property
    def chance(self) -> float:
        """Chance that the best belief is right, were its weight one: low while no place was named there, rising with the way
        confirmed, falling with the way in which nothing more was: then it is time to look round again
        (rhs.patrol.relocate)."""
        r = self._rules
        if self.confirmed or not self._named:
            return 1.0 if self.confirmed else r.unnamed
        confirmed = 0.6 + 0.35 * min(self._count / r.confirmations, self._way_m / r.way_m, 1.0)
        return max(confirmed * 0.5 ** (self._stale_m / r.stale_m), r.unnamed)


class Contradiction:
    """PlaceEvidence named somewhere else while the robot knows where it is: looked at again before anything is moved.

    A named place counts against a sharp belief only when `repeats` views in a row name it, at poses that differ by the
    motion between them: a look-alike seldom stays one as the robot moves. Against a belief that is `held` it takes
    `against` of them over `against_m`. pending: checked views in a row that have named another place."""

    def __init__(self, rules: ConfirmationRules = USUAL) -> None:
        self._rules = rules
        self._forget()

    def _forget(self) -> None:
        self.pending, self._way_m, self._silent_m = 0, 0.0, 0.0
        self._named = np.empty((0, 3))

    def chance(self, *, held: bool) -> float:
        """What the belief keeps of its chance: each place named elsewhere takes half of it, or 3 % of a belief that is
        held; there no more of them count than would overthrow it."""
        return 0.97 ** min(self.pending, self._rules.against) if held else 0.5**self.pending

    def move(self, previous_from_body: np.ndarray) -> None:
        """The robot moved (4x4), and so would the named places have."""
        self._named = np.array([planar(se2(*pose) @ previous_from_body) for pose in self._named]).reshape(-1, 3)
        way_m = float(np.hypot(*planar(previous_from_body)[:2])) if self.pending else 0.0
        self._way_m, self._silent_m = self._way_m + way_m, self._silent_m + way_m
        if self._silent_m > self._rules.forgotten_m:
            self._forget()

    def convinces(self, named: Sequence[np.ndarray], *, against: bool, held: bool) -> bool:
        """Whether the named poses (3,) are to be accepted. Those that do not speak against a sharp belief always are."""
        if not against:
            self._forget()
            return True
        self._silent_m = 0.0
        again = any(same_place(pose, mean, self._rules) for mean in self._named for pose in named)
        self.pending, self._way_m = (self.pending + 1, self._way_m) if again else (1, 0.0)
        self._named = np.array(named).reshape(-1, 3)
        if held:
            return self.pending >= self._rules.against and self._way_m >= self._rules.against_m
        return self.pending >= self._rules.repeats


def possible(answer: PlaceAnswer, walls: ScanMatcher | None, rules: ConfirmationRules = USUAL) -> list[Recognised]:
    """The distinct places of an answer, without those where no robot can stand."""
    return [r for r in answer.distinct if walls is None or walls.room_m(planar(r.map_from_body)) >= rules.room_m]


def fits(
    scan: Scan | None, walls: ScanMatcher | None, pose: np.ndarray, rules: ConfirmationRules = USUAL
) -> bool:
    """Whether a scan, if there is one, could have been taken from a planar pose (3,)."""
    return scan is None or walls is None or not walls.share(scan, pose) < rules.fits_share


def hidden(scan: Scan | None, grid: OccupancyGrid | None, pose: np.ndarray, rules: ConfirmationRules = USUAL) -> bool:
    """Whether somebody stands before what could be recognised from a planar pose (3,): many beams of the scan end before the
    first wall of the map, and hardly any behind it, as those of a robot that is elsewhere do."""
    from rhs.estimation.scans.rays import cast  # compiled code

    if scan is None or grid is None:
        return False
    known = np.isfinite(scan.ranges_m)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    eye = pose[:2] + np.array([[c, -s], [s, c]]) @ scan.origin_xy_m
    walls_m = cast(grid.occupied(), grid, eye, scan.bearings_rad[known] + pose[2], scan.max_range_m)
    short_m = walls_m - scan.ranges_m[known]
    before, behind = (short_m > rules.before_m).sum(), (short_m < -rules.before_m).sum()
    beams = max(len(scan.ranges_m), 1)
    return bool(before >= rules.hidden_share * beams and behind <= rules.behind_share * beams)


def same_place(pose_a: np.ndarray, pose_b: np.ndarray, rules: ConfirmationRules = USUAL) -> bool:
    """Whether two planar poses (3,) are one place."""
    gap = pose_a - pose_b
    return bool(np.hypot(gap[0], gap[1]) < rules.same_m and abs(wrap(gap[2])) < np.radians(rules.same_deg))
