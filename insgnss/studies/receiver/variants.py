"""The receivers of the laboratory as data: which channels they have, what goes to the filter, and what comes back.

| name | channels | to the filter | back to the channels |
|------|----------|---------------|----------------------|
| scalar | own loops over range, rate and a Gauss-Markov acceleration | none: least squares | nothing |
| aided | own loops over range and rate | running estimates, taken for less than they say | radial acceleration |
| two_stage | the same | running estimates as if they were white noise | radial acceleration |
| optimal | the same; without INS as scalar | the interval's observations alone | range, rate, acceleration |
| one_stage | none: discriminators are rows of the filter | every observation | the replicas themselves |
| one_stage_code | the same, code and phase | every observation | the replicas themselves |

A phase alone says nothing of the place: all phases of ``one_stage`` begin from one position, whose error stays. With
``one_stage_code`` each phase has a state of its own, by how much its range is off from that of the code (the method of
the additional variable): 11 or 17 states and one for each satellite.

A loop is the Kalman filter of its model: its bandwidth follows from C/N0, motion and oscillator. Without INS the filter
is the same one, of an inertial system that feels nothing: the bias of its accelerometers is the vehicle's acceleration,
a Gauss-Markov process; attitude and gyros are known, so that 11 of its 17 states are left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy import linalg
from scipy.spatial.transform import Rotation

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError
from insgnss.filter.layout import Layout, RandomWalk, StateBlock
from insgnss.filter.parameters import resolve_parameters
from insgnss.filter.prediction import new_scratch
from insgnss.filter.rows.replica_offset import ACCELERATION_COLUMNS, COLUMNS, OWN_COLUMN, RANGE_COLUMNS
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, new_bank
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.rotations import EARTH_RATE_E, matrix_to_quaternion
from insgnss.inertial.sensor_model import sensor_model
from insgnss.interference.riccati import discretised
from insgnss.simulation.closed_loop_sky import ClosedLoopTruth, InertialAiding
from insgnss.simulation.oscillator import ClockTruth
from insgnss.studies.receiver.imu import UnknownMotion
from insgnss.studies.receiver.workspace import (
    INTERVAL_MESSAGE,
    NO_STATE,
    ONE_STAGE,
    SCALAR,
    TWO_STAGE,
    FilterRoom,
    ReceiverDesign,
)
from insgnss.tables import Float64
from insgnss.tracking.admissible import (
    require_known,
    require_positive,
    require_truth_value,
    require_whole,
    require_within,
)
from insgnss.units import mg_to_mps2


@dataclass(frozen=True)
class Variant:
    """One receiver.

    ``widening`` multiplies the oscillator's density for which the channels are designed, ``inflation`` the variances of
    their estimates as rows; both cure a filter that counts the same information twice.
    """

    kind: int
    words: str
    inflation: float = 1.0
    widening: float = 1.0
    with_code: bool = False  # of one stage that tracks the phase

    def __post_init__(self) -> None:
        """Refuse a receiver that cannot exist.

        Raises
        ------
        ConfigError : an unknown kind, factors that are not positive, or a receiver of code and phase with two stages
        """
        require_within(
            SCALAR,
            ONE_STAGE,
            'start from one in RECEIVERS, as replace(RECEIVERS["aided"], ...)',
            kind=self.kind,
        )
        require_whole(SCALAR, "start from one in RECEIVERS", kind=self.kind)
        words: Any = self.words
        if not isinstance(words, str) or not words:
            raise ConfigError(f"{words!r} is not a description", key="words", advice="give a text")
        require_positive("1 leaves the channels' variances as they are", inflation=self.inflation)
        require_positive("1 leaves the oscillator's density as it is", widening=self.widening)
        require_truth_value(with_code=self.with_code)
        if self.with_code and self.kind != ONE_STAGE:
            advice = 'take RECEIVERS["one_stage_code"], or with_code = False'
            raise ConfigError(
                "only a one-stage receiver tracks code and phase", key="with_code", advice=advice
            )

    @property
    def has_filter(self) -> bool:
        """Return whether a navigation filter runs."""
        return self.kind != SCALAR

    @property
    def has_second_stage(self) -> bool:
        """Return whether the filter takes what channels with filters of their own give it."""
        return self.kind in (TWO_STAGE, INTERVAL_MESSAGE)

    @property
    def needs_ins(self) -> bool:
        """Return whether the channels cannot do without an inertial system."""
        return self.kind == TWO_STAGE


AIDED_INFLATION: Final = 10.0
VARIANTS: Final = {
    "scalar": Variant(SCALAR, "independent channels, least squares"),
    "aided": Variant(TWO_STAGE, "channels aided with acceleration, estimates down-weighted", AIDED_INFLATION),
    "two_stage": Variant(TWO_STAGE, "two stages, estimates as white noise"),
    "optimal": Variant(INTERVAL_MESSAGE, "two stages, the interval's observations alone"),
    "one_stage": Variant(ONE_STAGE, "discriminators as rows of the filter"),
    "one_stage_code": Variant(ONE_STAGE, "code and phase as rows, a state for each phase", with_code=True),
}

USUAL_VARIANTS: Final = tuple(name for name, variant in VARIANTS.items() if not variant.with_code)


def variant_of(name: str | Variant) -> Variant:
    """Return a variant by its name.

    Raises
    ------
    ConfigError : the name is unknown
    """
    return (
        name if isinstance(name, Variant) else VARIANTS[require_known(name, VARIANTS, "variants", "receiver")]
    )


@dataclass(frozen=True)
class InitialSigmas:
    """One sigma of the errors that a receiver begins with: signals are found, the inertial system is aligned."""

    position_m: float
    velocity_mps: float
    attitude_rad: float
    clock_m: float
    drift_mps: float
    acceleration_mps2: float


# a loop that tracks the phase begins within the discriminator's aperture
STARTS: Final = {
    "coherent": InitialSigmas(0.003, 0.02, 0.005, 0.003, 0.02, 1.0),
    "noncoherent": InitialSigmas(5.0, 0.5, 0.005, 5.0, 0.5, 1.0),
}
# position and clock where code and phase are tracked, and each phase less its code
_FOUND_M: Final = 5.0
_LEAST_DRIFT: Final = 1e-12  # far below any clock's [rad^2/s^3]


def oscillator_of(drift_density: float, carrier_hz: float) -> Oscillator:
    """Return a clock whose drift wanders with a one-sided density of the carrier's frequency, S [rad^2/s^3].

    Equation: S / 2 (c / (2 pi f0))^2 = c^2 2 pi^2 h_-2

    Raises
    ------
    ConfigError : the density is neither 0 nor a number from 1e-12 on
    """
    if drift_density != 0.0 and not _LEAST_DRIFT <= drift_density < math.inf:
        raise ConfigError(
            f"invalid drift density {drift_density:g}",
            key="drift_density",
            advice="give rad^2/s^3, one-sided: 0.02 to 1000, or 0 for an oscillator without drift",
        )
    h_minus2 = 0.5 * drift_density / (2.0 * math.pi * carrier_hz) ** 2 / (2.0 * math.pi**2)
    return Oscillator(h0_s=0.0, h_minus2_per_s=h_minus2)


def without_ins(unknown: UnknownMotion) -> ImuGrade:
    """Return the grade of an inertial system that senses nothing: its bias is the vehicle's acceleration."""
    return ImuGrade(
        gyro_bias_deg_per_h=0.0,
        gyro_bias_instability_deg_per_h=0.0,
        gyro_correlation_time_s=1e6,
        gyro_arw_deg_per_sqrt_h=0.0,
        accel_bias_mg=0.0,
        accel_bias_instability_mg=unknown.sigma / mg_to_mps2(1.0),
        accel_correlation_time_s=unknown.time_s,
        accel_vrw_mps_per_sqrt_h=0.0,
    )


