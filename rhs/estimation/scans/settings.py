"""Thresholds of what is judged from scans, light to import: plugins nest these classes in their `advanced` settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import Bounded, within

SEES_AROUND_RAD = 2.0  # a scanner that sees less of its surroundings hardly ever sees one wall from two passages


@dataclass(frozen=True)
class MatchSettings(Bounded):
    """A scan laid onto a map near a believed pose (rhs.estimation.scans.scan_match)."""

    beams: int = within(80, 8, 100_000)
    """used of a scan, evenly spaced"""
    range_max_m: float = within(6.5, 0.1, 1000.0)
    """longer beams are not used, metres"""
    sigma_m: float = within(0.06, 1e-4, 10.0)
    """of a beam's end against a wall, metres: half a cell of map and the depth noise"""
    trust: float = within(0.25, 1e-6, 1.0)
    """neighbouring beams share their errors, so each counts for so much"""
    reach_m: float = within(0.35, 1e-3, 100.0)
    """ends further from any wall belong to something the map does not hold, metres"""
    least_share: float = within(0.6, 0.0, 1.0)
    """of the ends that must lie within reach"""
    blind_below: float = within(0.004, 0.0, 1.0)
    """directions with less than this share of the information of the best seen one count as unseen"""
    floor_m: float = within(0.04, 0.0, 10.0)
    """no direction gets sharper than this by one scan, metres; divided by lever_m for the heading"""
    lever_m: float = within(3.0, 1e-3, 1000.0)
    """a heading moves what the scan sees by so much per radian, metres"""
    behind_cells: int = within(3, 1, 100)
    """a wall was seen from a side when one of so many cells on that side is free"""
    behind_cos: float = within(0.2, 0.0, 1.0)
    """a beam that comes from the other side at more than this, the cosine of its angle to the wall's normal, meets
    another surface than the mapped one"""
    iterations: int = within(12, 1, 1000)
    """Gauss-Newton steps at most"""
    gate_probability: float = within(0.999, 0.5, 1.0 - 1e-12)
    """chance that a true match passes the chi-square gate of its shift against the prior"""
    unmapped: float = within(0.2, 0.0, 0.99)
    """share of the surfaces seen before a wall that are of things which the map does not hold. In 12 furnished buildings
    replayed with drifts of 0 and 0.02 no view went wrong at 0.1 to 0.3; at 0.05 1 % did, and at 0.5 a drift that was there
    went less well corrected. 0: every end is of the map, as of points in no order"""
    step_sigmas: float = within(2.0, 0.1, 1000.0)
    """neighbouring ends whose distances to the wall differ by more times sigma_m are of two surfaces"""
    bend_deg: float = within(30.0, 0.1, 180.0)
    """and those at walls that turn by more, degrees: LineSettings.corner_deg"""


@dataclass(frozen=True)
class FieldSettings(Bounded):
    """The likelihood field (Thrun, Burgard, Fox, Probabilistic Robotics, 6.4)."""

    beams: int = within(40, 1, 100_000)
    """used of each scan, evenly spaced"""
    sigma_m: float = within(0.12, 1e-3, 10.0)
    """of a beam's end against the wall, metres: map and depth noise"""
    stray: float = within(0.1, 1e-6, 0.99)
    """share of beams that mean nothing"""
    range_max_m: float = within(8.0, 0.1, 1000.0)
    """longer beams are not used, metres"""
    open_m: float = within(0.5, 0.0, 100.0)
    """further than this from any wall a beam ends in the open, metres"""


