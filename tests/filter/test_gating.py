"""Gates and clock steps: what is wrong is refused, what the receiver's clock did is absorbed, the rest is untouched."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.filter.loop import DONE
from insgnss.filter.output.writing import CLOCK_STEP, DRIFT_STEP
from insgnss.filter.state import CLOCK, DRIFT, Bank, copy_bank
from insgnss.gnss.observation_rows import ABSENT, PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.status import GATED, USED
from insgnss.tables import Float64
from tests.filter.scene import (
    RANGE_SIGMA_M,
    RATE_SIGMA_MPS,
    START_NS,
    Result,
    at_rest,
    attitude,
    new_filter,
    observed,
    parameters,
    perfect_rows,
    place,
    run,
    sky,
    update,
)

LEVER_B = (0.5, 0.2, -1.0)
MILLISECOND_M = 1e-3 * C_MPS
STEP_AT = 6  # epoch at which something happens; the five before let the filter settle
EPOCHS = 10


class Scene(NamedTuple):
    """A vehicle at rest with a filter that starts on the truth, and its rows."""

    truth: Bank
    bank: Bank
    log: GnssRows


def scene(rng: np.random.Generator, n_satellites: int, *, offsets: tuple[float, ...] = ()) -> Scene:
    """Return ten seconds of rows at 1 Hz with their noise."""
    at = place()
    truth = new_filter(at, C_eb=attitude(at, 3.0, -2.0, 50.0), offsets=offsets)
    group = ([0, 1] * 6)[:n_satellites] if offsets else ()
    epoch_ns = START_NS + np.arange(1, EPOCHS + 1) * NS_PER_S
    imu = at_rest(at, truth.state[0].C_eb, 1.0, 10.0)
    log = perfect_rows(
        truth, parameters(LEVER_B), epoch_ns, sky(at)[:n_satellites], w_ib_b=imu.w_ib_b[0], group=group
    )
    log.observation["value"] += rng.normal(size=(len(log.sat), 2)) * [RANGE_SIGMA_M, RATE_SIGMA_MPS]
    return Scene(truth, copy_bank(truth), log)


def by_epoch(log: GnssRows) -> Float64:
    """Return a view of the values, (epoch, satellite, kind)."""
    values: Float64 = log.observation["value"].reshape(EPOCHS, -1, 2)
    return values


def run_scene(s: Scene) -> Result:
    """Run the filter over the scene."""
    at = place()
    imu = at_rest(at, s.truth.state[0].C_eb, EPOCHS + 1.0, 50.0)
    return run(s.bank, s.log, imu, parameters(LEVER_B))


def events(result: Result) -> list[tuple[int, int, float]]:
    """Return time, kind and number of each event of the loop."""
    written = result.out.events[: result.out.counts[0].events]
    return [(int(e["t_ns"]), int(e["kind"]), float(e["a"])) for e in written]


def errors(s: Scene) -> tuple[float, float]:
    """Return the position's largest error in its sigmas and the clock's drift error [m/s]."""
    sigma = np.sqrt(np.diag(s.bank.P[0]))
    position = np.abs(s.bank.state["r_e"][0] - s.truth.state["r_e"][0]) / sigma[:3]
    return float(np.max(position)), float(s.bank.state["clock"][0, 1] - s.truth.state["clock"][0, 1])


SATELLITES = [2, 3, 4, 7, 12]


@pytest.mark.parametrize("n_satellites", SATELLITES)
@pytest.mark.parametrize("step_ms", [1.0, -1.0, 0.3, -0.3, 10.0, -10.0, 0.001])
def test_clock_step_is_absorbed_with_one_event_and_no_row_lost(
    rng: np.random.Generator, step_ms: float, n_satellites: int
) -> None:
    s = scene(rng, n_satellites)
    by_epoch(s.log)[STEP_AT:, :, PSEUDORANGE] += step_ms * MILLISECOND_M

    result = run_scene(s)

    assert result.code == DONE
    assert np.all(result.out.ledger["status"] == USED)
    [(t_ns, kind, step_m)] = events(result)
    assert (t_ns, kind) == (int(s.log.epoch_ns[STEP_AT]), CLOCK_STEP)
    # the median of rows good to 1 m, beside a clock known to a few metres
    assert step_m == pytest.approx(step_ms * MILLISECOND_M, abs=10.0)
    position, drift = errors(s)
    assert position < 4.0
    assert abs(drift) < 0.3


@pytest.mark.parametrize("step_m", [20.0, -100.0])
def test_clock_step_below_the_usual_sizes_is_absorbed_where_many_rows_show_it(
    rng: np.random.Generator, step_m: float
) -> None:
    """No motion moves twelve ranges by the same 20 m: a step of any size beyond the gates is the clock's."""
    s = scene(rng, 12)
    by_epoch(s.log)[STEP_AT:, :, PSEUDORANGE] += step_m

    result = run_scene(s)

    assert np.all(result.out.ledger["status"] == USED)
    assert [kind for _, kind, _ in events(result)] == [CLOCK_STEP]
    assert errors(s)[0] < 4.0


