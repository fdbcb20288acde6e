"""At which level of a dial do half of the runs fail? Levels are chosen as the outcomes come in (rhs.metrics.threshold).

A dial is any numeric setting with two ends, `sensor.image_sigma=0..40`. Every other word may take several values, as in a
sweep: each combination is searched on its own, all with the same seeds. A run that fails, or is killed, did not succeed.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rhs.base.errors import ConfigError, RhsError
from rhs.config.compose import Composer, RunConfig, to_plain
from rhs.config.overrides import Word, parse, sweep_words, swept_keys
from rhs.metrics.threshold import LEVELS, Dial, Posterior, Threshold, dial_between, in_words

from .jobs import Job, Limits
from .kept import MISSING, kept_rows
from .sweep import job_of

MOST_COMBINATIONS = 200
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass
class Search:
    """One combination of parts under the dial, and what is known of it."""

    name: str
    words: list[Word]
    known: Posterior = field(default_factory=Posterior)
    reasons: list[str] = field(default_factory=list)
    refused: list[tuple[float, str]] = field(default_factory=list)  # level and why


@dataclass(frozen=True)
class Plan:
    """The dial, the combinations and the folder they go to."""

    dial: Dial
    searches: list[Search]
    composer: Composer
    output: str
    first_seed: int


def dial_of(words: Sequence[str]) -> tuple[Dial, list[str]]:
    """The one word `key=low..high` and the other words. Raises ConfigError."""
    found = [(word, match) for word in words
             if (match := re.fullmatch(rf"([A-Za-z_][\w.]*)=({NUMBER})\.\.({NUMBER})", word))]
    if len(found) != 1:
        raise ConfigError(f"break: found {len(found)} dials; expected one, key=LOW..HIGH, for example "
                          f"sensor.image_sigma=0..40")
    word, match = found[0]
    low, high = float(match[2]), float(match[3])
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ConfigError(f"break {word}: expected two ends, the lower first")
    return dial_between(match[1], low, high), [one for one in words if one != word]


def plan(words: Sequence[str]) -> Plan:
    """Compose every combination at every level of the dial before anything runs. Raises ConfigError in one line."""
    dial, rest = dial_of(words)
    overrides = parse(rest)
    swept = swept_keys(overrides)
    if "seed" in swept or "output" in swept:
        raise ConfigError("break: every run has a seed of its own, from seed=N on; give one seed and one output")
    composer, searches, output, seed = Composer(()), [], "", 0
    for combination in sweep_words(overrides, most=MOST_COMBINATIONS):
        name = " ".join(word.text for word in combination if word.key in swept) or "this configuration"
        config = composer.config(combination)
        if _setting(config, dial.key) is None:
            low = int(dial.low) if dial.low.is_integer() else dial.low  # the setting may take whole numbers only
            config = composer.config([*combination, _word(dial.key, low)])  # or says which setting was meant
        dial = replace(dial, whole=_is_whole(config, dial.key))
        _check_values(dial, composer, combination)
        searches.append(Search(name, combination))
        output, seed = config.output, config.seed
    return Plan(dial, searches, composer, output, seed)


def _check_values(dial: Dial, composer: Composer, combination: Sequence[Word]) -> None:
    """Raises ConfigError for a value of the dial that the part refuses: both ends first, then what lies between."""
    ends = [dial.value(0.0), dial.value(1.0)]
    for value in dict.fromkeys([*ends, *(dial.value(float(level)) for level in LEVELS)]):
        try:
            composer.config([*combination, _word(dial.key, value)])
        except ConfigError as error:
            more = "" if value in ends else "; a dial takes every value between its ends"
            raise ConfigError(f"{error}{more}") from error


def _setting(config: RunConfig, key: str) -> Any:
    """The plain value of a setting; None where there is none."""
    value: Any = to_plain(config)
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value


def _is_whole(config: RunConfig, key: str) -> bool:
    """Whether a setting takes whole numbers, as its default does."""
    value = _setting(config, key)
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise ConfigError(f"break: {key} is no numeric setting here (it is {value!r}); see python -m rhs --help")
    return isinstance(value, int)


def run_plan(found: Plan, folder: Path, limits: Limits, *, runs: int, tell: Callable[[Job | str, str], None],
             ) -> list[dict[str, Any]]:
    """`runs` runs for each combination, the same seeds for all, so many at a time as there are processes; their accounts."""
    at_once = max(1, math.ceil(limits.jobs / len(found.searches)))
    for first in range(0, runs, at_once):
        seeds = range(found.first_seed + first, found.first_seed + min(first + at_once, runs))
        batch = [(search, *next_job(found, search, level, seed)) for search in found.searches
                 for level, seed in zip(search.known.next_levels(len(seeds)), seeds, strict=True)]
        rows = kept_rows([job for _, _, job in batch], folder, limits, tell=tell)
        for (search, value, job), row in zip(batch, rows, strict=True):
            learn(search, found.dial.level(value), row, str(folder / job.name))
    return [account(search, found.dial) for search in found.searches]


def next_job(found: Plan, search: Search, level: float, seed: int) -> tuple[float, Job]:
    """The value of the dial at a level, and the run of a combination there with this seed."""
    value = found.dial.value(level)
    words = [*(word for word in search.words if word.key != "seed"), _word(found.dial.key, value), _word("seed", seed)]
    keys = [word.key for word in search.words if word.text in search.name.split(" ")]
    return value, job_of(found.composer.config(words), words, [*keys, found.dial.key, "seed"])


def _word(key: str, value: float) -> Word:
    return Word(key, value, f"{key}={value:g}" if isinstance(value, float) else f"{key}={value}")


def learn(search: Search, level: float, row: Mapping[str, Any], where: str) -> None:
    """The outcome of a run at a level; one that left no row did not succeed. Raises RhsError where nobody knows."""
    success = 0.0 if row["status"] == MISSING else row.get("success")
    if not isinstance(success, int | float) or math.isnan(success):
        raise RhsError(f"{where}: this task has no success that could break; its rows leave it unknown")
    search.known.learn(level, success == 1.0)
    if success != 1.0:
        search.reasons.append(str(row.get("failure") or row.get("reason") or ""))
    if row["status"] == "refused":
        search.refused.append((level, str(row.get("reason") or "")))


def account(search: Search, dial: Dial) -> dict[str, Any]:
    """What is known of one combination, in units of the dial."""
    known, tried = search.known.summary(), search.known.tried
    why = "" if any(succeeded for _, succeeded in tried) else Counter(search.reasons).most_common(1)[0][0]
    if search.refused and not why:
        why = f"{len(search.refused)} of {len(tried)} were refused, not driven{_from(search, dial)}: " \
              f"{search.refused[0][1]}"
    return {"combination": search.name, "dial": dial.key, **_in_units(known, dial, why), "withstood": withstood(known),
            "tried": [[dial.value(level), succeeded] for level, succeeded in tried],
            "levels": [[level, succeeded] for level, succeeded in tried]}


def _from(search: Search, dial: Dial) -> str:
    """From which value on every run was refused, and how many of those short of it succeeded: there the dial ends, whatever
    the parts can do. Empty where refused and driven runs lie among one another."""
    low, high = (end(level for level, _ in search.refused) for end in (min, max))
    for beyond, edge, word in ((lambda level: level >= low, low, "more"), (lambda level: level <= high, high, "less")):
        short = [succeeded for level, succeeded in search.known.tried if not beyond(level)]
        if short and len(search.known.tried) - len(short) == len(search.refused):
            return (f", all at {dial.text(edge)} and {word}, where the dial ends, {sum(short)} of {len(short)} "
                    "others succeeded")
    return ""


def withstood(known: Threshold) -> float:
    """Share of the dial, from its harmless end on, at which half have failed: 0 none, 1 all of it."""
    if not known.found:
        return float(known.success >= 0.5)
    share = min(max(known.middle, 0.0), 1.0)
    return share if known.direction > 0 else 1.0 - share


def _in_units(known: Threshold, dial: Dial, why: str) -> dict[str, Any]:
    """why: none succeeded, in words."""
    values = {name: float(dial.value(min(max(getattr(known, name), 0.0), 1.0))) for name in ("middle", "low", "high")}
    between = f"{dial.text(known.low)} to {dial.text(known.high)}"
    return asdict(known) | values | {"found": known.found, "runs_needed": known.runs_needed, "between": between,
                                     "says": in_words(known, dial) + (f": {why[:200]}" if why else "")}
