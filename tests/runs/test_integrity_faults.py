"""The faults that protection levels bound: counted per epoch; the others are no more probable than is taken off."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.config.integrity import Integrity
from insgnss.constants import NS_PER_S
from insgnss.filter.output.writing import new_ledger
from insgnss.filter.whole_log import LedgerPart
from insgnss.gnss.carrier_rows import CARRIER_DTYPE
from insgnss.gnss.observation_rows import N_BANDS, OBSERVATION_DTYPE, GnssRows, satellite_name
from insgnss.runs.integrity.alerts import Separations, alert_events, epoch_misfit, fault_table
from insgnss.runs.integrity.faults import Fault, FaultModel, fault_model, satellites_in_view
from insgnss.status import SWITCHED_OFF, USED
from tests.statistics_bounds import share_below_bounds

NUMBERS = {satellite_name(number): number for number in range(240)}


def rows_of(epochs: list[tuple[float, list[str]]]) -> GnssRows:
    """Return rows of one signal a satellite: time [s] and names at each epoch."""
    names = [name for _, here in epochs for name in here]
    observation = np.zeros(len(names), OBSERVATION_DTYPE)
    observation["slot"] = [NUMBERS[name] * N_BANDS for name in names]
    observation["status"] = USED
    epoch_ns = np.array([round(time_s * NS_PER_S) for time_s, _ in epochs], np.int64)
    first = np.concatenate([[0], np.cumsum([len(here) for _, here in epochs])])
    none = np.zeros((0, 8))
    return GnssRows(
        epoch_ns, first, observation, none, np.zeros(8), np.zeros(0, CARRIER_DTYPE), none, epoch_ns
    )


def satellites(letters: str, count: int) -> list[str]:
    """Return the names of as many satellites of each constellation."""
    return [f"{letter}{number:02d}" for letter in letters for number in range(1, count + 1)]


def in_view_of(model_blocks: list[GnssRows]) -> list[int]:
    """Return how many satellites count as in view at each epoch."""
    epoch_ns = np.concatenate([rows.epoch_ns for rows in model_blocks])
    return [int(n) for n in satellites_in_view(model_blocks, epoch_ns)[1].sum(axis=0)]


def test_satellites_are_counted_at_each_epoch_and_not_over_the_log() -> None:
    """Sixty satellites over a log, thirty at once: in view for a minute before and after, in an outage as before it."""
    early, late = satellites("G", 30), satellites("E", 30)
    times = [0.0, 100.0, 200.0, 300.0, 330.0, 500.0, 900.0]
    rows = rows_of([(t, early if t < 310.0 else late if t < 600.0 else []) for t in times])
    assert in_view_of([rows]) == [30, 30, 30, 60, 60, 30, 30]
    two = [rows_of([(0.0, early), (100.0, early)]), rows_of([(200.0, late)])]
    assert in_view_of(two) == [30, 30, 30]
    rows.observation["status"] = SWITCHED_OFF
    assert in_view_of([rows]) == [0] * 7
    assert fault_model([rows], Integrity()).faults == []


def test_one_constellation_takes_its_pairs_off_the_risk_at_each_epoch() -> None:
    few, many = satellites("G", 10), satellites("G", 32)
    model = fault_model([rows_of([(0.0, few), (200.0, many)])], Integrity())
    assert model.unmonitored == pytest.approx([45e-10, 496e-10])
    assert model.unmonitored_at(np.array([-1, 0, 10, 200, 999]) * NS_PER_S) == pytest.approx(
        [45e-10] * 3 + [496e-10] * 2
    )
    assert [fault.name for fault in model.faults] == many


@pytest.mark.parametrize("count", [8, 12, 15])
def test_modern_receiver_keeps_half_of_its_risk(count: int) -> None:
    """Four constellations of up to 15 satellites: 60 in view; pairs of constellations are monitored when needed."""
    model = fault_model([rows_of([(0.0, satellites("GECR", count))])], Integrity())
    assert model.unmonitored.max() <= 0.5e-7
    pairs = [fault for fault in model.faults if "+" in fault.name]
    assert bool(pairs) == (count > 8)
    for pair in pairs:
        assert len(pair.satellites) == 2 * count
        assert pair.probability == pytest.approx((count * 1e-5 + 1e-6) ** 2)
    assert len({fault.name for fault in model.faults}) == len(model.faults)


def test_pair_that_leaves_no_solution_is_not_monitored() -> None:
    model = fault_model([rows_of([(0.0, [*satellites("GE", 30), "C01", "C02"])])], Integrity())
    assert not any(fault.name == "E+G" for fault in model.faults)
    assert model.unmonitored[0] > 0.5e-7


@pytest.mark.parametrize(
    ("letters", "count", "p", "q"),
    [("G", 9, 0.02, 0.01), ("GE", 6, 0.02, 0.01), ("GECR", 5, 0.02, 0.01), ("GEC", 7, 0.01, 0.03)],
)
def test_faults_that_are_drawn_are_monitored_or_as_rare_as_is_taken_off_the_risk(
    rng: np.random.Generator, letters: str, count: int, p: float, q: float
) -> None:
    """Each draw is of one fault of the model, or of none; each as rare as the model has it."""
    names, n = satellites(letters, count), 200_000
    config = Integrity(risk=2e-3, satellite_fault=p, constellation_fault=q)
    model = fault_model([rows_of([(0.0, names)])], config)
    numbers = np.array([NUMBERS[name] for name in names])
    of_constellation = np.array([name[0] for name in names])
    faulty = rng.uniform(size=(n, len(names))) < p
    for letter in letters if len(letters) > 1 else "":
        faulty |= (rng.uniform(size=n) < q)[:, None] & (of_constellation == letter)
    explained = ~faulty.any(axis=1)
    for fault in sorted(model.faults, key=lambda fault: len(fault.satellites)):
        # by the smallest set of satellites that holds all faulty ones
        by_fault = ~explained & ~faulty[:, ~np.isin(numbers, fault.satellites)].any(axis=1)
        assert by_fault.mean() <= share_below_bounds(min(fault.probability, 1.0), n)[1]
        explained |= by_fault
    assert (~explained).mean() <= share_below_bounds(min(float(model.unmonitored[0]), 1.0), n)[1]


def separations(d: dict[str, list[float]], misfit: dict[str, float]) -> Separations:
    """Return separations north, in limits of 1 m, of each fault, and the misfit of its sub-filter at each epoch."""
    faults = [Fault(name, np.array([NUMBERS[name]]), 1e-5) for name in d]
    values = np.zeros((len(d), 3, len(next(iter(d.values())))))
    values[:, 0] = list(d.values())
    t_ns = np.arange(values.shape[2])
    misfits = np.repeat([[misfit.get(name, 0.0)] for name in d], len(t_ns), axis=1)
    return Separations(faults, values, np.ones(values.shape), t_ns, t_ns.astype(np.float64), misfits, t_ns)


def test_alert_names_the_suspect_and_the_satellites_it_drags_along() -> None:
    """The healthy G02 exceeds its limit by more; without G03 the other measurements agree. G01 has no alert."""
    d = {"G01": [0.0] * 6, "G02": [0, 1.5, 20, 20, 0, 0], "G03": [0, 1.2, 5, -9, 0, 3]}
    both = separations(d, {"G01": -99.0, "G02": 7.0, "G03": -9.0})
    (event,) = alert_events(both)
    assert event.detail.startswith("suspect G03: ") and "-9.00 m n at 3.0 s" in event.detail
    assert event.detail.endswith("due to the suspect: G02") and "alert in 4 row(s)" in event.detail
    assert event.t_ns == 1
    assert fault_table(both)["alert_rows"].tolist() == [0, 3, 4]


def test_misfit_is_that_of_the_other_measurements_and_two_for_each_that_is_left_out() -> None:
    """Two epochs of three satellites; G02 is left out in the second run, which predicts the others ten times better."""
    rows = rows_of([(0.0, satellites("G", 3)), (1.0, satellites("G", 3))])
    full, sub = (LedgerPart(*new_ledger(rows)) for _ in range(2))
    full.entries["innovation"], full.entries["variance"] = 10.0, 4.0
    sub.entries["innovation"], sub.entries["variance"] = 1.0, 5.0
    sub.entries["innovation"][1::3] = sub.entries["variance"][1::3] = np.nan
    each = 2 * (1.0 / 5.0 + np.log(5.0 / 4.0)) + 2.0 - 3 * 25.0
    assert epoch_misfit([rows], [sub], [full]) == pytest.approx([2 * each, 2 * each])  # codes and rates
    assert epoch_misfit([], [], []).tolist() == []


def test_satellite_is_preferred_to_its_constellation_where_both_explain_the_rest() -> None:
    """Three satellites of one constellation, the first of them wrong, and three of another."""
    rows = rows_of([(0.0, satellites("GE", 3))])
    full, satellite, constellation = (LedgerPart(*new_ledger(rows)) for _ in range(3))
    for part, left_out in ((full, 0), (satellite, 1), (constellation, 3)):
        part.entries["innovation"], part.entries["variance"] = 0.9, 1.0
        part.entries["innovation"][:left_out] = np.nan
    full.entries["innovation"][0] = 20.0
    misfits = [epoch_misfit([rows], [part], [full])[0] for part in (satellite, constellation)]
    assert misfits[0] < misfits[1] < 0.0


def test_alerts_of_two_suspects_at_two_times_are_two_events() -> None:
    events = alert_events(separations({"G01": [0, 0, 0, 0, 7], "G02": [0, 3, 0, 0, 0.5]}, {}))
    assert [event.detail[:11] for event in events] == ["suspect G01", "suspect G02"]
    assert [event.t_ns for event in events] == [4, 1]


def test_no_alert_and_no_solution_give_no_event() -> None:
    one = separations({"G01": [0.5, np.nan, 0.2]}, {})
    assert alert_events(one) == []
    assert fault_table(one)["rows_without"].tolist() == [1]


def test_model_without_epochs_has_nothing_unmonitored() -> None:
    assert (
        FaultModel([], np.zeros(0, np.int64), np.zeros(0)).unmonitored_at(np.arange(3)).tolist() == [0.0] * 3
    )
