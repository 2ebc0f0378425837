"""C/N0 of a receiver study's channels on the way past emitters: the link of the flown interference margin."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from insgnss.antenna.installation import Installation, no_antenna
from insgnss.config.interference import InterferenceConfig
from insgnss.config.library import file_of
from insgnss.config.strict import load_toml
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.interference.margin import db, ratio
from insgnss.runs.margin.link import emitter_gain, link
from insgnss.runs.margin.loops import signal_loop
from insgnss.runs.margin.path import FlownPath
from insgnss.simulation.closed_loop_sky import ClosedLoopTruth
from insgnss.tables import Float64

LINK_STEP_S: Final = 0.1  # at which the link and the gains are evaluated
_SATELLITE: Final = "G01"  # any of GPS: they have one signal


def emitters_of(emitters: InterferenceConfig | str | Path) -> InterferenceConfig:
    """Return emitters: as they are, from a file (a path ending in .toml), or by name from ``models/emitters``.

    Raises
    ------
    ModelError, MissingFileError, ConfigError : there are none, or the file does not fit
    """
    if isinstance(emitters, InterferenceConfig):
        return emitters
    return load_toml(file_of("emitters", emitters), InterferenceConfig)


def jammed_cn0_dbhz(
    truth: ClosedLoopTruth,
    emitters: InterferenceConfig,
    start_s: float,
    antennas: Installation | None = None,
) -> Float64:
    """Return the C/N0 of each channel at each integration, (n, m).

    Equation: 1/q = N_0 / C + sum over emitters of (J/S) kappa, as ``flown_margin`` has it

    Parameters
    ----------
    start_s : seconds of the week at the trajectory's t = 0
    antennas : of the vehicle; None: 0 dBic everywhere
    """
    every = max(round(LINK_STEP_S / truth.step_s), 1)
    pick = np.unique(np.append(np.arange(0, len(truth.t_s), every), len(truth.t_s) - 1))
    place = geodetic(truth.r_e[pick])
    C_ne = ned_axes(place)
    C_nb = np.einsum("kij,kjl->kil", C_ne, truth.C_eb[pick])
    shape = (len(pick), 3, 3)
    time_s = (start_s + truth.t_s[pick]) % (NS_PER_WEEK / NS_PER_S)
    path = FlownPath(time_s, place, C_nb, np.zeros(shape), np.zeros(len(pick)))
    own = no_antenna() if antennas is None else antennas
    received = link(path, emitters.emitter, emitters.receiver, own).received_dbw
    gain = emitter_gain(C_nb, np.einsum("kij,kmj->kmi", C_ne, truth.directions(pick)), own, 0.0)
    loop = signal_loop(_SATELLITE, emitters.receiver, emitters.emitter, {})
    js = ratio(received[:, None] - (emitters.receiver.signal_dbw + gain)[..., None])
    inverse = ratio(-(emitters.receiver.cn0_dbhz + gain)) + js @ loop.separation
    looked = -db(inverse)
    t = truth.t_s[pick]
    return np.column_stack([np.interp(truth.t_s, t, looked[:, c]) for c in range(looked.shape[1])])
