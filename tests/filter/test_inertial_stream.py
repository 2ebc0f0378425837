"""Screening of inertial samples: gaps, values no sensor gives, spikes, sensors that are out; the stream as the log."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.library import filter_config, imu_grade
from insgnss.filter.imu.inertial_stream import Cut, Sample, SampleStream, ScreenedLog, screened
from insgnss.filter.imu.sensor_outage import WINDOW
from insgnss.filter.imu.tag_guard import TagGuard
from insgnss.filter.setup import FilterSetup
from insgnss.tables import Event, ImuTable

START_NS = 1_400_000_000_000_000_000
TCXO = Oscillator(h0_s=2e-19, h_minus2_per_s=2e-20)
INDUSTRIAL, TACTICAL = imu_grade("industrial"), imu_grade("tactical")


def setup(grade: ImuGrade = INDUSTRIAL, longest_step_s: float | None = None) -> FilterSetup:
    """Return a filter's setup for a sensor."""
    config = filter_config("tight17")
    gaps = config.gaps.model_copy(update={"longest_step_s": longest_step_s})
    return FilterSetup(config.model_copy(update={"gaps": gaps}), grade, TCXO, lever_arm_m=(0.5, 0.0, -1.0))


def times(step_s: float, n: int, jitter_s: float, rng: np.random.Generator) -> np.ndarray:
    """Return tags of a step with uniform jitter, which does not add up."""
    t = np.arange(n) * step_s + rng.uniform(-jitter_s, jitter_s, n)
    return START_NS + np.rint(1e9 * t).astype(np.int64)


def log(rng: np.random.Generator, t_ns: np.ndarray, sway: float = 0.2) -> ImuTable:
    """Return a vehicle that sways, with white noise of the industrial grade."""
    t = (t_ns - START_NS)[:, None] * 1e-9
    w = sway * np.sin(t * [0.7, 1.1, 0.3]) + 1e-3 * rng.normal(size=(len(t), 3))
    f = (
        np.array([0.0, 0.0, -9.81])
        + 5.0 * sway * np.sin(t * [0.5, 0.8, 1.0])
        + 0.02 * rng.normal(size=w.shape)
    )
    return ImuTable(t_ns, w, f)


def kinds(found: ScreenedLog) -> list[str]:
    """Return the kinds of the events."""
    return [event.kind for event in found.events]


# ------------------------------------------------------------------------------------------------------------ gaps


@pytest.mark.parametrize(
    ("step_s", "jitter_s"),
    [(0.2, 0.002), (0.1, 0.002), (0.05, 0.002), (0.02, 0.002), (0.01, 0.002), (0.005, 0.0), (0.001, 0.0001)],
)
def test_even_log_has_no_gap_whatever_its_rate(
    step_s: float, jitter_s: float, rng: np.random.Generator
) -> None:
    table = log(rng, times(step_s, 4000, jitter_s, rng))
    found = screened(table, setup())
    assert found.events == [] and found.cuts == []
    assert found.imu.t_ns.tobytes() == table.t_ns.tobytes() and len(found.imu.unknown) == 0


@pytest.mark.parametrize("steps_ms", [(6, 7), (6, 6, 9), (2, 8)])
def test_uneven_steps_of_real_loggers_are_no_gaps(
    steps_ms: tuple[int, ...], rng: np.random.Generator
) -> None:
    t_ns = START_NS + np.cumsum(np.resize(steps_ms, 5000)) * 1_000_000
    found = screened(log(rng, t_ns), setup())
    assert found.events == [] and len(found.imu.unknown) == 0


@pytest.mark.parametrize(
    ("step_s", "missing", "told"), [(0.01, 1, False), (0.01, 5, True), (0.1, 1, False), (0.1, 5, True)]
)
def test_missing_samples_are_bridged_and_told_by_the_logs_own_step(
    step_s: float, missing: int, told: bool, rng: np.random.Generator
) -> None:
    table = log(rng, times(step_s, 2000, 0.0, rng))
    keep = np.ones(2000, np.bool_)
    keep[1000 : 1000 + missing] = False
    cut = ImuTable(table.t_ns[keep], table.w_ib_b[keep], table.f_b[keep])
    found = screened(cut, setup())
    assert kinds(found) == (["imu_gap"] if told else [])
    assert np.isin(cut.t_ns, found.imu.t_ns).all() and len(found.imu.t_ns) == len(cut.t_ns) + 1
    (at,) = np.flatnonzero(found.imu.unknown[:, 0] > 0.0)
    assert found.imu.t_ns[at] == table.t_ns[999 + missing]
    assert np.allclose(found.imu.w_ib_b[at], 0.5 * (table.w_ib_b[999] + table.w_ib_b[1000 + missing]))


