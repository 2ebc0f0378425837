"""The filter's state: its layout, with names for every index, and the arrays that hold it.

A bank holds one filter for each heading that is still possible (one filter when the heading is known): one record and
one covariance per hypothesis. Copying the three arrays of a bank copies the filter.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.antenna.visibility import UNDECIDED
from insgnss.gnss.observation_rows import N_KINDS, N_SATELLITE_SLOTS, N_SLOTS
from insgnss.inertial.error_state import BA as BA
from insgnss.inertial.error_state import BG as BG
from insgnss.inertial.error_state import CLOCK as CLOCK
from insgnss.inertial.error_state import DR as DR
from insgnss.inertial.error_state import DRIFT as DRIFT
from insgnss.inertial.error_state import DV as DV
from insgnss.inertial.error_state import FURTHER
from insgnss.inertial.error_state import PSI as PSI
from insgnss.kernels.jit import kernel
from insgnss.kernels.records import Record, dtype_of
from insgnss.tables import Float64, Int8, Int64

# optional states, where the settings and the log ask for them (``Layout`` says where each stands); first of all the
# inter-system clock offsets [m], as many as there are further constellations
OFFSETS: Final = FURTHER
MAX_OPTIONAL: Final = 128  # room for all of them
MAX_RANGE_BIASES: Final = 64  # among them: satellites whose range errors are states
# slow errors of the whole sky: ionosphere at the zenith, its gradients north and east, troposphere
N_PATTERNS: Final = 4
N_OF_SATELLITE: Final = 2  # slow errors of each satellite: of its message, and of its reflection
MAX_SLOW: Final = N_PATTERNS + N_OF_SATELLITE * MAX_RANGE_BIASES  # each satellite's after those of the sky
MAX_COUPLINGS: Final = 48  # room for sensor errors other than biases
# kinds of own rows that may be left out, that carry the filter, and whose errors step
MAX_WATCHED: Final = 16
# antenna position, ECEF [m], and clock bias [m] of the epoch before; their value is in the state
N_CLONE: Final = 4
CLONE_CLOCK: Final = 3  # where among them the clock stands
ABSENT_STATE: Final = -1
N_MEMORY: Final = 27  # numbers kept of each band of a satellite

# factors on the assumed noise: variances of pseudoranges, range rates, carrier differences; the clock's two densities
N_FACTORS: Final = 5
DRIFT_FACTOR: Final = 3
BIAS_FACTOR: Final = 4
# what shows how long errors last: bands of an epoch, sums of their mean squares and of their squared means, and the
# weight that what is assumed still has
BANDS, SQUARES, MEANS, ASSUMED = range(4)
N_LASTING_SUMS: Final = 4
ASSUMED_BANDS: Final = 3.0  # that weight at first
LEVEL_EPOCHS: Final = 5  # for which a level of the settings counts

STATE_NAMES: Final = (
    *(f"{name}_{axis}" for name in ("dr_e", "dv_e", "psi_e") for axis in "xyz"),
    *(f"{name}_{axis}" for name in ("b_a", "b_g") for axis in "xyz"),
    "clock_bias",
    "clock_drift",
)


class StateRecord(Record):
    """The state of one hypothesis, and its memory."""

    q_eb: Annotated[Float64, 4]  # attitude, body to ECEF
    C_eb: Annotated[Float64, 3, 3]  # the same as a matrix
    r_e: Annotated[Float64, 3]  # position of the IMU, ECEF [m]
    v_e: Annotated[Float64, 3]  # [m/s]
    b_a: Annotated[Float64, 3]  # accelerometer bias [m/s^2]
    b_g: Annotated[Float64, 3]  # gyro bias [rad/s]
    # of accelerometers and gyros, 1: one has failed, and their biases no longer return to zero
    failed: Annotated[Int64, 2]
    clock: Annotated[Float64, 2]  # receiver clock bias [m] and drift [m/s]
    optional: Annotated[Float64, MAX_OPTIONAL]  # values of the optional states, from OFFSETS on
    # the epoch before, as the carrier's differences need it
    r_clone: Annotated[Float64, 3]  # antenna position at its reception, ECEF [m]
    clock_clone: float  # [m]
    C_swung: Annotated[Float64, 3, 3]  # attitude at the last epoch
    swung_ns: int  # when that was; 0: never
    # where the IMU's time is estimated: velocities, ECEF [m/s]
    v_shown: Annotated[Float64, 3]  # that counts as motion
    v_corrected: Annotated[Float64, 3]  # after the last epoch's rows
    previous_zenith_delays: Annotated[Float64, 2]  # zenith delays, dry and wet [m]
    clone_ns: int  # its time tag; 0: there is none
    v_mean: Annotated[Float64, 3]  # velocity of the last seconds, ECEF [m/s]
    v_mean_variance: float  # mean variance of its errors, of a horizontal axis; 0: none yet
    # sums since the covariance was last carried on
    sum_dt: float  # time [s]
    f_smooth: Annotated[Float64, 3]  # specific force of the last moments, ECEF [m/s^2]
    w_smooth: Annotated[Float64, 3]  # rate of the last moments, body [rad/s]
    # both of the time by which the IMU's tags may be off, ``near_s``; of the last sample where that is shorter
    near_s: float
    f_near: Annotated[Float64, 3]
    w_near: Annotated[Float64, 3]
    # specific force and rate of the last step, body: what sensor errors go with
    f_last: Annotated[Float64, 3]
    w_last: Annotated[Float64, 3]
    f_mean: Annotated[Float64, 3]  # and its slow mean, body [m/s^2]; zero: there is none yet
    sum_dv: Annotated[Float64, 3]  # velocity increment of the specific force, ECEF [m/s]
    sum_C: Annotated[Float64, 3, 3]  # integral of C_eb [s]
    noise_excess: float  # of the samples' white noise beyond that of their grade, as a share of its variance
    sum_gyro_q: float  # attitude variance to add [rad^2]
    sum_accel_q: float  # velocity variance to add [m^2/s^2]
    # integrals of ``f_last`` [m/s] and ``w_last`` [rad]
    sum_f: Annotated[Float64, 3]
    sum_w: Annotated[Float64, 3]
    noise_factor: Annotated[Float64, N_FACTORS]  # found noise levels
    # since the clock's was last judged: sum of the drift's corrections [m/s], and variance of that sum
    drift_moved: Annotated[Float64, 2]
    adapted_ns: int  # when they were last moved
    adapted_count: int
    level_epochs: Annotated[Int64, N_KINDS]  # over how many epochs the level of a kind was learnt
    level_risen: Annotated[Float64, 2]  # by how much an epoch raised one that was settled; 0: it did not
    carriers_tested: float  # carrier differences of the last half minute, and how many of them failed a test
    carriers_failed: float
    lasting: Annotated[Float64, N_KINDS, N_LASTING_SUMS]  # of each kind, see ``lasting_errors``
    explained: Annotated[
        Float64, 2, 3
    ]  # means of the epochs' deviation from the prediction, see ``integrity``
    explained_variance: Annotated[Float64, 2]  # of these means while the filter is right
    explained_ns: int
    crept_ns: int  # when a satellite was last found by its range rate to run away
    stuck_ns: int  # when many range rates were last repeats of what was there before
    stuck_since_ns: int  # and since when
    rates_out_ns: int  # until when no range rate is believed
    rates_late_s: float  # by which they lag behind the motion, see ``late_rates``
    dv_late: Annotated[Float64, 2, 3]  # by which two stages of smoothing lag, ECEF [m/s]
    swing_late: Annotated[Float64, 3]  # the antenna's velocity about the IMU at the last sample, ECEF [m/s]
    suspicion: float  # how far they are beyond chance, chi^2 of three
    mask_waits: int  # 1 while the heading is too uncertain for the visibility stage
    mask_uncertain: int  # satellites of the last epoch whose visibility was uncertain
    # sums over weak signals, see ``update.weak_signals``: of what their residuals show, and of how clearly
    weak_shown: float
    weak_rows: float
    cn0_level: float  # recent strongest signal, referred to the zenith [dBHz]; 0: none yet
    cn0_level_ns: int
    log_weight: float  # natural logarithm of the hypothesis' probability
    # of fixes without raw GNSS data: 1 from one that is far off to the next that is used
    doubted_by: Annotated[Int64, MAX_WATCHED]
    unlikely_ns: int  # when what the vehicle seldom does was first held against it; 0: not yet
    # how far the motion that was shown has moved the state, and what of it the updates have left
    motion_response: Annotated[Float64, OFFSETS + MAX_OPTIONAL]
    log_likelihood: float  # of the epoch's rows
    motion_information: float  # what the response could add to it at most


STATE_DTYPE: Final = dtype_of(StateRecord)


class HeadRecord(Record):
    """The common data of a bank's hypotheses."""

    now_ns: int  # time of the state
    next: int  # index of the inertial sample whose interval contains the state
    leader: int  # the hypothesis of the largest weight
    epoch_ns: int  # time of the last epoch; 0 before the first
    epoch_step_ns: int  # from the epoch before to it
    renewed_ns: int  # when the state was last set at a stroke: start, reset, clock step
    rejected_epochs: int  # consecutive epochs with most rows of a kind refused
    silent_ns: int  # time since when no measurement was used; 0 when there are some
    diverged_ns: int  # time since when the innovations are far too large; 0 when they are not
    tag_tested_ns: int  # epoch whose time tag was tested last, see ``tag_jumps``
    tag_shown_ns: int  # epoch that last showed a jump ...
    tag_late_s: float  # ... to a tag that is late by so much [s] ...
    tag_odds: float  # ... and the log odds that epochs have shown for it
    tag_elsewhere: int  # ... 1: at a place that is wrong, too
    tag_jump_ns: int  # when the tags last jumped for certain; 0: never
    tag_jumps: int  # jumps that have followed each other
    placed_ns: (
        int  # when many pseudoranges last agreed with the place, velocity measured ever since; 0: never
    )
    log_likelihood: float  # of the epochs, where one heading is left; for ``suspects``
    doubted_ns: int  # the filter's own prediction is not suspected before
    masking: int  # visibility stage: 0 nothing reported yet, 1 it waits, 2 it masks
    uncertain: int  # satellites over epochs, whose visibility was uncertain, not reported yet
    uncertain_ns: int  # when that began ...
    uncertain_last_ns: int  # ... and when it was so last
    heading_open: int  # 1 until the heading has been reported as known
    more_than_headings: int  # 1 where the hypotheses differ in more than what motion shows
    slip: float  # angle from course to heading when last known (``sideslip``) [rad]
    slip_variance: float  # [rad^2]
    slip_ns: int  # when that was; 0: never
    slip_walk: float  # density of its changes [rad^2/s]
    slip_s: float  # time over which they were seen [s]
    own_nis: Annotated[Float64, MAX_WATCHED]  # mean of the normalised squared innovations of own rows
    own_nis_ns: Annotated[Int64, MAX_WATCHED]  # when it was last carried on; 0: never
    own_contradicts: Annotated[Int64, MAX_WATCHED]  # 1 while the kind is not used
    # largest variance of a prediction that may be agreed with; 0: that of a reading; -1: none
    own_reach: Annotated[Float64, MAX_WATCHED]
    own_refused: Annotated[Int64, MAX_WATCHED]  # readings refused in a row, of a sensor whose error may step
    own_refused_ns: Annotated[Int64, MAX_WATCHED]  # when the first of them came
    # of own rows that carry the filter (``own_rows.carrying``)
    carried_ns: Annotated[Int64, MAX_WATCHED]  # when they last came; 0: never
    inertial_noise: Annotated[Float64, MAX_WATCHED]  # logarithm of the inertial noise over that of the grade
    noise_told: Annotated[Int64, MAX_WATCHED]  # 1 while an event says that it is high
    # each slow error's satellite, counted from one; 0: none
    biased: Annotated[Int64, MAX_RANGE_BIASES]
    biased_ns: Annotated[Int64, MAX_RANGE_BIASES]  # when it was last in an epoch
    n_slow: int  # rows of ``SlowErrors.S`` that are in use
    from_fix: int  # 1 until the slow errors of the fix that the state was opened from are known


