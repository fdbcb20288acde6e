"""The map of the survey while a patrol goes on: it forgets what has gone and takes in what came to stay
(`mission.update_map=true`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.grid import OccupancyGrid, inflate
from rhs.api.records import Scan
from rhs.api.task import Parts
from rhs.base.errors import ConfigError
from rhs.estimation.scans.settings import VoteSettings
from rhs.estimation.survey import FURNITURE, HIDDEN, known

STAYS_S = 10.0  # what was seen to stand for so long belongs to the map; who passes by does not
BESIDE_CELLS = 2.0  # a cell so near to something that stays is the face of it, drawn a cell too thick
OPENED_VIEWS = 4  # through which ground that the survey never saw, as inside what has gone, is seen to be free
FREE, TAKEN = 0.03, 0.97


class ChangedMap:
    """Votes for a thing in each cell of the map (rhs.estimation.scans.votes), over the whole patrol: what the survey mapped
    begins with the most votes there are, and loses them to beams that pass. What stood as high as the camera is seen to have
    gone by its scan, a low thing only from where the floor under it is in the picture."""

    def __init__(self, grid: OccupancyGrid, settings: VoteSettings) -> None:
        from rhs.estimation.scans.votes import Votes  # compiled code

        self.grid = grid
        self.at_eye, self.below = (Votes(grid.shape, grid.resolution_m, grid.origin_m, settings) for _ in range(2))
        low = grid.probability == np.float32(FURNITURE)
        self.at_eye.votes[grid.occupied() & ~low] = self.below.votes[low] = settings.most
        self._hidden = grid.probability == np.float32(HIDDEN)
        self._seen = np.zeros(grid.shape, int)  # views; of what is hidden those that showed the floor

    def look(self, map_from_body: np.ndarray, scan: Scan | None, obstacle: Scan | None, within_m: float) -> None:
        """Count one view of a robot that knows where it is: its scan, and what its whole picture shows besides."""
        from rhs.estimation.scans.votes import low_only

        if scan is not None:
            cells = self.at_eye.look(map_from_body, scan, hits=np.isfinite(scan.ranges_m), within_m=within_m)
            self._seen[cells[:, 0], cells[:, 1]] += ~self._hidden[cells[:, 0], cells[:, 1]]
        if obstacle is not None:
            cells = self.below.look(map_from_body, obstacle, hits=low_only(obstacle, scan), within_m=within_m)
            self._seen[cells[:, 0], cells[:, 1]] += self._hidden[cells[:, 0], cells[:, 1]]

    @property
    def votes(self) -> np.ndarray:
        """(H, W) for a thing of any height."""
        return np.maximum(self.at_eye.votes, self.below.votes)

    def update(self, stood_s: np.ndarray) -> bool:
        """Redraw the map; whether it is another one now. stood_s (H, W): for how long something that it does not know was
        seen to stand in each cell, seconds."""
        taken, votes = self.grid.occupied(), self.votes
        gone = taken & (votes <= 0.0)
        gone &= ~inflate(taken & ~gone, BESIDE_CELLS)
        opened = ~known(self.grid) & (votes <= 0.0) & (self._seen >= OPENED_VIEWS)
        come = (stood_s >= STAYS_S) & (votes >= self.at_eye.settings.most) & self.grid.free()
        if not (gone.any() or come.any()):
            return False
        probability = self.grid.probability.copy()
        probability[gone | opened], probability[come] = FREE, TAKEN
        self.grid = replace(self.grid, probability=probability)
        return True


def check_updates(parts: Parts, sensed: frozenset[str]) -> None:
    """sensed: what the sensor provides. Raises ConfigError, in one line, where nobody can say what has gone from the map."""
    if parts.slam is not None:
        raise ConfigError("mission.update_map=true changes the map of the survey; slam= draws one of its own all the time: "
                          "leave one of them out")
    if "scan" not in sensed:
        raise ConfigError(f"mission.update_map=true needs a measured scan, which {parts.who['sensor']} does not give; "
                          "type sensor=rgbd, or leave it out")
