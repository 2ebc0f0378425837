"""Simulated satellites of QZSS: their names, their messages, and the receiver's offset of their clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.config.library import find
from insgnss.errors import ConfigError
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.log.rinex.navigation import read_navigation
from insgnss.runs.simulate import Simulation, simulate

SKY = 'kind = "nominal"\nqzss = ["G04", "G20"]\nqzss_offset_m = '


def made(folder: Path, offset_m: float, sky: str = SKY) -> Simulation:
    """Return a quarter of a minute at rest under a sky with two satellites of QZSS."""
    text = find("scenarios", "at_rest").read_text(encoding="utf-8")
    scenario = folder / "qzss.toml"
    scenario.write_text(f"{text}\n[sky]\n{sky}{offset_m}\n", encoding="utf-8")
    return simulate(scenario, duration_s=15.0, noise=False)


def test_offset_is_in_the_ranges_of_qzss_alone(tmp_path: Path) -> None:
    off, right = (made(tmp_path, size).log.gnss for size in (2.0, 0.0))
    assert {name for name in off.sv_names if name[0] != "G"} == {"J01", "J02"}
    names = np.array(off.sv_names)[off.sv]
    wanted = np.where(np.char.startswith(names, "J"), 2.0, 0.0)
    np.testing.assert_allclose(off.pseudorange_m - right.pseudorange_m, wanted, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(off.doppler_hz, right.doppler_hz)


def test_messages_of_qzss_are_read_back(tmp_path: Path) -> None:
    log = made(tmp_path, 2.0)
    log.save(tmp_path / "out")
    read, events = read_navigation([tmp_path / "out" / "nav.rnx"])
    assert not events and {"J01", "J02"} < set(read.ephemerides.sv_names)
    states = satellite_states(log.log.gnss, read)
    assert np.isfinite(states.position).all()


def test_satellite_that_is_not_in_the_sky_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"sky\.qzss.*G31"):
        made(tmp_path, 0.0, SKY.replace("G04", "G31"))
