"""What a recording had to be rid of before it could be read: the counts that `source=replay` leaves in recording.json.

Stamps that were put right, with no view lost, stand in `stamps_repaired`. Beside them: what its views say of the camera.
"""

from __future__ import annotations

from rhs.api.metric import LOOP, RunFiles, columns_of

from .survey import NAN, Values

FILE = "recording"  # recording.json: {"rejected": {reason: count}}
# Why a view goes; a `jump` of the clock is kept.
THROWN = ("duplicate", "backward", "outlier", "not_finite", "empty", "other_frame")
_SOURCE = "rhs.metrics.recording"
_COLUMNS = (
    ("stamps_rejected", "", "views of a recording left out: stamp repeated, backward, far off or no number; scan empty; of "
     "another frame than the first", _SOURCE),
    ("stamps_jumped", "", "jumps of a recording's clock; the views are kept", _SOURCE),
    ("views_unpaired", "", "images of a recording left out because their partner (depth, second camera) is not there",
     _SOURCE),
    ("truth_rejected", "", "true poses of a recording left out: unknown, or for their stamps", _SOURCE),
)
NAMES = tuple(column[0] for column in _COLUMNS)


def _values(run: RunFiles) -> Values:
    """The columns; NaN for a simulator."""
    plain = run.json(FILE)
    counts = plain.get("rejected") if isinstance(plain, dict) else None
    if not isinstance(counts, dict):
        return dict.fromkeys(NAMES, NAN)
    return {"stamps_rejected": sum(int(counts.get(reason, 0)) for reason in THROWN),
            "stamps_jumped": int(counts.get("jump", 0)), "views_unpaired": int(counts.get("unpaired", 0)),
            "truth_rejected": sum(int(n) for reason, n in counts.items() if reason.startswith("truth_")
                                  and reason not in ("truth_jump", "truth_reordered"))}


CAMERA = "camera_fit"  # camera_fit.json: what the views say of the camera that was told
_FIT = "rhs.estimation.views.camera_fit"
_CAMERA_COLUMNS = (
    ("focal_ratio", "", "focal length that the views of a recording with depth fit over the one told", _FIT),
    ("focal_ratio_sigma", "", "its standard error", _FIT),
    ("depth_magnified", "", "size of the depth images of a recording on the pictures over that of registered ones", _FIT),
    ("depth_magnified_sigma", "", "its standard error", _FIT),
)


def _camera_values(run: RunFiles) -> dict[str, float | int | str]:
    """The columns; NaN for a simulator, and where too few views are turned apart."""
    plain = run.json(CAMERA)
    known = plain if isinstance(plain, dict) else {}
    return {name: float(known.get(name, NAN)) for name, *_ in _CAMERA_COLUMNS}


RECORDING = (*columns_of(_values, *_COLUMNS, tasks=(*LOOP, "localise"), counts=NAMES),
             *columns_of(_camera_values, *_CAMERA_COLUMNS))