def feeling_nothing(r_e: Float64, count: int) -> InertialAiding:
    """Return such an inertial system's outputs: the Earth's rotation and the weight at ``r_e``, in ECEF axes."""
    gravity = np.empty(3)
    normal_gravity_ecef(np.ascontiguousarray(r_e), gravity)
    return InertialAiding(
        np.tile(EARTH_RATE_E, (count, 1)), np.tile(-gravity, (count, 1)), np.zeros((count, 6))
    )


@dataclass(frozen=True)
class TrueStart:
    """Where a run begins, in truth."""

    r_e: Float64
    v_e: Float64
    C_eb: Float64
    clock_m: float
    drift_mps: float
    acceleration_e: Float64  # relative to the Earth [m/s^2]

    @classmethod
    def of(cls, truth: ClosedLoopTruth, clock: ClockTruth) -> TrueStart:
        """Return the first middle."""
        acceleration = (truth.v_e[1] - truth.v_e[0]) / truth.step_s
        bias, drift = float(clock.bias_m[0]), float(clock.drift_mps[0])
        return cls(truth.r_e[0], truth.v_e[0], truth.C_eb[0], bias, drift, acceleration)


def further_states(phases: int, density: float, disturbed: int = 0) -> Layout:
    """Return the states behind those of motion and clock.

    Parameters
    ----------
    phases : how many have a state of their own, each its range less that of the code
    density : of their walk, two-sided [m^2/s]
    disturbed : how many hold what noise within an interval does to its messages; zero between two updates

    Raises
    ------
    ConfigError : more than there is room for
    """
    blocks = []
    if phases:
        names = tuple(f"phase_{c}_m" for c in range(phases))
        blocks.append(StateBlock("phase_less_code", names, "m", _FOUND_M, RandomWalk(math.sqrt(density))))
    if disturbed:
        names = tuple(f"interval_{i}" for i in range(disturbed))
        blocks.append(StateBlock("interval_noise", names, "1", 1.0, RandomWalk(0.0)))
    return Layout(tuple(blocks))


