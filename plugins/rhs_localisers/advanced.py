"""Thresholds of the localisers that a user seldom touches: `localiser.advanced.name=value`. Light to import."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import check_ranges
from rhs.estimation.filters.settings import ClusterSettings
from rhs.estimation.scans.settings import FieldSettings, MatchSettings
from rhs.estimation.views.settings import ContinuitySettings, PlaceRules, RansacSettings


@dataclass(frozen=True)
class ConfirmationRules:
    """When recognised places confirm a pose, and what contradicts it (confirmation.py). Chosen on the bundled buildings."""

    confirmations: int = 4
    """so many named places in a row have to agree with the motion after a doubt"""
    way_m: float = 1.5
    """and over so much way, metres"""
    against: int = 6
    """so many named places speak against a belief that is held before it is doubted: a copy of a painting is taken for the
    other one for as long as the robot drives towards it"""
    against_m: float = 3.0
    """and over so much way, metres"""
    repeats: int = 3
    """so many against a belief that may have been carried off unseen"""
    jump_m: float = 0.75
    """a belief that moved so far off its own motion is another belief, metres"""
    jump_deg: float = 30.0
    """or turned off it by so much, degrees"""
    silences: int = 6
    """so many views in which a place was expected and none recognised are a doubt"""
    silent_m: float = 2.0
    """for a robot whose views all went on they have to cover so much way, metres"""
    before_m: float = 0.3
    """a beam that ends so much before the first wall of the map meets something else, metres"""
    hidden_share: float = 0.2
    """where so many beams do, a place that is not recognised is hidden and no doubt: somebody 0.45 m wide fills a third of a
    view of 57 degrees at 1.2 m"""
    behind_share: float = 0.1
    """unless more beams than this end behind a wall"""
    strong: float = 0.25
    """explained share of a named place below which it neither confirms nor contradicts what is known: chosen on one building
    of eight paintings, where 6 of 7 right ones have more, 3 of 4 wrong ones less"""
    fits_share: float = 0.7
    """least share of a scan's ends on walls of the map, seen from a pose that a place confirms"""
    room_m: float = 0.15
    """a robot does not stand as near to a wall as this, metres: half its radius"""
    unnamed: float = 0.2
    """chance of a belief that no place confirms"""
    stale_m: float = 2.0
    """way without a place that halves the chance of a belief which is not confirmed, metres"""
    forgotten_m: float = 2.0
    """way after which a place named elsewhere, and not again, is forgotten, metres"""
    same_m: float = 1.0
    """two named poses as near as this are one place, metres"""
    same_deg: float = 20.0
    """and turned against each other by less than this, degrees"""

    def __post_init__(self) -> None:
        check_ranges("", self, confirmations=(1, 10_000), way_m=(1e-3, 1000.0), against=(1, 10_000), against_m=(0.0, 1000.0),
                     repeats=(1, 10_000), jump_m=(0.0, 1000.0), jump_deg=(0.0, 180.0), silences=(1, 10_000),
                     silent_m=(0.0, 1000.0), strong=(0.0, 1.0), fits_share=(0.0, 1.0), room_m=(0.0, 10.0),
                     before_m=(0.0, 100.0), hidden_share=(0.0, 1.0), behind_share=(0.0, 1.0),
                     unnamed=(0.0, 1.0), stale_m=(1e-3, 1000.0), forgotten_m=(1e-3, 1000.0), same_m=(1e-3, 100.0),
                     same_deg=(0.1, 180.0))