@pytest.mark.parametrize("n_satellites", SATELLITES)
@pytest.mark.parametrize("step_mps", [30.0, -30.0, 300.0])
def test_drift_step_is_absorbed_with_one_event_and_no_row_lost(
    rng: np.random.Generator, step_mps: float, n_satellites: int
) -> None:
    s = scene(rng, n_satellites)
    values = by_epoch(s.log)
    values[STEP_AT:, :, RANGE_RATE] += step_mps
    values[STEP_AT:, :, PSEUDORANGE] += step_mps * np.arange(EPOCHS - STEP_AT)[:, None]

    result = run_scene(s)

    assert result.code == DONE
    assert np.all(result.out.ledger["status"] == USED)
    [(t_ns, kind, step)] = events(result)
    assert (t_ns, kind) == (int(s.log.epoch_ns[STEP_AT]), DRIFT_STEP)
    assert step == pytest.approx(step_mps, abs=1.0)
    position, drift = errors(s)
    assert position < 4.0
    assert drift == pytest.approx(step_mps, abs=0.3)


@pytest.mark.parametrize("n_satellites", SATELLITES)
def test_steps_of_clock_and_drift_in_one_epoch_are_both_absorbed(
    rng: np.random.Generator, n_satellites: int
) -> None:
    s = scene(rng, n_satellites)
    values = by_epoch(s.log)
    values[STEP_AT:, :, RANGE_RATE] -= 80.0
    values[STEP_AT:, :, PSEUDORANGE] += MILLISECOND_M - 80.0 * np.arange(EPOCHS - STEP_AT)[:, None]

    result = run_scene(s)

    assert np.all(result.out.ledger["status"] == USED)
    assert [kind for _, kind, _ in events(result)] == [CLOCK_STEP, DRIFT_STEP]
    assert errors(s)[0] < 4.0


def test_clock_step_leaves_the_offset_of_the_other_constellation_alone(rng: np.random.Generator) -> None:
    s = scene(rng, 12, offsets=(15.0,))
    by_epoch(s.log)[STEP_AT:, :, PSEUDORANGE] -= MILLISECOND_M

    result = run_scene(s)

    assert np.all(result.out.ledger["status"] == USED)
    assert len(events(result)) == 1
    assert s.bank.state["optional"][0, 0] == pytest.approx(15.0, abs=3.0)


@pytest.mark.parametrize("n_satellites", [1, *SATELLITES])
@pytest.mark.parametrize("error_m", [50.0, -50.0, 5000.0, MILLISECOND_M, -MILLISECOND_M])
def test_one_wrong_pseudorange_is_refused_and_the_rest_is_used(
    rng: np.random.Generator, error_m: float, n_satellites: int
) -> None:
    s = scene(rng, n_satellites)
    by_epoch(s.log)[STEP_AT, 0, PSEUDORANGE] += error_m

    result = run_scene(s)

    status = result.out.ledger["status"].reshape(EPOCHS, n_satellites, 2)
    assert status[STEP_AT, 0, PSEUDORANGE] == GATED
    status[STEP_AT, 0, PSEUDORANGE] = USED
    assert np.all(status == USED)
    assert events(result) == []
    assert errors(s)[0] < 4.0


@pytest.mark.parametrize("n_satellites", [1, *SATELLITES])
@pytest.mark.parametrize("error_mps", [3.0, -100.0])
def test_one_wrong_range_rate_is_refused_and_the_rest_is_used(
    rng: np.random.Generator, error_mps: float, n_satellites: int
) -> None:
    s = scene(rng, n_satellites)
    by_epoch(s.log)[STEP_AT, -1, RANGE_RATE] += error_mps

    result = run_scene(s)

    status = result.out.ledger["status"].reshape(EPOCHS, n_satellites, 2)
    assert status[STEP_AT, -1, RANGE_RATE] == GATED
    status[STEP_AT, -1, RANGE_RATE] = USED
    assert np.all(status == USED)
    assert events(result) == []


@pytest.mark.parametrize("error_m", [50.0, 5000.0])
@pytest.mark.parametrize("n_satellites", [5, 12])
def test_wrong_satellite_is_refused_in_the_epoch_of_a_clock_step_too(
    rng: np.random.Generator, error_m: float, n_satellites: int
) -> None:
    s = scene(rng, n_satellites)
    by_epoch(s.log)[STEP_AT:, :, PSEUDORANGE] += MILLISECOND_M
    by_epoch(s.log)[STEP_AT, 0, PSEUDORANGE] += error_m

    result = run_scene(s)

    status = result.out.ledger["status"].reshape(EPOCHS, n_satellites, 2)
    assert status[STEP_AT, 0, PSEUDORANGE] == GATED
    assert np.sum(status != USED) == 1
    assert errors(s)[0] < 4.0