@pytest.mark.parametrize(("longest_step_s", "gaps"), [(0.5, 0), (0.15, 1), (0.03, 1)])
def test_absolute_limit_of_a_gap_is_taken_as_it_is_given(
    longest_step_s: float, gaps: int, rng: np.random.Generator
) -> None:
    """Unless it is below the log's own step: then every sample would stand behind a gap."""
    table = log(rng, times(0.05, 400, 0.0, rng))
    keep = (np.arange(400) < 200) | (np.arange(400) > 203)
    cut = ImuTable(table.t_ns[keep], table.w_ib_b[keep], table.f_b[keep])
    assert kinds(screened(cut, setup(longest_step_s=longest_step_s))) == ["imu_gap"] * gaps


def test_gap_opens_the_attitude_by_what_the_log_has_shown(rng: np.random.Generator) -> None:
    """A calm log by the setting's 5 deg/s within a second, one of violent rates by those."""
    sigma = []
    for sway in (0.0, 0.5):
        table = log(rng, times(0.01, 6000, 0.0, rng), sway)
        keep = np.abs(np.arange(6000) - 5000) > 50
        found = screened(ImuTable(table.t_ns[keep], table.w_ib_b[keep], table.f_b[keep]), setup())
        at = int(np.argmax(found.imu.unknown[:, 0]))
        length_s = (found.imu.t_ns[at] - found.imu.t_ns[at - 1]) * 1e-9
        sigma.append(np.degrees(np.sqrt(found.imu.unknown[at, 0] * length_s)))
    assert sigma[0] == pytest.approx(5.0 * np.sqrt(1.01**3 / 12.0), rel=0.02)
    assert 2.0 * sigma[0] < sigma[1] < 20.0


def test_rate_of_a_log_may_change_and_is_soon_its_own_measure(rng: np.random.Generator) -> None:
    t_ns = START_NS + np.cumsum(np.repeat([10_000_000, 20_000_000, 100_000_000, 5_000_000], 1000))
    found = screened(log(rng, t_ns), setup())
    assert len(found.events) < 25
    late = np.arange(len(found.imu.t_ns)) % 1000 > 150
    assert np.count_nonzero(found.imu.unknown[:, 0][late] > 0.0) < 10


# ------------------------------------------------------------------------------------------------------ bad samples


@pytest.mark.parametrize("value", [2e6, -1e9, 1e35, 1e100, np.nan, np.inf])
@pytest.mark.parametrize("sensor", ["w_ib_b", "f_b"])
def test_value_that_no_sensor_gives_is_left_out_and_told_once_a_run(
    sensor: str, value: float, rng: np.random.Generator
) -> None:
    table = log(rng, times(0.01, 1000, 0.0, rng))
    getattr(table, sensor)[[300, 600, 601, 602, 990], 1] = value
    found = screened(table, setup(TACTICAL))
    assert kinds(found) == ["imu_bad_sample"] * 3
    assert len(found.logged_ns) == 995 and np.isfinite(found.imu.w_ib_b).all()
    assert np.count_nonzero(found.imu.unknown[:, 0] > 0.0) == 3


def test_projectile_of_300_revolutions_a_second_and_20000_g_passes(rng: np.random.Generator) -> None:
    table = log(rng, times(0.001, 2000, 0.0, rng))
    table.w_ib_b[:, 0] += 1885.0
    table.f_b[1000:1010, 0] += 2e5
    found = screened(table, setup(TACTICAL))
    assert found.events == [] and len(found.imu.t_ns) == 2000


def test_declared_range_decides_where_there_is_one(rng: np.random.Generator) -> None:
    """Twice 2000 deg/s is 70 rad/s."""
    table = log(rng, times(0.01, 1000, 0.0, rng))
    table.w_ib_b[500, 0] = 71.0
    assert kinds(screened(table, setup())) == ["imu_bad_sample"]


@pytest.mark.parametrize(
    ("sensor", "size"), [("w_ib_b", 20.0), ("w_ib_b", -2.0), ("f_b", 500.0), ("f_b", 60.0)]
)
def test_spike_is_left_out(sensor: str, size: float, rng: np.random.Generator) -> None:
    table = log(rng, times(0.01, 3000, 0.0, rng))
    getattr(table, sensor)[500::100, 2] += size
    found = screened(table, setup(TACTICAL))
    assert len(found.logged_ns) == 3000 - 25
    assert kinds(found).count("imu_spike") == 20