@dataclass(frozen=True)
class PanoramaSettings:
    """When walls seen all round say that a robot which doubts itself is where it would be (panorama.py)."""

    bearings: int = 180
    """into which the circle is divided"""
    near_m: float = 0.5
    """what was seen from further away is not used, metres"""
    more: float = 0.25
    """the map is asked whenever this share of the bearings more was looked at"""
    about: int = 400
    """only a robot before which, while it knew its place, something stood that is not on the map, so many views ago at
    most, asks: else nobody can have hidden anything"""
    sure: float = 0.99
    """chance of being right from which the robot knows its place again, the chance of having been carried off being half:
    walls look alike more often than by chance, as who is carried off stands along a corridor as before"""
    step_m: float = 0.2
    """between the places of the map that are tried, metres"""
    turn_deg: float = 10.0
    """and between the headings, degrees"""
    most: int = 60_000
    """places and headings tried at most: in a larger map the places lie further apart"""
    range_max_m: float = 8.0
    """longer beams are not used, metres"""
    slack_m: float = 0.15
    """a beam ends at a wall that is so near to its end, metres ..."""
    slack_per_m: float = 0.02
    """... and so much further for each metre: headings err"""
    hit: float = 0.75
    """chance of a beam that ends at the first wall of the map, ..."""
    short: float = 0.2
    """... before it: somebody or something new stands there, ..."""
    through: float = 0.05
    """... behind it: what stood there has gone, or the map is wrong ..."""
    unknown: float = 0.3
    """... and of one that leads where the map knows nothing"""
    trust: float = 0.15
    """neighbouring beams share their errors, so each counts for so much"""

    def __post_init__(self) -> None:
        check_ranges("", self, bearings=(8, 3600), near_m=(0.0, 100.0), more=(0.01, 1.0), about=(0, 1_000_000),
                     sure=(0.5, 1.0),
                     step_m=(0.01, 10.0), turn_deg=(0.1, 180.0), most=(1, 10_000_000), range_max_m=(0.1, 1000.0),
                     slack_m=(1e-3, 10.0), slack_per_m=(0.0, 1.0), hit=(1e-6, 1.0), short=(1e-6, 1.0),
                     through=(1e-6, 1.0), unknown=(1e-6, 1.0), trust=(1e-6, 1.0))


@dataclass
class ByPlaces:
    """What the localisers that recognise places share."""

    min_coverage: float = 0.0
    """least share of the key-points which ought to be seen again, were the place the same, that are; 0: not asked"""
    weak: float = 0.5
    """chance that a place named with a small explained share (confirmation.strong) is right"""
    smooth_share: float = 0.9
    """share of a scan's ends on walls above which a robot whose key-points cannot tell is still where it expects to be"""
    ransac: RansacSettings = field(default_factory=RansacSettings)
    places: PlaceRules = field(default_factory=PlaceRules)
    continuity: ContinuitySettings = field(default_factory=ContinuitySettings)
    confirmation: ConfirmationRules = field(default_factory=ConfirmationRules)
    match: MatchSettings = field(default_factory=MatchSettings)

    def __post_init__(self) -> None:
        check_ranges("", self, min_coverage=(0.0, 1.0), weak=(0.01, 0.9999), smooth_share=(0.0, 1.0))


@dataclass
class SiftDbAdvanced(ByPlaces):
    """Thresholds of `localiser=sift_db`."""

    panorama: PanoramaSettings = field(default_factory=PanoramaSettings)
    gate_probability: float = 0.999
    """chance that a right place passes the chi-square gate of a guess"""
    keep: int = 8
    """guesses kept at most"""
    floor: float = 1e-5
    """weight below which a guess is dropped"""
    steady_m: float = 5.0
    """the drift of the odometry keeps its sign for about so long, metres"""
    least_bits: float = 1.0
    """a robot that watched its way asks the places as usual only where they would tell it so much of its pose, in the
    direction of which they tell most: log2(1 + ratio of its variance and theirs) / 2; one bit answers one yes-no question"""
    seldom: int = 9
    """else every so many views. In between no key-points are looked for while its scan goes on and lies on walls: one that
    was carried off to where its scan fits as well finds out by then; 1: asks as any other"""
    pictured_share: float = 0.5
    """a map drawn by one camera errs by this share of what the survey's last view was unsure by before its loop was closed:
    the most that is left on a closed loop. Scans laid on it err alike: no belief in it is surer"""
    pictured_sigma_m: float = 0.05
    """and by so much besides, metres (1 sigma), as does each place recognised in it. With both 0.1 % of the views of patrols
    in 24 drawn buildings were further off than three sigmas, in one of them; 0.9 % in three with 0.08 m for all"""
    pictured_sigma_rad: float = 0.015
    """the same of the heading, radians"""
    pictured: MatchSettings = field(
        default_factory=lambda: MatchSettings(range_max_m=3.0, sigma_m=0.12, trust=0.03, floor_m=0.12, unmapped=0.0))
    """a scan read off pictures, laid onto the map: its error grows with the range and goes together from view to view
    (believed like a measured one it moved the robot by up to 0.23 m at once in random:loop/3)"""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges("", self, gate_probability=(0.5, 1.0 - 1e-12), keep=(1, 10_000), floor=(0.0, 0.5), steady_m=(0.0, 1e4),
                     least_bits=(0.0, 100.0), seldom=(1, 10_000), pictured_share=(0.0, 10.0),
                     pictured_sigma_m=(0.0, 10.0), pictured_sigma_rad=(0.0, 3.0))


