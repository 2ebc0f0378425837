"""Waiting for a start: collects fixes and inertial samples until a filter can be opened."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S, WGS84_A_M
from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.carried_start import CarriedState, is_violent, open_carried
from insgnss.filter.start.first_levels import begin_as_shown, begin_with_model_noise
from insgnss.filter.start.fix import Fix, fix_epoch, try_fix
from insgnss.filter.start.mean_acceleration import levelling_motion
from insgnss.filter.start.rest import samples_show_rest, slight_acceleration, velocities_show_rest
from insgnss.filter.start.start import (
    Kinematics,
    StartHeading,
    attitudes_at_start,
    given_attitudes,
    given_kinematics,
    kinematics_from_fix,
    open_bank,
    open_headings,
)
from insgnss.filter.start.start_noise import AS_DECLARED, StartNoise
from insgnss.filter.state import Bank, StateRecord
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.gnss.least_squares import CLOCKS
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.inertial.alignment import AlignmentWindow, inertial_window
from insgnss.status import USED
from insgnss.tables import Event, Float64

_LONGEST_HISTORY_NS = 5 * NS_PER_S
_FIX_VELOCITY_SIGMA_MPS = 3.0  # least sigma of a velocity or a clock's drift taken from two fixes
_FASTEST_DRIFT_MPS = 3000.0  # 10 ppm
_SAME_PLACE2 = 16.0  # squared sigmas
_LEAST_RATES = 4  # for a velocity and a clock drift
_WAIT_FIXES = 3  # after a gap, for a second velocity
_VIOLENT_S = 30.0  # after a gap, for the end of a manoeuvre that prevents levelling
_LEAST_RANGES = 4  # for a fix
_TELL_NS = 30 * NS_PER_S  # after this time without a start, and again after twice as long
_MOST_BELOW_HORIZON = 0.25  # of the satellites: a given state that sees fewer is of another place


@dataclass
class Starter:
    """Tries each epoch in turn; remembers the fixes of the last seconds for velocity and acceleration."""

    setup: FilterSetup
    given: bool  # a given start is still to be used
    first_try_ns: int | None = None
    fixes: list[Fix] = field(default_factory=list)
    agreeing: list[Fix] = field(default_factory=list)  # those that may agree by chance, too
    headings: list[StartHeading] | None = None  # those of an automatic start, None: the whole circle
    carried: CarriedState | None = None  # from before a gap in the samples
    lacking: str = ""  # what the last epoch that was tried lacked
    wait_ns: int = _TELL_NS  # after which an event says so
    noise: StartNoise = field(default_factory=StartNoise)

    def begin(self, *, given: bool, carried: CarriedState | None) -> None:
        """State the start of a stretch of samples: an unused given start, and the carried state."""
        self.given, self.carried = given, carried

    def snapshot(self) -> Starter:
        """Return a copy that shares nothing but the setup and the fixes themselves, neither of which changes."""
        fixes, agreeing = list(self.fixes), list(self.agreeing)
        return replace(self, fixes=fixes, agreeing=agreeing, noise=self.noise.snapshot())

    def try_start(
        self, imu: ImuSamples, rows: GnssRows, epoch: int, par: Parameters
    ) -> tuple[Bank | None, Fix | None, list[Event]]:
        """Return the bank opened at ``epoch`` if it can be, the fix it is based on, and events to report."""
        t_ns = int(rows.epoch_ns[epoch])
        start_ns = self.setup.start_ns
        if self.given and start_ns is not None and t_ns < start_ns:
            return None, None, []
        if self.first_try_ns is None:
            self.first_try_ns = t_ns
        opened = self._try(imu, rows, epoch, par)
        waited_ns = t_ns - self.first_try_ns
        if opened[0] is not None or waited_ns < self.wait_ns:
            return opened
        self.wait_ns = 2 * waited_ns
        detail = f"no start for {waited_ns / NS_PER_S:.0f} s: {self.lacking}"
        return *opened[:2], [*opened[2], Event(t_ns, "start_waits", detail)]

    def _try(
        self, imu: ImuSamples, rows: GnssRows, epoch: int, par: Parameters
    ) -> tuple[Bank | None, Fix | None, list[Event]]:
        t_ns = int(rows.epoch_ns[epoch])
        if self.given:
            self.lacking = "the given start lies before the inertial samples"
            return self._given_start(imu, rows, epoch, par)
        assert self.first_try_ns is not None
        start = self.setup.config.start
        waited_ns = t_ns - self.first_try_ns
        patient = waited_ns < start.patience_s * NS_PER_S
        early = np.array([waited_ns < _TELL_NS, patient]) | (par.adapt_gain <= 0.0)
        noise = np.where(early, AS_DECLARED, self.noise.factor())
        fix, misfit = try_fix(rows, epoch, par, self.setup.ties, start.max_gdop, noise)
        self.noise.note(misfit)
        if fix is None:
            self.lacking = _why_no_fix(rows, epoch)
            return None, None, []
        self.lacking = "the fixes have no rows to spare, or contradict each other or the inertial samples"
        self.agreeing = _recent(self.agreeing, t_ns)
        range_doubted, rate_doubted = self._doubted(fix)
        self.agreeing.append(fix)
        if range_doubted:
            self.lacking = (
                "the pseudoranges that agree are different ones in each epoch, or give different places"
            )
            return None, fix, []
        if rate_doubted:
            fix = fix.without_velocity()
        self.fixes = [*_recent(self.fixes, t_ns), fix]
        if (fix.n_used < start.min_satellites or not fix.checked) and patient:
            return None, fix, []
        window_ns = int(start.window_s * NS_PER_S)
        window = inertial_window(imu.t_ns, imu.w_ib_b, imu.f_b, t_ns - window_ns, t_ns)
        if patient and fix.v_a is None and np.sum(fix.tried[RANGE_RATE]) >= _LEAST_RATES:
            return None, fix, []  # an epoch whose range rates agree shows far more of the motion
        motion = self._motion(fix)
        if window is None:
            self.lacking = (
                "no second of plausible inertial samples before the epochs: compare the time scales"
            )
            return None, fix, []
        if motion is None:
            self.lacking = "no range rates that agree, and no fix before within five seconds"
            return None, fix, []
        if self.carried is not None:
            opened = self._carried_start(self.carried, imu, fix, window, motion, par)
        else:
            opened = self._automatic_start(imu, fix, window, motion, par, patient=patient)
        if opened[0] is not None and self.carried is None:
            opened[2].extend(begin_as_shown(opened[0], rows, epoch, par, self.noise, noise))
        return opened

    def _carried_start(
        self,
        carried: CarriedState,
        imu: ImuSamples,
        fix: Fix,
        window: AlignmentWindow,
        motion: tuple[Float64, Float64],
        par: Parameters,
    ) -> tuple[Bank | None, Fix | None, list[Event]]:
        """Open the bank after a gap in the samples."""
        earlier = self._earlier_fix(fix, with_velocity=True)
        if earlier is None and not carried.parked and len(self.fixes) < _WAIT_FIXES and fix.v_a is not None:
            return None, fix, []  # the acceleration, without which nothing says which way is up
        waited = fix.t_ns - (self.first_try_ns or fix.t_ns)
        if is_violent(window) and waited < _VIOLENT_S * NS_PER_S:
            return None, fix, []
        opened = open_carried(carried, self.setup, imu, fix, window, motion, earlier, par)
        if opened is None:
            self.carried = None
            return self._automatic_start(imu, fix, window, motion, par, patient=False)
        return opened[0], fix, opened[1]

    def _motion(self, fix: Fix) -> tuple[Float64, Float64] | None:
        """Return velocity and its covariance from the range rates, else from two positions, else None."""
        if fix.v_a is not None:
            return fix.v_a, fix.P_v[:3, :3]
        earlier = self._earlier_fix(fix, with_velocity=False)
        if earlier is None:
            return None
        dt = (fix.t_ns - earlier.t_ns) / NS_PER_S
        P_v = (fix.P[:3, :3] + earlier.P[:3, :3]) / dt**2 + _FIX_VELOCITY_SIGMA_MPS**2 * np.eye(3)
        return (fix.r_a - earlier.r_a) / dt, P_v

    def _with_drift(self, fix: Fix) -> Fix:
        """Return the fix with the drift of the clock: without range rates that of two fixes, as the velocity.

        A drift that is not known lets any range rate pass the first gate, even all of the wrong sign.
        """
        earlier = self._earlier_fix(fix, with_velocity=False)
        if math.isfinite(fix.drift) or earlier is None:
            return fix
        both = np.flatnonzero(np.isfinite(fix.clocks) & np.isfinite(earlier.clocks))
        if len(both) == 0:
            return fix
        dt, group = (fix.t_ns - earlier.t_ns) / NS_PER_S, int(both[0])
        drift = float(fix.clocks[group] - earlier.clocks[group]) / dt
        if abs(drift) > _FASTEST_DRIFT_MPS:
            return fix  # the clock has jumped
        P_v = np.zeros((4, 4))
        variance = (fix.clock_variance(group) + earlier.clock_variance(group)) / dt**2
        P_v[CLOCKS, CLOCKS] = variance + _FIX_VELOCITY_SIGMA_MPS**2
        return replace(fix, drift=drift, P_v=P_v)

    def _doubted(self, fix: Fix) -> tuple[bool, bool]:
        """Return whether the ranges and the rates of a fix may agree by chance.

        Where most epochs have no solution, some of the rows of one agree now and then: with twenty times the noise,
        once in a hundred or two. Those of a true one are the same again soon, and of the same place.
        """
        doubted = self.noise.disagrees & [bool(left_out) for left_out in fix.left_out]
        for old in self.agreeing:
            same_ranges, same_rates = (a == b for a, b in zip(fix.left_out, old.left_out, strict=True))
            doubted &= [not (same_ranges and _are_near(old, fix)), not same_rates]
        return bool(doubted[PSEUDORANGE]), bool(doubted[RANGE_RATE])

    def _earlier_fix(self, fix: Fix, *, with_velocity: bool) -> Fix | None:
        """Return the latest fix that is at least a window older, None without one."""
        window_ns = int(self.setup.config.start.window_s * NS_PER_S)
        for old in reversed(self.fixes):
            if fix.t_ns - old.t_ns >= window_ns and (old.v_a is not None or not with_velocity):
                return old
        return None

    def _automatic_start(
        self,
        imu: ImuSamples,
        fix: Fix,
        window: AlignmentWindow,
        motion: tuple[Float64, Float64],
        par: Parameters,
        *,
        patient: bool,
    ) -> tuple[Bank | None, Fix | None, list[Event]]:
        """Open the bank from a fix: levelled at rest, or in motion with the acceleration of two velocities."""
        v_a, P_v = motion
        config, grade = self.setup.config, self.setup.grade
        earlier = self._earlier_fix(fix, with_velocity=True)
        if earlier is None and patient and fix.v_a is not None:
            return None, fix, []  # the acceleration, without which nothing says which way is up
        at_rest = self._at_rest(window, fix, earlier)
        a_e, sd_a = None, 0.0
        now, before = fix.velocity, None if earlier is None else earlier.velocity
        if at_rest and now is not None and before is not None:
            sd_a = slight_acceleration(now, before)
        elif not at_rest:
            window, mean = levelling_motion(imu, fix, earlier, v_a, P_v, window)
            if mean.excess > 1.0 and patient:
                return None, fix, []  # one of the two velocities is wrong
            a_e, sd_a = mean.a_e, mean.sigma
            P_v = P_v * mean.excess**2
        kin = kinematics_from_fix(self._with_drift(fix), v_a, P_v, config)
        headings = self.headings or open_headings(fix.r_a, v_a, P_v, config)
        attitudes = attitudes_at_start(window, fix.r_a, v_a, a_e, sd_a, config, grade, headings)
        w = imu.w_ib_b[int(np.searchsorted(imu.t_ns, fix.t_ns, side="right")) - 1]
        bank = open_bank(kin, attitudes, w, par, config, grade, imu.t_ns, self.setup.layout)
        bank.head["from_fix"] = 1
        speed = float(np.linalg.norm(v_a))
        how = "at rest, levelled by the accelerometers" if at_rest else f"in motion at {speed:.1f} m/s"
        heading = (
            f"{len(attitudes)} heading hypotheses"
            if len(attitudes) > 1
            else f"heading sigma {math.degrees(attitudes[0].sd_yaw):.0f} deg"
        )
        detail = f"automatic, {how}; {fix.n_used} pseudoranges; {heading}"
        return bank, fix, [Event(fix.t_ns, "start", detail)]

    def _at_rest(self, window: AlignmentWindow, fix: Fix, earlier: Fix | None) -> bool:
        """Return whether gyros, accelerometers and GNSS all say that the vehicle stands.

        GNSS says so by its range rates alone: slow now, and not braking since the ``earlier`` fix.
        """
        now = fix.velocity
        if now is None:
            return False
        slow = velocities_show_rest(now, None if earlier is None else earlier.velocity, self.setup.config)
        return slow and samples_show_rest(window, self.setup.config, self.setup.grade)

    def _given_start(
        self, imu: ImuSamples, rows: GnssRows, epoch: int, par: Parameters
    ) -> tuple[Bank | None, Fix | None, list[Event]]:
        """Open the bank from the given state at its time, or at the first epoch; the clock is set by that epoch."""
        start = self.setup.start
        assert start is not None  # for the type checker: ``given`` says so
        t_epoch = int(rows.epoch_ns[epoch])
        t_ns = t_epoch if self.setup.start_ns is None else self.setup.start_ns
        if t_ns < imu.t_ns[0]:
            return None, None, []
        k = int(np.searchsorted(imu.t_ns, t_ns, side="right"))
        w = imu.w_ib_b[k - 1]
        unknown = np.full(len(self.setup.clock_groups), math.nan)
        kin = given_kinematics(start, t_ns, unknown, 0.0, w, par)
        attitudes = given_attitudes(start, self.setup.config)
        bank = self._open(kin, attitudes, w, par, imu)
        seen = seen_from(bank, rows, epoch, w, imu.f_b[k - 1], par, len(self.setup.clock_groups))
        if seen.below_horizon > _MOST_BELOW_HORIZON:
            return self._elsewhere(imu, rows, epoch, par, seen.below_horizon)
        if not np.isfinite(seen.clocks).any():
            self.lacking = "no satellite of the epoch has a pseudorange and a valid ephemeris"
            return None, None, []
        back = (t_epoch - t_ns) / NS_PER_S
        kin = given_kinematics(start, t_ns, seen.clocks - seen.drift * back, seen.drift, w, par)
        bank = self._open(kin, attitudes, w, par, imu)
        begin_with_model_noise(bank, rows, epoch, par, AS_DECLARED)
        self.given = False
        return bank, None, [Event(t_ns, "start", "from the given state; the clock is set by the first epoch")]

    def _elsewhere(
        self, imu: ImuSamples, rows: GnssRows, epoch: int, par: Parameters, below: float
    ) -> tuple[Bank | None, Fix | None, list[Event]]:
        """Give up a given state from which the satellites that the receiver tracks cannot be seen.

        It takes a fix of the epoch to be sure of that, one with redundancy while there is patience.
        """
        t_ns, limits = int(rows.epoch_ns[epoch]), self.setup.config.start
        assert self.first_try_ns is not None
        fix = fix_epoch(rows, epoch, par, self.setup.ties, limits.max_gdop)
        patient = t_ns - self.first_try_ns < limits.patience_s * NS_PER_S
        if fix is None or (not fix.checked and patient):
            self.lacking = "the satellites are below the horizon of the given start, and no epoch has a fix"
            return None, None, []
        self.given = False
        lat, lon, _ = ecef_to_geodetic(fix.r_a)
        detail = (
            f"{100.0 * below:.0f} % of the satellites are below the horizon of the given state; their ranges meet at"
            f" {math.degrees(lat):.3f}, {math.degrees(lon):.3f} deg: starting automatically instead"
        )
        bank, new_fix, events = self._try(imu, rows, epoch, par)
        return bank, new_fix, [Event(t_ns, "start_refused", detail), *events]

    def _open(self, kin: Kinematics, attitudes: list, w: Float64, par: Parameters, imu: ImuSamples) -> Bank:  # type: ignore[type-arg]
        return open_bank(
            kin, attitudes, w, par, self.setup.config, self.setup.grade, imu.t_ns, self.setup.layout
        )


def _recent(fixes: list[Fix], t_ns: int) -> list[Fix]:
    return [fix for fix in fixes if t_ns - fix.t_ns <= _LONGEST_HISTORY_NS]


def _are_near(old: Fix, fix: Fix) -> bool:
    """Return whether two fixes are of one place, but for the motion between them, which must be known."""
    if fix.v_a is None:
        return False
    dt = (fix.t_ns - old.t_ns) / NS_PER_S
    off = fix.r_a - old.r_a - fix.v_a * dt
    variance = np.trace(fix.P[:3, :3] + old.P[:3, :3] + fix.P_v[:3, :3] * dt**2)
    return bool(off @ off < _SAME_PLACE2 * variance)


def _why_no_fix(rows: GnssRows, epoch: int) -> str:
    """Return why an epoch has no fix, in words."""
    offered = rows.observation["status"][rows.first[epoch] : rows.first[epoch + 1], PSEUDORANGE] == USED
    if offered.sum() < _LEAST_RANGES:
        return (
            f"only {offered.sum()} of {len(offered)} pseudoranges are usable and a start needs four; check the"
            " ephemerides"
        )
    return f"the {offered.sum()} pseudoranges agree on no place, or lie too unfavourably; check the time tags"


class EpochView(NamedTuple):
    """An epoch's rows as predicted from a state."""

    clocks: Float64  # (g,) of each group [m], NaN without rows
    drift: float  # [m/s]
    below_horizon: float  # share of the pseudoranges offered whose satellites the Earth hides


