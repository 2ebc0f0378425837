"""What a row of the trust campaign is: a scenario, what spoils it, where it is looked at, and what must hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from insgnss.config.vehicle_kind import VehicleRows
from insgnss.tables import Event, GnssTable, ImuTable, NavigationData

if TYPE_CHECKING:
    from tests.benchmarks.trust.flying import Flown

BLOCKS: Final[Mapping[str, tuple[str, ...]]] = {
    "position": ("n_m", "e_m", "d_m"),
    "velocity": ("vn_mps", "ve_mps", "vd_mps"),
    "tilt": ("roll_deg", "pitch_deg"),
    "yaw": ("yaw_deg",),
    "accel_bias": tuple(f"accel_bias_{axis}_mps2" for axis in "xyz"),
    "gyro_bias": tuple(f"gyro_bias_{axis}_radps" for axis in "xyz"),
}
MOTION: Final = ("position", "velocity", "tilt", "yaw")
ALL: Final = tuple(BLOCKS)
# The filter takes pseudorange errors to last 2.5 s (models/filters/tight17.toml) and weighs each epoch of 1 Hz down by
# that. The simulated noise is white, so the variance of the position is up to 2.5 times too large, on purpose.
MODEST: Final[Mapping[str, float]] = {"position": 2.5, "velocity": 1.25}
SIGMAS: Final = 5.0  # what the faults of the table must stay within: one in two million for one value
# A row of situations holds some 10^5 values: a consistent filter is beyond 6 sigma in one row of 5000, beyond 5 in 20
SIGMAS_OF_MANY: Final = 6.0

VICTIM: Final = "(victim)"  # in the pattern of ``event``: the satellites that lie

Statistic = Literal["nees", "most", "least", "mean", "median", "rms"]


@dataclass(frozen=True)
class Check:
    """Something that must hold over all runs of a row.

    ``nees``: mean of the squared error over sigma at ``at`` over the axes of ``of`` and over the runs; bounds that are
    not given are those of chi-square. ``rms``: root of the mean over runs of a window's mean square; ``most``, ``least``,
    ``mean``, ``median`` of a number that is kept of each run.
    """  # noqa: E501

    name: str
    statistic: Statistic
    of: str  # a block, or the name of a number
    at: str = ""  # of NEES: a look
    low: float | None = None
    high: float | None = None
    # the filter's variance may be that many times too large, for a reason that the row states
    modest: float = 1.0


@dataclass(frozen=True)
class Case:
    """A drawn flight before its replay, which a fault may change."""

    imu: ImuTable
    gnss: GnssTable
    navigation: NavigationData
    start_ns: int
    victims: tuple[str, ...] = ()  # satellites that lie
    through_file: bool = False  # the inertial log is written and read again, so that the reader sees it
    events: tuple[Event, ...] = ()


Spoiler = Callable[[Case, float, np.random.Generator], Case]
Measure = Callable[["Flown"], float]


@dataclass(frozen=True)
class Mark:
    """Checks that are expected to fail: of which rows, which ones, why, and what will mend them."""

    rows: str  # pattern of names
    checks: str
    reason: str
    in_tests: bool = True  # whether few seeds show the failure: then the tests ask for it


@dataclass(frozen=True)
class Row:
    """One row: a scenario of one grade, flown with several seeds."""

    name: str  # without spaces; the page's anchor and the option --rows
    title: str
    scenario: str  # TOML text, or the name of one in models/scenarios
    checks: tuple[Check, ...]
    grade: str = ""  # in place of the scenario's
    rate_hz: float | None = None  # of the IMU, in place of the scenario's
    gnss_rate_hz: float | None = None
    duration_s: float | None = None
    # seconds after the origin; negative: before the end of the scenario
    looks: Mapping[str, float] = field(default_factory=dict)
    windows: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # seconds after the origin
    measures: Mapping[str, Measure] = field(default_factory=dict)
    spoil: Spoiler | None = None
    lever_off_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # by which the declared lever arm is wrong
    # of looks and windows: where the fault begins; it moves by ``spread_s`` from seed to seed
    origin_s: float = 0.0
    spread_s: float = 0.0
    event: str = ""  # pattern that an event's "kind: detail" must match after the origin
    start: Literal["automatic", "given"] = "automatic"
    cut: bool = False  # the log begins at a place drawn by the seed
    vehicle: VehicleRows | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the filter, by dotted key
    output: float | None = None  # rate of navigation rows; None: one for each epoch
    live: bool = False  # through the streaming engine
    integrity: bool = False  # with protection levels
    times: int = 1  # as many runs as the campaign's seeds, times that
    fault: bool = False
    expected: tuple[Mark, ...] = ()  # given by the module of that name
    in_tests: bool = False

    def origin(self, seed: int) -> float:
        """Return where the fault of a seed's run begins [s]."""
        # steps of the golden ratio fill an interval evenly, whatever the number of seeds
        return self.origin_s + self.spread_s * ((seed * 0.6180339887498949) % 1.0)


@dataclass(frozen=True)
class Line:
    """A bound on one number of several rows together: all their runs are one sample.

    ``nees``: mean of the squared error over sigma of blocks at a look; ``rms``: root of the mean of a window's squares;
    ``ratio``: root of a mean square of the first pattern's rows over that of the second's.
    """

    name: str
    rows: tuple[str, ...]  # patterns
    of: tuple[str, ...]  # blocks; of a ratio the name of a number
    at: str  # a look, or the window of an rms
    statistic: Literal["nees", "rms", "ratio"]
    low: float
    high: float


def nees(*blocks: str, at: str = "end", modest: Mapping[str, float] = MODEST) -> tuple[Check, ...]:
    """Return a check of the NEES of each block against chi-square."""
    return tuple(
        Check(f"nees {block} {at}", "nees", block, at, modest=modest.get(block, 1.0)) for block in blocks
    )


def honest(
    window: str = "all", limit: float = SIGMAS_OF_MANY, blocks: tuple[str, ...] = MOTION
) -> tuple[Check, ...]:
    """Return the checks that no error of a window is beyond ``limit`` sigma, a check for each block."""
    return tuple(
        Check(f"worst {block} {window}", "most", f"{window}.{block}.worst", high=limit) for block in blocks
    )


def no_event(*kinds: str) -> tuple[Check, ...]:
    """Return a check for each kind of event that must not happen."""
    return tuple(Check(f"no {kind}", "most", f"events.{kind}", high=0.0) for kind in kinds)


NO_FALSE_HEADING: Final = Check("no false heading", "most", "false_heading", high=0.0)
REPORTED: Final = Check("reported by an event", "least", "reported", low=1.0)
