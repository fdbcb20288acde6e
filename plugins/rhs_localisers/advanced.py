"""Thresholds of the localisers that a user seldom touches: `localiser.advanced.name=value`. Light to import."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import Bounded, within
from rhs.estimation.filters.settings import ClusterSettings
from rhs.estimation.scans.settings import FieldSettings, MatchSettings
from rhs.estimation.views.settings import ContinuitySettings, PlaceRules, RansacSettings


@dataclass(frozen=True)
class ConfirmationRules(Bounded):
    """When recognised places confirm a pose, and what contradicts it (confirmation.py). Chosen on the bundled buildings."""

    confirmations: int = within(4, 1, 10_000)
    """so many named places in a row have to agree with the motion after a doubt"""
    way_m: float = within(1.5, 1e-3, 1000.0)
    """and over so much way, metres"""
    against: int = within(6, 1, 10_000)
    """so many named places speak against a belief that is held before it is doubted: a copy of a painting is taken for the
    other one for as long as the robot drives towards it"""
    against_m: float = within(3.0, 0.0, 1000.0)
    """and over so much way, metres"""
    repeats: int = within(3, 1, 10_000)
    """so many against a belief that may have been carried off unseen"""
    jump_m: float = within(0.75, 0.0, 1000.0)
    """a belief that moved so far off its own motion is another belief, metres"""
    jump_deg: float = within(30.0, 0.0, 180.0)
    """or turned off it by so much, degrees"""
    silences: int = within(6, 1, 10_000)
    """so many views in which a place was expected and none recognised are a doubt"""
    silent_m: float = within(2.0, 0.0, 1000.0)
    """for a robot whose views all went on they have to cover so much way, metres"""
    before_m: float = within(0.3, 0.0, 100.0)
    """a beam that ends so much before the first wall of the map meets something else, metres"""
    hidden_share: float = within(0.2, 0.0, 1.0)
    """where so many beams do, a place that is not recognised is hidden and no doubt: somebody 0.45 m wide fills a third of a
    view of 57 degrees at 1.2 m"""
    behind_share: float = within(0.1, 0.0, 1.0)
    """unless more beams than this end behind a wall"""
    strong: float = within(0.25, 0.0, 1.0)
    """explained share of a named place below which it neither confirms nor contradicts what is known: chosen on one building
    of eight paintings, where 6 of 7 right ones have more, 3 of 4 wrong ones less"""
    fits_share: float = within(0.7, 0.0, 1.0)
    """least share of a scan's ends on walls of the map, seen from a pose that a place confirms"""
    misfits: int = within(8, 1, 10_000)
    """so many views on end whose scans lie off the walls say that a robot which may have been carried off unseen was"""
    misfit_share: float = within(0.6, 0.0, 1.0)
    """a scan lies off the walls where less of it than this ends on them. In a patrol of two cameras (home+obstacles/7531,
    121 views whose way was not watched) a right belief had at most three such views on end, a wrong one up to eighteen"""
    room_m: float = within(0.15, 0.0, 10.0)
    """a robot does not stand as near to a wall as this, metres: half its radius"""
    unnamed: float = within(0.2, 0.0, 1.0)
    """chance of a belief that no place confirms"""
    stale_m: float = within(2.0, 1e-3, 1000.0)
    """way without a place that halves the chance of a belief which is not confirmed, metres"""
    forgotten_m: float = within(2.0, 1e-3, 1000.0)
    """way after which a place named elsewhere, and not again, is forgotten, metres"""
    same_m: float = within(1.0, 1e-3, 100.0)
    """two named poses as near as this are one place, metres"""
    same_deg: float = within(20.0, 0.1, 180.0)
    """and turned against each other by less than this, degrees"""


