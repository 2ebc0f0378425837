"""``insgnss track``: loops simulated for a C/N0, a motion and a bandwidth: their errors, and whether they hold."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Annotated

import typer

from insgnss.cli.command import at_least
from insgnss.cli.command_errors import argument_of
from insgnss.cli.printing import AsJson, print_json, result_console, text_table
from insgnss.cli.progress import counting
from insgnss.constants import C_MPS
from insgnss.errors import ConfigError

if TYPE_CHECKING:
    from insgnss.tracking.channels import ChannelHistory, ChannelSimulation

_MOST_INTEGRATIONS = 1e7  # of all channels together: about 1.5 GB while they run
_FREQUENCY = "Bandwidth of the assisting frequency loop in Hz; 0: none."
_WANDER = "Frequency random walk of oscillator and aiding: one-sided density S in rad^2/s^3."


def track(
    cn0: Annotated[float, typer.Option("--cn0", help="C/N0 in dBHz.")] = 40.0,
    signal: Annotated[
        str, typer.Option("--signal", help="'glonass-st', or GPS with its PRN, such as 'gps-ca-7'.")
    ] = "gps-ca-1",
    bandwidth: Annotated[
        float, typer.Option("--bandwidth", "-b", help="Carrier loop's one-sided noise bandwidth in Hz.")
    ] = 15.0,
    order: Annotated[int, typer.Option("--order", help="Order of the carrier loop, 1 to 3.")] = 3,
    frequency_bandwidth: Annotated[float, typer.Option("--frequency-bandwidth", help=_FREQUENCY)] = 0.0,
    code_bandwidth: Annotated[
        float, typer.Option("--code-bandwidth", help="Carrier-aided code loop's bandwidth in Hz.")
    ] = 1.0,
    integration: Annotated[
        float, typer.Option("--integration", callback=at_least(0.01, 1e3), help="Integration time in ms.")
    ] = 1.0,
    discriminator: Annotated[
        str, typer.Option("--discriminator", "-d", help="Phase discriminator: atan, iq, sign, q, atan2.")
    ] = "atan",
    spacing: Annotated[float, typer.Option("--spacing", help="Early-to-late spacing, in chips.")] = 1.0,
    acceleration: Annotated[
        float,
        typer.Option("--acceleration", callback=at_least(-1e5, 1e5), help="Along the line of sight, m/s^2."),
    ] = 0.0,
    jerk: Annotated[
        float, typer.Option("--jerk", callback=at_least(-1e6, 1e6), help="Along the line of sight, m/s^3.")
    ] = 0.0,
    wander: Annotated[float, typer.Option("--wander", callback=at_least(0.0, 1e6), help=_WANDER)] = 0.0,
    aided: Annotated[
        bool, typer.Option("--aided", help="Remove the motion, as perfect inertial aiding would.")
    ] = False,
    seconds: Annotated[
        float, typer.Option("--time", callback=at_least(1e-6), help="Simulated seconds of each channel.")
    ] = 20.0,
    channels: Annotated[
        int,
        typer.Option(
            "--channels", "-n", min=1, max=10_000, help="Number of channels, each with its own noise."
        ),
    ] = 12,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all noise.")] = 1,
    threads: Annotated[
        int,
        typer.Option("--threads", min=1, max=1024, help="Number of threads; it does not change the results."),
    ] = 1,
    as_json: AsJson = False,
) -> None:
    """Simulate tracking loops: rms errors, lock, and the C/N0 that the receiver would report."""
    began = time.perf_counter()
    # the numerical libraries are loaded only when the command runs
    from insgnss.gnss.signals import G1_HZ, L1_HZ
    from insgnss.tracking.codes import code_of
    from insgnss.tracking.loop_filters import assisted_filter, digital_filter
    from insgnss.tracking.trial import CarrierDynamics, design_channels, simulation_of

    code, step_s = code_of(signal), integration * 1e-3
    carrier_hz = G1_HZ if signal == "glonass-st" else L1_HZ
    if not step_s <= seconds:
        raise ConfigError(
            f"{seconds:g} s are less than one integration of {integration:g} ms",
            key="--time",
            advice="simulate at least one integration",
        )
    if seconds / step_s * channels > _MOST_INTEGRATIONS:
        advice = f"simulate {_MOST_INTEGRATIONS * step_s / channels:.4g} s at most, or fewer channels"
        raise ConfigError(
            f"{seconds:g} s in {channels} channels need too much memory", key="--time", advice=advice
        )
    loop = assisted_filter(order, bandwidth, frequency_bandwidth, step_s)
    with argument_of("--code-bandwidth", "bandwidth_hz"):
        code_loop = digital_filter(1, code_bandwidth, step_s)
    design = design_channels(code, carrier_hz, cn0, loop, code_loop, discriminator, spacing)
    motion = CarrierDynamics(acceleration, jerk, wander)
    simulation = simulation_of(design, code, carrier_hz, motion, seconds, channels, seed, aided)
    with counting() as bar:
        task = bar.add_task("tracking", total=simulation.scene.sign.size)
        history = simulation.run(seed, threads, lambda done: bar.advance(task, done))
    if as_json:
        print_json(_digest(simulation, history, cn0, code.rate_hz))
        return
    _print_result(simulation, history, cn0, code.rate_hz)
    typer.echo(f"nothing was written; {time.perf_counter() - began:.2f} s in all")


def _digest(
    simulation: ChannelSimulation, history: ChannelHistory, cn0: float, chip_hz: float
) -> dict[str, float | int]:
    """Return the result as plain data."""
    from insgnss.tracking.trial import assess

    assessment = assess(simulation, history)
    chip_m = C_MPS / chip_hz
    return {
        "phase_rms_deg": math.degrees(assessment.phase_rms_rad),
        "phase_noise_deg": math.degrees(assessment.phase_noise_rad),
        "delay_rms_m": assessment.delay_rms_chips * chip_m,
        "delay_noise_m": assessment.delay_noise_chips * chip_m,
        "frequency_rms_hz": assessment.rate_rms_radps / (2.0 * math.pi),
        "noise_bandwidth_hz": float(simulation.design.carrier.noise_bandwidth_hz()),
        "channels": int(assessment.channels),
        "slipped": int(assessment.slipped),
        "phase_lock": float(assessment.phase_lock),
        "cn0_dbhz": cn0,
        "cn0_moments_dbhz": float(assessment.moment_dbhz),
        "cn0_narrow_wide_dbhz": float(assessment.narrow_wide_dbhz),
    }


def _print_result(simulation: ChannelSimulation, history: ChannelHistory, cn0: float, chip_hz: float) -> None:
    """Print errors and those of the linear loop, lock and C/N0."""
    from insgnss.tracking.trial import assess

    assessment = assess(simulation, history)
    degrees = [math.degrees(value) for value in (assessment.phase_rms_rad, assessment.phase_noise_rad)]
    metres = [value * C_MPS / chip_hz for value in (assessment.delay_rms_chips, assessment.delay_noise_chips)]
    rows = (
        ("carrier phase", *(f"{value:.2f} deg" for value in degrees)),
        ("code delay", *(f"{value:.3f} m" for value in metres)),
        ("carrier frequency", f"{assessment.rate_rms_radps / (2.0 * math.pi):.3f} Hz", ""),
    )
    title = "errors after the first fifth of the time, of channels in lock"
    console = result_console(100)
    console.print(text_table(title, ("", "rms", "noise of the linear loop"), rows))
    console.print(
        f"true noise bandwidth {simulation.design.carrier.noise_bandwidth_hz():.3f} Hz, "
        f"slipped {assessment.slipped} of {assessment.channels} channels, phase lock {assessment.phase_lock:.3f}",
        highlight=False,
    )
    console.print(
        f"C/N0 {cn0:.2f} dBHz: moments {assessment.moment_dbhz:.2f},"
        f" narrow-wide {assessment.narrow_wide_dbhz:.2f} dBHz",
        highlight=False,
    )
