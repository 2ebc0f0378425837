"""What a receiver study's antennas receive: C/N0 past emitters, gains, satellites hidden by the airframe, masking.

C/N0 on the way past emitters is by the link of the flown interference margin.

A receiver that masks leaves out the channels whose satellites its antennas do not see at the attitude that its filter
estimates, with the stage that masks a log's satellites (``antenna.visibility``), at the beginning of each block of
integrations. A channel that was left out begins again where the filter expects its signal (``receiver_search``).

What the loops do without masking is simulated, not assumed: replicas that a filter steers stay where the filter expects
the signal, so that a hidden channel coasts and its discriminators give noise about zero; as rows of the C/N0 of an open
sky these are counted as information that is not there. Channels with loops of their own walk away on that noise. In
``models/scenarios/masked_bank.toml`` (five of eleven hidden by 43.5 deg of bank, told 45 dBHz, tactical, TCXO, four
runs) without and with masking: one stage that tracks the phase has its velocity to 7 and 4 mm/s and a NEES of 7.6 and
0.9 in the bank; two stages without phase are off by 12 and 0.7 m; ``optimal`` with phase loses lock in every run and in
none.
Neglects: other signals. Correlators have the satellite's own code alone: no reflection and no cross-correlation is
there to be locked on. Those are false locks of the sample level, and assumed in ``masking_study``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from insgnss.antenna.installation import Installation, no_antenna
from insgnss.antenna.visibility import IS_VISIBLE, UNDECIDED, VisibilityLimits, look_at_all, new_looks
from insgnss.config.interference import InterferenceConfig
from insgnss.config.library import file_of
from insgnss.config.strict import load_toml
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.filter.state import PSI
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.interference.margin import db, ratio
from insgnss.runs.margin.link import emitter_gain, link
from insgnss.runs.margin.loops import signal_loop
from insgnss.runs.margin.path import FlownPath
from insgnss.simulation.closed_loop_sky import ClosedLoopTruth
from insgnss.studies.receiver.workspace import FilterRoom
from insgnss.tables import Bool, Float64, Int8, Int64

LINK_STEP_S: Final = 0.1  # at which the link and the gains are evaluated
_SATELLITE: Final = "G01"  # any of GPS: they have one signal
AIRFRAME_LOSS_DB: Final = 30.0  # of a signal whose way ends at the airframe


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
    pick = _looked_at(truth)
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
    return _at_all_times(truth, pick, -db(inverse))


class ReceiverMasking(NamedTuple):
    """A receiver's model of its antennas."""

    antennas: Installation
    limits: VisibilityLimits


def gain_dbic(truth: ClosedLoopTruth, antennas: Installation) -> Float64:
    """Return the antennas' gain towards each channel's satellite at each integration, (n, m)."""
    pick = _looked_at(truth)
    C_ne = ned_axes(geodetic(truth.r_e[pick]))
    u_n = np.einsum("kij,kmj->kmi", C_ne, truth.directions(pick))
    gain = emitter_gain(C_ne @ truth.C_eb[pick], u_n, antennas, AIRFRAME_LOSS_DB)
    return _at_all_times(truth, pick, gain)


def _looked_at(truth: ClosedLoopTruth) -> Int64:
    """Return the integrations at which link and gains are evaluated, the last among them."""
    every = max(round(LINK_STEP_S / truth.step_s), 1)
    return np.unique(np.append(np.arange(0, len(truth.t_s), every), len(truth.t_s) - 1))


def _at_all_times(truth: ClosedLoopTruth, pick: Int64, values: Float64) -> Float64:
    """Return the values (k, m) of the picked integrations at all of them, (n, m)."""
    t = truth.t_s
    return np.column_stack([np.interp(t, t[pick], values[:, c]) for c in range(values.shape[1])])


class AttitudeMask:
    """The masking of one run: it remembers its decisions."""

    def __init__(self, masking: ReceiverMasking, count: int) -> None:
        self._masking = masking
        self._decision: Int8 = np.full((2, count), UNDECIDED, np.int8)

    def hidden(self, f: FilterRoom, u_e: Float64) -> Bool:
        """Return which channels' satellites are hidden at the filter's attitude, (m,).

        Parameters
        ----------
        u_e : (m, 3) directions to the satellites, ECEF
        """
        m = f.state[0]
        C_ne = ned_axes(geodetic(m.r_e[None]))[0]
        P_b = m.C_eb.T @ f.P[PSI : PSI + 3, PSI : PSI + 3] @ m.C_eb
        u_n = np.ascontiguousarray(u_e @ C_ne.T)[None]
        self._decision[0] = self._decision[1]
        looks = new_looks(1, len(u_e))._replace(decision=self._decision)
        C_nb = (C_ne @ m.C_eb)[None]
        look_at_all(C_nb, P_b[None], u_n, *self._masking, looks)
        return np.asarray((self._decision[1] & IS_VISIBLE) == 0)