@pytest.mark.parametrize(
    ("sensor", "size"),
    [
        *(("w_ib_b", [4.0, -7.0, 5.0]), ("w_ib_b", [4.0, -7.0]), ("w_ib_b", [0.4])),
        *(("f_b", [60.0, 45.0, 90.0]), ("f_b", [60.0, 45.0]), ("f_b", [-15.0])),
    ],
)
def test_spike_that_may_be_a_shock_is_as_wrong_as_it_is_unknown(
    sensor: str, size: list[float], rng: np.random.Generator
) -> None:
    """What the samples would have changed: half of it is taken and as much is unknown."""

    def integral(of: ScreenedLog) -> float:
        dt = np.diff(of.imu.t_ns) * 1e-9
        return float(dt @ getattr(of.imu, sensor)[1:, 1])

    table = log(rng, times(0.01, 3000, 0.0, rng))
    whole = integral(screened(table, setup(TACTICAL)))
    getattr(table, sensor)[1500 : 1500 + len(size), 1] += size
    found = screened(table, setup(TACTICAL))
    assert kinds(found) == ["imu_spike"] * len(size)

    shock = 0.01 * sum(size)
    moved = integral(found) - whole
    at = np.flatnonzero(found.imu.unknown[:, 0 if sensor == "w_ib_b" else 1])
    dt = np.diff(found.imu.t_ns)[at - 1] * 1e-9
    sigma = float(np.sqrt(dt @ found.imu.unknown[at, 0 if sensor == "w_ib_b" else 1]))
    noise = 0.01 if sensor == "f_b" else 0.003
    assert moved == pytest.approx(0.5 * shock, abs=noise)
    assert abs(0.5 * shock) - noise < sigma < 1.1 * abs(0.5 * shock) + noise


def test_motion_is_no_spike(rng: np.random.Generator) -> None:
    """A rocket's ignition, a rate that begins at a stroke, the vibration of a motor, a shock of five samples."""
    table = log(rng, times(0.005, 20_000, 0.0, rng))
    table.f_b[4000:, 0] += 150.0
    table.w_ib_b[8000:9000, 0] += 10.0
    t = np.arange(8000) * 0.005
    table.f_b[12_000:, 2] += 30.0 * np.sin(2.0 * np.pi * 71.3 * t)
    table.w_ib_b[12_000:, 1] += 1.0 * np.sin(2.0 * np.pi * 83.1 * t)
    table.f_b[10_000:10_005, 1] += 80.0
    found = screened(table, setup(TACTICAL))
    assert found.events == [] and len(found.imu.t_ns) == 20_000


# ------------------------------------------------------------------------------------------- sensors that are out


@pytest.mark.parametrize("value", [None, 0.0], ids=["held", "zero"])
@pytest.mark.parametrize(("sensor", "name"), [("w_ib_b", "gyros"), ("f_b", "accelerometers")])
def test_sensor_that_holds_its_value_is_told_with_its_axes(
    sensor: str, name: str, value: float | None, rng: np.random.Generator
) -> None:
    table = log(rng, times(0.01, 4000, 0.0, rng))
    x = getattr(table, sensor)
    x[2000:3000, 1:] = x[2000, 1:] if value is None else value
    found = screened(table, setup())
    out, back = found.events[:2]
    assert (out.kind, back.kind) == ("imu_sensor_out", "imu_sensor_back")
    assert f"the {name} (body axes y, z) hold" in out.detail
    column = 0 if sensor == "w_ib_b" else 1
    assert np.all(found.imu.unknown[2010:2990, column] > 0.0)
    assert np.all(found.imu.unknown[:2000, column] == 0.0) and np.all(found.imu.unknown[3001:, column] == 0.0)
    kept = found.imu.w_ib_b if sensor == "w_ib_b" else found.imu.f_b
    assert np.array_equal(kept[2000:3000, 0], x[2000:3000, 0])  # the axis that measures is used


@pytest.mark.parametrize(("first", "taken"), [(0.0, False), (None, True)], ids=["zero", "held"])
def test_sensor_is_out_from_its_first_zero_or_first_repeat(
    first: float | None, taken: bool, rng: np.random.Generator
) -> None:
    """A zero in place of the weight is replaced in the very first sample; a value that is repeated was sound once."""
    table = log(rng, times(0.02, 2500, 0.0, rng), sway=0.0)
    table.f_b[2000:2300] = table.f_b[2000] if first is None else first
    found = screened(table, setup())
    assert np.all(found.imu.unknown[2001:2300, 1] > 0.0)
    assert abs(found.imu.f_b[2000, 2] + 9.81) < 0.2
    assert (found.imu.f_b[2000, 2] == table.f_b[2000, 2]) == taken


