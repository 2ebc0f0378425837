"""The four cases over the same flights: what is asked of each is what physics and the stage's own rules demand."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from insgnss.config.library import scenario_config
from insgnss.errors import ConfigError
from insgnss.studies import MaskingStudy, masking_study
from insgnss.studies.masking.banked_flight import BankedFlight
from insgnss.studies.masking.cases import CASES, fly
from insgnss.studies.masking.study import STUDY_SEED
from insgnss.studies.scenario_equipment import filter_of, without_fault_tests
from tests.statistics_bounds import mean_chi_square_bounds

RUNS = 2
FLIGHTS = 16  # of the two cases with the stage
FROM_S, UNTIL_S = 35.0, 55.0  # the outage of those: as long as the scenario's, 45 s earlier
ENDED_S = 56.0  # what they are looked at for is over
GUARDS = scenario_config("sokolov_2015").search.guards
TICK_S = 1.0 / scenario_config("sokolov_2015").channels.supervisor_rate_hz
SWEEP_S = 3.163
HONEST_SIGMAS = 5.0  # of the distance from the truth: one in 10^5 for the shortest of its axes alone


@cache
def study() -> MaskingStudy:
    return masking_study(runs=RUNS)


@cache
def study_without_fault_tests() -> MaskingStudy:
    return masking_study(runs=1, fault_tests=False)


def of(table: pd.DataFrame, case: str) -> pd.DataFrame:
    """Return one case's rows."""
    return table[table["case"] == case].reset_index(drop=True)


def case_row(name: str, of_study: MaskingStudy | None = None) -> pd.Series:
    """Return the row of a case in the table of cases."""
    return (of_study or study()).cases.set_index("case").loc[name]


def test_elevation_mask_cannot_know_of_the_bank_and_changes_no_bit() -> None:
    # all eleven stand above 13 deg over the horizon, banked or not
    for table in ("errors", "rows", "reacquisition"):
        a, b = (of(getattr(study(), table), case).drop(columns="case") for case in "ab")
        pd.testing.assert_frame_equal(a, b, check_exact=True)


def test_unsupervised_receiver_makes_the_same_false_rows_whatever_the_filter_does() -> None:
    counts = [case_row(case) for case in "abc"]

    assert len({row["false_rows"] for row in counts}) == 1
    assert counts[0]["false_rows"] > 100 * RUNS  # four false locks of some 20 s, two kinds
    for row in counts:
        assert row["believed"] + row["refused"] == row["false_rows"]
    locks = study().false_locks
    assert (locks["believed"] + locks["refused"] == locks["rows"]).all()


def test_stage_refuses_every_false_row_but_those_at_the_edges_of_the_bank() -> None:
    rows = of(study().rows, "c")
    false = rows[rows["lock"] != ""]
    lost = of(study().reacquisition, "c").query("run == 0").set_index("sv")
    since_lost = false["time_s"] - false["sv"].map(lost["lost_s"])
    to_return = false["sv"].map(lost["returned_s"]) - false["time_s"]

    # rolling in at 41 deg/s takes the gain past what the attitude's sigma leaves open within half a second
    inside = (since_lost > 0.5) & (to_return > 0.0)
    assert (false.loc[inside, "status"] == "masked_gain").all()
    assert case_row("c")["believed"] < 0.02 * case_row("c")["false_rows"]


def test_false_lock_is_believed_without_the_stage_and_not_with_it() -> None:
    coasting = study().false_locks.set_index(["case", "lock", "kind"])["believed"]

    # it begins without an offset, and range and rate agree: no test of a single row sees it
    assert coasting["a", "coasting", "pseudorange"] > 0.5 * 20 * RUNS
    assert coasting["c", "coasting", "pseudorange"] <= RUNS
    # 7 to 22 m off in the end, unless the others contradict its rate; a weak signal's range counts little, but the
    # position is still off when the satellites are back
    assert case_row("a")["rms_after_m"] > 1.5 * case_row("c")["rms_after_m"]


@pytest.mark.parametrize("case", ["c", "d"])
def test_masked_flight_stays_within_the_filters_own_sigma(case: str) -> None:
    errors = of(study().errors, case)
    late = errors[errors["time_s"] > 30.0]

    assert (late["error_m"] / late["sd_m"]).max() < HONEST_SIGMAS


def test_without_fault_tests_the_unmasked_flight_leaves_the_filters_own_sigma() -> None:
    errors = of(study_without_fault_tests().errors, "a")

    assert (errors["error_m"] / errors["sd_m"]).max() > HONEST_SIGMAS


def test_supervised_receiver_makes_no_false_row_and_loses_no_true_one() -> None:
    assert case_row("d")[["false_rows", "believed", "refused", "true_refused"]].tolist() == [0, 0, 0, 0]
    times = of(study().rows, "d").query("kind == 'pseudorange'").groupby("sv").size()
    # once a second, but for the 20 to 24 s of each satellite's spell
    assert times.between(239 - 25, 239 - 20).all()


def test_supervised_satellite_is_measured_again_after_guard_detection_and_pull_in() -> None:
    found = of(study().reacquisition, "d")

    assert set(found["how"]) == {"supervised"}
    assert len(found) == 5 * RUNS
    # visible long enough, one accumulation of 3.4 ms, loops pulled in; each told at a tick of the supervisor
    least = GUARDS.rise_s + GUARDS.pull_in_s
    assert found["delay_s"].min() >= least - 1e-9
    # a detection that was too early costs another
    assert found["delay_s"].max() <= least + 6.0 * TICK_S
    assert found["search_s"].max() < 0.1


