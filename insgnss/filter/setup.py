"""Everything that fixes a filter before the first sample: settings, parameters, clock groups, start."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, get_args

import numpy.typing as npt

from insgnss.antenna.installation import Installation, no_antenna
from insgnss.antenna.visibility import VisibilityLimits
from insgnss.config.filter import FilterConfig
from insgnss.config.flight import GivenStart, ImuGrade, Oscillator
from insgnss.config.quantities import Constellation
from insgnss.errors import ConfigError
from insgnss.filter.antennas.phase_log import PhaseLog, phase_log
from insgnss.filter.epoch_aid import EpochAid
from insgnss.filter.layout import Layout, StateBlock
from insgnss.filter.layout_names import StateLayout, state_layout
from insgnss.filter.output.further_columns import COVARIANCES, POINT, POINT_COVARIANCES, QUATERNION
from insgnss.filter.output.total_sigmas import SLOW_COLUMNS
from insgnss.filter.output.writing import NAV_COLUMNS
from insgnss.filter.own_rows.declared import own_measurements
from insgnss.filter.own_rows.rows import Measurement, OwnMeasurements
from insgnss.filter.parameters import resolve_parameters, weather_of
from insgnss.filter.registry import layout_of
from insgnss.filter.state import MAX_OPTIONAL, MAX_RANGE_BIASES
from insgnss.filter.states.gnss_time import GNSS_TIME, UNKNOWN_GNSS_TIME
from insgnss.filter.states.imu_time import IMU_TIME, UNKNOWN_IMU_TIME
from insgnss.filter.states.lever_arm import LEVER_ARM, UNKNOWN_LEVER_ARM
from insgnss.filter.states.rate_lag import UNKNOWN_RATE_LAG
from insgnss.filter.states.wanted import SlowSizes, StateInputs
from insgnss.filter.update.epoch_space import FilterWorkspace, new_workspace
from insgnss.filter.update.masking import NO_LIMITS
from insgnss.gnss.clock_groups import tied_clocks
from insgnss.gnss.least_squares import Ties
from insgnss.gnss.observation_rows import GnssRows, prepare_rows
from insgnss.gnss.orbits.ephemeris_choice import BroadcastMessages, broadcast_messages
from insgnss.gnss.orbits.plausible_messages import plausible_klobuchar
from insgnss.gnss.orbits.precise import precise_states
from insgnss.gnss.orbits.satellite_state import SatelliteStates, glonass_channels, satellite_states
from insgnss.gnss.phase_centre import SatelliteAntennas
from insgnss.gnss.troposphere import Weather
from insgnss.kernels.compiled_ahead import usable_cores
from insgnss.tables import Float64, GnssTable, NavigationData, PreciseProducts

LIVE_SATELLITES: Final = 48  # that a receiver may have in view at the same time
# the columns of ``nav`` that every filter may have
_OF_EVERY_ROW: Final = ("time_s", *NAV_COLUMNS, *SLOW_COLUMNS, "hpl_m", "vpl_m")
_ON_REQUEST: Final = (*QUATERNION, *COVARIANCES, *POINT, *POINT_COVARIANCES)


@dataclass(frozen=True)
class FilterSetup:
    """A filter ready to be started; ``replay`` and the streaming engine are given the same one."""

    config: FilterConfig
    grade: ImuGrade
    oscillator: Oscillator
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    range_rate_lag_s: float = 0.0  # by which range rates lag behind the motion
    clock_groups: tuple[str, ...] = ("G",)  # see ``gnss.clock_groups``; the first keeps the receiver clock
    start: GivenStart | None = None  # None: automatic
    start_ns: int | None = None  # GPS time of a given start; None: the first epoch
    navigation: NavigationData | None = None  # None: the log carries satellite states
    with_carrier: bool = False  # the log has carrier phases
    products: PreciseProducts | None = None  # orbits and clocks instead of the messages'
    # the vehicle's antennas, none: nothing masked
    installation: Installation = field(default_factory=no_antenna)
    visibility_limits: VisibilityLimits = NO_LIMITS
    antennas: SatelliteAntennas | None = None  # phase centres of the satellites, for the products
    states_wanted: tuple[StateBlock, ...] = ()  # further states, besides the filter's own
    aid: EpochAid | None = None  # what several antennas add at epochs, before the first one; None: nothing
    own: OwnMeasurements | None = None  # of further sensors and a user's own; None: none
    n_satellites: int = LIVE_SATELLITES  # whose range errors can be states at the same time
    with_base: bool = False  # a base station corrects the ranges
    # where a stretch of samples starts that has no raw GNSS data (``start.without_gnss``); None: at its epochs
    start_alone: Callable[[Any], Any] | None = None

    @property
    def may_estimate_imu_time(self) -> bool:
        """Whether the offset of the IMU's time tags is a state, or there is room for it."""
        return self.layout.at(IMU_TIME) >= 0 or self.layout.n_optional + 2 <= MAX_OPTIONAL

    def with_imu_time(self, *, early: bool) -> FilterSetup:
        """Return the setup of a filter that estimates the offset of the IMU's time tags, unseen in ``nav`` if added.

        Tags that look ``early`` may be range rates that lag: then their lag is a state as well, if there is room.
        """
        names = (UNKNOWN_IMU_TIME, UNKNOWN_RATE_LAG) if early else (UNKNOWN_IMU_TIME,)
        added = tuple(block for block in names if self.layout.at(block.name) < 0)
        if self.layout.n_optional + len(added) > MAX_OPTIONAL:
            return self
        return replace(self, states_wanted=(*self.states_wanted, *added))

    @property
    def may_estimate_gnss_time(self) -> bool:
        """Whether the offset of the GNSS tags can become a state: several antennas' phases do not know it."""
        free = self.layout.n_optional < MAX_OPTIONAL and self.aid is None
        return free and self.layout.at(GNSS_TIME) < 0

    def with_gnss_time(self) -> FilterSetup:
        """Return the setup of a filter that also estimates the offset of the GNSS time tags, unseen in ``nav``."""
        return replace(self, states_wanted=(*self.states_wanted, UNKNOWN_GNSS_TIME))

    @property
    def may_estimate_lever_arm(self) -> bool:
        """Whether the lever arm's error is not a state yet, and there is room for it."""
        return self.layout.at(LEVER_ARM) < 0 and self.layout.n_optional + 3 <= MAX_OPTIONAL

    def with_lever_arm(self) -> FilterSetup:
        """Return the setup of a filter that also estimates the lever arm's error, unseen in ``nav``."""
        return replace(self, states_wanted=(*self.states_wanted, UNKNOWN_LEVER_ARM))

    def with_further(
        self, states: Sequence[StateBlock] = (), measurements: Sequence[Measurement] = ()
    ) -> FilterSetup:
        """Return the setup of a filter that estimates further states and takes further measurements too.

        Raises
        ------
        MeasurementError : a measurement's name, times or gate cannot be used
        ConfigError : not a list of state blocks, or a block with a column that ``nav`` has already
        """
        _refuse_states(states)
        given = () if self.own is None else tuple(kind.source for kind in self.own.kinds)
        own = own_measurements(measurements, given)
        return replace(self, states_wanted=(*self.states_wanted, *states), own=own)

    @property
    def klobuchar(self) -> Float64 | None:
        """Coefficients of the ionosphere that the filter's loop evaluates, (8,)."""
        return None if self.navigation is None else plausible_klobuchar(self.navigation.klobuchar)

    @cached_property
    def messages(self) -> BroadcastMessages | None:
        """The navigation messages sorted once, none older than the settings allow; None without a file."""
        if self.navigation is None:
            return None
        return broadcast_messages(self.navigation, max_age_s=self.config.measurements.max_ephemeris_age_s)

    @property
    def n_offsets(self) -> int:
        """Number of inter-system clock offsets."""
        return len(self.clock_groups) - 1

    @property
    def ties(self) -> Ties:
        """Which clocks are equal within metres: QZSS's and GPS's."""
        return tied_clocks(self.clock_groups, self.config.process.qzss_offset_sigma_m)

    @cached_property
    def layout(self) -> Layout:
        """Which further states the filter has, and where they stand."""
        with_carrier = self.with_carrier and self.config.measurements.carrier
        most = min(self.n_satellites, MAX_RANGE_BIASES)
        wanted = StateInputs(self.config, self.clock_groups, with_carrier, self.grade, most, self.slow_sizes)
        return layout_of(wanted, self.states_wanted, tuple(self.ties.home.tolist()))

    @cached_property
    def named_states(self) -> StateLayout:
        """The filter's states by name."""
        return state_layout(self.layout)

    @property
    def threads(self) -> int:
        """How many filters may run side by side: own rows are Python, and a user's may keep state between calls."""
        return usable_cores() if self.own is None else 1

    def workspace(self, rows_per_epoch: int) -> FilterWorkspace:
        """Return new work space for epochs of at most so many rows."""
        return new_workspace(rows_per_epoch, self.layout, self.installation, self.visibility_limits)

    def parameters(self) -> npt.NDArray[Any]:
        """Return the numbers of the compiled filter, (1,) of ``PARAMETERS_DTYPE``."""
        return resolve_parameters(
            self.config,
            self.grade,
            self.oscillator,
            self.lever_arm_m,
            self.klobuchar is not None,
            self.layout,
            with_antennas=len(self.installation.lever_b) > 0,
            slow=self.slow_sizes,
        )

    @property
    def weather(self) -> Weather:
        """The air that the troposphere's model starts from."""
        return weather_of(self.config.measurements)

    def states(
        self, gnss: GnssTable, navigation: NavigationData | BroadcastMessages | None
    ) -> SatelliteStates:
        """Return the satellite states of a log: by precise products where there are any, else by the messages."""
        if isinstance(navigation, NavigationData):
            navigation = broadcast_messages(
                navigation, max_age_s=self.config.measurements.max_ephemeris_age_s
            )
        if self.products is not None and gnss.sat is None:
            return precise_states(gnss, self.products, navigation, antennas=self.antennas)
        return satellite_states(gnss, navigation)

    def rows(
        self,
        gnss: GnssTable,
        navigation: NavigationData | BroadcastMessages | None,
        *,
        ionosphere_l1: Float64 | None = None,
        correction_m: Float64 | None = None,
    ) -> GnssRows:
        """Return a log as the filter's rows; ``navigation`` is the setup's own, or its messages sorted once."""
        use = self.config.measurements
        return prepare_rows(
            gnss,
            navigation,
            self.klobuchar,
            clock_groups=self.clock_groups,
            signals=use.signals_of(),
            every_band=use.every_band,
            pseudorange=use.pseudorange,
            range_rate=use.range_rate,
            carrier=use.carrier if self.with_carrier else None,
            carrier_max_interval_s=use.carrier_max_interval_s,
            ionosphere_free=use.ionosphere == "ionosphere_free",
            max_age_s=use.max_ephemeris_age_s,
            states=None if self.products is None or gnss.sat is not None else self.states(gnss, navigation),
            ionosphere_l1=ionosphere_l1,
            correction_m=correction_m,
            variance_scale={str(letter): value for letter, value in use.variance_scale.items()},
            slow_sigma_m=self.slow_sizes.satellite,
        )

    @property
    def lacks_ionosphere(self) -> bool:
        """Whether no model removes the ionosphere: the settings name none, or its coefficients are not known."""
        model = self.config.measurements.ionosphere
        return model == "none" or (model == "klobuchar" and self.klobuchar is None)

    @property
    def unmodelled_zenith_m(self) -> float:
        """Sigma at the zenith [m] of an ionosphere that no model removes, else zero; a base station leaves a share."""
        return self.slow_sizes.ionosphere if self.lacks_ionosphere else 0.0

    @property
    def slow_sizes(self) -> SlowSizes:
        """The range errors that settings, models, products and a base station leave, and that last for minutes."""
        sizes, model = self.config.slow_errors, self.config.measurements.ionosphere
        share = sizes.with_base_share if self.with_base else 1.0
        zenith = 0.0 if model == "ionosphere_free" else sizes.ionosphere_zenith_m
        if self.lacks_ionosphere:
            zenith = sizes.no_ionosphere_zenith_m
        known, precise = sizes.satellite_m, self.products is not None
        largest = max(known.values(), default=0.0)  # of a constellation that the settings do not name
        satellite = {
            str(letter): share * (sizes.precise_satellite_m if precise else known.get(letter, largest))
            for letter in get_args(Constellation)
        }
        return SlowSizes(share * zenith, share * sizes.troposphere_zenith_m, satellite)

    def phases(self, main: GnssTable, rows: GnssRows, further: Sequence[GnssTable]) -> PhaseLog:
        """Return the phases of several antennas at the epochs of the main one's observations and rows."""
        logs = [(main, rows), *((table, self.rows(table, self.messages)) for table in further)]
        return phase_log(logs, glonass_channels(main, self.messages))

    @property
    def log_drop(self) -> float:
        """Logarithm of the weight below which a hypothesis of the heading goes."""
        return math.log(self.config.heading.drop_below)


