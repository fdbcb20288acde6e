"""The errors a user can meet, and the checks of a setting's value: what a plugin raises and calls."""

from rhs.base.errors import (
    ConfigError,
    ContractError,
    EngineError,
    PluginError,
    RecordingError,
    RhsError,
    check_choice,
    check_range,
    check_ranges,
)

__all__ = ["ConfigError", "ContractError", "EngineError", "PluginError", "RecordingError", "RhsError", "check_choice",
           "check_range", "check_ranges"]