def test_gyros_back_after_long_begin_anew_and_accelerometers_do_not(rng: np.random.Generator) -> None:
    for sensor, cuts in (("w_ib_b", 1), ("f_b", 0)):
        table = log(rng, times(0.01, 9000, 0.0, rng))
        getattr(table, sensor)[2000:8000] = 0.0
        assert len(screened(table, setup()).cuts) == cuts


@pytest.mark.parametrize(("sensor", "size"), [("w_ib_b", 5.0), ("f_b", 100.0)])
def test_spikes_from_the_beginning_are_no_noise_of_the_log(
    sensor: str, size: float, rng: np.random.Generator
) -> None:
    """The first are among the samples by which the noise is learnt."""
    table = log(rng, times(0.02, 2500, 0.0, rng))
    hit = np.arange(5, 2500, 50)
    getattr(table, sensor)[hit, 1] += size
    left_out = np.setdiff1d(table.t_ns, screened(table, setup()).logged_ns)
    assert set(table.t_ns[hit[2:]]) <= set(left_out) <= set(table.t_ns[hit])


@pytest.mark.parametrize("value", [None, 0.0], ids=["held", "zero"])
@pytest.mark.parametrize(("sensor", "name"), [("w_ib_b", "gyros"), ("f_b", "accelerometers")])
def test_sensor_dead_from_the_beginning_is_out_and_begins_anew(
    sensor: str, name: str, value: float | None, rng: np.random.Generator
) -> None:
    """The other sensor shows that the log is not one without noise; what was levelled without it is not kept."""
    table = log(rng, times(0.01, 3000, 0.0, rng))
    x = getattr(table, sensor)
    x[:2000] = x[0] if value is None else value
    found = screened(table, setup())
    assert kinds(found) == ["imu_sensor_out", "imu_sensor_back", "restart"]
    assert f"the {name} (body axes x, y, z) hold" in found.events[0].detail
    assert f"the {name} are back" in found.events[2].detail
    column = 0 if sensor == "w_ib_b" else 1
    assert np.all(found.imu.unknown[WINDOW + 2 : 2000, column] > 0.0)
    assert [first for first, _ in found.cuts] == [2000]


def test_coarse_sensor_at_rest_is_not_out(rng: np.random.Generator) -> None:
    """Steps of its resolution larger than the noise: the same number for minutes, before and after a drive."""
    table = log(rng, times(0.01, 30_000, 0.0, rng), sway=0.0)
    moving = slice(10_000, 20_000)
    table.w_ib_b[moving] += 0.2 * np.sin(0.01 * np.arange(10_000))[:, None]
    table.f_b[moving] += np.sin(0.02 * np.arange(10_000))[:, None]
    coarse = ImuTable(table.t_ns, np.rint(table.w_ib_b / 0.004) * 0.004, np.rint(table.f_b / 0.1) * 0.1)
    for part in (slice(0, None), slice(9_000, None)):
        seen = ImuTable(coarse.t_ns[part], coarse.w_ib_b[part], coarse.f_b[part])
        assert screened(seen, setup()).events == []


def test_log_without_noise_is_not_out(rng: np.random.Generator) -> None:
    t_ns = times(0.01, 3000, 0.0, rng)
    w, f = np.zeros((3000, 3)), np.tile([0.0, 0.0, -9.81], (3000, 1))
    w[1000:2000, 2], f[1000:2000, 1] = 0.3, 3.0
    assert screened(ImuTable(t_ns, w, f), setup()).events == []


def test_sensor_at_its_range_is_saturated(rng: np.random.Generator) -> None:
    """At the declared 2000 deg/s, and where values are clipped at what nobody has declared."""
    for limit, grade in ((np.radians(2000.0), INDUSTRIAL), (0.15, TACTICAL)):
        table = log(rng, times(0.01, 4000, 0.0, rng))
        table.w_ib_b[1500:2500, 2] += np.linspace(0.0, 2.0 * limit, 1000)
        clipped = dataclasses.replace(table, w_ib_b=np.clip(table.w_ib_b, -limit, limit))
        events = [e for e in screened(clipped, setup(grade)).events if e.kind == "imu_sensor_out"]
        assert events and "at the end of their range" in events[-1].detail