def filter_room(
    grade: ImuGrade,
    oscillator: Oscillator,
    start: InitialSigmas,
    at: TrueStart,
    rng: np.random.Generator,
    with_ins: bool,
    directions: Float64 | None = None,
    divergence_density: float = 0.0,
    phases: int = 0,
    disturbed: tuple[int, ...] = (),
) -> FilterRoom:
    """Return a filter that begins with errors of the ``start``'s sigmas.

    Without INS the attitude is that of ECEF and has no error; the bias of the accelerometers begins at minus the
    vehicle's acceleration. With ``directions`` (m, 3) to the satellites each phase has a state of its own: position and
    clock are those of a code that was acquired, and the phases have been seen once with the ``start``'s sigma.
    Without directions there is room for ``phases`` of them: their variance is zero until a phase comes
    back whose cycle is not known. Behind them is room for what noise within an interval does to the states
    ``disturbed`` (``interval_noise``).
    """
    phases = phases if directions is None else 0
    extra = phases if directions is None else len(directions)
    further = extra + len(disturbed)
    layout = further_states(extra, divergence_density if directions is not None else 0.0, len(disturbed))
    bank, sensor, n = new_bank(1, further), sensor_model(grade), OFFSETS + further
    m, P = bank.state[0], bank.P[0]
    sigma = np.zeros(n)
    sigma[DR : DR + 3], sigma[DV : DV + 3] = start.position_m, start.velocity_mps
    sigma[CLOCK], sigma[DRIFT] = start.clock_m, start.drift_mps
    if with_ins:
        sigma[PSI : PSI + 3] = start.attitude_rad
        sigma[BA : BA + 3], sigma[BG : BG + 3] = sensor.accel_bias.sigma, sensor.gyro_bias.sigma
    else:
        sigma[BA : BA + 3] = start.acceleration_mps2
    if directions is not None:
        sigma[DR : DR + 3], sigma[CLOCK], sigma[OFFSETS:] = _FOUND_M, _FOUND_M, _FOUND_M
    P[:] = np.diag(sigma**2)
    draws = np.zeros(n)
    known = n - phases - len(disturbed)
    draws[:known] = rng.standard_normal(known)
    error = sigma * draws
    if directions is not None:
        error = _phases_seen(P, error, directions, start.position_m, rng)
        m.optional[:extra] = error[OFFSETS:]
    m.r_e[:], m.v_e[:] = at.r_e + error[DR : DR + 3], at.v_e + error[DV : DV + 3]
    C_eb = np.eye(3)
    if with_ins:
        C_eb = Rotation.from_rotvec(error[PSI : PSI + 3]).as_matrix() @ at.C_eb
    else:
        m.b_a[:] = -at.acceleration_e + error[BA : BA + 3]
    m.C_eb[:] = C_eb
    matrix_to_quaternion(np.ascontiguousarray(C_eb), m.q_eb)
    m.clock[0], m.clock[1] = at.clock_m + error[CLOCK], at.drift_mps + error[DRIFT]
    own = (OFFSETS,) if extra else ()
    # what the clock does to the accelerations of all channels; only messages of intervals have any
    shared = OFFSETS + extra + disturbed.index(NO_STATE) if NO_STATE in disturbed else CLOCK
    return FilterRoom(
        bank.state,
        P,
        parameters_of(grade, oscillator, layout),
        new_scratch(n),
        np.zeros((4, n)),
        np.zeros((3, OWN_COLUMN + 1)),
        np.array((*COLUMNS, *own), np.int64),
        np.array((*COLUMNS[:RANGE_COLUMNS], OFFSETS), np.int64),
        np.array((*ACCELERATION_COLUMNS, shared, *own), np.int64),
        np.array(disturbed, np.int64),
    )


