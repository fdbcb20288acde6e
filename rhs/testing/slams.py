"""What a SLAM must do (see rhs.testing): it moves as an odometry says, and knows where it is and what is there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import SLAM, complete
from rhs.api.validate import check_belief, check_grid, check_poses

from .odometry import ODOMETRY, WRONG_SHARE
from .room import HALL, context, drive, for_part
from .shared_state import untouched


def knows_where_it_is_and_was_and_what_is_there(settings: Any, folder: Path) -> None:
    """From the first view on: a belief in the map, which begins at context.world.start, a pose for each view, a grid."""
    part = complete(SLAM, settings.build(context(folder)))
    for count, (_, view) in enumerate(drive(HALL), start=1):
        with untouched(view):
            part.update(for_part(settings, view))
        belief = check_belief(part.belief(), who="belief()").map_from_body
        poses = check_poses(part.trajectory(), count, who="trajectory()")
        if count == 1:
            check_grid(part.grid(), who="grid()")
    check_grid(part.grid(), who="grid()")
    first, pose = drive(HALL)[0][0], drive(HALL)[-1][0]
    way = float(np.linalg.norm((pose - first)[:3, 3]))
    for name, said, true in (("belief()", belief, pose), ("trajectory()[-1]", poses[-1], pose),
                             ("trajectory()[0]", poses[0], first)):
        off = float(np.linalg.norm((said - true)[:3, 3]))
        assert off < WRONG_SHARE * way, (f"{name} is {off:.2f} m from where the robot is after {way:.2f} m; the map begins "
                                         "at context.world.start")


SLAMS = (*ODOMETRY, knows_where_it_is_and_was_and_what_is_there)