@dataclass
class FilterAdvanced:
    """What both particle filters share."""

    base_sigma_m: float = 0.005
    """least motion noise of a view, metres (1 sigma)"""
    base_sigma_rad: float = 0.003
    """least noise of the turn of a view, radians (1 sigma)"""
    long_sure: int = 10
    """views of knowing its place after which a robot takes what is not on the map for something new"""
    kld_epsilon: float = 0.05
    """number of particles: Kullback-Leibler distance allowed to the true distribution (Fox 2003)"""
    kld_quantile: float = 2.33
    """normal quantile of the chance of keeping it: 2.33 is 99 %"""
    kld_cell_m: float = 0.25
    """bins of that distribution, metres"""
    kld_cell_deg: float = 10.0
    """and degrees"""
    cluster_m: float = 1.0
    """particles this near the densest spot are of the cluster reported, metres"""
    cluster_rad: float = 0.5
    """and this near in heading, radians"""
    clusters: ClusterSettings = field(default_factory=ClusterSettings)
    likelihood: FieldSettings = field(default_factory=FieldSettings)

    def __post_init__(self) -> None:
        check_ranges("", self, base_sigma_m=(1e-6, 1.0), base_sigma_rad=(1e-6, 1.0), long_sure=(0, 1_000_000),
                     kld_epsilon=(1e-4, 1.0), kld_quantile=(0.0, 6.0), kld_cell_m=(0.01, 10.0), kld_cell_deg=(0.5, 120.0),
                     cluster_m=(0.01, 100.0), cluster_rad=(0.01, 3.2))


@dataclass
class ParticleAdvanced(FilterAdvanced, ByPlaces):
    """Thresholds of `localiser=particle_filter`."""

    shaken: float = 0.75
    """below this mass of the heaviest cluster a place has to be named before the robot tracks again: scans fit every
    corridor"""
    claim_sigma_m: float = 0.05
    """least spread of a named place, metres (1 sigma): what the check's own covariance leaves out"""
    claim_sigma_rad: float = 0.02
    """and of its heading, radians (1 sigma)"""
    near_m: float = 1.2
    """a stored view further off says nothing about a pose, metres"""
    near_deg: float = 35.0
    """nor one turned away from it by more, degrees"""
    metres_per_radian: float = 2.0
    """turning by a radian changes the view as much as moving by so many metres"""

    def __post_init__(self) -> None:
        FilterAdvanced.__post_init__(self)
        ByPlaces.__post_init__(self)
        check_ranges("", self, shaken=(0.0, 1.0), claim_sigma_m=(1e-4, 10.0), claim_sigma_rad=(1e-4, 3.0),
                     near_m=(0.01, 100.0), near_deg=(1.0, 180.0), metres_per_radian=(0.0, 1000.0))


@dataclass(frozen=True)
class SearchSettings:
    """The dense search of the whole map; see scan_search.py."""

    per_m2: float = 300.0
    """throws per square metre of free room"""
    most: int = 60_000
    """throws at most"""
    climbers: int = 300
    """throws that climb"""
    children: int = 8
    """tries of each in a round"""
    rounds: int = 6
    """rounds of climbing"""
    sigma_m: float = 0.15
    """of the tries in the first round, metres"""
    sigma_rad: float = 0.1
    """and radians"""
    finer: float = 0.6
    """sigma of each round as a share of the one before"""
    alike: float = 1.0
    """a summit lower by less than this (a logarithm) counts as much: maps are a little wrong"""

    def __post_init__(self) -> None:
        check_ranges("", self, per_m2=(0.0, 1e6), most=(1, 10_000_000), climbers=(1, 1_000_000), children=(1, 1000),
                     rounds=(1, 100), sigma_m=(1e-4, 10.0), sigma_rad=(1e-4, 3.0), finer=(0.01, 1.0), alike=(0.0, 1000.0))