def _phases_seen(
    P: Float64, error: Float64, directions: Float64, sigma_m: float, rng: np.random.Generator
) -> Float64:
    """Correct ``P`` by one look at every phase, and return the error that is then left.

    Equation: K = P H^T (H P H^T + r I)^-1, P <- (I - K H) P (I - K H)^T + r K K^T, e <- e - K (H e + n)
    """
    m = len(directions)
    H = np.zeros((m, len(P)))
    H[:, DR : DR + 3], H[:, CLOCK], H[:, OFFSETS:] = -directions, 1.0, np.eye(m)
    K = np.linalg.solve(H @ P @ H.T + sigma_m**2 * np.eye(m), H @ P).T
    left = np.eye(len(P)) - K @ H
    whole = left @ P @ left.T + sigma_m**2 * K @ K.T
    P[:] = 0.5 * (whole + whole.T)
    return np.asarray(error - K @ (H @ error + sigma_m * rng.standard_normal(m)))


def parameters_of(grade: ImuGrade, oscillator: Oscillator, layout: Layout) -> npt.NDArray[Any]:
    """Return the numbers of the tight filter for a receiver whose heading is known: all of a force is motion."""
    par = resolve_parameters(_settings(), grade, oscillator, (0.0, 0.0, 0.0), False, layout)
    par["covariance_step"] = 0.0  # a step for every integration
    return par


@cache
def _settings() -> FilterConfig:
    """Return the settings of the filter, read once for all runs."""
    return filter_config("tight", {"process.motion_sigma": 0.0})


def receiver_of(
    variant: Variant,
    step_s: float,
    interval: int,
    drift_density: float,
    unknown: UnknownMotion | None,
    limits: tuple[float, float, int],
    record_every: int,
    settle: int,
    steps: tuple[float, float] = (0.0, 0.0),
) -> ReceiverDesign:
    """Return a receiver whose channels are designed for the oscillator, and for the motion where it is unknown.

    Parameters
    ----------
    drift_density : two-sided, of the clock's drift [m^2/s^3]
    unknown : None: an inertial system gives the acceleration
    """
    # range, its rate, and the acceleration if it is unknown
    states = 2 if unknown is None else 3
    A = np.diag(np.ones(states - 1), 1)
    of_clock, of_motion = np.zeros_like(A), np.zeros_like(A)
    of_clock[1, 1] = drift_density
    if unknown is not None:
        A[2, 2] = -1.0 / unknown.time_s
        of_motion[2, 2] = 2.0 * unknown.sigma**2 / unknown.time_s
    F, walk = discretised(A, variant.widening * of_clock + of_motion, step_s)
    disturbing = (of_clock,) if unknown is None else (of_clock, of_motion)
    return ReceiverDesign(
        variant.kind,
        interval,
        variant.inflation,
        np.ascontiguousarray(F),
        np.ascontiguousarray(walk),
        np.ascontiguousarray(linalg.inv(F)),
        np.stack([discretised(A, density, step_s).Q for density in disturbing]),
        record_every,
        settle,
        limits,
        steps,
    )
