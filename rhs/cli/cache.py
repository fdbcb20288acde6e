"""`python -m rhs cache`: what surveys of sweeps are kept for later ones, and where.

    python -m rhs cache          how many, how large, and the folder
    python -m rhs cache clear    delete them

RHS_CACHE is the folder (else the user's for caches), RHS_CACHE_MB what it may hold (2000; 0: nothing is kept). Of a full
folder those go first that were used longest ago. `cache=false` as a word of a sweep leads every survey anew.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rhs.api.settings import nearest
from rhs.base.errors import ConfigError
from rhs.sweeps import survey_cache


def main(words: Sequence[str]) -> int:
    """The command."""
    if list(words) not in ([], ["clear"]):
        raise ConfigError(f"cache {' '.join(words)}: expected nothing more, or clear{nearest(words[0], ['clear'])}")
    most_mb = survey_cache.most_mb()
    if words:
        count, size_mb = survey_cache.clear()
        sys.stdout.write(f"{count} surveys deleted, {size_mb:.0f} MB, from {survey_cache.cache_folder()}\n")
        return 0
    count, size_mb = survey_cache.kept()
    sys.stdout.write(f"{count} surveys, {size_mb:.0f} of {most_mb:.0f} MB, in {survey_cache.cache_folder()}; "
                     "python -m rhs cache clear deletes them\n")
    return 0
