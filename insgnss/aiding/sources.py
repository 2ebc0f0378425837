"""The inputs of a filter's aiding besides the filter: its resolved settings and the source of the satellites."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from insgnss.aiding.satellite_arcs import SatelliteArcs, broadcast_arcs, precise_arcs
from insgnss.aiding.table import AidingSetup, AidingTable, compute_aiding
from insgnss.aiding.trace import FilterTrace
from insgnss.config.aiding import AidingConfig
from insgnss.errors import NavigationDataError
from insgnss.filter.setup import FilterSetup
from insgnss.gnss.orbits.ephemeris_choice import BroadcastMessages, broadcast_messages
from insgnss.gnss.orbits.plausible_messages import plausible_klobuchar
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.tables import PreciseProducts


@dataclass(frozen=True)
class AidingSources:
    """The setup of an aiding and its satellites: precise products where the filter uses them, else the messages."""

    setup: AidingSetup
    messages: BroadcastMessages | None = None
    products: PreciseProducts | None = None

    def arcs(self, first_ns: int, last_ns: int) -> SatelliteArcs:
        """Return the pieces of every satellite over a span of reception, GPS time."""
        if self.products is not None:
            return precise_arcs(self.products, self.setup.signals, first_ns, last_ns)
        assert self.messages is not None  # ``aiding_sources`` gives one of the two
        return broadcast_arcs(self.messages, self.setup.signals, first_ns, last_ns)

    def table(self, found: FilterTrace) -> AidingTable:
        """Return the aiding at all rows of a trace."""
        t_ns = found.trace.t_ns
        satellites = self.arcs(int(t_ns[0]), int(t_ns[-1])) if len(t_ns) else self.arcs(0, 0)
        return compute_aiding(self.setup, satellites, found.trace, found.samples, found.covariances)


def aiding_sources(
    filter: FilterSetup,
    config: AidingConfig,
    channels: Mapping[str, int] | None = None,
) -> AidingSources:
    """Return the inputs of a filter's aiding.

    Air: the troposphere as the filter has it; the ionosphere by GPS's coefficients whatever model the filter uses,
    since a receiver's code is delayed whether or not the filter combines it away (none where the settings say "none").

    Parameters
    ----------
    filter : of the run that is aided
    channels : GLONASS channels beyond those of the messages

    Raises
    ------
    NavigationDataError : nothing says where satellites are that the log does not hold
    """
    navigation = filter.navigation
    if filter.products is None and (navigation is None or not navigation.has_messages):
        raise NavigationDataError(
            "the aiding of a log with satellite states in its rows needs messages or precise products: the rows do"
            " not cover hidden satellites and the time between epochs",
            key="gnss.navigation",
            advice="name a RINEX navigation file in the flight file, or replay without aiding",
        )
    use = filter.config.measurements
    messages = (
        None if navigation is None else broadcast_messages(navigation, max_age_s=use.max_ephemeris_age_s)
    )
    known = {} if messages is None else messages.channels
    setup = AidingSetup(
        config=config,
        sensor=sensor_model(filter.grade),
        clock=clock_model(filter.oscillator),
        lever_arm_m=filter.lever_arm_m,
        clock_groups=filter.clock_groups,
        channels=dict(channels or {}) | known,
        klobuchar=None
        if navigation is None or use.ionosphere == "none"
        else plausible_klobuchar(navigation.klobuchar),
        troposphere=use.troposphere == "saastamoinen",
        weather=filter.weather,
    )
    return AidingSources(setup, messages, filter.products)