@dataclass(frozen=True)
class PanoramaSettings(Bounded):
    """When walls seen all round say that a robot which doubts itself is where it would be (panorama.py)."""

    bearings: int = within(180, 8, 3600)
    """into which the circle is divided"""
    near_m: float = within(0.5, 0.0, 100.0)
    """what was seen from further away is not used, metres"""
    more: float = within(0.25, 0.01, 1.0)
    """the map is asked whenever this share of the bearings more was looked at"""
    about: int = within(400, 0, 1_000_000)
    """only a robot before which, while it knew its place, something stood that is not on the map, so many views ago at
    most, asks: else nobody can have hidden anything"""
    sure: float = within(0.99, 0.5, 1.0)
    """chance of being right from which the robot knows its place again, the chance of having been carried off being half:
    walls look alike more often than by chance, as who is carried off stands along a corridor as before"""
    step_m: float = within(0.2, 0.01, 10.0)
    """between the places of the map that are tried, metres"""
    turn_deg: float = within(10.0, 0.1, 180.0)
    """and between the headings, degrees"""
    most: int = within(60_000, 1, 10_000_000)
    """places and headings tried at most: in a larger map the places lie further apart"""
    range_max_m: float = within(8.0, 0.1, 1000.0)
    """longer beams are not used, metres"""
    slack_m: float = within(0.15, 1e-3, 10.0)
    """a beam ends at a wall that is so near to its end, metres ..."""
    slack_per_m: float = within(0.02, 0.0, 1.0)
    """... and so much further for each metre: headings err"""
    hit: float = within(0.75, 1e-6, 1.0)
    """chance of a beam that ends at the first wall of the map, ..."""
    short: float = within(0.2, 1e-6, 1.0)
    """... before it: somebody or something new stands there, ..."""
    through: float = within(0.05, 1e-6, 1.0)
    """... behind it: what stood there has gone, or the map is wrong ..."""
    unknown: float = within(0.3, 1e-6, 1.0)
    """... and of one that leads where the map knows nothing"""
    trust: float = within(0.15, 1e-6, 1.0)
    """neighbouring beams share their errors, so each counts for so much"""


@dataclass
class ByPlaces(Bounded):
    """What the localisers that recognise places share."""

    weak: float = within(0.5, 0.01, 0.9999)
    """chance that a place named with a small explained share (confirmation.strong) is right"""
    smooth_share: float = within(0.9, 0.0, 1.0)
    """share of a scan's ends on walls above which a robot whose key-points cannot tell is still where it expects to be"""
    ransac: RansacSettings = field(default_factory=RansacSettings)
    places: PlaceRules = field(default_factory=PlaceRules)
    continuity: ContinuitySettings = field(default_factory=ContinuitySettings)
    confirmation: ConfirmationRules = field(default_factory=ConfirmationRules)
    match: MatchSettings = field(default_factory=MatchSettings)


@dataclass
class SiftDbAdvanced(ByPlaces):
    """Thresholds of `localiser=sift_db`."""

    panorama: PanoramaSettings = field(default_factory=PanoramaSettings)
    gate_probability: float = within(0.999, 0.5, 1.0 - 1e-12)
    """chance that a right place passes the chi-square gate of a guess"""
    keep: int = within(8, 1, 10_000)
    """guesses kept at most"""
    floor: float = within(1e-5, 0.0, 0.5)
    """weight below which a guess is dropped"""
    steady_m: float = within(5.0, 0.0, 1e4)
    """the drift of the odometry keeps its sign for about so long, metres"""
    least_bits: float = within(1.0, 0.0, 100.0)
    """a robot that watched its way asks the places as usual only where they would tell it so much of its pose, in the
    direction of which they tell most: log2(1 + ratio of its variance and theirs) / 2; one bit answers one yes-no question"""
    seldom: int = within(9, 1, 10_000)
    """else every so many views. In between no key-points are looked for while its scan goes on and lies on walls: one that
    was carried off to where its scan fits as well finds out by then; 1: asks as any other"""
    pictured_share: float = within(0.5, 0.0, 10.0)
    """a map drawn by one camera errs by this share of what the survey's last view was unsure by before its loop was closed:
    the most that is left on a closed loop. Scans laid on it err alike: no belief in it is surer"""
    pictured_sigma_m: float = within(0.05, 0.0, 10.0)
    """and by so much besides, metres (1 sigma), as does each place recognised in it. With both 0.1 % of the views of patrols
    in 24 drawn buildings were further off than three sigmas, in one of them; 0.9 % in three with 0.08 m for all"""
    pictured_sigma_rad: float = within(0.015, 0.0, 3.0)
    """the same of the heading, radians"""
    pictured: MatchSettings = field(
        default_factory=lambda: MatchSettings(range_max_m=3.0, sigma_m=0.12, trust=0.03, floor_m=0.12, unmapped=0.0))
    """a scan read off pictures, laid onto the map: its error grows with the range and goes together from view to view
    (believed like a measured one it moved the robot by up to 0.23 m at once in random:loop/3)"""


