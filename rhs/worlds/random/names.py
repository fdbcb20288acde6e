"""What may stand after `world=random:`, and which building it names.

    random:FAMILY[+plain|+obstacles|+moved|+shut|+people|+obstacles+people|+moved+people][/NUMBER]

NUMBER is the building's seed; without it the building's seed is the run's. `+plain` puts nothing in after the survey,
`+obstacles` always something; without a word half of the buildings have obstacles. `+moved` moves or takes away one to
three of the things that the survey saw, and puts nothing in; a draw with nothing to move is drawn again. `+shut` puts
barriers across ways, so that the robot can no longer get to some of its places. `+people` is `+plain` with people who walk
about, `+obstacles+people` and `+moved+people` have both.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rhs.api.settings import nearest
from rhs.base.errors import ConfigError

PREFIX = "random:"
FAMILIES = {
    "loop": "a corridor round a block, 1.1 to 3.5 m wide, perhaps with a niche, a dead end or a notched block",
    "ladder": "two to four blocks between corridors: loops that share a side",
    "office": "a corridor with three to six rooms, doors 0.8 to 1 m, desks, shelves, chairs",
    "home": "four to six rooms that open into one another, with the furniture of a home",
    "hall": "a hall with round and square pillars, benches, screens; perhaps a lobby",
    "non_manhattan": "no right angles: curved and polygonal rings, stars, zigzags, askew rooms",
}
WORDS = ("plain", "obstacles", "moved", "shut", "people", "obstacles+people", "moved+people")
MOST = 2**31 - 1


@dataclass(frozen=True)
class Named:
    """A random building by name. word: one of WORDS, or empty; number: its seed, None where the run's is taken."""

    family: str
    word: str = ""
    number: int | None = None


def is_random(world: object) -> bool:
    """Whether `world=` asks for a building that is drawn."""
    return isinstance(world, str) and world.startswith(PREFIX)


def parse(world: str) -> Named:
    """The building that these words name. Raises ConfigError in one line."""
    found = re.fullmatch(r"random:([^+/]*)(?:\+([^/]*))?(?:/(.*))?", world, re.DOTALL)
    family, word, number = found.groups() if found else (world.removeprefix(PREFIX), None, None)
    if family not in FAMILIES:
        raise ConfigError(f"world={world}: there is no family '{family}'{nearest(family, list(FAMILIES))}; "
                          f"families: {', '.join(FAMILIES)}")
    if word is not None and word not in WORDS:
        raise ConfigError(f"world={world}: found '+{word}'{nearest(word, list(WORDS))}; expected "
                          f"{', '.join(f'+{one}' for one in WORDS)}")
    if number is not None and not (re.fullmatch(r"[0-9]{1,10}", number) and int(number) <= MOST):
        raise ConfigError(f"world={world}: found '/{number}'; expected the number of a building, 0 to {MOST}, such as "
                          f"random:{family}/12")
    return Named(family, word or "", None if number is None else int(number))


def building_of(world: str, seed: object) -> str:
    """The building that a run was in: the world's name, or with its number where the run's seed chose it. Rows with one
    answer share a building, rows with two do not; whatever is no random building is its own name."""
    if not is_random(world) or "/" in world:
        return world
    try:
        return f"{world}/{int(seed)}"  # type: ignore[call-overload]
    except (TypeError, ValueError):
        return world
