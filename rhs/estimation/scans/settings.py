"""Thresholds of what is judged from scans, light to import: plugins nest these classes in their `advanced` settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import check_ranges

SEES_AROUND_RAD = 2.0  # a scanner that sees less of its surroundings hardly ever sees one wall from two passages


@dataclass(frozen=True)
class MatchSettings:
    """A scan laid onto a map near a believed pose (rhs.estimation.scans.scan_match)."""

    beams: int = 80
    """used of a scan, evenly spaced"""
    range_max_m: float = 6.5
    """longer beams are not used, metres"""
    sigma_m: float = 0.06
    """of a beam's end against a wall, metres: half a cell of map and the depth noise"""
    trust: float = 0.25
    """neighbouring beams share their errors, so each counts for so much"""
    reach_m: float = 0.35
    """ends further from any wall belong to something the map does not hold, metres"""
    least_share: float = 0.6
    """of the ends that must lie within reach"""
    blind_below: float = 0.004
    """directions with less than this share of the information of the best seen one count as unseen"""
    floor_m: float = 0.04
    """no direction gets sharper than this by one scan, metres; divided by lever_m for the heading"""
    lever_m: float = 3.0
    """a heading moves what the scan sees by so much per radian, metres"""
    behind_cells: int = 3
    """a wall was seen from a side when one of so many cells on that side is free"""
    behind_cos: float = 0.2
    """a beam that comes from the other side at more than this, the cosine of its angle to the wall's normal, meets
    another surface than the mapped one"""
    iterations: int = 12
    """Gauss-Newton steps at most"""
    gate_probability: float = 0.999
    """chance that a true match passes the chi-square gate of its shift against the prior"""
    unmapped: float = 0.2
    """share of the surfaces seen before a wall that are of things which the map does not hold. In 12 furnished buildings
    replayed with drifts of 0 and 0.02 no view went wrong at 0.1 to 0.3; at 0.05 1 % did, and at 0.5 a drift that was there
    went less well corrected. 0: every end is of the map, as of points in no order"""
    step_sigmas: float = 2.0
    """neighbouring ends whose distances to the wall differ by more times sigma_m are of two surfaces"""
    bend_deg: float = 30.0
    """and those at walls that turn by more, degrees: LineSettings.corner_deg"""

    def __post_init__(self) -> None:
        check_ranges("", self, beams=(8, 100_000), range_max_m=(0.1, 1000.0), sigma_m=(1e-4, 10.0), trust=(1e-6, 1.0),
                     reach_m=(1e-3, 100.0), least_share=(0.0, 1.0), blind_below=(0.0, 1.0), floor_m=(0.0, 10.0),
                     lever_m=(1e-3, 1000.0), behind_cells=(1, 100), behind_cos=(0.0, 1.0), iterations=(1, 1000),
                     gate_probability=(0.5, 1.0 - 1e-12), unmapped=(0.0, 0.99), step_sigmas=(0.1, 1000.0),
                     bend_deg=(0.1, 180.0))


@dataclass(frozen=True)
class FieldSettings:
    """The likelihood field (Thrun, Burgard, Fox, Probabilistic Robotics, 6.4)."""

    beams: int = 40
    """used of each scan, evenly spaced"""
    sigma_m: float = 0.12
    """of a beam's end against the wall, metres: map and depth noise"""
    stray: float = 0.1
    """share of beams that mean nothing"""
    range_max_m: float = 8.0
    """longer beams are not used, metres"""
    open_m: float = 0.5
    """further than this from any wall a beam ends in the open, metres"""

    def __post_init__(self) -> None:
        check_ranges("", self, beams=(1, 100_000), sigma_m=(1e-3, 10.0), stray=(1e-6, 0.99), range_max_m=(0.1, 1000.0),
                     open_m=(0.0, 100.0))


