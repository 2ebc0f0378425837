"""The compiled loop's output: navigation rows, the ledger of measurements, and events."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS
from insgnss.filter.headings.headings import turn_about
from insgnss.filter.output.gps_time import covariance_at_gps_time, place_at_gps_time
from insgnss.filter.output.nav_sigmas import (
    attitude_deviations,
    level_turn,
    rotated_variances,
    velocity_deviations,
)
from insgnss.filter.output.trace_rows import TraceRoom, no_trace
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.rows.usual_variance import foreseen_variance
from insgnss.filter.soundness import is_finite
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, Bank, StateRecord
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix, up_direction
from insgnss.geodesy.rotations import matrix_to_euler, turn_left
from insgnss.geodesy.vectors import Vector, place, plus, times
from insgnss.gnss.observation_rows import CARRIER, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.kernels.records import Record, dtype_of
from insgnss.status import NO_IMU, USED
from insgnss.tables import Event, Float64, Int64

_AXES = ("x", "y", "z")
NAV_COLUMNS: Final = (
    *("lat_deg", "lon_deg", "h_m", "vn_mps", "ve_mps", "vd_mps", "roll_deg", "pitch_deg", "yaw_deg"),
    *(
        "sd_n_m",
        "sd_e_m",
        "sd_d_m",
        "sd_vn_mps",
        "sd_ve_mps",
        "sd_vd_mps",
        "sd_roll_deg",
        "sd_pitch_deg",
        "sd_yaw_deg",
    ),
    *(f"accel_bias_{a}_mps2" for a in _AXES),
    *(f"gyro_bias_{a}_radps" for a in _AXES),
    *(f"sd_accel_bias_{a}_mps2" for a in _AXES),
    *(f"sd_gyro_bias_{a}_radps" for a in _AXES),
    *("clock_bias_m", "clock_drift_mps", "sd_clock_bias_m", "sd_clock_drift_mps"),
    *("n_used", "n_hypotheses"),
)
N_NAV: Final = len(NAV_COLUMNS)
N_USED: Final = NAV_COLUMNS.index("n_used")
N_HYPOTHESES: Final = NAV_COLUMNS.index("n_hypotheses")

LEAST_VARIANCE, LARGEST_VARIANCE = 1e-36, 1e36  # what single precision holds, and its inverse


# kinds of event the compiled loop writes; the numbers a, b behind each
CLOCK_STEP: Final = np.int64(1)  # a: step [m]
DRIFT_STEP: Final = np.int64(2)  # a: step [m/s]
NO_MEASUREMENTS: Final = np.int64(3)
MEASUREMENTS_BACK: Final = np.int64(4)  # a: seconds without
MASKING_WAITS: Final = np.int64(5)
MASKING_ON: Final = np.int64(6)
MASKING_UNCERTAIN: Final = np.int64(7)  # a: satellites over epochs
RANGES_NOISY: Final = np.int64(8)  # a: by how much their sigma has risen
RATES_NOISY: Final = np.int64(9)  # the same
TAG_STEP: Final = np.int64(10)  # a: by how much the GNSS tags are late [s]
TAGS_UNSTEADY: Final = np.int64(11)  # a: after how many jumps


NAV_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("t_ns", np.int64),
            ("value", np.float64, (N_NAV,)),  # NAV_COLUMNS, sigmas without the slow errors
            # (co)variances that the slow errors add, see ``slow_errors``: nn, ne, nd, ee, ed, dd, clock [m^2]
            ("slow", np.float64, (7,)),
        ],
    )
)
LEDGER_DTYPE: Final = np.dtype(
    (
        np.record,
        np.dtype(
            [  # pairs: 0 pseudorange, 1 range rate; narrow types: a log has millions of entries
                ("innovation", np.float64, (2,)),
                ("variance", np.float32, (2,)),  # of the innovation: D + r
                ("predicted", np.float32, (2,)),  # D = h P h^T
                ("u_n", np.float32, (3,)),  # line of sight, north-east-down
                ("u_b", np.float32, (3,)),  # line of sight in body axes
                ("gain", np.float32),  # of the best antenna [dBic], NaN where none is described
                ("status", np.int8, (2,)),
            ],
            align=True,
        ),
    )
)


class CarrierEntry(Record):
    """One carrier difference in the ledger."""

    innovation: float
    variance: Annotated[float, np.float32]
    predicted: Annotated[float, np.float32]
    status: Annotated[int, np.int8]


CARRIER_LEDGER_DTYPE: Final = dtype_of(CarrierEntry, align=True)
EVENT_DTYPE: Final = np.dtype((np.record, [("t_ns", np.int64), ("kind", np.int64), ("a", np.float64)]))


class CountRecord(Record):
    """How far the output has been written."""

    nav: int  # navigation rows written
    events: int  # events, those beyond the room for them too
    time: int  # the first output time not written yet


COUNT_DTYPE: Final = dtype_of(CountRecord)
Table: TypeAlias = npt.NDArray[Any]


class Output(NamedTuple):
    """Where the loop writes, and when."""

    nav: Table  # of NAV_DTYPE, filled from the front
    optional: Float64  # (n_nav, 2 k) values of the further states and their sigmas, beside ``nav``
    ledger: Table  # (n,) of LEDGER_DTYPE, one entry per observation
    carrier: Table  # (n,) or, where no carrier is used, (0,) of CARRIER_LEDGER_DTYPE
    events: Table  # of EVENT_DTYPE, filled from the front
    times_ns: Int64  # (k,) output times; empty for one row per epoch
    counts: Table  # (1,) of COUNT_DTYPE
    trace: TraceRoom


def new_output(
    rows: GnssRows,
    n_nav: int,
    n_events: int,
    times_ns: Int64,
    n_shown: int = 0,
    trace: TraceRoom | None = None,
) -> Output:
    """Return room for ``n_nav`` navigation rows, a ledger of ``rows`` as known before the filter, and events.

    ``n_shown`` is the number of further states that the table shows, as the filter's layout has them; ``trace`` is
    room for states at further times.
    """
    ledger, carrier = new_ledger(rows)
    return Output(
        np.zeros(n_nav, NAV_DTYPE),
        np.zeros((n_nav, 2 * n_shown)),
        ledger,
        carrier,
        np.zeros(n_events, EVENT_DTYPE),
        times_ns,
        np.zeros(1, COUNT_DTYPE),
        no_trace() if trace is None else trace,
    )


def new_ledger(rows: GnssRows) -> tuple[Table, Table]:
    """Return the entries of rows, and those of their carriers, as they are known before the filter."""
    ledger = np.zeros(len(rows.observation), LEDGER_DTYPE)
    ledger["status"] = rows.observation["status"]
    for name in ("innovation", "variance", "predicted", "u_n", "u_b", "gain"):
        ledger[name] = math.nan
    carrier = np.zeros(len(rows.carrier), CARRIER_LEDGER_DTYPE)
    carrier["status"] = rows.carrier["status"]
    for name in ("innovation", "variance", "predicted"):
        carrier[name] = math.nan
    return ledger, carrier


def mark_without_imu(ledger: Table, carriers: Table) -> None:
    """Write of entries that there were no inertial samples at their time, where they could have been used."""
    for entries in (ledger, carriers):
        status = entries["status"]
        status[status == USED] = NO_IMU


def event_in_words(t_ns: int, kind: int, a: float, why: str = "") -> Event:
    """Return an event of the filter as users read it: ``a`` is its number, if any.

    ``why`` goes on: why a step is believed, the status of the satellites, or the inputs without GNSS.
    """
    if kind == CLOCK_STEP:
        size = f"{a:.1f} m ({1e3 * a / C_MPS:.4f} ms)"
        return Event(t_ns, "clock_jump", f"the receiver clock stepped by {size}{why}; absorbed")
    if kind == DRIFT_STEP:
        size = f"{a:.2f} m/s"
        return Event(t_ns, "clock_drift_jump", f"the receiver clock's drift stepped by {size}{why}; absorbed")
    if kind == TAG_STEP:
        detail = f"the GNSS time tags have jumped: the pseudoranges show that they are off by {a:+.3f} s now"
        return Event(t_ns, "time_tag_jump", f"{detail} (positive: late); {why}")
    if kind == TAGS_UNSTEADY:
        detail = f"the GNSS time tags have jumped {a:.0f} times: from here on each epoch's offset counts as unknown"
        return Event(t_ns, "time_tag_jump", f"{detail} (log the receiver's own time, not the computer's)")
    if kind == NO_MEASUREMENTS:
        return Event(t_ns, "no_measurements", why or "no measurement is used: the filter coasts")
    if kind == MEASUREMENTS_BACK:
        return Event(t_ns, "measurements_back", f"measurements are used again after {a:.1f} s")
    if kind == MASKING_WAITS:
        return Event(t_ns, "masking_waits", "the heading is too uncertain for airframe masking")
    if kind == MASKING_ON:
        return Event(t_ns, "masking_on", "the heading is known well enough: hidden satellites are masked")
    if kind == MASKING_UNCERTAIN:
        detail = (
            f"{a:.0f} satellite-epochs too near to the visibility edge for this attitude's uncertainty{why}"
        )
        return Event(t_ns, "masking_uncertain", detail)
    if kind in (RANGES_NOISY, RATES_NOISY):
        rows = "pseudoranges" if kind == RANGES_NOISY else "range rates"
        return Event(t_ns, "noise_risen", f"the noise of all {rows} has risen to {a:.0f} times what it was")
    return Event(t_ns, f"kind_{kind}", f"{a}")


@kernel
def log_event(events: Table, count: CountRecord, t_ns: int, kind: np.int64, a: float) -> None:
    """Write one event while there is room, and count it in any case."""
    i = count.events
    if i < events.shape[0]:
        event = events[i]
        event.t_ns = t_ns
        event.kind = kind
        event.a = a
    count.events = i + 1


@kernel(apart=True)
def write_ledger(ledger: Table, carriers: Table, first: int, lines: Lines) -> None:
    """Write an epoch's entries, from ``first`` on, from its lines.

    Where there is no satellite, the rest of a line is of another epoch: its entry keeps the NaN that it began with. So
    does one whose numbers are not finite.
    """
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        entry = ledger[first + j]
        if math.isfinite(line.u_n[0] + line.u_n[1] + line.u_n[2] + line.u_b[0] + line.u_b[1] + line.u_b[2]):
            entry.gain = line.gain
            for k in range(3):
                entry.u_n[k] = line.u_n[k]
                entry.u_b[k] = line.u_b[k]
        for kind in range(2):
            entry.status[kind] = line.status[kind]
            if is_entry(line, kind):
                entry.innovation[kind] = line.innovation[kind]
                entry.predicted[kind] = line.predicted[kind]
                entry.variance[kind] = line.predicted[kind] + foreseen_variance(line, kind)
        if carriers.shape[0] > 0:
            write_carrier(carriers[first + j], line)


@kernel(inline=True)
def is_entry(line: Line, kind: int) -> bool:
    """Return whether innovation and variances of one kind are numbers that the ledger's single precision holds."""
    variance = line.predicted[kind] + line.variance[kind]
    return math.isfinite(line.innovation[kind]) and LEAST_VARIANCE < variance < LARGEST_VARIANCE


