"""A user is told once, and only when something really is compiled."""

from __future__ import annotations

from rhs.api.jit import compiled, on_compile


def doubled(x):
    return 2 * x


def test_compiling_is_told_once_and_using_what_is_compiled_is_not(tmp_path, monkeypatch):
    import numba

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))  # nothing is known yet
    told = []
    on_compile(lambda: told.append(1))
    fast = compiled(doubled)
    assert fast(2) == 4 and told == [1]
    assert fast(3) == 6 and fast(1.5) == 3.0 and told == [1]
    again = []
    on_compile(lambda: again.append(1))
    assert compiled(doubled)(2) == 4 and again == []  # read from the cache