HEAD_DTYPE: Final = dtype_of(HeadRecord)

StateArray: TypeAlias = npt.NDArray[Any]


class SlowErrors(NamedTuple):
    """What range errors that last do to the leader's state, see ``update.slow_errors``."""

    S: Float64  # (MAX_SLOW, n) effect of one sigma of each
    R: Float64  # (n, n) covariance of what earlier values of theirs have left


class Bank(NamedTuple):
    """All hypotheses: one record and one covariance each, and their common data."""

    state: StateArray  # (m,) of STATE_DTYPE
    P: Float64  # (m, n, n) covariance of the error state
    head: StateArray  # (1,) of HEAD_DTYPE
    seen: Int8  # (m, N_SATELLITE_SLOTS) what the visibility stage decided last of each satellite
    # (m, N_SLOTS, N_MEMORY) means of what each band shows against the others, see ``satellite_memory``
    memory: Float64
    slow: SlowErrors


def new_bank(n_hypotheses: int, n_optional: int) -> Bank:
    """Return an empty bank: zero states, equal weights."""
    n = OFFSETS + n_optional
    state = np.zeros(n_hypotheses, STATE_DTYPE)
    state["log_weight"] = -np.log(n_hypotheses)
    state["noise_factor"] = 1.0
    state["level_epochs"] = LEVEL_EPOCHS
    state["lasting"][:, :, ASSUMED] = ASSUMED_BANDS
    memory = np.full((n_hypotheses, N_SLOTS, N_MEMORY), -np.inf)
    seen = np.full((n_hypotheses, N_SATELLITE_SLOTS), UNDECIDED, np.int8)
    P, slow = np.zeros((n_hypotheses, n, n)), no_slow_errors(n)
    return Bank(state, P, np.zeros(1, HEAD_DTYPE), seen, memory, slow)


