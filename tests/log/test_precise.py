"""SP3, RINEX clock and ANTEX files: time systems, gaps, flags, joined days, damage."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
import sidereon
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from insgnss.constants import NS_PER_S
from insgnss.errors import InputError, InsGnssError, NavigationDataError
from insgnss.log.precise import read_antennas, read_precise
from tests.gnss.precise_sample import CLOCKS, ORBITS, START_NS, STEP_S, antex_text, clock_text, sp3_text


def written(folder: Path, *texts: str | bytes) -> list[Path]:
    paths = [folder / f"file_{k}" for k in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_bytes(text.encode() if isinstance(text, str) else text)
    return paths


def test_nodes_are_the_numbers_of_the_file(tmp_path: Path) -> None:
    products, events = read_precise(written(tmp_path, sp3_text()))
    assert products.sv_names == ("G05", "G20") and events == []
    np.testing.assert_array_equal(products.orbit_ns, START_NS + np.arange(14) * STEP_S * NS_PER_S)
    for s, name in enumerate(products.sv_names):
        np.testing.assert_allclose(products.r_e[s], 1e3 * np.array(ORBITS[name])[:, :3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(products.clock_s[s], 1e-6 * np.array(ORBITS[name])[:, 3], rtol=1e-12)


def test_nodes_agree_with_an_independent_reading(tmp_path: Path) -> None:
    products, _ = read_precise(written(tmp_path, sp3_text(version="d")))
    theirs = sidereon.load_sp3(sp3_text(version="d").encode())
    for k in range(14):
        np.testing.assert_array_equal(products.r_e[1, k], theirs.state("G20", k).position_m)


@pytest.mark.parametrize(
    ("system", "ahead_s"),
    # of GPS time minus the file's; in 2010 GPS time was 15 s ahead of UTC
    [("GPS", 0), ("GAL", 0), ("QZS", 0), ("TAI", -19), ("BDT", 14), ("UTC", 15), ("GLO", 15)],
)
def test_time_system_becomes_gps_time(tmp_path: Path, system: str, ahead_s: int) -> None:
    products, _ = read_precise(written(tmp_path, sp3_text(system=system), clock_text(system=system)))
    assert products.orbit_ns[0] - START_NS == ahead_s * NS_PER_S
    assert products.clock_ns[0] - START_NS == ahead_s * NS_PER_S


def test_missing_values_are_gaps(tmp_path: Path) -> None:
    orbits = {name: list(records) for name, records in ORBITS.items()}
    orbits["G05"][3] = (*orbits["G05"][3][:3], 999999.999999)
    orbits["G20"][5] = (0.0, 0.0, 0.0, orbits["G20"][5][3])
    products, _ = read_precise(written(tmp_path, sp3_text(orbits)))
    assert list(np.flatnonzero(np.isnan(products.clock_s[0]))) == [3]
    assert not np.isnan(products.r_e[0]).any()
    assert list(np.flatnonzero(np.isnan(products.r_e[1, :, 0]))) == [5]
    # the clock beside a missing orbit stays
    assert not np.isnan(products.clock_s[1]).any()


def test_flag_of_a_manoeuvre_or_a_clock_event_leaves_a_gap(tmp_path: Path) -> None:
    flags = {("G05", 6): "E   ", ("G20", 8): "    M"}
    products, events = read_precise(written(tmp_path, sp3_text(flags=flags)))
    assert [event.kind for event in events] == ["precise_flagged"] * 2
    assert list(np.flatnonzero(np.isnan(products.clock_s[0]))) == [6]
    assert list(np.flatnonzero(np.isnan(products.r_e[1, :, 0]))) == [8]


def test_predicted_values_are_told_and_can_be_left_out(tmp_path: Path) -> None:
    flags = {(name, k): " P   P" for name in ORBITS for k in range(10, 14)}
    paths = written(tmp_path, sp3_text(flags=flags))
    whole, events = read_precise(paths)
    assert len(whole.orbit_ns) == 14
    assert [event.kind for event in events] == ["precise_predicted"]
    assert events[0].t_ns == START_NS + 10 * STEP_S * NS_PER_S
    observed, _ = read_precise(paths, use_predicted=False)
    assert len(observed.orbit_ns) == len(observed.clock_ns) == 10


def test_files_are_joined_and_the_earlier_one_counts_where_they_overlap(tmp_path: Path) -> None:
    moved = {name: [(x + 1e-4, y, z, c) for x, y, z, c in records] for name, records in ORBITS.items()}
    products, events = read_precise(written(tmp_path, sp3_text(), sp3_text(moved, first_s=10 * STEP_S)))
    assert len(products.orbit_ns) == 24
    np.testing.assert_allclose(products.r_e[0, 13], 1e3 * np.array(ORBITS["G05"])[13, :3], rtol=0, atol=1e-6)
    orbit, _ = [event for event in events if event.kind == "precise_overlap"]
    assert "8 orbit node(s)" in orbit.detail and orbit.t_ns == START_NS + 10 * STEP_S * NS_PER_S


def test_rinex_clock_replaces_that_of_the_orbit_file(tmp_path: Path) -> None:
    for texts in ((sp3_text(), clock_text()), (clock_text(), sp3_text())):
        products, _ = read_precise(written(tmp_path, *texts))
        assert len(products.clock_ns) == 7
        np.testing.assert_array_equal(products.clock_s[1], CLOCKS["G20"])


def test_gzipped_file_is_read(tmp_path: Path) -> None:
    products, _ = read_precise(written(tmp_path, gzip.compress(sp3_text().encode())))
    assert len(products.orbit_ns) == 14


def test_damaged_line_costs_its_record_alone(tmp_path: Path) -> None:
    text = sp3_text().replace("-24286.536246", "-24286.5x6246", 1)
    products, events = read_precise(written(tmp_path, text))
    assert [event.kind for event in events] == ["precise_damaged"]
    assert list(np.flatnonzero(np.isnan(products.r_e[0, :, 0]))) == [1]
    assert not np.isnan(products.r_e[1]).any()


def test_cut_file_gives_what_it_holds_and_says_so(tmp_path: Path) -> None:
    text = sp3_text()
    products, events = read_precise(written(tmp_path, text[: len(text) // 2]))
    assert len(products.orbit_ns) == 4
    assert "precise_cut" in [event.kind for event in events]


def test_damaged_clock_line_is_told(tmp_path: Path) -> None:
    text = clock_text().replace("-1.068106494322e-05", "-1.0681064943#2e-05")
    products, events = read_precise(written(tmp_path, sp3_text(), text))
    assert [event.kind for event in events] == ["precise_damaged"]
    assert np.isnan(products.clock_s).sum() == 1


@pytest.mark.parametrize("text", ["not a product", clock_text(), sp3_text()[:900], "#cP garbage\n" * 30])
def test_file_without_orbits_is_refused_with_its_name(tmp_path: Path, text: str) -> None:
    with pytest.raises(NavigationDataError, match="file_0"):
        read_precise(written(tmp_path, text))


def test_unknown_time_system_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InsGnssError, match="file_0"):
        read_precise(written(tmp_path, sp3_text(system="XYZ")))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_damage_anywhere_ends_in_products_or_in_an_error_of_ours(tmp_path: Path, data: st.DataObject) -> None:
    text = data.draw(st.sampled_from([sp3_text(), clock_text(), antex_text()]))
    raw = bytearray(text.encode()[: data.draw(st.integers(1, len(text)))])
    for place in data.draw(st.lists(st.integers(0, len(raw) - 1), max_size=4)):
        raw[place] ^= 1 << data.draw(st.integers(0, 7))
    for read in (read_precise, lambda paths: read_antennas(paths[0])):
        try:
            read(written(tmp_path, bytes(raw)))
        except InsGnssError as error:
            assert "file_0" in str(error)


def test_antennas_of_the_pair_are_read_with_their_span(tmp_path: Path) -> None:
    antennas, events = read_antennas(written(tmp_path, antex_text())[0])
    assert antennas.sv_names == ("G05", "G20") and events == []
    # both frequencies have the same offset, so the pair has it too
    np.testing.assert_allclose(antennas.offset_b, [[0, 0, 0.7], [0, 0, 1.154]], rtol=0, atol=1e-12)
    # 2009-08-17, GPS week 1545, second day
    assert antennas.from_ns[0] == (1545 * 7 + 1) * 86_400 * NS_PER_S
    assert antennas.until_ns[0] > 2**62


def test_offset_of_the_pair_is_the_ionosphere_free_one(tmp_path: Path) -> None:
    text = antex_text().replace(f"{700.0:10.2f}", f"{500.0:10.2f}", 1)
    antennas, _ = read_antennas(written(tmp_path, text)[0])
    # 2.5457 * 0.5 - 1.5457 * 0.7
    assert antennas.offset_b[0, 2] == pytest.approx(2.545728 * 0.5 - 1.545728 * 0.7, abs=1e-6)


def test_antenna_file_without_satellites_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_antennas(written(tmp_path, "\n".join(antex_text().splitlines()[:3]) + "\n")[0])
    with pytest.raises(InputError):
        read_antennas(written(tmp_path, sp3_text())[0])
