"""A part that calls sys.exit() where nobody expected it ends no command in silence."""

import sys

from rhs.base.commands import answered


def test_an_exit_of_a_part_is_a_line_with_its_place_and_a_failure(capsys):
    assert answered(lambda: sys.exit(0)) == 1
    said = capsys.readouterr().err
    assert said.startswith("rhs: SystemExit: 0 (") and "test_ending_parts.py:" in said and said.count("\n") == 1