def no_slow_errors(n: int) -> SlowErrors:
    """Return room for the effects of slow errors on ``n`` states, none of which they have reached."""
    return SlowErrors(np.zeros((MAX_SLOW, n)), np.zeros((n, n)))


@kernel(apart=True)
def copy_state(source: StateRecord, target: StateRecord) -> None:
    """Copy one state, field by field: the compiler takes a record for its bytes, and copies them one at a time."""
    for i in range(3):
        target.r_e[i], target.v_e[i] = source.r_e[i], source.v_e[i]
        target.b_a[i], target.b_g[i] = source.b_a[i], source.b_g[i]
        target.r_clone[i] = source.r_clone[i]
        target.f_smooth[i] = source.f_smooth[i]
        target.f_near[i], target.w_near[i] = source.f_near[i], source.w_near[i]
        target.f_last[i], target.w_last[i] = source.f_last[i], source.w_last[i]
        target.f_mean[i], target.sum_dv[i] = source.f_mean[i], source.sum_dv[i]
        target.sum_f[i], target.sum_w[i] = source.sum_f[i], source.sum_w[i]
        target.v_mean[i], target.w_smooth[i] = source.v_mean[i], source.w_smooth[i]
        target.v_shown[i], target.v_corrected[i] = source.v_shown[i], source.v_corrected[i]
        target.dv_late[0, i], target.dv_late[1, i] = source.dv_late[0, i], source.dv_late[1, i]
        target.swing_late[i] = source.swing_late[i]
        for j in range(3):
            target.C_eb[i, j], target.sum_C[i, j] = source.C_eb[i, j], source.sum_C[i, j]
            target.C_swung[i, j] = source.C_swung[i, j]
    for i in range(4):
        target.q_eb[i] = source.q_eb[i]
    for i in range(2):
        target.clock[i], target.previous_zenith_delays[i] = source.clock[i], source.previous_zenith_delays[i]
        target.level_risen[i], target.drift_moved[i] = source.level_risen[i], source.drift_moved[i]
    for i in range(MAX_OPTIONAL):
        target.optional[i] = source.optional[i]
    for i in range(N_FACTORS):
        target.noise_factor[i] = source.noise_factor[i]
    for i in range(N_KINDS):
        target.level_epochs[i] = source.level_epochs[i]
        for j in range(N_LASTING_SUMS):
            target.lasting[i, j] = source.lasting[i, j]
    target.clock_clone, target.clone_ns = source.clock_clone, source.clone_ns
    target.swung_ns, target.near_s = source.swung_ns, source.near_s
    target.carriers_tested, target.carriers_failed = source.carriers_tested, source.carriers_failed
    target.noise_excess = source.noise_excess
    target.sum_dt, target.sum_gyro_q, target.sum_accel_q = (
        source.sum_dt,
        source.sum_gyro_q,
        source.sum_accel_q,
    )
    target.adapted_ns, target.adapted_count = source.adapted_ns, source.adapted_count
    for i in range(3):
        target.explained[0, i], target.explained[1, i] = source.explained[0, i], source.explained[1, i]
    for i in range(2):
        target.explained_variance[i] = source.explained_variance[i]
        target.failed[i] = source.failed[i]
    target.explained_ns, target.suspicion = source.explained_ns, source.suspicion
    target.crept_ns, target.rates_out_ns = source.crept_ns, source.rates_out_ns
    target.rates_late_s = source.rates_late_s
    target.stuck_ns, target.stuck_since_ns = source.stuck_ns, source.stuck_since_ns
    target.mask_waits, target.mask_uncertain = source.mask_waits, source.mask_uncertain
    target.log_weight, target.v_mean_variance = source.log_weight, source.v_mean_variance
    target.cn0_level, target.cn0_level_ns = source.cn0_level, source.cn0_level_ns
    target.weak_shown, target.weak_rows = source.weak_shown, source.weak_rows
    target.unlikely_ns = source.unlikely_ns
    for i in range(MAX_WATCHED):
        target.doubted_by[i] = source.doubted_by[i]
    target.log_likelihood, target.motion_information = source.log_likelihood, source.motion_information
    for i in range(OFFSETS + MAX_OPTIONAL):
        target.motion_response[i] = source.motion_response[i]


