"""The antenna's gain behind the sky in body axes, if the run states the vehicle's antennas."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from insgnss.antenna.equipment import installation, limits_of
from insgnss.antenna.visibility import gain_map
from insgnss.config.filter import Visibility
from insgnss.config.flight import MountedAntenna
from insgnss.errors import InsGnssError
from insgnss.report.charts import Trace, packed
from insgnss.runs.result import Run
from insgnss.tables import Float64

_STEP_DEG: Final = 10.0  # of the tiles: a pattern changes by about a decibel over one


def pattern_traces(run: Run, scale: dict[str, Any]) -> list[Trace]:
    """Return the gain over the body's sphere as rings of tiles; none where antennas or their files are not known.

    Parameters
    ----------
    scale : colours and their limits, of a marker
    """
    gain = _gain(run)
    if gain is None:
        return []
    azimuth, down = _grid()
    rings = []
    for ring, values in zip(down.tolist(), gain, strict=True):
        known = np.isfinite(values)
        rings.append(
            {
                "type": "barpolar",
                "base": [ring - 0.5 * _STEP_DEG] * int(known.sum()),
                "r": [_STEP_DEG] * int(known.sum()),
                "theta": packed(azimuth[known]),
                "width": [_STEP_DEG] * int(known.sum()),
                "marker": {"color": packed(values[known]), "line": {"width": 0}, **scale, "showscale": False},
                "showlegend": False,
                "name": "gain",
                "hovertemplate": "%{marker.color:.1f} dBic<extra></extra>",
            }
        )
    return rings


def _grid() -> tuple[Float64, Float64]:
    """Return the middles of the tiles: azimuth, and the angle from straight up [deg]."""
    return np.arange(0.0, 360.0, _STEP_DEG), np.arange(0.5 * _STEP_DEG, 180.0, _STEP_DEG)


def _gain(run: Run) -> Float64 | None:
    """Return the gain of the best antenna (rings, sectors), None where it cannot be had any more."""
    flight, filter_ = (dict(run.settings.get(key) or {}) for key in ("flight", "filter"))
    described = dict(flight.get("gnss") or {}).get("antenna")
    if not described:
        return None
    # the flight file is the first of a run's files: relative paths start in its folder
    first = next(iter(run.settings.get("input_sha256") or {}), "")
    try:
        antennas, _ = installation(
            [MountedAntenna.model_validate(antenna) for antenna in described], Path(first).parent
        )
        limits = limits_of(Visibility.model_validate(filter_.get("visibility") or {}))
    except (InsGnssError, ValueError):  # a file is gone: the page does without the background
        return None
    return gain_map(antennas, limits, *_grid())