@dataclass(frozen=True)
class ScanLoopSettings:
    """Loops of a corridor walked back the other way (rhs.estimation.scans.scan_loops)."""

    within_m: float = 1.5
    """believed distance of the two views, metres"""
    turned_deg: float = 120.0
    """least difference of their headings, degrees; views that look the same way are the camera's business"""
    min_way_m: float = 5.0
    """way between them, metres"""
    there_m: float = 9.0
    """scans from so much of the way on both sides of the earlier view make its map, metres"""
    back_m: float = 1.5
    """and of the later view its cloud, metres"""
    sigma_m: float = 0.4
    """how far off the belief may be, metres (1 sigma)"""
    sigma_rad: float = 0.1
    """and its heading, radians (1 sigma)"""
    cell_m: float = 0.1
    """cells of map and cloud, metres"""
    least_points: int = 50
    """fewer wall points on either side say nothing"""
    match: MatchSettings = field(default_factory=lambda: MatchSettings(sigma_m=0.05, trust=0.1, unmapped=0.0))

    def __post_init__(self) -> None:
        check_ranges("", self, within_m=(0.01, 100.0), turned_deg=(0.0, 180.0), min_way_m=(0.0, 1e4), there_m=(0.1, 1000.0),
                     back_m=(0.1, 1000.0), sigma_m=(1e-4, 100.0), sigma_rad=(1e-4, 3.0), cell_m=(0.01, 2.0),
                     least_points=(8, 100_000))


@dataclass(frozen=True)
class LineSettings:
    """Straight walls in one scan (rhs.estimation.scans.wall_lines)."""

    sigma_per_m: float = 0.003
    """noise of an inverse range, 1/m (1 sigma); a Kinect has 0.002 (Nguyen, Izadi and Lovell 2012)"""
    jump_per_m: float = 0.03
    """a step of the inverse range between neighbouring beams that ends a stretch, 1/m"""
    gap_beams: int = 5
    """unknown beams in a row that end a stretch"""
    trim_beams: int = 2
    """beams left out at both ends of a wall: they may have met what lies behind its edge"""
    least_beams: int = 20
    """a shorter stretch is no wall"""
    least_m: float = 0.5
    """nor is one of fewer metres"""
    range_max_m: float = 7.5
    """further beams are not used, metres"""
    shared: float = 4.0
    """so many neighbouring beams err as one"""
    corner_deg: float = 30.0
    """two parts that touch at less than this are one bent wall, degrees"""
    bend_sigma: float = 2.0
    """a line whose curvature stands out by so many sigmas is no straight wall"""

    def __post_init__(self) -> None:
        check_ranges("", self, sigma_per_m=(1e-6, 1.0), jump_per_m=(1e-6, 10.0), gap_beams=(1, 1000), trim_beams=(0, 1000),
                     least_beams=(11, 100_000), least_m=(0.0, 100.0), range_max_m=(0.1, 1000.0), shared=(1.0, 1e4),
                     corner_deg=(0.0, 90.0), bend_sigma=(0.0, 1000.0))


@dataclass(frozen=True)
class PointSettings:
    """A scan laid onto points with normals (rhs.estimation.scans.point_map). Tried on two laser logs, ACES and MIT CSAIL."""

    range_max_m: float = 25.0
    """longer beams have no end, metres"""
    span_m: float = 0.2
    """neighbouring ends as near as this tell the direction of a wall, metres"""
    span_steps: float = 2.5
    """or as near as so many gaps between beams"""
    flat: float = 0.06
    """of a wall's points the variance across is less than this share of that along"""
    beam_deg: float = 1.0
    """of beams closer than this only some have points, after all have told the direction of walls: what neighbours see is
    hardly new (trust), degrees"""
    reach_m: float = 0.5
    """a partner is looked for as far as this at first, metres"""
    reach_least_m: float = 0.2
    """and in the end"""
    sigma_m: float = 0.04
    """of an end against a wall, metres"""
    trust: float = 0.4
    """neighbouring beams share their errors, so each counts for so much"""
    lever_m: float = 3.0
    """a heading moves what the scan sees by so much per radian, metres"""
    blind_below: float = 0.01
    """directions with less than this share of the information of the best seen one count as unseen"""
    cell_m: float = 0.05
    """points of a map nearer than this are one, metres"""

    def __post_init__(self) -> None:
        check_ranges("", self, range_max_m=(0.1, 1000.0), span_m=(1e-3, 10.0), span_steps=(1.0, 100.0), flat=(0.0, 1.0),
                     beam_deg=(0.0, 30.0), reach_m=(0.01, 100.0), reach_least_m=(0.01, 100.0), sigma_m=(1e-4, 10.0),
                     trust=(1e-6, 1.0), lever_m=(1e-3, 1000.0), blind_below=(0.0, 1.0), cell_m=(0.005, 2.0))


