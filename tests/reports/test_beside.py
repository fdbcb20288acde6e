"""The pictures of a run, drawn by another process, are those that the run would draw."""

from functools import partial

import pytest

from rhs.base import processes
from rhs.reports.beside import Drawer, draw_apart


@pytest.fixture
def allowed(monkeypatch):
    monkeypatch.setattr(processes, "_helpers", True)


def test_nobody_is_asked_where_it_is_not_allowed(tmp_path):
    assert not Drawer().pictures(tmp_path)


def test_an_empty_folder_is_drawn_and_one_that_cannot_be_drawn_is_left_to_the_run(allowed, tmp_path):
    assert Drawer().pictures(tmp_path)  # nothing to be drawn
    (tmp_path / "plan.json").write_text("{")
    assert not Drawer().pictures(tmp_path)


def test_a_process_that_is_not_needed_ends(allowed):
    drawer = Drawer()
    process = drawer._process
    drawer.close()
    assert process.poll() is not None
    drawer.close()


def test_one_that_was_killed_is_not_waited_for(allowed, tmp_path):
    drawer = Drawer()
    drawer._process.kill()
    assert not drawer.pictures(tmp_path)


@pytest.mark.parametrize("bad", [0, 1])
def test_each_picture_is_drawn_once_and_one_that_fails_is_said(tmp_path, bad):
    drawings = [partial((tmp_path / name).touch, exist_ok=False) for name in ("one", "two", "three")]
    draw_apart(drawings)
    assert {path.name for path in tmp_path.iterdir()} == {"one", "two", "three"}
    (tmp_path / ("two", "one")[bad]).unlink()  # the other is there, and cannot be made
    with pytest.raises((RuntimeError, FileExistsError)):
        draw_apart(drawings)