@kernel
def copy_matrix(source: Float64, target: Float64) -> None:
    """Copy an (n, n) matrix."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@kernel(inline=True)
def forget_state(bank: Bank, member: int, at: int, variance: float) -> None:
    """Make one state of a hypothesis, at ``at`` in the error state, unknown; its value stays, to be linear there."""
    P = bank.P[member]
    for i in range(P.shape[0]):
        P[at, i], P[i, at] = 0.0, 0.0
        bank.slow.R[at, i], bank.slow.R[i, at] = 0.0, 0.0
    for k in range(bank.slow.S.shape[0]):
        bank.slow.S[k, at] = 0.0
    P[at, at] = variance
    bank.state[member].motion_response[at] = 0.0


def copy_bank(bank: Bank) -> Bank:
    """Return a copy that shares nothing with ``bank``."""
    arrays = {name: getattr(bank, name).copy() for name in Bank._fields if name != "slow"}
    return Bank(**arrays, slow=_copied(bank.slow))


def _copied(slow: SlowErrors) -> SlowErrors:
    return SlowErrors(*(array.copy() for array in slow))


def joined_banks(bank: Bank, other: Bank) -> Bank:
    """Return a bank of the hypotheses of both, weights as they are, common data from the first."""
    n, n_states = len(bank.state), bank.P.shape[1]
    both = new_bank(n + len(other.state), n_states - OFFSETS)
    both.head[:] = bank.head
    for name in ("state", "P", "seen", "memory"):
        joined: npt.NDArray[Any] = getattr(both, name)
        joined[:n], joined[n:] = getattr(bank, name), getattr(other, name)
    return both._replace(slow=_copied(bank.slow))


def select_members(bank: Bank, keep: Int64) -> Bank:
    """Return a bank of the hypotheses ``keep`` (indices), weights normalised, the heaviest leading."""
    state = bank.state[keep]
    weight = state["log_weight"]
    top = weight.max()
    state["log_weight"] = weight - top - np.log(np.sum(np.exp(weight - top)))
    head = bank.head.copy()
    head["leader"] = int(np.argmax(weight))
    P = np.ascontiguousarray(bank.P[keep])
    return Bank(state, P, head, bank.seen[keep], bank.memory[keep], _copied(bank.slow))