def _refuse_states(states: Any) -> None:
    """Refuse anything but a list of state blocks, and columns that would replace others of ``nav``.

    Raises
    ------
    ConfigError : the first thing that is wrong
    """
    if not isinstance(states, Sequence) or not all(isinstance(block, StateBlock) for block in states):
        advice = "give a list of insgnss.StateBlock(...)"
        raise ConfigError(f"{states!r} is not a list of state blocks", key="states", advice=advice)
    # which a filter may add in the middle of a log
    own = (UNKNOWN_LEVER_ARM, UNKNOWN_IMU_TIME, UNKNOWN_GNSS_TIME, UNKNOWN_RATE_LAG)
    taken = {name for block in own for name in (block.name, *block.columns)}
    for block in states:
        if not taken.isdisjoint((block.name, *block.columns)):
            raise ConfigError(
                f"the state block {block.name!r} has a name of the filter's own states",
                key="states",
                advice=f"avoid the names {', '.join(sorted(taken))}",
            )
        for column in block.columns:
            if not {column, f"sd_{column}"}.isdisjoint((*_OF_EVERY_ROW, *_ON_REQUEST)):
                raise ConfigError(
                    f"the table nav has a column {column!r} or 'sd_{column}' already",
                    key="states",
                    advice=f"rename the column of the state block {block.name!r}, as {block.name}_{column}",
                )


class WorkOfThread(threading.local):
    """The work space of each thread that runs filters one after the other: a look back runs hundreds of a minute."""

    _setup: FilterSetup | None = None
    _space: FilterWorkspace

    def space(self, setup: FilterSetup, rows_per_epoch: int) -> FilterWorkspace:
        """Return the space of this thread for filters of a setup; ``rows_per_epoch`` is always the same."""
        if self._setup is not setup:
            self._setup, self._space = setup, setup.workspace(rows_per_epoch)
        return self._space