@dataclass
class FilterAdvanced(Bounded):
    """What both particle filters share."""

    base_sigma_m: float = within(0.005, 1e-6, 1.0)
    """least motion noise of a view, metres (1 sigma)"""
    base_sigma_rad: float = within(0.003, 1e-6, 1.0)
    """least noise of the turn of a view, radians (1 sigma)"""
    long_sure: int = within(10, 0, 1_000_000)
    """views of knowing its place after which a robot takes what is not on the map for something new"""
    kld_epsilon: float = within(0.05, 1e-4, 1.0)
    """number of particles: Kullback-Leibler distance allowed to the true distribution (Fox 2003)"""
    kld_quantile: float = within(2.33, 0.0, 6.0)
    """normal quantile of the chance of keeping it: 2.33 is 99 %"""
    kld_cell_m: float = within(0.25, 0.01, 10.0)
    """bins of that distribution, metres"""
    kld_cell_deg: float = within(10.0, 0.5, 120.0)
    """and degrees"""
    cluster_m: float = within(1.0, 0.01, 100.0)
    """particles this near the densest spot are of the cluster reported, metres"""
    cluster_rad: float = within(0.5, 0.01, 3.2)
    """and this near in heading, radians"""
    clusters: ClusterSettings = field(default_factory=ClusterSettings)
    likelihood: FieldSettings = field(default_factory=FieldSettings)


@dataclass
class ParticleAdvanced(FilterAdvanced, ByPlaces):
    """Thresholds of `localiser=particle_filter`."""

    shaken: float = within(0.75, 0.0, 1.0)
    """below this mass of the heaviest cluster a place has to be named before the robot tracks again: scans fit every
    corridor"""
    claim_sigma_m: float = within(0.05, 1e-4, 10.0)
    """least spread of a named place, metres (1 sigma): what the check's own covariance leaves out"""
    claim_sigma_rad: float = within(0.02, 1e-4, 3.0)
    """and of its heading, radians (1 sigma)"""
    near_m: float = within(1.2, 0.01, 100.0)
    """a stored view further off says nothing about a pose, metres"""
    near_deg: float = within(35.0, 1.0, 180.0)
    """nor one turned away from it by more, degrees"""
    metres_per_radian: float = within(2.0, 0.0, 1000.0)
    """turning by a radian changes the view as much as moving by so many metres"""


@dataclass(frozen=True)
class SearchSettings(Bounded):
    """The dense search of the whole map; see scan_search.py."""

    per_m2: float = within(300.0, 0.0, 1e6)
    """throws per square metre of free room"""
    most: int = within(60_000, 1, 10_000_000)
    """throws at most"""
    climbers: int = within(300, 1, 1_000_000)
    """throws that climb"""
    children: int = within(8, 1, 1000)
    """tries of each in a round"""
    rounds: int = within(6, 1, 100)
    """rounds of climbing"""
    sigma_m: float = within(0.15, 1e-4, 10.0)
    """of the tries in the first round, metres"""
    sigma_rad: float = within(0.1, 1e-4, 3.0)
    """and radians"""
    finer: float = within(0.6, 0.01, 1.0)
    """sigma of each round as a share of the one before"""
    alike: float = within(1.0, 0.0, 1000.0)
    """a summit lower by less than this (a logarithm) counts as much: maps are a little wrong"""