def seen_from(
    bank: Bank, rows: GnssRows, epoch: int, w_ib_b: Float64, f_b: Float64, par: Parameters, n_groups: int
) -> EpochView:
    """Return the clocks as an epoch shows them from a state, and how many of its satellites cannot be seen from there.

    A clock is the median over the satellites: one wrong range does not set it.
    """
    n_rows = int(rows.first[epoch + 1] - rows.first[epoch])
    work = new_epoch(n_rows, bank.P.shape[1])
    m: StateRecord = bank.state[0]
    predict_measurements(m, bank.P[0], par, rows, epoch, w_ib_b, f_b, work)
    line = work.lines[:n_rows]
    clocks = np.full(n_groups, math.nan)
    for g in range(n_groups):
        seen = (line["status"][:, PSEUDORANGE] == USED) & (line["group"] == g)
        if seen.any():
            clocks[g] = np.median(line["innovation"][seen, PSEUDORANGE]) + m.clock[0]
    seen = line["status"][:, RANGE_RATE] == USED
    drift = float(np.median(line["innovation"][seen, RANGE_RATE])) if seen.any() else 0.0
    offered = rows.observation["status"][rows.first[epoch] : rows.first[epoch + 1], PSEUDORANGE] == USED
    _, _, h = ecef_to_geodetic(m.r_e)
    dip_sine = math.sqrt(max(1.0 - (WGS84_A_M / (WGS84_A_M + max(h, 0.0))) ** 2, 0.0))  # seen from a height
    hidden = line["u_n"][offered, 2] > dip_sine
    return EpochView(clocks, drift, float(hidden.mean()) if offered.any() else 0.0)
