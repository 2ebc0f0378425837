"""What a scenario says of sky, antenna and measurements, as the engine takes it."""

from __future__ import annotations

from pathlib import Path

from insgnss.antenna.equipment import installation
from insgnss.antenna.installation import Installation
from insgnss.config.filter import FilterConfig, NoiseConfig, Visibility
from insgnss.config.flight import MountedAntenna
from insgnss.config.library import filter_config
from insgnss.config.scenario import ScenarioConfig
from insgnss.simulation.sky import SkyTrack
from insgnss.simulation.sky_law import SkyLaw

_NO_LIMIT = 1e6  # sigmas


def sky_of(scenario: ScenarioConfig) -> SkyLaw:
    """Return where the scenario's satellites are."""
    tracks = tuple(SkyTrack(int(t.sv[1:]), t.azimuth_deg, t.elevation_deg) for t in scenario.satellites)
    place = scenario.place
    return SkyLaw.of_tracks((place.lat_deg, place.lon_deg, place.h_m), tracks, scenario.duration_s)


def visibility_of(scenario: ScenarioConfig) -> Visibility:
    """Return the settings of the visibility stage."""
    antenna = scenario.antenna
    return Visibility(
        threshold_gain_dbic=antenna.threshold_gain_dbic,
        hysteresis_db=antenna.hysteresis_db,
        nominal_cn0_dbhz=scenario.measurements.cn0_dbhz,
    )


def antennas_of(scenario: ScenarioConfig) -> tuple[MountedAntenna, ...]:
    """Return the vehicle's antenna: level, at the IMU."""
    return (MountedAntenna(pattern=scenario.antenna.pattern, lever_arm_m=(0.0, 0.0, 0.0)),)


def installation_of(scenario: ScenarioConfig) -> Installation:
    """Return the antenna with its pattern read.

    Raises
    ------
    ModelError, MissingFileError : there is no such pattern or file
    """
    return installation(antennas_of(scenario), Path())[0]


def filter_of(scenario: ScenarioConfig) -> FilterConfig:
    """Return the library's filter with the scenario's white noise, in empty air, without carrier phase.

    The same sigma for every satellite: no part that grows with elevation or falls with C/N0, no correlation in time.
    """
    base, m = filter_config("tight"), scenario.measurements
    alike = {"elevation": 0.0, "cn0_at_45_dbhz": 0.0}
    use = base.measurements.model_copy(
        update={"ionosphere": "none", "troposphere": "none", "carrier": False, "elevation_mask_deg": -90.0}
    )
    return base.model_copy(
        update={
            "name": "",
            "measurements": use,
            "pseudorange_noise_m": NoiseConfig(floor=m.range_variance_m2**0.5, **alike),
            "range_rate_noise_mps": NoiseConfig(floor=m.rate_variance_m2ps2**0.5, **alike),
            "visibility": visibility_of(scenario),
        }
    )


def without_fault_tests(config: FilterConfig) -> FilterConfig:
    """Return the filter of the paper, which accepts all rows and its start: no gate, no test for faults, no reset."""
    wide = dict.fromkeys(("pseudorange_sigma", "range_rate_sigma", "carrier_sigma"), _NO_LIMIT)
    none = dict.fromkeys(("residual_sigma", "drift_sigma", "reflected_below_db"), 0.0)
    return config.model_copy(
        update={
            "gates": config.gates.model_copy(update={**wide, "clock_jump_min_m": _NO_LIMIT}),
            "faults": config.faults.model_copy(update=none),
            "health": config.health.model_copy(update={"strain_nis": _NO_LIMIT, "recovery": False}),
            "adaptation": config.adaptation.model_copy(update={"on": False}),
        }
    )
