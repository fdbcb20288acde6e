"""The words of the command line, read by Hydra's grammar and checked before anything is composed.

`planner=prm` chooses an option of a group, `planner.samples=500` sets a value, `seed=range(10)` or `planner=prm,rrt`
sweeps, `planner=glob(*)` over every planner there is, `zip(world=a,b seed=1,2)` gives values in pairs. Unknown groups,
options and malformed words are refused here, each in one line.
"""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, IntervalSweep, Override, RangeSweep
from hydra.errors import HydraException

from rhs.api.contracts import CHOICES, DEGRADE, KINDS
from rhs.api.settings import nearest
from rhs.base.errors import ConfigError

from . import registry
from .registry import JOINED, OF_SWEEP, elsewhere, in_files, names_in

GROUPS = (*CHOICES, "stack", "experiment")
DEEPEST = 64  # brackets within brackets
MOST_READ = 2_000  # words kept as read
FUNCTIONS = ("range", "glob", "choice", "sort", "shuffle", "int", "float", "str", "bool")  # of Hydra's grammar, of use here
QUOTED = r"""'(?:\\.|[^'\\])*'|"(?:\\.|[^"\\])*\""""  # a text in quotes
OPEN = "a bracket or a quote is not closed"
PAIRS = "expected as many values for each of two keys or more, zip(world=a,b seed=1,2)"
SAME = {"hydra.run.dir": "output", "hydra.sweep.dir": "output"}  # words of Hydra's own that mean one of ours
# Words of earlier versions: what is typed instead. They are taken, with a warning, for two minor versions.
DEPRECATED = {"loop_closer=one_eye": "loop_closer=monocular", "unroll.bend=told": "unroll.bend=given",
              "source.renderer=tiny": "source.renderer=tinyrenderer"}
INSTEAD = {"hydra.launcher=submitit": "engine=slurm", "hydra.launcher": "--jobs N, or engine=dask and the like",
           "hydra.verbose": "--debug", "hydra.output_subdir": "output=FOLDER", "hydra.job": "output=FOLDER"}


@dataclass(frozen=True)
class Word:
    """One override: a group's option (text) or a setting's value (any plain value), and how it was written."""

    key: str
    value: Any
    text: str

    @property
    def is_group(self) -> bool:
        return self.key in GROUPS and not isinstance(self.value, dict)


@dataclass(frozen=True)
class Zip:
    """`zip(world=a,b seed=1,2)`: values of several keys taken in pairs."""

    input_line: str
    columns: tuple[Override, ...]


def is_of_sweep(key: str) -> bool:
    """Whether a word says where the jobs of a sweep run and what stays of them, not what a run does."""
    return key in OF_SWEEP or key.startswith("engine.")


def parse(words: Sequence[str]) -> list[Override | Zip]:
    """Hydra's overrides, or ConfigError naming the word that cannot be read."""
    parser = OverridesParser.create()
    return [_zip(parser, word) if word.startswith("zip(") else _parse_one(parser, _current(word)) for word in words]


def _zip(parser: OverridesParser, word: str) -> Zip:
    """The columns of a zip, as long as one another."""
    if not word.endswith(")"):
        raise ConfigError(f"{word}: {OPEN}; {PAIRS}")
    columns = tuple(_parse_one(parser, _current(text)) for text in re.findall(rf"(?:{QUOTED}|\S)+", word[4:-1]))
    lengths = {column.key_or_group: _length(column) for column in columns}
    if len(lengths) < 2 or len(set(lengths.values())) > 1:
        found = " and ".join(f"{n:g} of {key}" for key, n in lengths.items()) or "no key"
        raise ConfigError(f"{word}: found {found}; {PAIRS}")
    return Zip(word, columns)


def _current(word: str) -> str:
    """The word as it is called now."""
    key, _, value = word.partition("=")
    if key in SAME:
        return f"{SAME[key]}={value}"
    now = DEPRECATED.get(word, word)
    if now != word:
        warnings.warn(f"{word} is now {now}; the old word goes in a later version", FutureWarning, stacklevel=3)
    return now


class _Names:
    """What Hydra's grammar asks when it meets glob(...): the options of a group. Only parts can be enumerated."""

    def get_group_options(self, group: str, results_filter: object = None) -> list[str]:
        if group not in CHOICES:
            raise ConfigError(f"{group}=glob(...): only {', '.join(CHOICES)} can be chosen by a pattern; list the values")
        return registry.names(group)


def check_no_path(word: str) -> None:
    """Refuse the name of a file or folder that stands alone, with what to type before it."""
    if Path(word).exists():
        raise ConfigError(f"{word}: a file or folder; for a recording write source=replay source.path= before it, for a map "
                          "or a building world=")


