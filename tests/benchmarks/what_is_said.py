"""How often what the gate and a break point say is true, of changes and curves that are known.

    python tests/benchmarks/what_is_said.py gate 1000       # of so many gates of 20 pairs each
    python tests/benchmarks/what_is_said.py lost 1000       # of so many in which successes are lost, nothing else
    python tests/benchmarks/what_is_said.py break 50        # of so many searches of 40 runs each
"""

import math
import sys
from collections import Counter

import numpy as np

from rhs.metrics.threshold import Posterior, Threshold
from rhs.reports.gate import error_parts, judge, looks

PAIRS, RUNS = 20, 40


def gated(rng: np.random.Generator, loss: float, spread: float, old: float, new: float, *, together: bool = False) -> str:
    """The word of a gate. spread: of the logarithm of the measure, over pairs; old, new: chances that a run succeeds.
    together: the new run succeeds only where the old one does."""
    ratio = (1.0 + loss) * np.exp(spread * rng.standard_normal(PAIRS))
    done = rng.random((1 if together else 2, PAIRS)) < np.array([[old], [new]])
    before, after = np.where(done, [np.ones(PAIRS), ratio], math.nan)
    for count, level in zip(looks(PAIRS), error_parts(looks(PAIRS)), strict=True):
        won = list(zip(*done[:, :count], strict=True))
        word = judge(before[:count], after[:count], won, margin=0.02, level=level).word
        if word != "needs more runs":
            break
    return word


def curve(threshold: float, slope: float, lapse: float = 0.0):
    """Chance of success that falls along the dial."""
    return lambda x: (1 - lapse) / (1 + (1 - 2 * lapse) * math.exp(min(max((x - threshold) / slope, -60.0), 60.0)))


def searched(rng: np.random.Generator, chance) -> Threshold:
    """What is known of a break point after a search."""
    known = Posterior()
    while known.runs < RUNS:
        for level in known.next_levels(2):
            known.learn(level, bool(rng.random() < chance(level)))
    return known.summary()


def said(found: Threshold) -> str:
    """The kind of the sentence."""
    if found.two_sided:
        return "not one threshold"
    if found.found:
        return "as likely does nothing" if found.idle else "half fail at"
    if found.beyond < 0.9:
        return "rather no threshold"
    return "does not break" if found.success >= 0.5 else "fails everywhere"


GATES = [(0.0, 0.03, 1, 1), (0.0, 0.1, 1, 1), (0.01, 0.01, 1, 1), (0.01, 0.03, 1, 1), (0.01, 0.1, 1, 1), (0.02, 0.03, 1, 1),
         (0.1, 0.03, 1, 1), (0.1, 0.1, 1, 1), (-0.1, 0.1, 1, 1), (0.0, 0.1, 0.8, 0.8), (0.0, 0.1, 0.5, 0.5),
         (0.0, 0.003, 1, 0.9), (0.0, 0.003, 0.9, 0.5)]
LOST = [(old, lost, together) for together in (False, True) for old in (0.1, 0.3, 0.5, 0.7, 0.9)
        for lost in (0.0, 0.02, 0.05, 0.1, 0.2) if lost < old]
CURVES = {"threshold 0.5, slope 0.005": (curve(0.5, 0.005), 0.5), "0.5, 0.03": (curve(0.5, 0.03), 0.5),
          "0.3, 0.1, lapses 0.1": (curve(0.3, 0.1, 0.1), 0.3), "0.5, 0.15": (curve(0.5, 0.15), 0.5),
          "0.5, 0.25": (curve(0.5, 0.25), 0.5), "0.97, 0.03": (curve(0.97, 0.03), 0.97),
          "1.0, 0.03": (curve(1.0, 0.03), 1.0), "1.05, 0.03": (curve(1.05, 0.03), 1.05),
          "0.5 everywhere": (lambda x: 0.5, math.nan),
          "0.3 everywhere": (lambda x: 0.3, math.nan), "0.7 everywhere": (lambda x: 0.7, math.nan),
          "good from 0.3 to 0.7 alone": (lambda x: float(0.3 < x < 0.7), math.nan),
          "good from 0.1 to 0.6 alone": (lambda x: float(0.1 < x < 0.6), math.nan),
          "bad from 0.4 to 0.6 alone": (lambda x: float(not 0.4 < x < 0.6), math.nan)}


def main(what: str, count: int) -> None:
    """A line for each change or curve."""
    for case in GATES if what == "gate" else ():
        rng = np.random.default_rng(1)
        words = Counter(gated(rng, *case) for _ in range(count))
        print("loss {}, spread {}, success {} -> {}:".format(*case), dict(sorted(words.items())), flush=True)
    for old, lost, together in LOST if what == "lost" else ():
        rng = np.random.default_rng(1)
        words = Counter(gated(rng, 0.0, 0.003, old, old - lost, together=together) for _ in range(count))
        print(f"success {old}, lost {lost}, {'together' if together else 'apart'}:", dict(sorted(words.items())), flush=True)
    for name, (chance, truth) in CURVES.items() if what == "break" else ():
        rng = np.random.default_rng(1)
        found = [searched(rng, chance) for _ in range(count)]
        held = sum(one.low <= truth <= one.high for one in found)
        print(f"{name}:", dict(Counter(map(said, found)).most_common()), f"interval held it {held}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
