"""Figures for papers: units on every axis, vectors, the same bytes each time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from IPython.core.formatters import DisplayFormatter
from PIL import Image

from insgnss.errors import ConfigError, ResultError
from insgnss.report import figures
from tests.report.runs import made_run


def drawn() -> dict[str, figures.Figure]:  # type: ignore[name-defined]
    run = made_run()
    made = {f"errors {g}": figures.errors(run, g) for g in ("position", "velocity", "attitude")}
    made |= {k: figures.innovations(run, k) for k in ("pseudorange", "range_rate")}
    return made | {"track": figures.track(run), "satellites": figures.satellites(run)}


def test_every_axis_has_a_label_with_its_unit() -> None:
    for name, figure in drawn().items():
        for axes in figure.axes:
            if axes.get_label() == "<colorbar>" or (axes.get_xlabel() == "" and axes is not figure.axes[-1]):
                assert ", " in axes.get_ylabel(), name  # of rows above the last, whose times are below
                continue
            assert ", " in axes.get_xlabel(), name
            assert ", " in axes.get_ylabel() or axes.get_ylabel() == "satellite", name


def test_errors_are_drawn_as_they_are_within_three_sigma() -> None:
    run = made_run()

    axes = figures.errors(run, "position").axes[0]

    assert np.array_equal(axes.lines[0].get_ydata(), run.errors["d_n_m"])
    top = axes.collections[0].get_paths()[0].vertices[:, 1].max()
    assert top == pytest.approx(3.0 * run.errors["sd_n_m"].max())


def test_style_is_that_of_the_module_and_does_not_leak() -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)

    axes = figures.errors(made_run(), "position").axes[0]

    assert axes.yaxis.label.get_fontsize() == figures.STYLE["axes.labelsize"]
    assert axes.lines[0].get_linewidth() == figures.STYLE["lines.linewidth"]
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize(("ending", "begins"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_saved_figures_are_vectors_and_the_same_bytes_each_time(
    ending: str, begins: bytes, tmp_path: Path
) -> None:
    run = made_run()

    first = figures.save_figures(run, tmp_path / "a", ending)
    second = figures.save_figures(run, tmp_path / "b", ending)

    assert {path.stem for path in first} == {
        *("track", "errors_position", "errors_velocity", "errors_attitude"),
        *("innovations_pseudorange", "innovations_range_rate", "satellites"),
    }
    for one, two in zip(first, second, strict=True):
        assert one.read_bytes().startswith(begins)
        assert one.read_bytes() == two.read_bytes()
    if ending == "svg":
        assert b">north, m</text>" in (tmp_path / "a" / "errors_position.svg").read_bytes()


def test_figures_that_the_run_has_nothing_for_are_refused(tmp_path: Path) -> None:
    run = made_run(reference=False)

    with pytest.raises(ResultError, match="no reference"):
        figures.errors(run)
    with pytest.raises(ConfigError, match="unknown group"):
        figures.errors(made_run(), "clock")
    with pytest.raises(ResultError, match="no carrier_difference was used"):
        figures.innovations(run, "carrier_difference")
    with pytest.raises(ConfigError, match="unsupported figure format"):
        figures.save(figures.track(run), tmp_path / "track.xyz")


def test_figure_shows_itself_in_a_notebook_that_has_not_loaded_pyplot(tmp_path: Path) -> None:
    data, _ = DisplayFormatter().format(figures.track(made_run()))

    (tmp_path / "shown.png").write_bytes(data["image/png"])
    with Image.open(tmp_path / "shown.png") as shown:
        assert min(shown.size) > 200
