"""A recording as the replay source hands it out, or why it is refused."""

from __future__ import annotations

import pytest

from rhs.api.errors import ConfigError
from rhs_sources.replay_config import Replay


def views(path, **settings):
    """The source, closed, and (capture, truth) of each view."""
    source = Replay(path=str(path), **settings).build(None)
    out = []
    while (capture := source.lead()) is not None:
        out.append((capture, source.truth()))
    source.close()
    return source, out


def refused(path, **settings):
    """The one line that says why."""
    with pytest.raises(ConfigError) as error:
        views(path, **settings)
    text = str(error.value)
    assert "\n" not in text and len(text) < 400
    return text
