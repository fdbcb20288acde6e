"""For plugin authors: the records parts hand to one another, the contracts they keep, and the checks of both.

The names that most plugins use can be taken from here; the modules hold the rest:

    contracts   what each kind of part must do         records     what parts hand to one another
    task        what a task is                         metric      what a column of the row is
    errors      what to raise, checks of settings      validate    the validator of every record
    geometry    poses, cameras                         grid        occupancy grids
    trajectory  trajectories in TUM form               floorplan   the true plan of a world
    belief      a belief after a motion                segments    segments against cells
    settings    plain values into dataclasses          files       files that appear whole
    frozen      arrays nobody can write to             randomness  generators by name
    jit         compiled loops                         distortion  lenses

The contract has a version: a plugin may declare `api: ClassVar[int]`, and one newer than API_VERSION is refused.
"""

from .contracts import API_VERSION, Context, SourceContext
from .errors import Bounded, ConfigError, ContractError, RhsError, check_choice, check_range, check_ranges, within
from .metric import Metric
from .records import (
    Belief,
    BeliefStatus,
    Capture,
    Closure,
    Event,
    Motion,
    Observation,
    Path,
    PlanningProblem,
    PlanReason,
    Scan,
    Step,
    Tracking,
    Twist,
    View,
    WorldFacts,
)

__all__ = [
    "API_VERSION", "Belief", "BeliefStatus", "Bounded", "Capture", "Closure", "ConfigError", "Context", "ContractError",
    "Event", "Metric", "Motion", "Observation", "Path", "PlanReason", "PlanningProblem", "RhsError", "Scan",
    "SourceContext", "Step", "Tracking", "Twist", "View", "WorldFacts", "check_choice", "check_range", "check_ranges",
    "within",
]
