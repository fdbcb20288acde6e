"""The room that plugins are checked in, for our own tests too."""

from rhs.testing.room import HIGH, LOW, observe, paintings, see

__all__ = ["HIGH", "LOW", "observe", "paintings", "see"]