@kernel(inline=True)
def write_carrier(entry: CarrierEntry, line: Line) -> None:
    """Write the entry of a carrier difference."""
    entry.status = line.status[CARRIER]
    if is_entry(line, CARRIER):
        entry.innovation = line.innovation[CARRIER]
        entry.predicted = line.predicted[CARRIER]
        entry.variance = line.predicted[CARRIER] + line.variance[CARRIER]


@kernel(apart=True)
def write_nav(
    nav: Table,
    optional: Float64,
    count: CountRecord,
    t_ns: int,
    m: StateRecord,
    P: Float64,
    par: Parameters,
    used: tuple[int, int],
) -> None:
    """Write one navigation row: the state of ``m`` in users' terms, with the deviations of covariance ``P``.

    ``used`` counts the satellites whose ranges were used, and the headings. A state that is not finite gives no
    row. ``P`` is carried to GPS time (``gps_time``).
    """
    if count.nav >= nav.shape[0] or not is_finite(m, P):
        return
    row = nav[count.nav]
    count.nav += 1
    row.t_ns = t_ns
    v = row.value
    r_e, v_e, q, C_eb = np.empty(3), np.empty(3), np.empty(4), np.empty((3, 3))
    place_at_gps_time(m, par, r_e, v_e, q, C_eb)
    covariance_at_gps_time(m, par, P)
    lat, lon, h = ecef_to_geodetic(r_e)
    C_ne = np.empty((3, 3))
    C_nb = np.empty((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)
    for i in range(3):
        v[3 + i] = C_ne[i, 0] * v_e[0] + C_ne[i, 1] * v_e[1] + C_ne[i, 2] * v_e[2]
        for j in range(3):
            C_nb[i, j] = C_ne[i, 0] * C_eb[0, j] + C_ne[i, 1] * C_eb[1, j] + C_ne[i, 2] * C_eb[2, j]
    roll, pitch, yaw = matrix_to_euler(C_nb)
    v[0], v[1], v[2] = math.degrees(lat), math.degrees(lon), h
    v[6], v[7], v[8] = math.degrees(roll), math.degrees(pitch), math.degrees(yaw)
    T = np.empty((3, 3))
    level_turn(lat, h, C_ne, T)
    rotated_variances(P, DR, C_ne, v, 9)
    velocity_deviations(P, C_ne, T, v, 12)
    attitude_deviations(P, C_ne, T, pitch, yaw, v, 15)
    for i in range(3):
        v[18 + i] = m.b_a[i]
        v[21 + i] = m.b_g[i]
        v[24 + i] = math.sqrt(max(P[BA + i, BA + i], 0.0))
        v[27 + i] = math.sqrt(max(P[BG + i, BG + i], 0.0))
    v[30], v[31] = m.clock[0], m.clock[1]
    v[32] = math.sqrt(max(P[CLOCK, CLOCK], 0.0))
    v[33] = math.sqrt(max(P[DRIFT, DRIFT], 0.0))
    v[34], v[35] = used[0], used[1]
    k = optional.shape[1] // 2
    for i in range(k):
        optional[count.nav - 1, i] = m.optional[i]
        optional[count.nav - 1, k + i] = math.sqrt(max(P[OFFSETS + i, OFFSETS + i], 0.0))


@kernel(apart=True)
def mixture_covariance(bank: Bank, P: Float64) -> None:
    """Write into ``P`` the covariance of the whole bank about its leader: sum of w (P_m + d d^T).

    d is the state of a hypothesis minus the leader's; the clone's part of it is left out, as it is not needed here.
    """
    lead = bank.state[bank.head[0].leader]
    n = P.shape[0]
    d = np.zeros(n)
    for a in range(n):
        for b in range(n):
            P[a, b] = 0.0
    for i in range(bank.state.shape[0]):
        m: StateRecord = bank.state[i]
        weight = math.exp(m.log_weight)
        if not weight > 0.0:  # lost, perhaps: zero times NaN is NaN
            continue
        for k in range(3):
            d[DR + k] = m.r_e[k] - lead.r_e[k]
            d[DV + k] = m.v_e[k] - lead.v_e[k]
            d[BA + k] = m.b_a[k] - lead.b_a[k]
            d[BG + k] = m.b_g[k] - lead.b_g[k]
        d[CLOCK], d[DRIFT] = m.clock[0] - lead.clock[0], m.clock[1] - lead.clock[1]
        attitude_difference(m, lead, d)
        for a in range(n):
            for b in range(n):
                P[a, b] += weight * (bank.P[i, a, b] + d[a] * d[b])


@kernel(inline=True)
def attitude_difference(m: StateRecord, lead: StateRecord, d: Float64) -> None:
    """Write the turn from the leader's attitude to that of ``m`` [rad] at PSI of ``d``: its tilt and its heading.

    Equation: C_m = exp([y u x]) exp([t x]) C_lead, d = t + y u, u the vertical and t horizontal: the order in which
    ``close_loop`` corrects. The rotation vector is not that sum: between opposite headings it has the tilt turned by
    90 deg, so the pitch of one would be in the sigma of the roll.
    """
    turn, q = times(up_direction(lead.r_e), turn_about(lead, m)), np.empty(4)
    for i in range(4):
        q[i] = m.q_eb[i]
    turn_left(q, -turn[0], -turn[1], -turn[2])
    place(d, PSI, plus(turn, rotation_between(lead.q_eb, q)))


@kernel(inline=True)
def rotation_between(p: Float64, q: Float64) -> Vector:
    """Return the rotation vector [rad] that turns the attitude ``p`` (4,) into ``q`` (4,)."""
    # q (x) conj(p)
    c = q[0] * p[0] + q[1] * p[1] + q[2] * p[2] + q[3] * p[3]
    x = -q[0] * p[1] + q[1] * p[0] - q[2] * p[3] + q[3] * p[2]
    y = -q[0] * p[2] + q[1] * p[3] + q[2] * p[0] - q[3] * p[1]
    z = -q[0] * p[3] - q[1] * p[2] + q[2] * p[1] + q[3] * p[0]
    if c < 0.0:
        c, x, y, z = -c, -x, -y, -z
    s = math.sqrt(x * x + y * y + z * z)
    return times((x, y, z), 2.0 * math.atan2(s, c) / s if s > 0.0 else 0.0)