@dataclass(frozen=True)
class BandSettings:
    """What of a depth image counts as an obstacle: the band between the floor and the robot's height
    (rhs.estimation.scans.obstacle_scan)."""

    robot_height_m: float = 0.0
    """height of the robot, metres; 0: as high as its camera and headroom_m more"""
    headroom_m: float = 0.1
    """of a robot whose height nobody says above its camera, metres: it sways"""
    floor_m: float = 0.04
    """lower things are driven over, metres: a door sill is 2 cm, a shoe 8"""
    floor_per_m: float = 0.01
    """and what of this share of the distance: a Kinect's depth noise moves the floor up by 0.5 cm at 3 m, 1.4 cm at 7 m"""
    unsure_per_m: float = 0.05
    """share of the distance added where the floor was not seen: a camera that sways by 3 degrees lifts it by so much"""
    range_m: float = 5.0
    """further things are left to later views, metres"""
    columns: int = 160
    """beams; the image is thinned to about so many columns, half a Kinect's 320: a chair leg of 4 cm is 2 of them at 3 m"""
    level_slope: float = 0.3
    """a patch may belong to the floor when it rises by less than this share of its length"""
    most_tilt: float = 0.1
    """greatest slope of the floor before the camera: it pitches and rolls by less than 6 degrees"""
    tilted_deg: float = 1.0
    """a camera that sees its floor tilted by more than this sways, degrees: its scans are then read along the horizon;
    less is the noise of the floor"""
    floor_within_m: float = 5.0
    """the floor is fitted to what is nearer than this, metres"""
    floor_patches: int = 30
    """fewer level patches than this are no floor"""

    def __post_init__(self) -> None:
        check_ranges("", self, robot_height_m=(0.0, 10.0), headroom_m=(0.0, 5.0), floor_m=(0.0, 1.0), floor_per_m=(0.0, 0.5),
                     unsure_per_m=(0.0, 0.5), range_m=(0.2, 100.0), columns=(8, 10_000), level_slope=(0.01, 10.0),
                     most_tilt=(0.0, 1.0), tilted_deg=(0.0, 90.0), floor_within_m=(0.2, 100.0), floor_patches=(3, 1_000_000))


@dataclass(frozen=True)
class FloorEndSettings:
    """What of a column of a depth image is a floor that ends before a blank wall (rhs.estimation.scans.floor_end)."""

    floor_m: float = 0.05
    """floor is within this of the plane fitted to it, metres,"""
    floor_per_m: float = 0.05
    """and within this share of the distance more: what two eyes know a distance to"""
    floor_below: float = 0.5
    """least share of the column below the end that is floor: texture with holes ends nowhere"""
    known_above: float = 0.2
    """most of it between the end and the horizon that is known: something that is known stands for itself"""
    least_rows: int = 3
    """fewer rows of floor, or blank ones up to the horizon, of the thinned image say nothing"""
    range_m: float = 3.0
    """further ends are left to later views, metres: up to there nine in ten are within 0.28 m
    (tests/benchmarks/floor_ends.py)"""

    def __post_init__(self) -> None:
        check_ranges("", self, floor_m=(0.0, 1.0), floor_per_m=(0.0, 0.5), floor_below=(0.0, 1.0), known_above=(0.0, 1.0),
                     least_rows=(1, 10_000), range_m=(0.2, 100.0))


@dataclass(frozen=True)
class VoteSettings:
    """Obstacles as votes of a grid, for and against (rhs.estimation.scans.votes)."""

    clear: float = 0.5
    """votes that a beam passing through a cell takes from it; one that ends there gives 1. A thing is seen ending beams more
    surely than passing them: a beam beside it passes the same cell"""
    gone: float = 2.0
    """the same of what was seen to move, where no beam of that view ends within 15 cm of the cell: it has gone on. Somebody
    who has is forgotten in three views then, in nine at `clear`"""
    most: float = 5.0
    """votes a cell keeps: what has gone is forgotten after most / clear views through it"""
    short_m: float = 0.15
    """the last stretch before a beam's end speaks neither way, metres: noise of depth and of the pose"""

    def __post_init__(self) -> None:
        check_ranges("", self, clear=(0.0, 10.0), gone=(0.0, 1000.0), most=(1.0, 1000.0), short_m=(0.0, 5.0))