def test_unsupervised_satellite_comes_back_as_its_channel_stands() -> None:
    found = of(study().reacquisition, "a").set_index("how")

    np.testing.assert_allclose(found.loc[["captured"], "delay_s"], GUARDS.pull_in_s, atol=1e-6)
    assert found["delay_s"].max() <= 0.5 + SWEEP_S + GUARDS.pull_in_s + 1e-3
    assert found.loc[["searched"], "in_vain_s"].min() > 20.0
    busy = found["search_s"] + found["false_lock_s"]
    assert (busy > found["returned_s"] - found["lost_s"] - 1e-6).all()


def test_sweep_is_that_of_the_paper_and_falls_with_the_sensitivity() -> None:
    sweeps = study().sweeps.set_index("cn0_dbhz")["sweep_s"]

    # ten looks of 10, 31.6, 100, 316 ms
    np.testing.assert_allclose(sweeps.loc[[35.0, 30.0, 25.0, 20.0]], [0.1, 0.316, 1.0, 3.16], rtol=2e-3)


def test_same_seed_gives_the_same_tables_and_another_seed_others() -> None:
    first = study().errors[study().errors["run"] == 0].reset_index(drop=True)
    other = masking_study(runs=1, seed=7, fault_tests=False)  # without the tests it is three times as fast

    pd.testing.assert_frame_equal(masking_study(runs=1).errors, first, check_exact=True)
    assert not np.array_equal(other.errors["error_m"], study_without_fault_tests().errors["error_m"])


def test_filter_without_fault_tests_believes_what_no_mask_refuses() -> None:
    plain = study_without_fault_tests()

    # second looks at the last minute are tests, too
    assert not without_fault_tests(filter_of(scenario_config("sokolov_2015"))).health.recovery

    assert case_row("a", plain)["refused"] == 0
    # a false row of 150 m or more among ten of 2 m
    assert case_row("a", plain)["max_during_m"] > 50.0
    assert set(of(plain.false_locks, "c")["statuses"].str.replace(r" \d+", "", regex=True)) <= {
        "masked_gain",
        "masked_gain, used",
    }
    # without a false row there is nothing that the tests could refuse
    with_tests = study().errors.query("case == 'd' and run == 0")["error_m"].max()
    assert case_row("d", plain)["max_during_m"] < 2.0 * with_tests


def test_study_is_saved_with_tables_settings_and_three_pictures(tmp_path: Path) -> None:
    study().save(tmp_path)

    tables = ("cases", "false_locks", "reacquisition", "errors", "rows", "sweeps", "decisions")
    expected = {f"masking_{name}.csv" for name in tables} | {"masking_settings.json"}
    expected |= {f"masking_{name}.png" for name in ("errors", "rows", "reacquisition")}
    assert {path.name for path in tmp_path.glob("[!.]*")} == expected
    panels = study().rows_figure().axes
    assert [axes.get_title(loc="left")[:3] for axes in panels] == ["(a)", "(b)", "(c)", "(d)"]
    for axes in panels:
        names = [label.get_text().split(",")[0] for label in axes.get_yticklabels()]
        assert names == ["G01", "G16", "G30", "G31", "G32"]
    assert study().error_figure().axes[0].get_ylabel().startswith("position error, m")


def test_wrong_requests_are_told() -> None:
    scenario = scenario_config("sokolov_2015")
    level = scenario.bank.model_copy(update={"roll_deg": -1.0})

    with pytest.raises(ConfigError, match="hides no satellite"):
        masking_study(scenario.model_copy(update={"bank": level}), runs=1)
    with pytest.raises(ConfigError, match="number of runs 0"):
        masking_study(runs=0)


@pytest.mark.slow
def test_error_at_the_end_of_the_outage_is_what_the_covariance_says_over_many_flights() -> None:
    whole = scenario_config("sokolov_2015")
    shorter = whole.flight.model_copy(update={"duration_s": ENDED_S})
    earlier = whole.outage.model_copy(update={"from_s": FROM_S, "until_s": UNTIL_S})
    scenario = whole.model_copy(update={"flight": shorter, "outage": earlier})
    flight = BankedFlight.of(scenario, scenario.equipment.imu, scenario.equipment.oscillator)
    masked = [case for case in CASES if case.stage]
    flown = [
        fly(flight, filter_of(scenario), np.random.default_rng([STUDY_SEED, run]), masked)
        for run in range(FLIGHTS)
    ]

    rms = []
    for case in range(len(masked)):
        errors = pd.concat([results[case].errors for results in flown])
        end = errors[errors["time_s"] == UNTIL_S]
        # one axis carries most of the variance while five satellites are gone: one degree of freedom each
        low, high = mean_chi_square_bounds(1, len(end))
        assert low <= float(np.mean((end["error_m"] / end["sd_m"]) ** 2)) <= high
        rms.append(np.sqrt(np.mean(errors.loc[errors["time_s"].between(FROM_S, UNTIL_S), "error_m"] ** 2)))
    # the same five are hidden with the same rows left: what supervision gains is not in the position
    assert rms[1] == pytest.approx(rms[0], rel=0.1)
