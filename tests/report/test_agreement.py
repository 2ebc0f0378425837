"""One judgement in one place: the page, the summaries and the consistency study say the same of a run."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest

from insgnss.report.sentences import sentences
from insgnss.runs.agreement import heading_of, times_their_sigma
from insgnss.runs.result import Run
from insgnss.studies.consistency.study import consistency_study
from tests.report.runs import START_S, made_run

KNOWN_S = START_S + 20.0  # of ``made_run``


def told(run: Run) -> tuple[str, str]:
    """Return the page's sentences and the consistency study's verdict, each as one text."""
    return " ".join(sentences(run)), "; ".join(consistency_study(run).verdict)


def with_sigma_of_yaw(run: Run, first: float, last: float) -> Run:
    sigma = np.linspace(first, last, len(run.nav))
    return dataclasses.replace(run, nav=run.nav.assign(sd_yaw_deg=sigma))


def without_heading_known(run: Run) -> Run:
    return dataclasses.replace(run, events=run.events[run.events["kind"] != "heading_known"])


def test_summaries_begin_where_the_heading_was_known() -> None:
    run = made_run()
    assert run.errors is not None
    before = run.errors["time_s"] < KNOWN_S
    wild = dataclasses.replace(run, errors=run.errors.assign(d_yaw_deg=np.where(before, 90.0, 0.5)))

    assert wild.error_summary().loc["yaw_deg", "rms"] == pytest.approx(0.5)
    assert wild.error_summary(from_s=-math.inf).loc["yaw_deg", "rms"] > 10.0


def test_summary_is_of_the_whole_reference_where_the_heading_was_known_after_it() -> None:
    run = made_run()
    late = run.events.assign(
        time_s=np.where(run.events["kind"] == "heading_known", 1e6, run.events["time_s"])
    )

    assert len(dataclasses.replace(run, events=late).error_summary()) == len(run.error_summary())


def test_nis_is_that_of_the_consistency_study() -> None:
    run = made_run()
    kinds = consistency_study(run).kinds.set_index("kind")

    assert run.nis_summary()["mean_nis"].to_dict() == pytest.approx(kinds["mean_nis"].to_dict())
    assert run.nis_summary(from_s=-math.inf)["used"].sum() > run.nis_summary()["used"].sum()


@pytest.mark.parametrize("scale", [1.0, math.sqrt(1.28), 0.7])
def test_page_and_study_say_the_same_of_the_innovations(scale: float) -> None:
    run = made_run()
    ledger = run.measurements
    ledger = ledger.assign(nis=ledger["nis"] * scale**2, innovation=ledger["innovation"] * scale)
    page, verdict = told(dataclasses.replace(run, measurements=ledger))
    for kind, row in dataclasses.replace(run, measurements=ledger).nis_summary().iterrows():
        words = f"{str(kind).replace('_', ' ')} innovations {times_their_sigma(math.sqrt(row['mean_nis']))}"
        assert words in page and words in verdict


@pytest.mark.parametrize(("first", "last", "lost"), [(90.0, 1.0, False), (90.0, 8.0, True)])
def test_page_and_study_say_the_same_of_a_heading_that_became_known(
    first: float, last: float, lost: bool
) -> None:
    run = with_sigma_of_yaw(made_run(), first, last)
    page, verdict = told(run)

    assert heading_of(run).known_s == KNOWN_S and heading_of(run).is_lost is lost
    assert f"became known 20.0 s after the start, at {KNOWN_S:.1f} s" in page
    assert f"heading known from t = {KNOWN_S:g} s" in verdict
    assert ("lost again" in page) is ("lost again" in verdict) is lost


def test_page_and_study_say_the_same_of_a_heading_that_was_given_or_never_known() -> None:
    given = without_heading_known(with_sigma_of_yaw(made_run(), 2.0, 1.0))
    never = without_heading_known(with_sigma_of_yaw(made_run(), 90.0, 40.0))

    assert "given at the start" in told(given)[0] and f"known from t = {START_S:g} s" in told(given)[1]
    assert "never became known" in told(never)[0] and "heading never known" in told(never)[1]
    yaw = consistency_study(never).observability.set_index("state").loc["yaw_deg"]
    assert pd.isna(yaw["known_s"])
