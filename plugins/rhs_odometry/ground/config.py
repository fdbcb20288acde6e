"""Settings of `odometry=ground_msckf`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import Bounded, one_of, within

from ..corridor.config import FloorRules
from ..tracks.settings import KltSettings


@dataclass(frozen=True)
class StixelSettings(Bounded):
    """How the free way is read off the pictures; see stixels.py. Chosen on six drawn buildings (numbers 1 to 6)."""

    beams: int = within(80, 8, 1000)
    """bearings across the view"""
    rows: int = within(64, 8, 1000)
    """heights in each"""
    steps: int = within(56, 8, 1000)
    """distances tried, evenly in inverse distance"""
    nearest_m: float = within(0.3, 0.01, 10.0)
    """the nearest of them, metres"""
    farthest_m: float = within(8.0, 0.1, 100.0)
    """and the farthest, metres"""
    range_m: float = within(5.0, 0.1, 100.0)
    """what stands further away is put into the scan as free so far, metres"""
    apart_m: tuple[float, ...] = (0.12, 0.3, 0.6)
    """a view is compared with the last ones from so far away, metres"""
    turned_rad: float = within(0.35, 0.01, 3.2)
    """and that looked in a direction no further apart, radians"""
    pivot_m: float = within(0.05, 0.0, 10.0)
    """a robot that turned on the spot, moving less than this, metres, is blind: of 185 hits nearer than a metre from
    such views 91 stood where nothing is (one patrol)"""
    pivot_rad: float = within(0.03, 0.0, 3.2)
    """see pivot_m: it turned by more than this, radians"""
    oldest: int = within(25, 1, 1000)
    """and no older, views"""
    cap: float = within(15.0, 0.1, 255.0)
    """a pixel differs by no more than this, grey levels: what is hidden in one of the views"""
    unknown: float = within(4.0, 0.0, 255.0)
    """a pixel that no other view shows counts as so different, grey levels"""
    floor_cost: float = within(1.0, 0.0, 255.0)
    """a pixel taken for floor costs so much more than one of a wall, grey levels: floor has to be shown"""
    low: float = within(10.0, 0.0, 1e6)
    """a low thing with something further away seen above it costs so much more, grey levels"""
    low_each: float = within(0.75, 0.0, 255.0)
    """and each of its pixels so much more: of what stands lower than the camera, in eleven drawn buildings with boxes, 76 %
    were seen and 5.2 % overlooked; 74 and 6.8 % without low things"""
    low_m: float = within(0.2, 0.0, 100.0)
    """it is no lower than this above its foot, metres"""
    behind: float = within(0.25, 0.0, 100.0)
    """and what is seen above it is further away by at least this share"""
    above_m: float = within(1.2, 0.0, 100.0)
    """things are no higher above the camera than this, metres"""
    colour: float = within(2.0, 0.0, 255.0)
    """weight of the colours of the floor seen so far, grey levels per unit of log-odds"""
    colour_most: float = within(2.0, 0.0, 100.0)
    """and the log-odds are no greater than this"""
    colour_least: int = within(20, 0, 1_000_000)
    """a colour seen in fewer pixels says nothing"""
    learn: float = within(15.0, 0.0, 1e6)
    """colours are learnt from columns that are so much clearer than any other distance, grey levels"""
    clear: float = within(8.0, 0.0, 1e6)
    """a column is believed when another distance costs so much more, summed over its pixels, grey levels"""
    compared: float = within(0.4, 0.0, 1.0)
    """and when at least this share of its pixels was compared with another view: colours alone were wrong in a third"""
    least_m: float = within(0.5, 0.0, 10.0)
    """what seems nearer is not believed, metres: 41 of 41 such hits were wrong, the robot had stopped before (one patrol)"""
    steep: float = within(0.03, 0.0, 10.0)
    """a column is not believed where the range changes by more than this share per column, besides one step of distance:
    what comes into sight behind an edge smears from the edge to the wall behind (78 wrong hits of 12,000 became 2)"""
    steep_columns: int = within(2, 1, 100)
    """over so many columns to each side"""
    other_share: float = within(0.2, 0.01, 1.0)
    """another distance is one that differs by this share"""
    bend: float = within(2.0, 0.0, 1e6)
    """cost of one step of distance between neighbouring columns"""
    leap: float = within(40.0, 0.0, 1e6)
    """and of any leap"""


@dataclass
class GroundMsckfAdvanced(Bounded):
    """Thresholds of `odometry=ground_msckf`."""

    few_tracks: int = within(8, 0, 10_000)
    """fewer followed points than this and the view says nothing: lost"""
    followed_share: float = within(0.4, 0.0, 1.0)
    """and fewer than this share of those of the last view: degenerate. Of 981 views that went on from the last 1 % had less
    than 0.46, of 200 that did not 95 % had less than 0.38 (ten drawn buildings)"""
    few_measured: int = within(8, 0, 10_000)
    """fewer points measured in the last `measured_views` views: degenerate, only the command is left"""
    measured_views: int = within(8, 1, 1000)
    """see few_measured"""
    still_px: float = within(0.35, 0.0, 100.0)
    """a point that moves less than this did not move, pixels of an image 320 wide: twice the noise of following"""
    still_share: float = within(0.8, 0.0, 1.0)
    """when so many of the points did not move, neither did the robot, whatever it was told"""
    still_points: int = within(12, 1, 10_000)
    """fewer points than this do not say whether the robot stands"""
    least_step_m: float = within(2e-4, 1e-9, 1.0)
    """no motion is known better, metres (1 sigma)"""
    least_turn_rad: float = within(5e-5, 1e-9, 1.0)
    """nor a turn, radians (1 sigma)"""
    follow: KltSettings = field(default_factory=KltSettings)
    stixels: StixelSettings = field(default_factory=StixelSettings)
    floor: FloorRules = field(default_factory=FloorRules)


@dataclass
class GroundMsckf(Bounded):
    """One camera at a known height over a level floor, in any building: no walls are assumed, the free way is measured."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan"})

    motion: str = one_of("command", "wheel")
    """what predicts the next pose: command or wheel"""
    motion_scale_sigma: float = within(0.1, 1e-4, 1.0)
    """how wrong the command or wheel distance may be all along, share (1 sigma)"""
    forward_noise: float = within(0.04, 1e-4, 1.0)
    """noise of one motion's length, share of it (1 sigma)"""
    turn_noise: float = within(0.08, 1e-4, 1.0)
    """noise of one motion's turn, share of it (1 sigma)"""
    height_share: float = within(0.004, 1e-5, 1.0)
    """how well the camera's height above the floor is known, share of it (1 sigma): it sets the scale"""
    wobble_sigma_deg: float = within(0.1, 1e-3, 30.0)
    """pitch and roll of a view (1 sigma): wheels on an ordinary floor"""
    drift_rad_per_rad: float = within(0.015, 0.0, 1.0)
    """heading lost besides what the filter knows, share of the turn (1 sigma)"""
    drift_spot: float = within(0.01, 0.0, 1.0)
    """and of a turn on the spot, where nothing has a depth, radians per root radian (1 sigma): 220 stretches of 40 views in
    24 drawn buildings lost 0.006 square degrees of heading per degree turned on the spot, 0.001 on an arc"""
    drift_rad_per_m: float = within(0.005, 0.0, 1.0)
    """and per metre driven, radians per root metre (1 sigma)"""
    drift_m_per_m: float = within(0.02, 0.0, 1.0)
    """place lost besides what the filter knows, metres per root metre driven (1 sigma)"""
    window: int = within(12, 5, 40)
    """views a track may span"""
    pixel_sigma_px: float = within(1.0, 0.05, 20.0)
    """noise of a track; five times the residual, as errors along a track go together"""
    points: int = within(130, 20, 400)
    """points followed at most"""
    advanced: GroundMsckfAdvanced = field(default_factory=GroundMsckfAdvanced)

    def build(self, context: Context) -> Odometry:
        from .odometry import build_ground_msckf

        return build_ground_msckf(self, context)