@pytest.mark.parametrize("first", [0, 11], ids=["wrong row first", "wrong row last"])
def test_gates_are_judged_on_the_prior_and_not_on_what_earlier_rows_made_of_it(first: int) -> None:
    """The clock is known to 100 m: 400 m pass, then eleven right rows stand 400 m beside an estimate good to 3 m."""
    at, par = place(), parameters()
    bank = new_filter(at)
    log = perfect_rows(bank, par, [START_NS], sky(at))
    log.observation["value"][first, PSEUDORANGE] += 400.0

    assert np.all(update(bank, log, par).out.ledger["status"] == USED)


def test_common_step_of_a_bare_majority_is_not_taken_for_the_clocks(rng: np.random.Generator) -> None:
    """Seven rows of twelve are a millisecond off: the clock would have moved all twelve."""
    s = scene(rng, 12)
    by_epoch(s.log)[STEP_AT, :7, PSEUDORANGE] += MILLISECOND_M

    result = run_scene(s)

    assert events(result) == []
    status = result.out.ledger["status"].reshape(EPOCHS, 12, 2)[STEP_AT, :, PSEUDORANGE]
    assert status.tolist() == [GATED] * 7 + [USED] * 5


def test_wrong_row_does_not_change_the_status_of_any_other() -> None:
    """Innovations from 4 to 6 sigma, some refused and some not: the same ones, whatever one more row shows."""
    at, par = place(), parameters()
    bank = new_filter(at, sigmas={CLOCK: 3.0})
    log = perfect_rows(bank, par, [START_NS], sky(at))
    line = observed(bank, par, log).lines
    sigma = np.sqrt(line["predicted"] + line["variance"])[:, :2]
    in_sigmas = np.linspace(4.0, 6.0, 12) * ([1.0, -1.0] * 6)
    log.observation["value"] += sigma * in_sigmas[:, None]
    status = []
    for wrong in (0.0, 40.0, 5000.0):
        values = log.observation.copy()
        values["value"][5] += wrong
        status.append(update(copy_bank(bank), log._replace(observation=values), par).out.ledger["status"])

    others = np.delete(np.arange(12), 5)
    assert set(status[0][others].ravel()) == {USED, GATED}
    for other in status[1:]:
        assert np.array_equal(other[others], status[0][others])


@pytest.mark.parametrize("kind", [PSEUDORANGE, RANGE_RATE], ids=["range", "rate"])
@pytest.mark.parametrize(("share", "expected"), [(1.0 - 1e-6, USED), (1.0 + 1e-6, GATED)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gate_stands_at_five_sigmas_of_the_innovation(
    kind: int, share: float, expected: int, sign: float
) -> None:
    at, par = place(), parameters()
    bank = new_filter(at, sigmas={CLOCK: 3.0})
    log = perfect_rows(bank, par, [START_NS], sky(at)[:1])
    line = observed(bank, par, log).lines[0]
    log.observation["value"][0, kind] += (
        sign * 5.0 * share * np.sqrt(line.predicted[kind] + line.variance[kind])
    )

    status = update(bank, log, par).out.ledger["status"][0]

    assert status[kind] == expected
    assert status[1 - kind] == USED


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["satellite clock", "satellite drift", "range", "rate"])
def test_what_is_not_a_number_never_passes_a_gate(bad: float, where: str) -> None:
    at, par = place(), parameters()
    bank = new_filter(at)
    log = perfect_rows(bank, par, [START_NS], sky(at))
    kind = PSEUDORANGE if where in ("satellite clock", "range") else RANGE_RATE
    if where.startswith("satellite"):
        log.sat[4, 6 + kind] = bad
    else:
        log.observation["value"][4, kind] = bad

    result = update(bank, log, par)

    status = result.out.ledger["status"]
    assert result.code == DONE
    assert status[4, kind] == GATED
    assert np.sum(status != USED) == 1
    assert np.all(np.isfinite(bank.P))
    assert np.all(
        np.isfinite(np.concatenate([bank.state[name].ravel() for name in ("r_e", "v_e", "q_eb", "clock")]))
    )


def test_common_step_of_a_single_satellite_is_not_taken_for_the_clocks(rng: np.random.Generator) -> None:
    s = scene(rng, 12)
    s.log.observation["status"].reshape(EPOCHS, 12, 2)[STEP_AT, 1:] = ABSENT
    by_epoch(s.log)[STEP_AT, 0] += [MILLISECOND_M, 100.0]

    result = run_scene(s)

    assert not {CLOCK_STEP, DRIFT_STEP} & {kind for _, kind, _ in events(result)}
    assert result.out.ledger["status"].reshape(EPOCHS, 12, 2)[STEP_AT, 0].tolist() == [GATED, GATED]


def test_clock_within_its_own_sigma_is_no_step() -> None:
    """At the start the clock is known to 10 km only: 3 ms of it are corrected, not reported."""
    at, par = place(), parameters()
    bank = new_filter(at, sigmas={CLOCK: 1e4, DRIFT: 100.0})
    log = perfect_rows(bank, par, [START_NS], sky(at))
    log.observation["value"] += [2.0e4, -150.0]

    result = update(bank, log, par)

    assert events(result) == []
    assert np.all(result.out.ledger["status"] == USED)
    assert bank.state["clock"][0] == pytest.approx([1200.0 + 2e4, 3.0 - 150.0], abs=2.0)