@dataclass(frozen=True)
class ScanLoopSettings(Bounded):
    """Loops of a corridor walked back the other way (rhs.estimation.scans.scan_loops)."""

    within_m: float = within(1.5, 0.01, 100.0)
    """believed distance of the two views, metres"""
    turned_deg: float = within(120.0, 0.0, 180.0)
    """least difference of their headings, degrees; views that look the same way are the camera's business"""
    min_way_m: float = within(5.0, 0.0, 1e4)
    """way between them, metres"""
    there_m: float = within(9.0, 0.1, 1000.0)
    """scans from so much of the way on both sides of the earlier view make its map, metres"""
    back_m: float = within(1.5, 0.1, 1000.0)
    """and of the later view its cloud, metres"""
    sigma_m: float = within(0.4, 1e-4, 100.0)
    """how far off the belief may be, metres (1 sigma)"""
    sigma_rad: float = within(0.1, 1e-4, 3.0)
    """and its heading, radians (1 sigma)"""
    cell_m: float = within(0.1, 0.01, 2.0)
    """cells of map and cloud, metres"""
    behind_m: float = within(0.2, 0.0, 100.0)
    """a wall seen on the way there looks away from who comes back this far behind its face, metres: less than a robot keeps
    from a wall, as the belief may be off"""
    least_points: int = within(50, 8, 100_000)
    """fewer wall points on either side say nothing"""
    match: MatchSettings = field(default_factory=lambda: MatchSettings(sigma_m=0.05, trust=0.1, unmapped=0.0))


@dataclass(frozen=True)
class LineSettings(Bounded):
    """Straight walls in one scan (rhs.estimation.scans.wall_lines)."""

    sigma_per_m: float = within(0.003, 1e-6, 1.0)
    """noise of an inverse range, 1/m (1 sigma); a Kinect has 0.002 (Nguyen, Izadi and Lovell 2012)"""
    jump_per_m: float = within(0.03, 1e-6, 10.0)
    """a step of the inverse range between neighbouring beams that ends a stretch, 1/m"""
    gap_beams: int = within(5, 1, 1000)
    """unknown beams in a row that end a stretch"""
    trim_beams: int = within(2, 0, 1000)
    """beams left out at both ends of a wall: they may have met what lies behind its edge"""
    least_beams: int = within(20, 11, 100_000)
    """a shorter stretch is no wall"""
    least_m: float = within(0.5, 0.0, 100.0)
    """nor is one of fewer metres"""
    range_max_m: float = within(7.5, 0.1, 1000.0)
    """further beams are not used, metres"""
    shared: float = within(4.0, 1.0, 1e4)
    """so many neighbouring beams err as one"""
    corner_deg: float = within(30.0, 0.0, 90.0)
    """two parts that touch at less than this are one bent wall, degrees"""
    bend_sigma: float = within(2.0, 0.0, 1000.0)
    """a line whose curvature stands out by so many sigmas is no straight wall"""


@dataclass(frozen=True)
class PointSettings(Bounded):
    """A scan laid onto points with normals (rhs.estimation.scans.point_map). Tried on two laser logs, ACES and MIT CSAIL."""

    range_max_m: float = within(25.0, 0.1, 1000.0)
    """longer beams have no end, metres"""
    span_m: float = within(0.2, 1e-3, 10.0)
    """neighbouring ends as near as this tell the direction of a wall, metres"""
    span_steps: float = within(2.5, 1.0, 100.0)
    """or as near as so many gaps between beams"""
    flat: float = within(0.06, 0.0, 1.0)
    """of a wall's points the variance across is less than this share of that along"""
    beam_deg: float = within(1.0, 0.0, 30.0)
    """of beams closer than this only some have points, after all have told the direction of walls: what neighbours see is
    hardly new (trust), degrees"""
    reach_m: float = within(0.5, 0.01, 100.0)
    """a partner is looked for as far as this at first, metres"""
    reach_least_m: float = within(0.2, 0.01, 100.0)
    """and in the end"""
    sigma_m: float = within(0.04, 1e-4, 10.0)
    """of an end against a wall, metres"""
    trust: float = within(0.4, 1e-6, 1.0)
    """neighbouring beams share their errors, so each counts for so much"""
    lever_m: float = within(3.0, 1e-3, 1000.0)
    """a heading moves what the scan sees by so much per radian, metres"""
    blind_below: float = within(0.01, 0.0, 1.0)
    """directions with less than this share of the information of the best seen one count as unseen"""
    cell_m: float = within(0.05, 0.005, 2.0)
    """points of a map nearer than this are one, metres"""


