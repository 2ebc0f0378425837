"""The sample flight: 20 minutes of an aircraft at 60 deg north with 11 GPS satellites, written as a folder of logs.

``python -m insgnss.simulation.sample_flight FOLDER [--seed N]`` makes it; the same seed gives the same files.
"""

from __future__ import annotations

import argparse
import datetime as dt
import time
from pathlib import Path

import numpy as np

from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.constants import C_MPS
from insgnss.gpstime import ns_to_datetime, week_seconds_to_ns
from insgnss.simulation.atmosphere import broadcast_atmosphere
from insgnss.simulation.log_files import write_gnss, write_imu, write_reference
from insgnss.simulation.observations import NoiseTerms, SimulatedReceiver
from insgnss.simulation.rinex_nav import write_rinex_navigation
from insgnss.simulation.sample_trajectories import AIRFIELD, level_turns
from insgnss.simulation.simulated_log import ClockStart, Scenario, Simulator
from insgnss.simulation.sky import PAPER_SKY, constellation_over
from insgnss.simulation.trajectory import reference_table
from insgnss.tables import GnssTable

GPS_WEEK = 2385
START_S = 293_700.0  # Wednesday 2025-09-24, 09:35:00 GPS: noon at the place
TOE_S = 295_200.0  # 10:00:00, the reference time of all messages
DURATION_S = 1200.0
REFERENCE_RATE_HZ = 10.0
SEED = 2015
FILES = ("imu.csv.gz", "gnss.csv", "nav.rnx", "reference.csv", "flight.toml", "README.md")

TACTICAL = ImuGrade(
    gyro_bias_deg_per_h=1.0,
    gyro_bias_instability_deg_per_h=0.3,
    gyro_correlation_time_s=1000.0,
    gyro_arw_deg_per_sqrt_h=0.1,
    gyro_scale_factor_ppm=100.0,
    accel_bias_mg=1.0,
    accel_bias_instability_mg=0.2,
    accel_correlation_time_s=1000.0,
    accel_vrw_mps_per_sqrt_h=0.06,
    accel_scale_factor_ppm=100.0,
    source="tactical grade of the sample flight",
)
TCXO = Oscillator(h0_s=2e-19, h_minus2_per_s=2e-20, source="temperature-compensated crystal")
LEVER_ARM_B = (0.8, 0.0, -1.1)
BORESIGHT_CN0_DBHZ = 45.0
# metres and m/s; with these gains 0.9 to 3 m and 0.04 to 0.1 m/s, larger for low satellites
PSEUDORANGE_NOISE = NoiseTerms(floor=0.5, elevation=0.6, cn0=0.7)
RANGE_RATE_NOISE = NoiseTerms(floor=0.03, elevation=0.02, cn0=0.03)
CLOCK = ClockStart(bias_m=0.3e-3 * C_MPS, drift_mps=50.0)


def sample_scenario(duration_s: float = DURATION_S) -> Scenario:
    """Return the scenario, or the first ``duration_s`` of it."""
    start_ns = int(week_seconds_to_ns(GPS_WEEK, START_S))
    toe_ns = int(week_seconds_to_ns(GPS_WEEK, TOE_S))
    navigation = constellation_over(AIRFIELD, PAPER_SKY, start_ns, DURATION_S, toe_ns)
    receiver = SimulatedReceiver(
        lever_arm_b=LEVER_ARM_B,
        first_tag_s=1.0,
        antenna_mask_deg=5.0,
        boresight_cn0_dbhz=BORESIGHT_CN0_DBHZ,
        pseudorange_noise=PSEUDORANGE_NOISE,
        range_rate_noise=RANGE_RATE_NOISE,
        atmosphere=broadcast_atmosphere(navigation.klobuchar),
    )
    return Scenario(
        level_turns(), navigation, TACTICAL, TCXO, start_ns, duration_s, receiver=receiver, clock=CLOCK
    )


def write_sample_flight(folder: Path, seed: int = SEED, duration_s: float = DURATION_S) -> None:
    """Write the logs, the truth, the flight file and a note of origin into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario = sample_scenario(duration_s)
    log = Simulator(scenario).draw(np.random.default_rng(seed))
    write_imu(folder / "imu.csv.gz", log.imu, GPS_WEEK)
    write_gnss(folder / "gnss.csv", log.gnss, GPS_WEEK)
    created = ns_to_datetime(scenario.start_ns)
    write_rinex_navigation(folder / "nav.rnx", scenario.navigation, created)
    t_s = np.arange(int(duration_s * REFERENCE_RATE_HZ) + 1) / REFERENCE_RATE_HZ
    reference = reference_table(scenario.trajectory.motion(t_s), scenario.start_ns)
    write_reference(folder / "reference.csv", reference, GPS_WEEK)
    (folder / "flight.toml").write_bytes(flight_file().encode("ascii"))
    note = note_of_origin(seed, duration_s, log.gnss, created)
    (folder / "README.md").write_bytes(note.encode("ascii"))


def flight_file() -> str:
    """Return the text of ``flight.toml``."""
    grade = "\n".join(f"{name} = {value}" for name, value in _numbers(TACTICAL).items())
    oscillator = "\n".join(f"{name} = {value}" for name, value in _numbers(TCXO).items())
    return f"""\
# A simulated flight of 20 minutes; see README.md for what is in it.
name = "sample flight"
gps_week = {GPS_WEEK}
start = "automatic"