def _parse_one(parser: OverridesParser, word: str) -> Override:
    if word.startswith("-"):
        raise ConfigError(f"unknown option {word}; see python -m rhs --help")
    if max(itertools.accumulate((c in "[{(") - (c in "]})") for c in word), default=0) > DEEPEST:
        raise ConfigError(f"cannot read '{word[:40]}...': it is nested more deeply than {DEEPEST} levels")
    word = _lettered(word)
    try:
        override = parser.parse_override(word)
    except (HydraException, ValueError) as error:
        if "=" not in word.strip("="):
            check_no_path(word)
            raise ConfigError(f"cannot read '{word}': write key=value, for example seed=3") from error
        reason = _unreadable(word, str(error))
        raise ConfigError(f"cannot read '{word if len(word) < 60 else f'{word[:57]}...'}': {reason}") from error
    override.config_loader = _Names()  # type: ignore[assignment]
    if override.is_delete():
        raise ConfigError(f"{word}: a setting cannot be taken away, only given another value")
    if not override.key_or_group:
        raise ConfigError(f"cannot read '{word}': write key=value, for example seed=3")
    key = override.key_or_group.replace("/", ".")
    if key.partition(".")[0] == "hydra":
        raise _hydra_key(word, key)
    if override.package is not None:
        raise ConfigError(f"{word}: groups have fixed places here; write {override.key_or_group}=NAME")
    return override


def _unreadable(word: str, said: str) -> str:
    """What is wrong with a word that Hydra's grammar does not take."""
    if named := re.search(r"while evaluating '(\w+)\(", said):
        if named[1] in FUNCTIONS:
            return f"{named[1]}(...) does not take this; for example seed=range(3), planner=glob(*), seed=1,2"
        return f"there is no {named[1]}(...){nearest(named[1], [*FUNCTIONS])} (there is {', '.join(FUNCTIONS)})"
    if "digits" in said:  # Python's own limit
        return "a number has more than 4300 digits"
    bare = re.sub(rf"\\.|{QUOTED}", "", word)
    if "'" in bare or '"' in bare or sum(map(bare.count, "([{")) != sum(map(bare.count, ")]}")):
        return OPEN
    if bare.endswith(","):
        return "no value after the last comma"
    return f"quote text with special characters: {word.partition('=')[0]}=\"'...'\""


def _lettered(word: str) -> str:
    """The word with quotes about texts of letters that Hydra's grammar lacks: `output=Läufe 2,b` is `output='Läufe 2',b`."""
    key, equals, value = word.partition("=")
    if value.isascii() or re.search(r"""['"\\]""", value):
        return word
    return key + equals + re.sub(r"[^,\[\]{}():=]*[^\x00-\x7f][^,\[\]{}():=]*", lambda found: f"'{found[0].strip()}'", value)


def _hydra_key(word: str, key: str) -> ConfigError:
    from hydra.conf import HydraConf

    known = [f"hydra.{name}" for name in HydraConf.__dataclass_fields__]
    head = ".".join(key.split(".")[:2])
    if head not in known:
        return ConfigError(f"{word}: unknown key {key}{nearest(head, known)}")
    hint = next((value for prefix, value in INSTEAD.items() if word.replace("/", ".").startswith(prefix)), None)
    return ConfigError(f"{word}: rhs runs its jobs itself and takes no settings of Hydra's"
                       + (f"; type {hint}" if hint else ""))


def plain_words(overrides: Sequence[Override | Zip]) -> list[Word]:
    """The words of a single run. Refuses sweeps."""
    words = []
    for item in overrides:
        if isinstance(item, Zip) or item.is_sweep_override():
            raise ConfigError(f"{item.input_line}: several values need --multirun (-m); a list is written [1,2]")
        words.append(_word(item, item.value()))
    return words


def sweep_words(overrides: Sequence[Override | Zip], *, most: int) -> Combinations:
    """The words of each job: the product of all sweeps, the first key slowest. Raises ConfigError, before any is written
    out, for none and for more than `most`."""
    count = math.prod(map(_length, overrides))
    if count > most:
        raise ConfigError(f"this sweep has {count:.6g} jobs; at most {most} are run at once")
    axes: list[list[tuple[str, ...]]] = [list(zip(*map(_texts, item.columns), strict=True)) if isinstance(item, Zip) else
            [(text,) for text in _texts(item)] for item in overrides]
    for item, axis in zip(overrides, axes, strict=True):
        if not axis:
            raise ConfigError(f"{item.input_line}: it has no values, so this sweep has no jobs{_instead(item)}")
    found = Combinations(axes)
    if len(found) <= MOST_READ:
        found.words_of([text for axis in axes for values in axis for text in values])
    return found


def _instead(item: Override | Zip) -> str:
    """What there is where a pattern over parts met none."""
    if isinstance(item, Zip) or item.key_or_group not in CHOICES:
        return ""
    return f" (there is {', '.join(registry.names(item.key_or_group))})"


