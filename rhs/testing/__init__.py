"""The conformance kit: does a part keep its contract (rhs.api.contracts)? For the tests of plugin authors.

    from rhs.testing import check_plugin
    check_plugin("odometry", MyOdometry())

runs every check of that kind on settings of yours and raises AssertionError naming the fact that does not hold.
`checks(kind)` gives them one by one for a parametrised test. A part is built several times, always from the settings, in
small rooms whose truth is known: what it says is held against that truth in direction, scale, frame and certainty.

    from rhs.testing import CORRIDOR, context, drive
    part = MyOdometry().build(context(folder, room=CORRIDOR))
    for world_from_body, observation in drive(CORRIDOR):
        motion = part.update(observation)

`untouched()` is a context in which no global random generator and none of the given arrays may be used up or changed.
"""

from .checks import Check, check_plugin, checks
from .room import CAMERA, CORRIDOR, FURNISHED, HALL, TUBE, Room, blind, context, drive, empty_grid, observe, paintings, see
from .shared_state import untouched

__all__ = ["CAMERA", "CORRIDOR", "Check", "FURNISHED", "HALL", "Room", "TUBE", "blind", "check_plugin", "checks", "context",
           "drive", "empty_grid", "observe", "paintings", "see", "untouched"]