# ------------------------------------------------------------------------------------------------------ as a stream


def spoilt(rng: np.random.Generator) -> ImuTable:
    """Return a log with everything that may go wrong, often at the same time."""
    table = log(rng, times(0.01, 12_000, 0.001, rng))
    w, f = table.w_ib_b, table.f_b
    for x, size in ((w, 10.0), (f, 300.0)):
        x[rng.integers(0, 12_000, 40), rng.integers(0, 3, 40)] += size
        x[rng.integers(0, 12_000, 20), rng.integers(0, 3, 20)] = np.nan
    w[3000:3100, 2] = w[3000, 2]
    f[3050:3400] = 0.0
    w[9000:11_000] = 0.0
    keep = np.ones(12_000, np.bool_)
    for first, n in ((1000, 3), (2500, 90), (5000, 300), (5301, 400), (8990, 20)):
        keep[first : first + n] = False
    keep[rng.integers(0, 12_000, 200)] = False
    return ImuTable(table.t_ns[keep], w[keep], f[keep])


def in_bits(cut: Cut) -> tuple[object, ...]:
    bridge = cut.bridge
    values = () if bridge is None else (bridge.t_ns, *(value.tobytes() for value in bridge[1:4]))
    return (*cut[:3], *values)


def test_stream_gives_the_samples_cuts_and_events_of_the_log(rng: np.random.Generator) -> None:
    table = spoilt(rng)
    whole, stream = screened(table, setup()), SampleStream(setup())
    found: list[Sample | Cut | Event] = []
    for sample in zip(table.t_ns.tolist(), table.w_ib_b, table.f_b, strict=True):
        found += stream.take(*sample)
    samples = [one for one in found if isinstance(one, Sample)]
    assert whole.imu.t_ns.tolist() == [one.t_ns for one in samples]
    assert whole.imu.w_ib_b.tobytes() == np.array([one.w_ib_b for one in samples]).tobytes()
    assert whole.imu.f_b.tobytes() == np.array([one.f_b for one in samples]).tobytes()
    assert whole.imu.unknown.tobytes() == np.array([one.unknown for one in samples]).tobytes()
    assert whole.logged_ns.tolist() == [one.t_ns for one in samples if one.logged]
    cuts = [one for one in found if isinstance(one, Cut)]
    assert [in_bits(cut) for _, cut in whole.cuts] == [in_bits(cut) for cut in cuts]
    assert any(cut.bridge is not None and cut.bridge.unknown.all() for cut in cuts)
    assert whole.events == [one for one in found if isinstance(one, Event)]
    assert len(whole.cuts) >= 3 and {"imu_gap", "imu_bad_sample", "imu_spike", "imu_sensor_out"} <= set(
        kinds(whole)
    )
    firsts = [int(np.searchsorted(whole.imu.t_ns, cut.next_ns)) for _, cut in whole.cuts]
    assert firsts == [first for first, _ in whole.cuts]


ZERO = np.zeros(3)


def passed(guard: TagGuard, tags_ms: list[int]) -> tuple[list[int], list[Event]]:
    """Return the tags [ms] that a guard lets through, and its events."""
    through, events = [], []
    for tag in tags_ms:
        found = guard.take(tag * 1_000_000, ZERO, ZERO)
        through += [sample[0] // 1_000_000 for sample in found.samples]
        events += found.events
    return through, events


@pytest.mark.parametrize("wild", [10**9, 5000, -(10**9), 3])
def test_single_wild_tag_is_refused_and_told_once(wild: int) -> None:
    tags = [*range(0, 1000, 10), wild, *range(1000, 3000, 10)]
    through, events = passed(TagGuard(), tags)
    assert through == list(range(0, 3000, 10))
    assert [event.kind for event in events] == ["imu_refused"]


def test_tag_after_a_gap_goes_on_with_the_next_one() -> None:
    tags = [*range(0, 1000, 10), *range(9000, 9500, 10), 20_000, *range(40_000, 41_000, 10)]
    through, events = passed(TagGuard(), tags)
    assert through == tags and events == []


def test_wild_tags_that_were_believed_are_given_up_when_the_old_ones_go_on() -> None:
    tags = [*range(0, 1000, 10), 10**9, 10**9 + 10, *range(1000, 4000, 10)]
    through, events = passed(TagGuard(), tags)
    assert [event.kind for event in events] == ["imu_refused", "restart"]
    assert through[-300:] == list(range(1000, 4000, 10)) and len(through) == 402
