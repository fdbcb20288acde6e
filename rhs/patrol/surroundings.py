"""What the robot has seen round itself in the last seconds, in the frame of its own motion: whatever its belief in the map
is worth, it does not drive into what it has seen, nor where it has not looked."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import planar, se2
from rhs.api.grid import inflate
from rhs.api.records import Motion, Observation, Scan, Tracking, Twist
from rhs.api.robot_shape import Footprint
from rhs.estimation.scans.settings import VoteSettings

from .control import ARC_STEP_M, arc
from .ends import Ends
from .neighbours import has_neighbour, near_any, nears, width_m

SIDE_M, CELL_M = 12.0, 0.05  # of the grid that goes with the robot
KEPT_M = 2.0  # the robot stays this near its middle
THING = 0.75  # votes from which a cell holds a thing: one beam that ended there and none that passed
NEAR_M = 2.5  # things further from the robot are no matter of the next command
TURN_STEP_RAD = np.radians(2.0)  # between two of its headings on the spot
SURE = 2.0  # votes of a thing that a tight way has to keep from: what the edges of things smear by a cell has fewer
SPECK_M, SPECK_VOTES = 2.5 * CELL_M, 2.0  # a cell that one view alone held for a thing, with no other so near, is none
CAME_NEAR_M, NOTHING = 0.3, np.zeros((0, 2))  # the rest of who came is so near
PATCH_M = 0.1  # grain of the ground that has to be seen
HIDES_M = 0.5  # furniture that stands in the way is as deep as that; what of it was not seen is this near to what was
HIDDEN_M = 1.0  # what is hidden further away is no matter of the next command
MAPPED_M = 0.12  # so near to something of the map a thing is that: half of its cell, and the belief's error
TRAIL_S = 2.0  # nothing that walks on is seen for longer in one cell; other low things are kept unless they bar for long
NEXT_M = 2 * CELL_M  # what is known to stand this near the robot's side is what it touches
CELL_REACH_M = 0.7 * CELL_M  # from the middle of a cell to its corners
STEPS_M = 0.15  # so near its side the robot looked before it drove up: GuardSettings.ahead_m
BESIDE_M = 0.25  # what came and was last seen this near the robot's side is nearer than it sees: nobody saw it go
# Something came where nothing was: so many new cells, this near, seen free so lately, no thing known within so much of them
# (odometry, depth noise and the corners of walls move the ends of beams by a cell or two)
CAME_CELLS, CAME_WITHIN_M, CAME_SEEN_S, CAME_APART_M = 5, 3.5, 10.0, 0.15
CAME_WIDE_M = 0.1  # and so far across the line of sight: a face seen edge-on comes and goes with each step of the robot


class Surroundings:
    """A grid of votes with the time at which each cell was seen last; its frame begins where the patrol does."""

    def __init__(self, radius_m: float, votes: VoteSettings, *, remember_s: float, fade_s: float = np.inf,
                 low_s: float = np.inf, pictured_m: float = 0.0, footprint: Footprint | None = None) -> None:
        """Seconds: what was seen is remembered; what came is, when it is seen no more; what is low and came unnoticed, while
        something moves. footprint: of a robot that is not round, and lies in the circle of radius_m."""
        from rhs.estimation.scans.votes import Votes  # compiled code

        self.footprint, self.pictured_m = footprint, pictured_m  # how exactly one camera sees, metres
        self.radius_m, self.remember_s, self.fade_s, self.low_s = radius_m, remember_s, fade_s, low_s
        cells = round(SIDE_M / CELL_M)
        corner = (-0.5 * SIDE_M, -0.5 * SIDE_M)
        self.at_eye, self.below = (Votes((cells, cells), CELL_M, corner, votes) for _ in range(2))
        self.ends = Ends((cells, cells))
        self.seen_s = np.full((cells, cells), -np.inf)
        self.pose, self.now_s = np.eye(4), -np.inf
        self.moved_s = -np.inf  # when something was last seen where nothing had been
        self.free_s = [np.full((cells, cells), -np.inf) for _ in range(2)]  # when a layer last saw nothing in a cell
        self.below_s = np.full((cells, cells), -np.inf)  # when the layer below last saw a cell, whatever the motion
        self.floor_s = np.full((cells, cells), -np.inf)  # the same, or when the robot stood there or could not see it better
        self.behind_s = np.full((cells, cells), -np.inf)  # when a view last showed the face of something low before a cell
        self.since_s = np.full((cells, cells), np.inf)  # when the layer below first saw what stands there
        self.came_s = np.full((cells, cells), np.inf)  # of such cells: when last; inf: what was always there
        self._times = {-np.inf: (self.seen_s, self.below_s, self.floor_s, self.behind_s, *self.free_s),
                       np.inf: (self.came_s, self.since_s)}
        self.scan: Scan | None = None  # of the last view
        self.sight: Scan | None = None  # the widest measured scan of the last view
        self.map_m: np.ndarray | None = None  # (K, 2) what the map knows near the robot, in its body frame; None: it is lost
        self.keeps_beside = True  # what is beside the robot is remembered longer
        self.monocular = False  # the last scan is of pictures that were compared: none while the robot turns on the spot
        reach = np.arange(-round(1.2 / PATCH_M), round(1.2 / PATCH_M) + 1) * PATCH_M
        self._patches = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)  # round the robot, metres

    def observe(self, observation: Observation, motion: Motion) -> None:
        """Take one view; scans that an odometry only believes in do not count as sight. A motion that nobody knows (the gate
        replaced it, or no scan can follow the last by it: wheels spun, or somebody carried the robot) makes what was seen
        before worthless."""
        from rhs.estimation.scans.votes import behind, low_only
        from rhs.estimation.views.motion_consistency import Continuity, scan_continuity

        if motion.status is Tracking.LOST and (motion.replaced or scan_continuity(
                self.scan, observation.scan, motion.previous_from_body) is Continuity.BROKEN):
            self.forget()
        self.scan = observation.scan
        if motion.status is not Tracking.OK:
            for free_s in self.free_s:
                free_s[:] = -np.inf
        self.pose = self.pose @ se2(*planar(motion.previous_from_body))
        self.now_s = observation.stamp_s
        self._follow()
        scan, obstacle = observation.scan, observation.obstacle
        if scan is None and obstacle is None and motion.scan_measured:
            scan, self.monocular = motion.scan, True
        self.sight = obstacle if obstacle is not None else scan
        seen, exact = [], not self.monocular  # of two pictures no end is more so than a cell
        self.at_eye.walks = self.below.walks = np.isfinite(self.came_s)
        if scan is not None:
            seen.append((self.at_eye, 0, *self.ends.look(self.at_eye, self.pose, scan, np.isfinite(scan.ranges_m), exact)))
        if obstacle is not None:
            low = low_only(obstacle, scan)
            seen.append((self.below, 1, *self.ends.look(self.below, self.pose, obstacle, low, exact)))
            rows, columns = self._cells_at(behind(obstacle, low, HIDES_M, step_m=CELL_M)).T
            self.behind_s[rows, columns] = self.now_s
        if motion.status is Tracking.OK:  # else what was seen before may stand elsewhere in this frame
            for layer, number, votes, cells in seen:
                self._note_what_came(layer.votes, votes, cells, self.free_s[number])
        for layer, number, _, cells in seen:
            nothing = cells[layer.votes[cells[:, 0], cells[:, 1]] <= 0.0]
            self.free_s[number][nothing[:, 0], nothing[:, 1]] = self.now_s
            self.seen_s[cells[:, 0], cells[:, 1]] = self.now_s
            if layer is self.below:
                rows, columns = cells.T
                self.below_s[rows, columns] = self.floor_s[rows, columns] = self.now_s
                stands = self.below.votes[rows, columns] > 0.0
                self.since_s[rows, columns] = np.where(stands, np.minimum(self.since_s[rows, columns], self.now_s), np.inf)
        self._stand()

    def _note_what_came(self, now: np.ndarray, before: np.ndarray, cells: np.ndarray, free_s: np.ndarray) -> None:
        """Whether things stand in cells (K, 2) that this layer saw free a moment ago, away from what was there already. now,
        before: its votes. free_s (H, W): when it last saw nothing in each cell."""
        rows, columns = cells.T
        new_votes, old_votes = now[rows, columns], before[rows, columns]
        hit = (new_votes > old_votes) | (new_votes >= self.at_eye.settings.most)
        again = hit & np.isfinite(self.came_s[rows, columns])
        self.came_s[rows[again], columns[again]] = self.now_s
        nothing = (self.at_eye.votes[rows, columns] <= 0.0) & (self.below.votes[rows, columns] <= 0.0)
        self.came_s[rows[nothing], columns[nothing]] = np.inf
        lately_s = self.now_s - CAME_SEEN_S
        new = cells[hit & (free_s[rows, columns] > lately_s)]
        new = new[np.hypot(*self._middles(new).T) < CAME_WITHIN_M]
        if len(new) < CAME_CELLS:
            return
        layers = zip((self.at_eye, self.below), self.free_s, strict=True)
        stood = [(layer.votes > 0.0) & (nothing_s <= lately_s) for layer, nothing_s in layers]
        things = (stood[0] | stood[1]) & ~np.isfinite(self.came_s)
        reach = round(CAME_APART_M / CELL_M)
        counted = np.zeros((things.shape[0] + 1, things.shape[1] + 1), int)
        counted[1:, 1:] = things.cumsum(axis=0).cumsum(axis=1)
        low, high = np.maximum(new - reach, 0).T, np.minimum(new + reach + 1, things.shape[0]).T
        near = counted[high[0], high[1]] - counted[low[0], high[1]] - counted[high[0], low[1]] + counted[low[0], low[1]]
        came = new[near == 0]
        if len(came) >= CAME_CELLS and width_m(self._middles(came)) > CAME_WIDE_M:
            self.moved_s = self.now_s
            self.came_s[came[:, 0], came[:, 1]] = self.now_s
            near = inflate(self.came_s == self.now_s, HIDES_M / CELL_M)
            self.seen_s[near] = self.floor_s[near] = -np.inf  # the rest of who came stands on ground that was seen before

    def came_near(self, point_m: np.ndarray) -> bool:
        """Whether something that was seen to come, not long out of sight, stands near the point (2,) of the body frame."""
        return bool((np.hypot(*(self.came_now(self.fade_s) - point_m).T) < CAME_NEAR_M).any())

    def came_now(self, within_s: float = 0.0) -> np.ndarray:
        """(K, 2) where something that was seen to come is seen in this view, or was that lately, in the body frame."""
        return self._middles(np.argwhere(np.isfinite(self.came_s) & (self.came_s >= self.now_s - within_s)))

    def _middles(self, cells: np.ndarray) -> np.ndarray:
        """(K, 2) middles of cells (K, 2), row and column, in the body frame."""
        return self.in_body((cells[:, ::-1] + 0.5) * CELL_M + self.at_eye.origin_m)

    @property
    def moves(self) -> bool:
        """Whether something was seen to move lately."""
        return self.now_s - self.moved_s < self.remember_s

    def forget(self) -> None:
        """Nothing was seen yet."""
        for layer in (self.at_eye, self.below):
            layer.votes[:] = 0.0
        for never_s, arrays in self._times.items():
            for array in arrays:
                array[:] = never_s

    def forget_near(self, points_m: np.ndarray, within_m: float) -> bool:
        """Forget what stands near the points (K, 2) of the body frame. Whether anything did."""
        cells = np.argwhere((self.at_eye.votes > 0.0) | (self.below.votes > 0.0))
        gone = cells[near_any(self._middles(cells), points_m, within_m)]
        for layer in (self.at_eye, self.below):
            layer.votes[gone[:, 0], gone[:, 1]] = 0.0
        return len(gone) > 0

    def forget_specks(self) -> None:
        """What one cell alone holds for a thing, however often it was seen: the flying pixels of an edge make such, and
        nearer than the camera sees the floor nothing clears them."""
        cells = np.argwhere(np.maximum(self.at_eye.votes, self.below.votes) >= THING)
        lone = cells[~has_neighbour(cells * CELL_M, SPECK_M)]
        for layer in (self.at_eye, self.below):
            layer.votes[lone[:, 0], lone[:, 1]] = 0.0

    def _saw(self, cells: np.ndarray) -> None:
        """All heights above the floor were looked at in these cells (K, 2)."""
        self.seen_s[cells[:, 0], cells[:, 1]] = self.floor_s[cells[:, 0], cells[:, 1]] = self.now_s

    def _stand(self) -> None:
        """Where the robot stands there is nothing else."""
        here = self._cells(self.pose[:2, 3] + self._patches)
        if self.footprint is None:
            away_m, side_m = np.hypot(*self._patches.T), self.radius_m
        else:
            away_m, side_m = self.footprint.gaps_m(self._patches @ self.pose[:2, :2]), 0.0
        self._saw(here[away_m < side_m])
        core = here[away_m < side_m - 2 * CELL_M]
        for layer in (self.at_eye, self.below):
            layer.votes[core[:, 0], core[:, 1]] = 0.0

    def _follow(self) -> None:
        """Keep the robot near the middle of the grid; what falls out at the border is forgotten."""
        off = self.pose[:2, 3] - (self.at_eye.origin_m + 0.5 * SIDE_M)
        if np.abs(off).max() < KEPT_M:
            return
        by, size = np.rint(off / CELL_M).astype(int), len(self.seen_s)
        columns, rows = np.clip(by, -size, size)
        wide = max(abs(rows), abs(columns))
        kept = slice(wide + rows, wide + rows + size), slice(wide + columns, wide + columns + size)
        for empty, arrays in ((0.0, (self.at_eye.votes, self.below.votes, *self.ends.arrays)), *self._times.items()):
            for array in arrays:
                array[:] = np.pad(array, wide, constant_values=empty)[kept]
        for layer in (self.at_eye, self.below):
            layer.origin_m = layer.origin_m + by * CELL_M

    def _cells(self, points_m: np.ndarray) -> np.ndarray:
        """(K, 2) row and column of (K, 2) points of the frame."""
        return np.clip(np.floor((points_m - self.at_eye.origin_m) / CELL_M).astype(int)[:, ::-1], 0, len(self.seen_s) - 1)

    def _cells_at(self, points_m: np.ndarray) -> np.ndarray:
        return self._cells(self.in_frame(points_m))  # of points (K, 2) of the body frame

    def things(self, within_s: float = np.inf, *, least: float = THING) -> np.ndarray:
        """(K, 2) things near the robot that were looked at in the last within_s seconds, metres in its body frame. least:
        votes."""
        reach = round(NEAR_M / CELL_M)
        row, column = np.maximum(self._cells(self.pose[None, :2, 3])[0] - reach, 0)
        near = slice(row, row + 2 * reach + 1), slice(column, column + 2 * reach + 1)
        rows, columns = np.nonzero(np.maximum(self.at_eye.votes[near], self.below.votes[near]) >= least)
        cells = rows + row, columns + column
        points = np.stack([cells[1] + 0.5, cells[0] + 0.5], axis=-1) * CELL_M + self.at_eye.origin_m
        points += np.stack([self.ends.x_m[cells], self.ends.y_m[cells]], axis=-1)
        seen_s, below_s, came_s = self.seen_s[cells], self.below_s[cells], self.came_s[cells]
        at_eye, below = self.at_eye.votes[cells] >= least, self.below.votes[cells] >= least
        remembered = seen_s >= self.now_s - self.remember_s
        beside = self.keeps_beside & (np.linalg.norm(points - self.pose[:2, 3], axis=-1) < self.radius_m + BESIDE_M)
        beside &= came_s >= self.now_s - self.low_s  # nobody saw it go; but who came goes on after a while
        fresh = remembered & (came_s >= self.now_s - self.fade_s)  # what came may have gone unseen
        low = below & fresh & (below_s >= self.now_s - within_s)
        if self.moved_s > -np.inf:  # so may a trail of votes that a pet left too near to be seen cleared
            stale = low & (below_s < self.now_s - self.low_s)
            if self.keeps_beside:
                stale &= below_s - self.since_s[cells] < TRAIL_S
            low[stale] = self._on_map(self.in_body(points[stale]))
        low |= below & beside & (below_s >= self.now_s - self.remember_s)
        found = low | (at_eye & ((fresh & (seen_s >= self.now_s - within_s)) | (beside & remembered)))
        points, votes = points[found], np.maximum(self.at_eye.votes[cells], self.below.votes[cells])[found]
        body = self.in_body(points[(votes >= SPECK_VOTES) | has_neighbour(points, SPECK_M)])
        return body[np.hypot(*body.T) < NEAR_M]

    def _on_map(self, points_m: np.ndarray, within_m: float = MAPPED_M) -> np.ndarray:
        """(K,) bool: of points (K, 2) of the body frame, those where the map knows something: that does not go."""
        return near_any(points_m, NOTHING if self.map_m is None else self.map_m, within_m)

    def bump(self, ahead: float, known_m: np.ndarray = NOTHING) -> np.ndarray:
        """Something was touched at the front (ahead > 0) or the back: where something is known to stand, by what was seen or
        else known_m (K, 2) in the body frame, else in the middle; the (K, 2) points of it in the body frame."""
        angles = np.radians(np.linspace(-30.0, 30.0, 7)) + self._touched_at_rad(ahead, known_m)
        points = ((self._reach_m(angles) + CELL_M) * np.stack([np.cos(angles), np.sin(angles)])).T
        cells = self._cells_at(points)
        self.below.votes[cells[:, 0], cells[:, 1]] = self.below.settings.most
        self.ends.forget(cells)
        self.below_s[cells[:, 0], cells[:, 1]] = self.now_s
        self._saw(cells)
        return points

    def _touched_at_rad(self, ahead: float, known_m: np.ndarray) -> float:
        """The bearing of what is known to stand next to that half of the robot; else the middle of it."""
        things = np.concatenate([self.things(), known_m])
        things = things[things[:, 0] * ahead > -NEXT_M]
        bearings_rad = np.arctan2(things[:, 1], things[:, 0])
        gaps_m = np.hypot(*things.T) - self._reach_m(bearings_rad)
        if len(gaps_m) and gaps_m.min() < NEXT_M:
            return float(bearings_rad[np.argmin(gaps_m)])
        return 0.0 if ahead > 0 else float(np.pi)

    def _reach_m(self, bearings_rad: np.ndarray) -> np.ndarray:
        """(K,) metres from the robot's middle to its side."""
        return np.full(len(bearings_rad), self.radius_m) if self.footprint is None else self.footprint.reach_m(bearings_rad)

    def free_way_m(self, command: Twist, margin_m: float, up_to_m: float, *, walls_m: np.ndarray = NOTHING,
                   hidden_m: np.ndarray = NOTHING, least: float = THING, turned_rad: float = 0.0) -> float:
        """Metres along the command's arc until the robot's side would be nearer than margin_m to a thing that it comes
        nearer to; at most up_to_m. walls_m (K, 2): things that somebody else knows of, in the body frame; hidden_m (K, 2):
        middles of cells in which something may stand, up to their corners where something moves; least: votes; turned_rad:
        of a robot that turns on the spot first."""
        seen = self.things(least=least)
        things = np.concatenate([seen, walls_m, hidden_m]) @ se2(0.0, 0.0, turned_rad)[:2, :2]  # as it will have them ahead
        margins_m = np.full(len(things), margin_m)
        margins_m[:len(seen)] += self._unsure_m(seen)
        margins_m[len(seen) + len(walls_m):] += CELL_REACH_M * self.moves
        return self.way_to_m(command, things, margins_m, up_to_m)

    def way_to_m(self, command: Twist, things: np.ndarray, margins_m: np.ndarray, up_to_m: float) -> float:
        """The same to these things (K, 2) of the body frame alone, by margins (K,)."""
        if not len(things):
            return up_to_m
        at, way = arc(command, up_to_m)
        gaps_m = np.linalg.norm(at[:, None] - things, axis=2) - self.radius_m
        if self.footprint is None:
            wrong = nears(gaps_m, np.linalg.norm(things, axis=1) - self.radius_m, margins_m)
        else:
            curvature = command.turn_radps / command.forward_mps if command.forward_mps else 0.0
            yaw_rad = curvature * way * (1.0 if command.forward_mps >= 0 else -1.0)
            close = (gaps_m < margins_m).any(axis=0)
            wrong = self._too_near(self.footprint, things[close], np.column_stack([at, yaw_rad]), margins_m[close])
        bad = wrong.any(axis=1)
        return float(way[np.argmax(bad)] - ARC_STEP_M) if bad.any() else up_to_m

    def _unsure_m(self, things_m: np.ndarray) -> np.ndarray:
        """(K,) metres by which things (K, 2) of the body frame may stand nearer than they were seen: what one camera read
        off pictures and the map does not know."""
        reads = self.monocular and self.map_m is not None
        return np.where(self._on_map(things_m), 0.0, self.pictured_m) if reads else np.zeros(len(things_m))

    def free_turn_rad(self, turn_rad: float, margin_m: float) -> float:
        """How far of a turn on the spot (left positive) the robot's side comes no nearer than margin_m to a thing that it
        comes nearer to; all of it for a round one."""
        things = self.things()
        if self.footprint is None or not len(things):
            return turn_rad
        steps = max(1, int(np.ceil(abs(turn_rad) / TURN_STEP_RAD)))
        yaw_rad = turn_rad * np.arange(1, steps + 1) / steps
        stands = np.column_stack([np.zeros((steps, 2)), yaw_rad])
        bad = self._too_near(self.footprint, things, stands, margin_m).any(axis=1)
        return float(turn_rad * np.argmax(bad) / steps) if bad.any() else turn_rad

    @staticmethod
    def _too_near(footprint: Footprint, things_m: np.ndarray, stands: np.ndarray,
                  margin_m: float | np.ndarray) -> np.ndarray:
        """(M, K) bool: on each of stands (M, 3), x, y, yaw in the body frame, the robot's side is nearer than margin_m
        (K,) to the thing (K, 2), and nearer than now."""
        from_m, (c, s) = things_m - stands[:, None, :2], (f(stands[:, None, 2]) for f in (np.cos, np.sin))
        turned = np.stack([from_m[..., 0] * c + from_m[..., 1] * s, from_m[..., 1] * c - from_m[..., 0] * s], axis=-1)
        return nears(footprint.gaps_m(turned), footprint.gaps_m(things_m), margin_m)

    def unseen(self, command: Twist, *, margin_m: float, up_to_m: float, since_s: float) -> np.ndarray:
        """(K, 2) patches that the robot would pass over on the command's arc, or within margin_m of, and that no view since
        since_s has covered, in this frame. Not those within margin_m of where it stands."""
        at, _ = arc(command, up_to_m)
        gaps = np.linalg.norm(self._patches[:, None] - at[None, ::2], axis=2).min(axis=1)
        side_m = self.radius_m + margin_m
        ahead = self._patches[(gaps < side_m) & (np.hypot(*self._patches.T) > side_m)]
        return self.still_unseen(self.in_frame(ahead), since_s)

    def hidden(self, *, low: bool = True, within_m: float = HIDDEN_M, deep_m: float = HIDES_M,
               mapped_m: float = MAPPED_M) -> np.ndarray:
        """(K, 2) middles of cells near the robot, in its body frame, where the rest of a thing that the map does not know
        may stand: one face of it was seen, and no view of the last remember_s has covered them, or, behind the face of a
        low one, which the scan at the camera's height looks over, shown their floor. low: whether those count too."""
        row, column = self._cells(self.pose[None, :2, 3])[0]
        reach = np.arange(-round(within_m / CELL_M), round(within_m / CELL_M) + 1)
        rows, columns = (grid.ravel() for grid in np.meshgrid(row + reach, column + reach, indexing="ij"))
        body = self._middles(np.stack([rows, columns], axis=1))
        old_s = self.now_s - self.remember_s
        unseen = self.seen_s[rows, columns] < old_s
        looked_over = low & (self.floor_s[rows, columns] < old_s) & (self.behind_s[rows, columns] >= old_s)
        things, lies_low = self._unknown(mapped_m)
        unseen[unseen] = near_any(body[unseen], things, deep_m)
        looked_over[looked_over] = near_any(body[looked_over], things[lies_low], deep_m)
        return body[unseen | looked_over]

    def _unknown(self, mapped_m: float = MAPPED_M) -> tuple[np.ndarray, np.ndarray]:
        """((K, 2) things that the map does not know, in the body frame, (K,) bool: only the whole depth image showed them);
        none while the robot is lost: all walls are unknown then."""
        things = NOTHING if self.map_m is None else self.things()
        things = things[~self._on_map(things, mapped_m)]
        rows, columns = self._cells_at(things).T
        return things, np.isfinite(self.since_s[rows, columns])

    def still_unseen(self, points_m: np.ndarray, since_s: float) -> np.ndarray:
        """Those of the points (K, 2) of this frame that no view since since_s has covered; of those beside the robot, which
        lay ahead of it when they were looked at last, and between which and it nobody steps, none for low_s."""
        rows, columns = self._cells(points_m).T
        beside = np.hypot(*(points_m - self.pose[:2, 3]).T) < self.radius_m + STEPS_M
        needed_s = np.where(beside, min(since_s, self.now_s - self.low_s), since_s)
        return points_m[self.seen_s[rows, columns] < needed_s]

    def count_as_seen(self, points_m: np.ndarray) -> None:
        """These points (K, 2) of this frame were looked at and cannot be seen better; but what may be the rest of something
        was not."""
        self._saw(self._cells(points_m[~near_any(self.in_body(points_m), self._unknown()[0], HIDES_M)]))

    def in_frame(self, points_m: np.ndarray) -> np.ndarray:
        """(K, 2) points of the body frame, in this frame."""
        return np.asarray(points_m @ self.pose[:2, :2].T + self.pose[:2, 3])

    def in_body(self, points_m: np.ndarray) -> np.ndarray:
        """(K, 2) points of this frame, in the robot's body frame."""
        return np.asarray((points_m - self.pose[:2, 3]) @ self.pose[:2, :2])
