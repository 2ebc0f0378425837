"""The kernels of the satellites' states and of the point solution, each with arguments of the types it is called with.

Nothing here is run: the arrays are empty, only their types count (``insgnss.runs.kernel_list``).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from insgnss.gnss.dilution import dilution
from insgnss.gnss.least_squares import RANGE, FitRows, fit, free_clocks, workspace
from insgnss.gnss.observation_rows import mark_repeats
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.satellite_state import broadcast_states, flight_times, no_states, signal_facts
from insgnss.gnss.point.integrity import Fits, agree, protection_levels, redundancy, redundancy_room
from insgnss.gnss.point.log import (
    PointFit,
    fit_position,
    new_room,
    see_rows,
    solve_epochs,
    solve_position,
    solve_velocity,
    write_rows,
)
from insgnss.gnss.point.rows import PointRows, PointSettings, new_point_log
from insgnss.gnss.troposphere import STANDARD_WEATHER
from insgnss.kernels.compiled_ahead import ANY_N, ANY_X
from insgnss.tables import EphemerisTable, GnssTable


def calls() -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Return the kernels, the longest to compile first.

    The search for wrong rows is not among them: a log whose rows agree does without.
    """
    ties, x, P, u_n, use = (
        free_clocks(1),
        np.zeros(4),
        np.zeros((4, 4)),
        np.zeros((0, 3)),
        np.zeros(0, np.bool_),
    )
    rows = _no_rows()
    places = np.zeros(0, np.int64)
    settings = PointSettings(
        ANY_X,
        ANY_X,
        ANY_X,
        STANDARD_WEATHER,
        (ANY_X,) * 4,
        (ANY_X,) * 4,
        (ANY_X,) * 2,
        ANY_X,
        ANY_X,
        ties,
        ANY_X,
    )
    out, room, limits = new_point_log(rows, 1), new_room(0), np.zeros(1)
    fits = Fits(limits, workspace(4), redundancy_room(0))
    one, solution = FitRows(RANGE, room.sat, x, x, room.group[0], ties, x), PointFit(use, x, P)
    return {
        solve_epochs: (rows, settings, limits, out),
        solve_position: (rows, settings, ANY_N, ANY_N, room, fits, solution, out),
        solve_velocity: (settings, ANY_N, x, room, fits, solution, out),
        broadcast_states: _no_satellites(),
        write_rows: (rows, settings, ANY_N, ANY_N, solution, room, fits, out),
        fit_position: (rows, settings, ANY_N, ANY_N, room, fits, solution, u_n),
        fit: (one, use, x, fits.work),
        agree: (one, use, x, x, P, fits),
        see_rows: (rows, settings, ANY_N, x, ANY_N, room, u_n),
        dilution: (one, use, x, P, fits.work, P, x),
        redundancy: (one, use, x, P, fits.work, fits.room),
        protection_levels: (use, fits.room, P, P, ANY_X, ANY_X),
        mark_repeats: (places, places, places, places, ANY_N, places),
        flight_times: (places, x, x),
    }


def _no_rows() -> PointRows:
    """Return a log without an epoch."""
    single: Any = np.zeros(0, np.float32)  # as the rows of a log are kept
    places = np.zeros(0, np.int64)
    return PointRows(
        epoch_ns=places,
        first=np.zeros(1, np.int64),
        sat=np.zeros((0, 8)),
        value=np.zeros((0, 2)),
        sigma=np.zeros((0, 2), np.float32),
        status=np.zeros((0, 2), np.int8),
        group=places,
        cn0=single,
        thermal=single,
        weakness=single,
        variance_scale=single,
        ionosphere_factor=np.zeros(0),
        ionosphere_m=single,
        klobuchar=np.zeros(8),
    )


def _no_satellites() -> tuple[Any, ...]:
    """Return the arguments of ``broadcast_states`` for a log without a row."""
    none, times, signals = np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int16)
    wide = {name: np.zeros(0) for name in EphemerisTable.__dataclass_fields__}
    of_time = {"toe_ns": times, "toc_ns": times, "group_delay_s": np.zeros((0, 2))}
    messages = broadcast_messages(EphemerisTable(**{**wide, **of_time, "sv_names": (), "message": ()}))  # type: ignore[arg-type]
    log = GnssTable(times, signals, signals, none, none, none, none, (), ())
    facts = signal_facts(log, messages)
    return times, signals, signals, none, times, facts, messages.index, no_states(0)
