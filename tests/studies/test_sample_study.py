"""A short flight through receivers on samples: position, aiding against none, searches, tables, bad input."""

from __future__ import annotations

import contextlib
import json
import math
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from typer.testing import CliRunner

from insgnss.cli.iq import _table
from insgnss.cli.main import app
from insgnss.config.library import find
from insgnss.config.sample_receiver import SampleReceiver
from insgnss.errors import ConfigError, InputError
from insgnss.log.iq_file import IqFile
from insgnss.runs.simulate import Simulation, simulate
from insgnss.studies.samples.design import loop_designs, loop_sigmas
from insgnss.studies.samples.search import acquire_recording
from insgnss.studies.samples.study import SampleStudy, record_samples, sample_receiver
from insgnss.tracking.codes import gps_ca
from insgnss.tracking.signal import Sampling

# the lowest sampling rate that holds the main lobe: a second of eight satellites takes a quarter of a second
SETTINGS = SampleReceiver(rate_hz=2.2e6, looks=100)
QUICK = SampleReceiver(rate_hz=2.2e6, looks=20, drop_after_s=1.0)
SECONDS = 10.0
LOSS_DB = 11.0
SATELLITES = {"G02", "G05", "G07", "G12", "G15", "G21", "G25", "G29"}
# reversals of bank at 180 deg/s one after the other: at 22 dBHz nine of ten unaided channels end far from their signal
# (simulated on correlators), at 33 dBHz none slips
REVERSAL = '[[manoeuvre]]\nkind = "s_turn"\nby_deg = {}\nbank_deg = 75.0\nroll_in_deg_per_s = 180.0\n'
REVERSALS = REVERSAL.format(25.0) + REVERSAL.format(-25.0)


@cache
def scenario_text() -> str:
    """Return the library's scenario with its manoeuvres replaced."""
    text = find("scenarios", "steep_turns").read_text(encoding="utf-8").replace("180.0", "300.0", 1)
    straight = '[[manoeuvre]]\nkind = "straight"\nduration_s = 3.0\n'
    return text[: text.index("[[manoeuvre]]")] + straight + REVERSALS + text[text.index("[imu]") :]


@cache
def flown() -> Simulation:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "reversals.toml"
        path.write_text(scenario_text(), encoding="utf-8")
        return simulate(path, duration_s=SECONDS)


@cache
def study() -> SampleStudy:
    return sample_receiver(flown(), losses_db=(LOSS_DB,), duration_s=SECONDS, settings=SETTINGS, seed=3)


def rows(table: pd.DataFrame, receiver: str) -> pd.DataFrame:
    return table[table["receiver"] == receiver]


def test_aided_receiver_holds_every_signal_where_the_unaided_one_loses_them() -> None:
    aided, unaided = (rows(study().summary, name).iloc[0] for name in ("aided", "unaided"))
    assert aided["on_signal_at_end"] == 8.0
    assert unaided["on_signal_at_end"] <= 4.0
    assert aided["position_rms_m"] < unaided["position_rms_m"]


def test_position_errors_fit_their_sigma() -> None:
    epochs = rows(study().epochs, "aided").iloc[-1]
    for axis in "ned":
        assert abs(epochs[f"error_{axis}_m"]) < 4.0 * epochs[f"sd_{axis}_m"] < 80.0
        assert abs(epochs[f"error_v{axis}_mps"]) < 4.0 * epochs[f"sd_v{axis}_mps"] < 4.0


def test_readings_of_channels_on_their_signal_have_the_loops_error() -> None:
    channels = rows(study().channels, "aided")
    settled = channels[channels["locked"] & (channels["time_s"] > channels["time_s"].min() + 2.0)]
    error, count = settled["delay_error_m"], len(settled)
    design, _ = loop_designs(SETTINGS, SETTINGS.aided, gps_ca(1), 33.0 - LOSS_DB)
    sigma_m, _ = loop_sigmas(design, 33.0 - LOSS_DB)
    low, high = stats.chi2.ppf([5e-4, 1.0 - 5e-4], count) / count
    assert count > 30
    assert abs(error.mean()) < 4.0 * sigma_m / np.sqrt(count)
    assert low < float((error**2).mean()) / sigma_m**2 < high


def test_seeded_search_looks_at_few_cells_and_both_find_the_signals() -> None:
    first = study().searches[study().searches["time_s"] < study().searches["time_s"].min() + 0.1]
    seeded, blind = (rows(first, name) for name in ("aided", "unaided"))
    assert len(seeded) == len(blind) == 8
    assert seeded["cells"].max() < blind["cells"].min() / 50
    assert (seeded["threshold"] < blind["threshold"].min()).all()
    assert seeded["found"].all()
    assert blind["found"].all()
    for table in (seeded, blind):
        assert table["delay_error_chips"].abs().max() < 0.3
        assert table["doppler_error_hz"].abs().max() < 15.0