@dataclass(frozen=True)
class FitSettings(Bounded):
    """Whether the map explains what is seen; see scan_fit.py."""

    expected: float = within(0.65, 0.0, 1.0)
    """share of a scan's ends in mapped ground that lie on walls, at which a right pose is as likely
    as the best wrong one"""
    rival_weight: float = within(0.65, 0.0, 1.0)
    """how far the share from the best rival place on the map moves `expected` to itself (0: not at all)"""
    rivals_m: float = within(1.0, 0.0, 1000.0)
    """way between two searches for rivals, metres"""
    apart_m: float = within(1.0, 0.0, 1000.0)
    """nearer than this to the belief nothing is a rival, metres"""
    rivals: int = within(30, 1, 10_000)
    """rivals looked at, the likeliest first, one in each square metre"""
    slope: float = within(4.0, 0.0, 1000.0)
    """log-odds that a share larger by 1 is worth"""
    step: float = within(1.5, 0.0, 100.0)
    """most that one scan is worth, log-odds"""
    prior: float = within(0.2, 1e-4, 0.9999)
    """chance of a belief of which nothing is known yet"""
    most: float = within(0.9995, 0.5, 1.0 - 1e-9)
    """surer than this nobody gets, one way or the other"""
    doubt: float = within(0.3, 0.0, 1.0)
    """below this chance the whole map is searched ..."""
    again: float = within(1.0, 0.0, 1e4)
    """... whenever so many new scans have come, so that a rival gets its chance"""
    reach_m: float = within(0.25, 0.01, 10.0)
    """an end as near as this to a wall lies on it, metres"""
    range_max_m: float = within(30.0, 0.1, 1000.0)
    """longer beams are not used, metres"""
    least_beams: int = within(10, 1, 100_000)
    """of fewer beams nothing is said"""
    mapped: float = within(0.7, 0.0, 1.0)
    """where a smaller share of the beams ends in mapped ground the others count as not explained"""
    jump_m: float = within(0.75, 0.0, 1000.0)
    """a belief that moved so far off its own motion is another belief, metres"""
    jump_deg: float = within(30.0, 0.0, 180.0)
    """or turned off it by so much, degrees"""
    slip_m: float = within(0.5, 0.0, 1000.0)
    """a belief that scans pulled so far off its own motion, metres, ..."""
    slip_over_m: float = within(3.0, 0.1, 1000.0)
    """... over so much way, is not trusted: at the end of the map it stays where the walls still look alike"""


@dataclass
class ScanAdvanced(FilterAdvanced):
    """Thresholds of `localiser=particle_filter_scan`."""

    fresh_m: float = within(0.1, 0.0, 100.0)
    """scans taken so far apart are worth two, nearer ones less in proportion, metres"""
    fresh_lever_m: float = within(1.0, 0.0, 100.0)
    """a turn by a radian is worth as much as so many metres"""
    near_above: float = within(0.9, 0.0, 1.0)
    """with less than this share of the weight within 0.25 m and 5 degrees the robot does not call itself tracking, however
    much lies in the cluster: along a bare corridor it may be metres off"""
    fit: FitSettings = field(default_factory=FitSettings)
    likelihood: FieldSettings = field(default_factory=lambda: FieldSettings(range_max_m=30.0))
    searching: float = within(0.2, 0.0, 1.0)
    """above this chance of being elsewhere the whole map is searched"""
    search: SearchSettings = field(default_factory=SearchSettings)
    continuity: ContinuitySettings = field(default_factory=ContinuitySettings)
