"""Settings of the gate between vision and wheels (rhs.gating), light to import."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.base.errors import check_choice, check_range

GATED = "gated: "  # how the reason of a replaced motion begins; rhs.metrics counts these


@dataclass
class Gate:
    """When vision is not believed."""

    # contradiction: wheels (or the last speed) replace a motion that contradicts them; off: an odometry is believed.
    # Only odometries that need depth are gated: those of one eye weave wheels and commands in themselves
    act: str = "contradiction"
    # chance that a good motion passes; the rest, one in a million, is replaced by the wheels
    probability: float = 0.999999
    # error of the wheels (1 sigma) as a share of distance and turn, and the least: wider than encoders are, for time
    # stamps that do not fit and floors that are not flat
    wheel_share: float = 0.1
    wheel_least_m: float = 0.02
    wheel_least_rad: float = 0.02
    # wheels that spin may count up to this share of their travel without moving the robot
    slip_share: float = 0.5
    # after so many contradictions on end the wheels are doubted, not vision
    patience: int = 10
    # without wheels: greatest change of speed between two views, m/s and rad/s; hands and robots stay far below
    leap_mps: float = 3.0
    leap_radps: float = 6.0

    def __post_init__(self) -> None:
        check_choice("gate", "act", self.act, ("contradiction", "off"))
        check_range("gate", "probability", self.probability, low=0.5, high=1.0 - 1e-12)
        check_range("gate", "wheel_share", self.wheel_share, low=0.0, high=1.0)
        check_range("gate", "wheel_least_m", self.wheel_least_m, low=1e-6, high=10.0, unit="m")
        check_range("gate", "wheel_least_rad", self.wheel_least_rad, low=1e-6, high=3.0, unit="rad")
        check_range("gate", "slip_share", self.slip_share, low=0.0, high=1.0)
        check_range("gate", "patience", self.patience, low=1, high=1_000_000)
        check_range("gate", "leap_mps", self.leap_mps, low=0.01, high=1000.0, unit="m/s")
        check_range("gate", "leap_radps", self.leap_radps, low=0.01, high=1000.0, unit="rad/s")
