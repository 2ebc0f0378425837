"""Pattern files: the library's own, and everything that can be wrong with one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.antenna.pattern_file import read_pattern
from insgnss.config.library import antenna_file, names
from insgnss.errors import ConfigError, MissingFileError, ModelError

GOOD = """\
# A pattern for the tests
# frame: antenna_forward_right_down
# frequency_hz: 1575.42e6
# polarisation: RHCP
# source: invented
elevation_deg,0,90,180,270
-90,-20,-20,-20,-20
0,-3,-4,-5,-6
90,4,4,4,4
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "pattern.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_good_file_gives_its_numbers(tmp_path: Path) -> None:
    table, events = read_pattern(written(tmp_path, GOOD))

    assert events == []
    assert (table.name, table.polarisation, table.frequency_hz) == ("pattern", "RHCP", 1575.42e6)
    assert table.elevation_deg.tolist() == [-90.0, 0.0, 90.0]
    assert table.azimuth_deg.tolist() == [0.0, 90.0, 180.0, 270.0]
    assert table.gain_dbic[1].tolist() == [-3.0, -4.0, -5.0, -6.0]


def test_library_holds_the_five_kinds_of_antenna() -> None:
    assert {"cardioid", "choke_ring", "hemispherical", "isotropic", "patch_l1"} <= set(names("antennas"))


@pytest.mark.parametrize("name", names("antennas"))
def test_pattern_of_the_library_is_sound_and_tells_its_source(name: str) -> None:
    table, events = read_pattern(antenna_file(name))

    assert events == []
    assert len(table.source) > 10
    # directivity: no antenna gathers more than everything; the mean gain over the sphere is at most 1 (0 dBic)
    el, weight = np.radians(np.arange(-89.5, 90.0)), np.cos(np.radians(np.arange(-89.5, 90.0)))
    mean_db = np.array([np.interp(np.degrees(el), table.elevation_deg, g) for g in table.gain_dbic.T])
    assert np.average((10.0 ** (0.1 * mean_db)).mean(axis=0), weights=weight) <= 1.01


def test_cardioid_file_is_its_formula() -> None:
    table, _ = read_pattern(antenna_file("cardioid"))
    el = np.radians(table.elevation_deg)
    expected = np.maximum(20.0 * np.log10(np.maximum(0.5 * (1.0 + np.sin(el)), 1e-9)), -60.0)

    # four decimals in the file
    np.testing.assert_allclose(table.gain_dbic[:, 0], expected, atol=5.1e-5)


def test_patch_has_a_lobe_behind_that_is_weaker_than_its_front() -> None:
    table, _ = read_pattern(antenna_file("patch_l1"))
    behind = table.gain_dbic[table.elevation_deg < -20.0].mean(axis=1)

    assert behind[0] > behind.min() + 3.0
    assert behind[0] < table.gain_dbic[-1, 0] - 10.0


def test_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(ModelError, match="patch_l1"):
        antenna_file("patch_11")


def test_missing_file_is_reported() -> None:
    with pytest.raises(MissingFileError):
        read_pattern(antenna_file("nowhere.csv"))


def test_pole_with_different_gains_gets_their_mean_and_an_event(tmp_path: Path) -> None:
    text = GOOD.replace("90,4,4,4,4", "90,4,5,4,5")

    table, events = read_pattern(written(tmp_path, text))

    assert table.gain_dbic[-1].tolist() == [4.5] * 4
    assert [event.kind for event in events] == ["pattern_pole_averaged"]
    assert "elevation 90" in events[0].detail


@pytest.mark.parametrize(
    ("old", "new", "line", "place", "words"),
    [
        ("0,-3,-4,-5,-6", "0,-3,,-5,-6", 8, "90", "hole"),
        ("0,-3,-4,-5,-6", "0,-3,-4,-5", 8, "270", "hole"),
        ("0,-3,-4,-5,-6", "0,-3,-4,-5,-6,-7", 8, None, "6 cells"),
        ("0,-3,-4,-5,-6", "0,-3,abc,-5,-6", 8, "90", "not a finite number"),
        ("0,-3,-4,-5,-6", "0,-3,nan,-5,-6", 8, "90", "not a finite number"),
        ("0,-3,-4,-5,-6", "0,-3,4e5,-5,-6", 8, "90", "not a gain"),
        ("0,-3,-4,-5,-6", "-90,-3,-4,-5,-6", 8, "elevation_deg", "do not increase"),
        ("90,4,4,4,4", "-5,4,4,4,4", 9, "elevation_deg", "do not increase"),
        ("\n90,4,4,4,4", "\n80,4,4,4,4", 9, "elevation_deg", "ends at elevation 80"),
        ("-90,-20,", "-60,-20,", 7, "elevation_deg", "starts at elevation -60"),
        ("0,90,180,270", "0,180,90,270", 6, "90", "do not increase"),
        ("0,90,180,270", "0,10,20,30", 6, None, "once around"),
        ("0,90,180,270", "10,90,180,270", 6, None, "once around"),
        ("0,90,180,270", "0,120,240,360", 6, None, "once around"),
        ("0,90,180,270", "0,90,x,270", 6, "x", "not a finite number"),
        ("elevation_deg,0", "el,0", 6, None, "no header"),
        ("antenna_forward_right_down", "antenna_forward_left_up", 2, "frame", "frame"),
        ("1575.42e6", "L1", 3, "frequency_hz", "not a frequency"),
        ("RHCP", "round", 4, "polarisation", "polarisation"),
        ("# source: invented", "# sauce: invented", 5, "sauce", "unknown key"),
        ("# source: invented", "# frame: again", 5, "frame", "twice"),
        ("# source: invented\n", "", None, "source", "missing"),
        ("-90,-20,-20,-20,-20\n0,-3,-4,-5,-6\n90,4,4,4,4\n", "", None, None, "no rows"),
        ("0,-3,-4,-5,-6", "0.001,-3,-4,-5,-6\n0.018,1,1,1,1\n51.237,1,1,1,1", None, None, None),
    ],
)
def test_wrong_file_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, line: int | None, place: str | None, words: str | None
) -> None:
    assert GOOD.count(old) == 1
    path = written(tmp_path, GOOD.replace(old, new))
    if words is None:  # uneven, but 180 000 x 4 nodes still fit
        assert len(read_pattern(path)[0].elevation_deg) == 5
        return

    with pytest.raises(ConfigError) as caught:
        read_pattern(path)

    assert words in str(caught.value)
    assert caught.value.file == str(path)
    assert caught.value.line == line
    assert (caught.value.column or caught.value.key) == place
    assert caught.value.advice


def test_grid_too_uneven_to_be_refined_is_refused(tmp_path: Path) -> None:
    text = GOOD.replace("0,90,180,270", "0,90.001,180,270").replace("\n0,-3", "\n0.001,-3")

    with pytest.raises(ConfigError, match="too uneven"):
        read_pattern(written(tmp_path, text))
