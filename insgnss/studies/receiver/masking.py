"""Satellites that antennas and airframe hide from a receiver study's channels: their C/N0, and masking by attitude.

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

from typing import Final, NamedTuple

import numpy as np

from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import IS_VISIBLE, UNDECIDED, VisibilityLimits, look_at_all, new_looks
from insgnss.filter.state import PSI
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.runs.margin.link import emitter_gain
from insgnss.simulation.closed_loop_sky import ClosedLoopTruth
from insgnss.studies.receiver.jammed_sky import LINK_STEP_S
from insgnss.studies.receiver.workspace import FilterRoom
from insgnss.tables import Bool, Float64, Int8

AIRFRAME_LOSS_DB: Final = 30.0  # of a signal whose way ends at the airframe


class ReceiverMasking(NamedTuple):
    """A receiver's model of its antennas."""

    antennas: Installation
    limits: VisibilityLimits


def gain_dbic(truth: ClosedLoopTruth, antennas: Installation) -> Float64:
    """Return the antennas' gain towards each channel's satellite at each integration, (n, m)."""
    every = max(round(LINK_STEP_S / truth.step_s), 1)
    pick = np.unique(np.append(np.arange(0, len(truth.t_s), every), len(truth.t_s) - 1))
    C_ne = ned_axes(geodetic(truth.r_e[pick]))
    u_n = np.einsum("kij,kmj->kmi", C_ne, truth.directions(pick))
    gain = emitter_gain(C_ne @ truth.C_eb[pick], u_n, antennas, AIRFRAME_LOSS_DB)
    t = truth.t_s
    return np.column_stack([np.interp(t, t[pick], gain[:, c]) for c in range(gain.shape[1])])


class AttitudeMask:
    """The masking of one run: it remembers its decisions."""

    def __init__(self, masking: ReceiverMasking, count: int) -> None:
        self._masking = masking
        self._decision: Int8 = np.full((2, count), UNDECIDED, np.int8)

    def hidden(self, f: FilterRoom, u_e: Float64) -> Bool:
        """Return which channels' satellites are hidden at the filter's attitude, (m,).

        Parameters
        ----------
        f : the filter
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