class Combinations(Sequence[list["Word"]]):
    """The words of every job of a sweep, each read when it is asked for: a sweep of 100,000 jobs begins at once."""

    def __init__(self, axes: list[list[tuple[str, ...]]]) -> None:
        self._axes = axes
        self._count = math.prod(map(len, axes))
        self._parser = OverridesParser.create()
        self._read: dict[str, Word] = {}

    def __len__(self) -> int:
        return self._count

    def texts(self, index: int) -> tuple[str, ...]:
        """The words of a job as one would type them."""
        chosen: list[tuple[str, ...]] = []
        for axis in reversed(self._axes):
            index, place = divmod(index, len(axis))
            chosen.append(axis[place])
        return tuple(itertools.chain.from_iterable(reversed(chosen)))

    def __getitem__(self, index: Any) -> Any:
        if not isinstance(index, int):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not 0 <= index < len(self):
            raise IndexError(index)
        return self.words_of(self.texts(index))

    def words_of(self, texts: Sequence[str]) -> list[Word]:
        """Words that were read from texts; most of them many times over, and so kept."""
        if len(self._read) > MOST_READ:
            self._read.clear()
        for text in texts:
            if text not in self._read:
                one = _parse_one(self._parser, text)
                self._read[text] = _word(one, one.value())
        return [self._read[text] for text in texts]

    def edges(self, most: int) -> list[int]:
        """Jobs that show whether the words are right: the first, the last, and each value beside the first of the others;
        of an axis of more than `most` values its first, its last and some between."""
        found, step = {0, len(self) - 1}, 1
        for axis in reversed(self._axes):
            places = range(len(axis))
            shown = places if len(places) <= most else {*places[:: len(places) // (most - 1)], places[-1]}
            found |= {step * place for place in shown}
            step *= len(axis)
        return sorted(found)


def _texts(item: Override) -> list[str]:
    """A word for each value of an override, as text."""
    if not item.is_sweep_override():
        return [item.input_line or ""]
    value: Any = item.value()
    if isinstance(value, RangeSweep) and not value.shuffle and isinstance(numbers := value.range(), range):
        return [f"{item.key_or_group}={number}" for number in numbers]  # as below, in a tenth of the time
    return [f"{item.key_or_group}={text}" for text in item.sweep_string_iterator()]


def _length(item: Override | Zip) -> float:
    """How many values a word has."""
    if isinstance(item, Zip):
        return _length(item.columns[0])
    value: Any = item.value()
    if isinstance(value, RangeSweep):
        if value.start is None or value.stop is None or not value.step:
            raise ConfigError(f"{item.input_line}: expected range(STOP), range(START,STOP) or range(START,STOP,STEP), the "
                              f"step not 0")
        steps = (value.stop - value.start) / value.step
        return max(0, math.ceil(steps)) if math.isfinite(steps) else math.inf
    if isinstance(value, IntervalSweep):
        raise ConfigError(f"{item.input_line}: an interval has no values to run; write range(START,STOP,STEP) or a list")
    if isinstance(value, ChoiceSweep):
        return len(value.list)
    return 1


def swept_keys(overrides: Sequence[Override | Zip]) -> list[str]:
    """Keys that take several values, in the order typed."""
    every = itertools.chain(*(o.columns if isinstance(o, Zip) else (o,) for o in overrides))
    return [o.key_or_group for o in every if o.is_sweep_override()]


def _word(item: Override, value: Any) -> Word:
    key = item.key_or_group
    if key == DEGRADE and isinstance(value, list):
        value = JOINED.join(map(str, _unquoted(value))) or None
    if key in GROUPS and not isinstance(value, (str, dict, type(None))):
        raise ConfigError(f"{item.input_line}: choose one {key} by name: {key}=NAME")
    return Word(key, _unquoted(value), (item.input_line or "").lstrip("+"))


def quoted(text: str) -> str:
    """Text as Hydra's grammar takes it whole."""
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


def _unquoted(value: Any) -> Any:
    """Plain Python values for Hydra's quoted strings, inside lists and dicts too."""
    if isinstance(value, dict):
        return {str(_unquoted(k)): _unquoted(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_unquoted(v) for v in value]
    return getattr(value, "text", value)


def check_options(words: Sequence[Word], options: Callable[[str], list[str]]) -> None:
    """Refuse a group option that does not exist. `options(group)` lists what there is, usable or not."""
    for word in words:
        if not word.is_group or (word.value is None and word.key not in (*KINDS, "task")):
            continue
        known = options(word.key)
        unknown = [one for one in names_in(word.key, str(word.value)) if one not in known and not in_files(word.key, one)]
        if unknown:
            raise ConfigError(f"{word.text}: there is no such {word.key}"
                              f"{elsewhere(unknown[0]) or nearest(unknown[0], known)}"
                              f" (there is {', '.join(known) or 'none'})")