@dataclass(frozen=True)
class BandSettings(Bounded):
    """What of a depth image counts as an obstacle: the band between the floor and the robot's height
    (rhs.estimation.scans.obstacle_scan)."""

    robot_height_m: float = within(0.0, 0.0, 10.0)
    """height of the robot, metres; 0: as high as its camera and headroom_m more"""
    headroom_m: float = within(0.1, 0.0, 5.0)
    """of a robot whose height nobody says above its camera, metres: it sways"""
    floor_m: float = within(0.04, 0.0, 1.0)
    """lower things are driven over, metres: a door sill is 2 cm, a shoe 8"""
    floor_per_m: float = within(0.01, 0.0, 0.5)
    """and what of this share of the distance: a Kinect's depth noise moves the floor up by 0.5 cm at 3 m, 1.4 cm at 7 m"""
    unsure_per_m: float = within(0.05, 0.0, 0.5)
    """share of the distance added where the floor was not seen: a camera that sways by 3 degrees lifts it by so much"""
    range_m: float = within(5.0, 0.2, 100.0)
    """further things are left to later views, metres"""
    columns: int = within(160, 8, 10_000)
    """beams; the image is thinned to about so many columns, half a Kinect's 320: a chair leg of 4 cm is 2 of them at 3 m"""
    level_slope: float = within(0.3, 0.01, 10.0)
    """a patch may belong to the floor when it rises by less than this share of its length"""
    most_tilt: float = within(0.1, 0.0, 1.0)
    """greatest slope of the floor before the camera: it pitches and rolls by less than 6 degrees"""
    tilted_deg: float = within(1.0, 0.0, 90.0)
    """a camera that sees its floor tilted by more than this sways, degrees: its scans are then read along the horizon;
    less is the noise of the floor"""
    floor_within_m: float = within(5.0, 0.2, 100.0)
    """the floor is fitted to what is nearer than this, metres"""
    floor_patches: int = within(30, 3, 1_000_000)
    """fewer level patches than this are no floor"""


@dataclass(frozen=True)
class FloorEndSettings(Bounded):
    """What of a column of a depth image is a floor that ends before a blank wall (rhs.estimation.scans.floor_end)."""

    floor_m: float = within(0.05, 0.0, 1.0)
    """floor is within this of the plane fitted to it, metres,"""
    floor_per_m: float = within(0.05, 0.0, 0.5)
    """and within this share of the distance more: what two eyes know a distance to"""
    floor_below: float = within(0.5, 0.0, 1.0)
    """least share of the column below the end that is floor: texture with holes ends nowhere"""
    known_above: float = within(0.2, 0.0, 1.0)
    """most of it between the end and the horizon that is known: something that is known stands for itself"""
    least_rows: int = within(3, 1, 10_000)
    """fewer rows of floor, or blank ones up to the horizon, of the thinned image say nothing"""
    range_m: float = within(3.0, 0.2, 100.0)
    """further ends are left to later views, metres: up to there nine in ten are within 0.28 m
    (tests/benchmarks/floor_ends.py)"""


@dataclass(frozen=True)
class VoteSettings(Bounded):
    """Obstacles as votes of a grid, for and against (rhs.estimation.scans.votes)."""

    clear: float = within(0.5, 0.0, 10.0)
    """votes that a beam passing through a cell takes from it; one that ends there gives 1. A thing is seen ending beams more
    surely than passing them: a beam beside it passes the same cell"""
    gone: float = within(2.0, 0.0, 1000.0)
    """the same of what was seen to move, where no beam of that view ends within 15 cm of the cell: it has gone on. Somebody
    who has is forgotten in three views then, in nine at `clear`"""
    most: float = within(5.0, 1.0, 1000.0)
    """votes a cell keeps: what has gone is forgotten after most / clear views through it"""
    short_m: float = within(0.15, 0.0, 5.0)
    """the last stretch before a beam's end speaks neither way, metres: noise of depth and of the pose"""