@dataclass(frozen=True)
class FitSettings:
    """Whether the map explains what is seen; see scan_fit.py."""

    expected: float = 0.65
    """share of a scan's ends in mapped ground that lie on walls, at which a right pose is as likely
    as the best wrong one"""
    rival_weight: float = 0.65
    """how far the share from the best rival place on the map moves `expected` to itself (0: not at all)"""
    rivals_m: float = 1.0
    """way between two searches for rivals, metres"""
    apart_m: float = 1.0
    """nearer than this to the belief nothing is a rival, metres"""
    rivals: int = 30
    """rivals looked at, the likeliest first, one in each square metre"""
    slope: float = 4.0
    """log-odds that a share larger by 1 is worth"""
    step: float = 1.5
    """most that one scan is worth, log-odds"""
    prior: float = 0.2
    """chance of a belief of which nothing is known yet"""
    most: float = 0.9995
    """surer than this nobody gets, one way or the other"""
    doubt: float = 0.3
    """below this chance the whole map is searched ..."""
    again: float = 1.0
    """... whenever so many new scans have come, so that a rival gets its chance"""
    reach_m: float = 0.25
    """an end as near as this to a wall lies on it, metres"""
    range_max_m: float = 30.0
    """longer beams are not used, metres"""
    least_beams: int = 10
    """of fewer beams nothing is said"""
    mapped: float = 0.7
    """where a smaller share of the beams ends in mapped ground the others count as not explained"""
    jump_m: float = 0.75
    """a belief that moved so far off its own motion is another belief, metres"""
    jump_deg: float = 30.0
    """or turned off it by so much, degrees"""
    slip_m: float = 0.5
    """a belief that scans pulled so far off its own motion, metres, ..."""
    slip_over_m: float = 3.0
    """... over so much way, is not trusted: at the end of the map it stays where the walls still look alike"""

    def __post_init__(self) -> None:
        check_ranges("", self, expected=(0.0, 1.0), rival_weight=(0.0, 1.0), rivals_m=(0.0, 1000.0), apart_m=(0.0, 1000.0),
                     rivals=(1, 10_000), slope=(0.0, 1000.0), step=(0.0, 100.0), prior=(1e-4, 0.9999),
                     most=(0.5, 1.0 - 1e-9), doubt=(0.0, 1.0), again=(0.0, 1e4), reach_m=(0.01, 10.0),
                     range_max_m=(0.1, 1000.0), least_beams=(1, 100_000), mapped=(0.0, 1.0),
                     jump_m=(0.0, 1000.0), jump_deg=(0.0, 180.0), slip_m=(0.0, 1000.0), slip_over_m=(0.1, 1000.0))


@dataclass
class ScanAdvanced(FilterAdvanced):
    """Thresholds of `localiser=particle_filter_scan`."""

    fresh_m: float = 0.1
    """scans taken so far apart are worth two, nearer ones less in proportion, metres"""
    fresh_lever_m: float = 1.0
    """a turn by a radian is worth as much as so many metres"""
    near_above: float = 0.9
    """with less than this share of the weight within 0.25 m and 5 degrees the robot does not call itself tracking, however
    much lies in the cluster: along a bare corridor it may be metres off"""
    fit: FitSettings = field(default_factory=FitSettings)
    likelihood: FieldSettings = field(default_factory=lambda: FieldSettings(range_max_m=30.0))
    searching: float = 0.2
    """above this chance of being elsewhere the whole map is searched"""
    search: SearchSettings = field(default_factory=SearchSettings)
    continuity: ContinuitySettings = field(default_factory=ContinuitySettings)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges("", self, searching=(0.0, 1.0), near_above=(0.0, 1.0), fresh_m=(0.0, 100.0), fresh_lever_m=(0.0, 100.0))