def test_recording_and_threads_change_no_number(tmp_path: Path) -> None:
    path, settings = tmp_path / "a.iq", QUICK.model_copy(update={"looks": 10})
    record_samples(flown(), path, 0.0, 2.2, settings, seed=5)
    both = [
        sample_receiver(
            flown(),
            losses_db=(0.0,),
            duration_s=2.2,
            settings=settings,
            seed=5,
            recording=source,
            threads=threads,
        )
        for source, threads in ((None, 2), (path, 1))
    ]
    assert (both[0].channels.groupby("receiver")["locked"].sum() == 8).all()
    for name in ("epochs", "channels"):
        pd.testing.assert_frame_equal(getattr(both[0], name), getattr(both[1], name))
    with pytest.raises(ConfigError, match="one recording for 2 losses"):
        sample_receiver(flown(), duration_s=2.2, settings=settings, recording=path)


def test_satellites_that_come_back_are_found_in_the_supervisors_window(tmp_path: Path) -> None:
    outage = '[[fault]]\nkind = "outage"\nsv = ["G05", "G25"]\nfrom_s = 4.0\nto_s = 7.0\n'
    (tmp_path / "outage.toml").write_text(scenario_text() + outage, encoding="utf-8")
    flight = simulate(tmp_path / "outage.toml", duration_s=SECONDS)
    made = sample_receiver(flight, losses_db=(0.0,), duration_s=SECONDS, receivers=("aided",), settings=QUICK)
    later = made.searches[made.searches["time_s"] > made.searches["time_s"].min() + 1.0]
    found = later[later["found"]]
    assert set(later["sv"]) == set(found["sv"]) == {"G05", "G25"}
    # the first search had the uncertain clock in its window, these have the filter's sigma
    assert later["cells"].max() < made.searches["cells"].iloc[0] / 50
    assert found["delay_error_chips"].abs().max() < 0.3
    states = made.channels[made.channels["sv"].isin(["G05", "G25"])]
    assert {"track", "search"} <= set(states["supervisor"])
    assert (states["time_s"][states["locked"]].max() - states["time_s"].max()) == 0.0


def test_study_is_saved_with_its_picture(tmp_path: Path) -> None:
    folder = study().save(tmp_path / "out")
    names = {
        "summary.csv",
        "epochs.csv",
        "channels.csv",
        "searches.csv",
        "settings.json",
        "sample_receiver.png",
    }
    assert names <= {path.name for path in folder.iterdir()}
    again = pd.read_csv(folder / "summary.csv")
    assert list(again["receiver"]) == ["aided", "unaided"]
    settings = json.loads((folder / "settings.json").read_text(encoding="utf-8"))
    assert SampleReceiver(**settings["settings"]) == SETTINGS
    assert (settings["seed"], settings["losses_db"], settings["duration_s"]) == (3, [LOSS_DB], SECONDS)
    assert settings["receivers"] == ["aided", "unaided"]
    assert settings["scenario"]["name"] == flown().config.name


def test_recorded_samples_hold_the_satellites_of_the_flight(tmp_path: Path) -> None:
    path = tmp_path / "a.iq"
    assert record_samples(flown(), path, 0.0, 0.3, SETTINGS) == 660_000
    file = IqFile(path, Sampling(2.2e6, is_complex=True))
    table = acquire_recording(file, 0.1, 5e-3, 10, 6000.0, 1e-3)
    found = set(table.loc[table["status"] == "found", "sv"])
    assert found == SATELLITES
    result = CliRunner().invoke(
        app, ["acquire", str(path), "--rate", "2.2e6", "--look", "5", "--looks", "10"]
    )
    assert result.exit_code == 0, result.output
    assert "8 satellites found" in result.output


