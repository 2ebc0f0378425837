"""The axes to declare, from the hypotheses that fit the logs: the simplest one, and whether it is the only one.

The findings say that the axes fit, other axes fit, or the log cannot decide between several. A proposal is sure only
where the log speaks clearly against every other reading of the columns. Where another one does as well, the one that a
mounting can give, both sensors rotated equally, is likely, or else the simplest if there is one.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.log.checks.axis_search import EQUAL, SURE, Hypothesis, Match, is_map
from insgnss.log.checks.declaration import AxesDeclaration
from insgnss.log.checks.longitudinal_axis import STEADY
from insgnss.log.checks.motion_fit import signed_permutations
from insgnss.log.checks.report import AXES_FIT, Finding, Proposal
from insgnss.tables import Float64

# -2 log of the belief in axes before the log is seen: as declared, turned as a whole, of reversed sign in one sensor,
# and for every row in which the sensors differ, the accelerometers' being turned besides counting as one more
STRANGE: Final = (0.0, 10.0, 12.0)
STRANGE_FIRST_ROW: Final = 30.0
STRANGE_ROW: Final = 25.0
# Cosines of a declared axis with the direction that it should have
AGAINST: Final = 0.5  # more than 60 deg away ...
ALONG: Final = 0.8  # ... while another axis is nearer than 37 deg


class VehicleAxes(NamedTuple):
    """Maps from sensor columns to body axes, and the evidence for them."""

    accel: Float64  # (3, 3) A
    gyro: Float64  # (3, 3) G
    factor: float  # on the gyros' declared unit
    hypothesis: Hypothesis
    turned: bool  # the accelerometers' axes are not the declared ones
    gyro_kept: bool  # the gyros' are
    rank: int  # 0 as declared, 1 both sensors equal, 2 equal except for the sign of all, then more for each row apart

    @property
    def cost(self) -> float:
        """-2 log likelihood above the best."""
        return self.hypothesis.cost

    @property
    def mounted(self) -> bool:
        """Whether a sensor that is right in itself, mounted otherwise, gives these axes."""
        return np.array_equal(self.accel, self.gyro) and bool(np.linalg.det(self.accel) > 0.0)


def relative(accel: Float64, gyro: Float64) -> Float64:
    """Return H = det(A) A^T G, the gyros' map in the accelerometers' own axes."""
    return np.asarray(np.rint(np.linalg.det(accel)) * accel.T @ gyro)


def candidates(ranked: list[Hypothesis], accel_0: Float64, gyro_0: Float64) -> list[VehicleAxes]:
    """Return the declarations that the hypotheses allow, the most credible first, each with its cost above that.

    A with det A = handed turns the mean motion forward and mean gravity down, and G = det(A) A H; declared axes that
    the log does not contradict stay. Stranger declarations need more evidence: in a coordinated flight the
    accelerometers see no side force, and only the prior separates a reversed axis from a right one.
    """
    by_declaration: dict[tuple[tuple[str, ...], tuple[str, ...], float], VehicleAxes] = {}
    for one in sorted(ranked, key=lambda one: one.cost):
        accel = _accel(one, accel_0)
        gyro = one.handed * accel @ one.gyro_map
        turned = not np.array_equal(accel, accel_0)
        axes = VehicleAxes(
            accel,
            gyro,
            one.factor,
            one,
            turned,
            bool(np.array_equal(gyro, gyro_0)),
            _rank(accel, gyro, accel_0, gyro_0),
        )
        by_declaration.setdefault((names(accel), names(gyro), one.factor), axes)
    return sorted(by_declaration.values(), key=credibility)


def credibility(axes: VehicleAxes) -> float:
    """Return -2 log of how credible a declaration is, with the evidence of the log: the least is the best."""
    if axes.rank < len(STRANGE):
        twice = axes.rank == 2 and axes.turned and not axes.gyro_kept
        return axes.cost + STRANGE[axes.rank] + (STRANGE_ROW if twice else 0.0)
    rows = axes.rank - len(STRANGE) + (1 if axes.turned else 0)
    return axes.cost + STRANGE_FIRST_ROW + STRANGE_ROW * rows


def strangeness(axes: VehicleAxes) -> float:
    """Return -2 log of the prior of a declaration among those that fit the log: those of a mounting come first.

    A left-handed log, or a sensor with reversed sign, is hardly more likely than a single wrong column.
    """
    if axes.rank == 0:
        return 0.0
    if axes.mounted:
        return STRANGE[1]
    both = STRANGE_ROW if axes.turned and not axes.gyro_kept else 0.0
    if axes.rank < len(STRANGE):
        return STRANGE_FIRST_ROW + (both if axes.rank == 2 else 0.0)
    apart = int(np.sum((axes.accel != axes.gyro).any(axis=1)))
    exchanged = not np.array_equal(np.abs(axes.accel), np.abs(axes.gyro))  # of two rows, which is one slip
    return STRANGE_FIRST_ROW + STRANGE_ROW * (apart - 1 - int(exchanged)) + both


def _accel(one: Hypothesis, accel_0: Float64) -> Float64:
    if np.rint(np.linalg.det(accel_0)) == one.handed and not contradicted(one, accel_0):
        return accel_0
    allowed = [A for A in signed_permutations() if np.rint(np.linalg.det(A)) == one.handed]
    score = np.round([float(A[0] @ one.along_s + A[2] @ one.down_s) for A in allowed], 3)
    # of equals the one that changes least: where the motion has no direction, gravity alone decides
    unchanged = np.array([float(np.sum(accel_0 == A)) for A in allowed])
    best: Float64 = allowed[int(np.lexsort((unchanged, score))[-1])]
    return best


def contradicted(one: Hypothesis, accel: Float64) -> bool:
    """Return whether motion or gravity lies clearly along another axis than declared."""
    return _against(accel[0], one.along_s) or _against(accel[2], one.down_s)


def _against(axis: Float64, direction: Float64) -> bool:
    length = float(np.linalg.norm(direction))
    if length < STEADY:
        return False
    return float(axis @ direction) / length < AGAINST and float(np.abs(direction).max()) / length > ALONG


def forward_known(one: Hypothesis) -> bool:
    """Return whether the vehicle moves along one sensor axis."""
    length = float(np.linalg.norm(one.along_s))
    return length > STEADY and float(np.abs(one.along_s).max()) / length > ALONG


def _rank(accel: Float64, gyro: Float64, accel_0: Float64, gyro_0: Float64) -> int:
    if np.array_equal(accel, accel_0) and np.array_equal(gyro, gyro_0):
        return 0
    if np.array_equal(accel, gyro):
        return 1
    if np.array_equal(accel, -gyro):
        return 2
    return 2 + int(np.sum((accel != gyro).any(axis=1)))


def names(matrix: Float64) -> tuple[str, str, str]:
    """Return a signed permutation as the flight file writes it: ("-y", "+x", "+z")."""
    words = []
    for row in matrix:
        at = int(np.argmax(np.abs(row)))
        words.append(("+" if row[at] > 0.0 else "-") + "xyz"[at])
    return (words[0], words[1], words[2])


# -2 log likelihood to every other reading, for axes that are sure: what no reading holds, as scale errors, made 16
# between a reading and its mirror image in 10 minutes of coordinated flight
SURE_AXES: Final = 50.0
MOST_OPEN: Final = 3  # columns that the motion may leave open while it bears the others out
SHOWN: Final = 4  # readings


def axes_findings(declared: AxesDeclaration, readings: list[VehicleAxes], match: Match) -> list[Finding]:
    """Return the finding on the axes.

    Parameters
    ----------
    declared : what the flight file says
    readings : the most credible first
    match : the search they come from
    """
    best, near = readings[0], _near(readings)
    labels = [_told(axes) for axes in (best, *near)]
    beyond = min(
        match.gap, min((axes.cost for axes in readings if _told(axes) not in labels), default=np.inf)
    )
    shown = _directions(best, beyond - best.cost)
    if best.rank == 0:
        return [_fitting(best, near, shown)]
    if not decided(readings):
        return [_undecided([best, *near])]
    return [_other_axes(declared, best, near, beyond - best.cost)]


def decided(readings: list[VehicleAxes]) -> bool:
    """Return whether one reading leads, by the log or by being the simplest: the lever arm is asked with it."""
    best = readings[0]
    return best.rank == 0 or all(strangeness(axes) - strangeness(best) > EQUAL for axes in _near(readings))


def gyros_known(readings: list[VehicleAxes]) -> bool:
    """Return whether one reading leads in how gyros and accelerometers go together: the time is asked with it.

    Which of the axes is forward may be left open.
    """
    best = readings[0].hypothesis
    near = [axes.hypothesis for axes in _near(readings)]
    alike = all(one.handed == best.handed and is_map(one, best.gyro_map, best.factor) for one in near)
    return alike or decided(readings)


def _near(readings: list[VehicleAxes]) -> list[VehicleAxes]:
    """Return the readings that are indistinguishable from the first."""
    best = readings[0]
    level = best.cost if best.rank == 0 else min(axes.cost for axes in readings)
    apart = EQUAL if best.rank == 0 else SURE
    return [axes for axes in readings[1:] if axes.cost - level < apart and _told(axes) != _told(best)]


def _fitting(best: VehicleAxes, near: list[VehicleAxes], shown: str) -> Finding:
    if not near:
        return Finding("ok", "motion", f"the axes fit the motion: {shown}", kind=AXES_FIT)
    advice = "turns with bank or pitch, accelerations and stops would decide"
    if best.cost > SURE:
        text = f"the motion indicates other axes than the declared ones: axes {_listed(near)}"
        return Finding("warning", "motion", text, advice, f"log likelihood {best.cost / 2.0:.0f} above")
    columns = _open_columns(best, near)
    if len(columns) <= MOST_OPEN:
        text = f"the axes fit the motion; it does not show the sign or order of {', '.join(columns)}"
        return Finding("ok", "motion", f"{text}: {shown}", advice, kind=AXES_FIT)
    text = f"the motion agrees with the axes, but {len(near)} other reading(s) explain it as well"
    return Finding("ok", "motion", f"{text}: axes {_listed(near)}", advice)


def _open_columns(best: VehicleAxes, near: list[VehicleAxes]) -> list[str]:
    """Return the sensor columns that other readings take otherwise."""
    columns = set()
    for axes in near:
        for kind, ours, theirs in (("accel", best.accel, axes.accel), ("gyro", best.gyro, axes.gyro)):
            rows = np.flatnonzero((ours != theirs).any(axis=1))
            columns |= {f"{kind} {names(ours)[row][1]}" for row in rows}
    return sorted(columns)


def _undecided(readings: list[VehicleAxes]) -> Finding:
    """Return the finding where the log decides between readings of which the declared one is not the likeliest."""
    advice = "turns with bank or pitch, accelerations and stops would decide"
    declared = next((axes for axes in readings if axes.rank == 0), None)
    ordered = sorted((axes for axes in readings if axes is not declared), key=strangeness)
    if declared is not None:
        text = (
            "the motion prefers other axes to the declared ones, which it does not rule out:"
            f" axes {_listed(ordered)}"
        )
        above = declared.cost - min(axes.cost for axes in readings)
        return Finding("warning", "motion", text, advice, f"log likelihood {above / 2.0:.0f} above")
    text = f"the declared axes do not fit the motion; several others do: axes {_listed(ordered)}"
    columns = _open_columns(ordered[0], ordered[1:])
    if len(columns) <= MOST_OPEN:
        text += f"; they differ in {', '.join(columns)} alone"
    return Finding("error", "motion", text, advice)


def _listed(readings: list[VehicleAxes]) -> str:
    shown = " or ".join(_told(axes) for axes in readings[:SHOWN])
    return shown + (f" or {len(readings) - SHOWN} more" if len(readings) > SHOWN else "")


def _told(axes: VehicleAxes) -> str:
    accel, gyro = names(axes.accel), names(axes.gyro)
    return ", ".join(accel) + ("" if accel == gyro else f" with gyros {', '.join(gyro)}")


def _other_axes(
    declared: AxesDeclaration, best: VehicleAxes, near: list[VehicleAxes], margin: float
) -> Finding:
    one = best.hypothesis
    text = f"the axes are {_told(best)}: {_directions(best, margin)}"
    if declared.turned:
        return Finding("error", "motion", text, "correct imu.mounting_matrix by this turn")
    if not forward_known(one) and contradicted(one, declared.accel):
        advice = "gravity is not along the declared axis; the motion does not show which is forward: declare imu.axes"
        return Finding("error", "motion", text, advice)
    left = " (left-handed)" if np.linalg.det(best.accel) < 0.0 else ""
    sure = f"{_certainty(best, near, margin)} for a vehicle that moves nose first"
    if not near:
        return Finding("error", "motion", text + left, "", sure, _proposals(declared, best))
    why = "the one that a mounting gives" if best.mounted else "the simplest"
    sure += f"; several axis mappings explain the motion; proposed is {why}"
    columns = _open_columns(best, near)
    others = (
        f"the sign or order of {', '.join(columns)}" if len(columns) <= MOST_OPEN else f"axes {_listed(near)}"
    )
    advice = f"the motion leaves open {others}"
    return Finding("error", "motion", text + left, advice, sure, _proposals(declared, best))


def _certainty(best: VehicleAxes, near: list[VehicleAxes], margin: float) -> str:
    clear = not near and margin > SURE_AXES
    # what the direction of motion prefers, the velocities must allow
    return "sure" if clear and forward_known(best.hypothesis) and best.hypothesis.fit < EQUAL else "likely"


def _proposals(declared: AxesDeclaration, best: VehicleAxes) -> tuple[Proposal, ...]:
    why = "gravity, turns and accelerations against the satellites' velocity require them"
    accel, gyro = names(best.accel), names(best.gyro)
    proposals = [Proposal("imu.axes", accel, why)]
    apart = not np.array_equal(declared.accel, declared.gyro)
    if accel != gyro or apart or np.linalg.det(best.accel) < 0.0:
        proposals.append(Proposal("imu.gyro_axes", gyro, why))
    return tuple(proposals)


def _directions(best: VehicleAxes, margin: float) -> str:
    one = best.hypothesis
    return (
        f"motion along {_vector(one.along_s)}, gravity along {_vector(one.down_s)} of the sensor's axes; log likelihood"
        f" {min(max(margin, 0.0), 1e4) / 2.0:.0f} above the next"
    )


def _vector(direction: Float64) -> str:
    return "(" + ", ".join(f"{value:+.2f}" for value in direction) + ")"
