"""``insgnss allan``: Allan deviation of a resting inertial log, and a grade file made from it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from insgnss.cli.command import at_least
from insgnss.cli.file_options import Force, Pictures, check_files
from insgnss.cli.printing import AsJson, print_json
from insgnss.cli.progress import telling
from insgnss.constants import S_PER_WEEK
from insgnss.errors import ConfigError
from insgnss.results.saving import overwriting

if TYPE_CHECKING:
    from insgnss.runs.allan import NoiseFit
    from insgnss.tables import ImuTable


def allan(
    log: Annotated[Path, typer.Argument(help="A flight file (.toml), or an IMU log (.csv, .csv.gz).")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for grade.toml, allan.csv, allan.png.")
    ] = None,
    like: Annotated[
        str | None,
        typer.Option("--like", help="Library grade for the terms that a log at rest cannot show."),
    ] = None,
    first: Annotated[
        float | None,
        typer.Option(
            "--from",
            callback=at_least(0.0, 2.0 * S_PER_WEEK),
            help="Start of the stationary part, seconds of the week.",
        ),
    ] = None,
    last: Annotated[
        float | None,
        typer.Option(
            "--to",
            callback=at_least(0.0, 2.0 * S_PER_WEEK),
            help="End of the stationary part, seconds of the week.",
        ),
    ] = None,
    gyro_unit: Annotated[
        str, typer.Option("--gyro-unit", help="Unit of a CSV log's gyros: rad/s, deg/s, rad, deg.")
    ] = "rad/s",
    accel_unit: Annotated[
        str,
        typer.Option(
            "--accel-unit", help="Unit of a CSV log's accelerometers: m/s^2, g, mg, cm/s^2, m/s, g*s."
        ),
    ] = "m/s^2",
    pictures: Pictures = True,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Measure a sensor's noise from a log at rest: random walk, bias instability, rate random walk."""
    began = time.perf_counter()
    with overwriting(force, [log], output):
        from insgnss.config.library import imu_grade
        from insgnss.runs.allan import FILES, STUDY_NAME, allan_study

        check_files(output, FILES, STUDY_NAME)
        with telling("measuring the noise"):
            imu = _part(_read(log, gyro_unit, accel_unit), first, last)
            study = allan_study(imu, None if like is None else imu_grade(like))
            written = [] if output is None else study.save(output, pictures)
    grade = study.grade
    if as_json:
        about = {"duration_s": study.duration_s, "samples": len(imu.t_ns)}
        print_json({**about, "grade": grade.model_dump(), "wrote": [str(path) for path in written]})
        return
    typer.echo(f"{log}: {study.duration_s:.0f} s at rest, {len(imu.t_ns)} samples")
    typer.echo(
        f"gyro: ARW {grade.gyro_arw_deg_per_sqrt_h:.4g} deg/sqrt(h), "
        f"instability {grade.gyro_bias_instability_deg_per_h:.4g} deg/h over {grade.gyro_correlation_time_s:.4g} s, "
        f"rate random walk {grade.gyro_rate_random_walk_deg_per_h_per_sqrt_h:.4g} deg/h/sqrt(h)"
    )
    typer.echo(
        f"accelerometer: VRW {grade.accel_vrw_mps_per_sqrt_h:.4g} m/s/sqrt(h), "
        f"instability {grade.accel_bias_instability_mg:.4g} mg over {grade.accel_correlation_time_s:.4g} s, "
        f"random walk {grade.accel_random_walk_mg_per_sqrt_h:.4g} mg/sqrt(h)"
    )
    for sensor, fit in (("gyro", study.gyro_fit), ("accelerometer", study.accel_fit)):
        _tell_what_is_unseen(sensor, fit, study.duration_s)
    for path in written:
        typer.echo(f"wrote {path}")
    where = "" if written else "nothing was written (no --output); "
    typer.echo(f"{where}{time.perf_counter() - began:.2f} s in all")


def _tell_what_is_unseen(sensor: str, fit: NoiseFit, duration_s: float) -> None:
    if fit.instability == 0.0 and fit.rate_random_walk == 0.0:
        typer.echo(
            f"{sensor}: {duration_s:.0f} s show no bias instability: the lowest deviation is used instead"
        )


def _read(log: Path, gyro_unit: str, accel_unit: str) -> ImuTable:
    """Return the inertial samples of a flight file's log, or of a CSV file with the usual names of columns."""
    from insgnss.config.flight import ImuConfig
    from insgnss.log.flight import Flight
    from insgnss.log.imu.csv_log import inertial, read_imu

    if log.suffix == ".toml":
        flight = Flight.load(log)
        return read_imu(inertial(flight.config), flight.config.gps_week, flight.imu_grade)[0]
    values: Literal["rates", "increments"] = "increments" if gyro_unit in ("rad", "deg") else "rates"
    units = {"gyro_unit": gyro_unit, "accel_unit": accel_unit, "values": values}
    try:
        mapping = ImuConfig.model_validate({"files": (log,), "grade": "", **units})
    except ValueError:
        raise ConfigError(
            f"'{gyro_unit}' and '{accel_unit}' do not go together or are not supported units",
            key="--gyro-unit",
            advice="rad/s or deg/s with m/s^2, g or mg; rad or deg with m/s or g*s; else describe it in a flight file",
        ) from None
    return read_imu(mapping, 0)[0]


def _part(imu: ImuTable, first: float | None, last: float | None) -> ImuTable:
    """Return the samples between two moments in seconds of the week of the first sample.

    Raises
    ------
    ConfigError : there is none
    """
    from insgnss.constants import NS_PER_S, NS_PER_WEEK
    from insgnss.tables import ImuTable

    time_s = (imu.t_ns - imu.t_ns[0] // NS_PER_WEEK * NS_PER_WEEK) / NS_PER_S
    begin_s, end_s = (time_s[0] if first is None else first), (time_s[-1] if last is None else last)
    inside = (time_s >= begin_s) & (time_s <= end_s)
    if not inside.any():
        raise ConfigError(
            f"the log has no sample from {begin_s:.3f} to {end_s:.3f} s",
            key="--from, --to",
            advice=f"it lasts from {time_s[0]:.3f} to {time_s[-1]:.3f} s",
        )
    return ImuTable(imu.t_ns[inside], imu.w_ib_b[inside], imu.f_b[inside])