def test_command_records_samples_and_prints_a_summary(tmp_path: Path) -> None:
    (tmp_path / "quick.toml").write_text("rate_hz = 2.2e6\nlooks = 10\n", encoding="utf-8")
    (tmp_path / "flight.toml").write_text(scenario_text(), encoding="utf-8")
    common = [str(tmp_path / "flight.toml"), "--settings", str(tmp_path / "quick.toml"), "--json"]
    told = CliRunner().invoke(app, ["iq", *common, "--duration", "0.2", "--record", str(tmp_path / "a.iq")])
    assert json.loads(told.output)["samples"] == 440_000
    assert (tmp_path / "a.iq").stat().st_size == 880_000
    plain = [*common[:-1], "--duration", "0.05", "--record", "b.iq"]
    with contextlib.chdir(tmp_path):
        told = CliRunner().invoke(app, ["iq", *plain])
    assert "wrote 110000 samples at 2.2e+06 Hz to b.iq" in told.output
    out = str(tmp_path / "out")
    told = CliRunner().invoke(
        app, ["iq", *common, "--duration", "3", "--loss", "0", "-r", "aided", "-o", out]
    )
    assert told.exit_code == 0, told.output
    results = json.loads(told.output)
    assert [row["receiver"] for row in results["summary"]] == ["aided"]
    # errors are counted from 5 s after the first fix on
    assert results["summary"][0]["position_rms_m"] is None
    assert "Give --duration 8 or more" in results["note"]
    wrong = CliRunner().invoke(app, ["iq", *common, "--duration", "1", "--receiver", "both"])
    assert wrong.exit_code == 2


def test_table_of_a_recording_without_errors_has_no_numbers_that_are_none() -> None:
    numbers = (
        "share_on_signal",
        "position_rms_m",
        "position_largest_m",
        "position_over_sigma",
        "velocity_rms_mps",
    )
    row = dict.fromkeys(numbers, math.nan) | {"cn0_dbhz": 33.0, "receiver": "aided", "channels": 0.0}
    summary = pd.DataFrame([row | {"on_signal_at_end": 0.0}])
    study = SampleStudy(summary, summary, summary, summary, SETTINGS, {})

    assert [next(iter(column.cells)) for column in _table(study).columns] == ["33.0", "aided", *["-"] * 6]


def test_weak_correlation_of_a_strong_signal_is_not_called_found(tmp_path: Path) -> None:
    # 20 dB more: correlations with the other codes stand out of the noise too
    path = tmp_path / "a.iq"
    record_samples(flown(), path, -22.0, 0.1, SETTINGS)
    file = IqFile(path, Sampling(2.2e6, is_complex=True))
    table = acquire_recording(file, 0.0, 1e-3, 80, 6000.0, 1e-3)
    assert (table["status"] == "cross_correlation").any()
    assert set(table.loc[table["status"] == "found", "sv"]) == SATELLITES


def test_impossible_orders_are_refused(tmp_path: Path) -> None:
    for options, key in (
        ({"receivers": ("both",)}, "receivers"),
        ({"receivers": ()}, "receivers"),
        ({"losses_db": ()}, "losses_db"),
        ({"threads": 0}, "threads"),
        ({"seed": -1}, "seed"),
        ({"receivers": "aided"}, "receivers"),
        ({"losses_db": 5.0}, "losses_db"),
        ({"losses_db": (math.nan,)}, "loss_db"),
        ({"threads": 1.5}, "threads"),
        ({"seed": 1.5}, "seed"),
        ({"duration_s": 100.0}, "duration_s"),
        ({"duration_s": 0.001}, "duration_s"),
        ({"duration_s": "3"}, "duration_s"),
    ):
        with pytest.raises(ConfigError) as raised:
            sample_receiver(flown(), **{"settings": SETTINGS, **options})  # type: ignore[arg-type]
        assert raised.value.key == key
    with pytest.raises(InputError, match="shorter than an acquisition"):
        sample_receiver(flown(), losses_db=(0.0,), duration_s=0.1, settings=SETTINGS)
    # 0.2 s of acquisition; the first epoch after it is at 1 s
    with pytest.raises(InputError, match="ends before the first epoch"):
        sample_receiver(flown(), losses_db=(0.0,), duration_s=0.7, receivers=("aided",), settings=QUICK)
    result = CliRunner().invoke(app, ["acquire", str(tmp_path / "no.iq"), "--rate", "4e6"])
    assert result.exit_code == 3
    with pytest.raises(ConfigError, match="nan is outside"):
        record_samples(flown(), tmp_path / "a.iq", math.nan, 0.1, SETTINGS)


def test_recording_that_does_not_fit_or_holds_nothing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.iq"
    path.write_bytes(bytes(2 * 2_200_000))
    with pytest.raises(InputError, match="holds 1 s of int8 samples"):
        sample_receiver(flown(), losses_db=(0.0,), duration_s=2.0, settings=SETTINGS, recording=path)
    with pytest.raises(InputError, match="all zero"):
        sample_receiver(flown(), losses_db=(0.0,), duration_s=1.0, settings=SETTINGS, recording=path)
    file = IqFile(path, Sampling(2.2e6, is_complex=True))
    with pytest.raises(InputError, match="all zero"):
        acquire_recording(file, 0.0, 1e-3, 80, 6000.0, 1e-3)
    with pytest.raises(ConfigError, match="start_s"):
        acquire_recording(file, math.nan, 1e-3, 80, 6000.0, 1e-3)
