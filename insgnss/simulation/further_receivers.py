"""The logs of a vehicle's further antennas: the same satellites from other places of the body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from insgnss.attitude.wind_up import wind_up_differences
from insgnss.simulation.observations import (
    AntennaMotion,
    SignalObservations,
    SignalPaths,
    SimulatedReceiver,
    antenna_motion,
    directions_e,
    observe_paths,
    signal_paths,
    to_table,
)
from insgnss.simulation.oscillator import ClockTruth
from insgnss.simulation.signal_errors import MarkovMultipath, SpecularReflection
from insgnss.simulation.trajectory import Trajectory
from insgnss.tables import EphemerisTable, Float64, GnssTable

LOCAL = (MarkovMultipath, SpecularReflection)  # errors that each antenna has of its own


@dataclass(frozen=True)
class FurtherReceiver:
    """A further antenna with a receiver of its own."""

    name: str
    receiver: SimulatedReceiver
    clock_bias_m: float = 0.0  # of a clock of its own, beyond the main one's at the first tag
    # main antenna's and its own axes, where the wave's turn is put in
    C_ba: tuple[Float64, Float64] | None = None


@dataclass(frozen=True)
class FurtherReceivers:
    """All of them, and whether one oscillator drives them together with the main receiver."""

    receivers: Sequence[FurtherReceiver] = ()
    separate_clocks: bool = False

    def draw(
        self,
        trajectory: Trajectory,
        eph: EphemerisTable,
        start_ns: int,
        clock: ClockTruth,
        own_clock: Callable[[float], ClockTruth],
        rng: np.random.Generator | None,
    ) -> tuple[GnssTable, ...]:
        """Return the log of each antenna.

        Orbits, clocks of satellites and the air are the same for all antennas and cancel in their differences: what
        messages and models miss of them is in the main log alone.

        Parameters
        ----------
        clock : of the main receiver
        own_clock : draws a clock with so much more bias at the first tag [m]
        """
        logs = []
        for one in self.receivers:
            mine = own_clock(one.clock_bias_m) if self.separate_clocks else clock
            antenna = antenna_motion(trajectory, mine.true_s, one.receiver.lever_arm_b)
            paths = signal_paths(antenna, eph, start_ns, mine.true_s)
            seen = observe_paths(
                *(paths, eph.sv_names, eph.group_delay_s[:, 0], start_ns, mine, one.receiver, rng),
                C_eb=antenna.C_eb,
            )
            logs.append(to_table(_wound_up(seen, one, antenna, paths), start_ns))
        return tuple(logs)


def _wound_up(
    seen: SignalObservations, one: FurtherReceiver, antenna: AntennaMotion, paths: SignalPaths
) -> SignalObservations:
    """Return the observations with the phase that the antenna's tilt against the main one adds."""
    if one.C_ba is None or seen.carrier_cycles is None:
        return seen
    both = np.stack(one.C_ba)
    towards = directions_e(paths)
    turned = np.stack(
        [wind_up_differences(both, C, u)[0] for C, u in zip(antenna.C_eb, towards, strict=True)]
    )
    cycles = np.tile(turned, seen.carrier_cycles.shape[1] // turned.shape[1]) / (2.0 * np.pi)
    # received phase grows towards the satellite, the logged one as ranges do
    return replace(seen, carrier_cycles=seen.carrier_cycles - cycles)