[imu]
files = ["imu.csv.gz"]
values = "rates"            # means over the interval that ends at the tag
gyro_unit = "rad/s"
accel_unit = "m/s^2"
axes = ["+x", "+y", "+z"]   # forward, right, down

[imu.grade]
{grade}

[gnss]
files = ["gnss.csv"]
navigation = ["nav.rnx"]
lever_arm_m = [{LEVER_ARM_B[0]}, {LEVER_ARM_B[1]}, {LEVER_ARM_B[2]}]   # IMU to antenna, forward, right, down

[gnss.oscillator]
{oscillator}

[gnss.slow_errors]                   # nothing in the simulation lasts
satellite_m = {{ G = 0.0 }}
ionosphere_zenith_m = 0.0
no_ionosphere_zenith_m = 0.0
ionosphere_gradient_per_1000_km = 0.0
troposphere_zenith_m = 0.0

[reference]
file = "reference.csv"
point = "imu"
"""


def _numbers(model: ImuGrade | Oscillator) -> dict[str, float]:
    given = model.model_fields_set
    return {name: value for name, value in model if name in given and isinstance(value, float)}


def note_of_origin(seed: int, duration_s: float, gnss: GnssTable, start: dt.datetime) -> str:
    """Return the text of the folder's README: the origin and content of the data."""
    g, p, r = TACTICAL, PSEUDORANGE_NOISE, RANGE_RATE_NOISE
    fewest = int(np.unique(gnss.t_ns, return_counts=True)[1].min())
    return f"""\
# Sample flight

Simulated, not measured. Made by `python -m insgnss.simulation.sample_flight FOLDER --seed {seed}`; the same seed gives
the same files. No rights of others are involved; it is licensed like the rest of the repository.

| | |
| --- | --- |
| start | {start:%Y-%m-%d %H:%M:%S} GPS time, week {GPS_WEEK}, second {START_S:.0f} |
| duration | {duration_s:.0f} s: 70 s at rest, take-off, climb to 1520 m, legs and turns of 25 \
to 45 deg of bank, landing, at rest |
| place | {AIRFIELD[0]} N {AIRFIELD[1]} E, {AIRFIELD[2]:.0f} m above the ellipsoid |
| `imu.csv.gz` | 100 Hz, means over the interval that ends at the tag; forward, right, down; rad/s, m/s^2 |
| `gnss.csv` | 1 Hz, GPS L1 C/A, {len(gnss.t_ns)} rows, {fewest} to 11 satellites; tags by the receiver's own clock |
| `nav.rnx` | RINEX 3.04, one message for each of 11 satellites, exact; Klobuchar coefficients, leap seconds |
| `reference.csv` | truth of the IMU (not of the antenna), {REFERENCE_RATE_HZ:.0f} Hz |
| `flight.toml` | the flight file |
| `picture.png` | what a replay gives; drawn by `python -m tests.benchmarks.picture` |

What was put in:

- **Motion**: splines of position and attitude, differentiated in the inertial frame; normal gravity of WGS-84.
- **Inertial sensors**, one sigma. Gyro: bias {g.gyro_bias_deg_per_h} deg/h, instability \
{g.gyro_bias_instability_deg_per_h} deg/h over {g.gyro_correlation_time_s:.0f} s,
  ARW {g.gyro_arw_deg_per_sqrt_h} deg/sqrt(h), scale {g.gyro_scale_factor_ppm:.0f} ppm. Accelerometer: \
bias {g.accel_bias_mg} mg, instability {g.accel_bias_instability_mg} mg
  over {g.accel_correlation_time_s:.0f} s, VRW {g.accel_vrw_mps_per_sqrt_h} m/s/sqrt(h), \
scale {g.accel_scale_factor_ppm:.0f} ppm.
- **Satellites**: the 11 of Sokolov and Yurchenko (2015) on orbits that pass within 3 deg of the azimuths and elevations
  printed there. They are not the satellites of this date.
- **Antenna** at {LEVER_ARM_B} m forward, right, down of the IMU. A satellite lower than 5 deg above the
  antenna's own plane is not tracked. C/N0 is {BORESIGHT_CN0_DBHZ:.0f} dBHz upwards and follows \
20 log10((1 + sin el) / 2).
- **Receiver clock**: TCXO, h0 {TCXO.h0_s:g} s, h-2 {TCXO.h_minus2_per_s:g} 1/s; it starts 0.3 ms ahead and \
drifts by 50 m/s.
- **Noise**, white, of variance floor^2 + (elevation / sin el)^2 + cn0^2 10^((45 - C/N0) / 10): pseudoranges with
  {p.floor}, {p.elevation}, {p.cn0} m (about 2 m), range rates with {r.floor}, {r.elevation}, {r.cn0} m/s \
(about 0.07 m/s).
- **Delays**: ionosphere by the broadcast coefficients, troposphere by Saastamoinen; no multipath, no faults.
"""


def main() -> None:
    """Write the sample flight into the folder named on the command line and print the files written."""
    parser = argparse.ArgumentParser(description="Write the sample flight into a folder.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=SEED)
    arguments = parser.parse_args()
    begun = time.perf_counter()
    write_sample_flight(arguments.folder, arguments.seed)
    for name in FILES:
        print(f"{arguments.folder / name}  {(arguments.folder / name).stat().st_size / 1e6:.3f} MB")
    print(f"{time.perf_counter() - begun:.1f} s")


if __name__ == "__main__":
    main()
