"""What a channel sees of a replica: mean and variance by the discriminators' theory, and without a signal."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from insgnss.errors import ConfigError
from insgnss.tracking.combined_filter import CombinedModel
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.vector_loop import (
    CODE_VARIANCE,
    N_SEEN,
    RANGE_VARIANCE,
    RATE_VARIANCE,
    RATIO,
    SEEN_CODE,
    SEEN_POWER,
    SEEN_RANGE,
    SEEN_RATE,
    ChannelConstants,
    channels_of,
    levels_of,
    noise_count,
    observe_channels,
)

LOOKS = 20_000


def seen(
    channels: ChannelConstants,
    cn0_dbhz: float,
    offset: tuple[float, ...],
    seed: int,
    told_dbhz: float | None = None,
) -> np.ndarray:
    """Return what is seen in many integrations, (n, 4)."""
    level = np.full(LOOKS, levels_of(cn0_dbhz)) if cn0_dbhz > 0.0 else np.full(LOOKS, -1)
    told = np.full(LOOKS, levels_of(cn0_dbhz if told_dbhz is None else told_dbhz))
    noise = np.random.default_rng(seed).standard_normal((LOOKS, noise_count(channels)))
    out = np.zeros((LOOKS, N_SEEN))
    observe_channels(channels, level, told, np.tile(offset, (LOOKS, 1)), noise, out)
    return out


def assert_mean(values: np.ndarray, mean: float) -> None:
    """Say that the mean of independent values agrees, at 1e-4."""
    assert abs(values.mean() - mean) < 3.9 * values.std() / math.sqrt(len(values))


@pytest.mark.parametrize("cn0_dbhz", [45.0, 30.0, 20.0])
def test_phase_as_range_has_the_discriminators_mean_and_variance(cn0_dbhz: float) -> None:
    channels = channels_of("coherent", 5e-3, 1.6e9, 1e6)
    row = channels.table[levels_of(cn0_dbhz)]
    k, a = channels.radians_per_m, row[RATIO]
    found = seen(channels, cn0_dbhz, (0.0, 0.0), 1)[:, SEEN_RANGE]
    spread = np.mean((found**2 - found.var()) ** 2)

    assert_mean(found, 0.0)
    assert abs(found.var() - row[RANGE_VARIANCE]) < 3.9 * math.sqrt(spread / LOOKS)
    discriminator = PhaseDiscriminator("iq")
    offset_m = 0.2 / k
    expected = -discriminator.mean(-0.2, a) / discriminator.slope(a) / k
    assert_mean(seen(channels, cn0_dbhz, (offset_m, 0.0), 2)[:, SEEN_RANGE], float(expected))


@pytest.mark.parametrize("cn0_dbhz", [45.0, 30.0, 20.0])
def test_delay_and_frequency_are_seen_without_bias_and_apart(cn0_dbhz: float) -> None:
    channels = channels_of("noncoherent", 10e-3, 1.6e9, 0.511e6)
    row = channels.table[levels_of(cn0_dbhz)]
    found = seen(channels, cn0_dbhz, (0.0, 0.0), 3)
    for column, variance in ((SEEN_RANGE, RANGE_VARIANCE), (SEEN_RATE, RATE_VARIANCE)):
        values = found[:, column]
        spread = np.mean((values**2 - values.var()) ** 2)
        assert_mean(values, 0.0)
        assert abs(values.var() - row[variance]) < 3.9 * math.sqrt(spread / LOOKS)
    assert abs(np.corrcoef(found[:, SEEN_RANGE], found[:, SEEN_RATE])[0, 1]) < 3.9 / math.sqrt(LOOKS)

    chip = channels.chip_m
    power = DelayDiscriminator("power")
    shifted = seen(channels, cn0_dbhz, (0.2 * chip, 0.0), 4)[:, SEEN_RANGE]
    expected = float(power.mean(0.2, row[RATIO])) / power.slope(row[RATIO]) * chip
    assert_mean(shifted, expected)
    moved = seen(channels, cn0_dbhz, (0.0, 0.3), 5)[:, SEEN_RATE]
    turn = channels.radians_per_m * 0.3 * 10e-3
    # sin of the turn between both halves, and the power that is left of each
    lost = np.sinc(0.25 * turn / math.pi) ** 2
    assert_mean(moved, lost * math.sin(0.5 * turn) / (0.5 * turn) * 0.3)


@pytest.mark.parametrize("cn0_dbhz", [45.0, 30.0])
def test_code_beside_a_phase_has_the_discriminators_mean_and_variance(cn0_dbhz: float) -> None:
    channels = channels_of("coherent", 1e-3, 1.6e9, 0.511e6)._replace(with_code=True)
    row, chip = channels.table[levels_of(cn0_dbhz)], channels.chip_m
    found = seen(channels, cn0_dbhz, (0.0, 0.0, 0.0), 11)
    for column, variance in ((SEEN_CODE, CODE_VARIANCE), (SEEN_RANGE, RANGE_VARIANCE)):
        values = found[:, column]
        spread = np.mean((values**2 - values.var()) ** 2)
        assert_mean(values, 0.0)
        assert abs(values.var() - row[variance]) < 3.9 * math.sqrt(spread / LOOKS)
    # one chip of spacing: the law of the filter of one channel, code and phase
    assert row[[CODE_VARIANCE, RANGE_VARIANCE]] == pytest.approx(
        CombinedModel(cn0_dbhz, 1.6e9, 0.511e6, 1.0).noise(), rel=1e-3
    )
    product = DelayDiscriminator("product", phase_rad=0.2)
    shifted = seen(channels, cn0_dbhz, (-0.2 / channels.radians_per_m, 0.0, 0.2 * chip), 12)[:, SEEN_CODE]
    expected = float(product.mean(0.2, row[RATIO])) / DelayDiscriminator("product").slope(row[RATIO]) * chip
    assert_mean(shifted, expected)


def test_power_of_noise_is_that_of_no_signal() -> None:
    channels = channels_of("coherent", 5e-3, 1.6e9, 1e6)
    found = seen(channels, -99.0, (0.0, 0.0), 6, told_dbhz=30.0)[:, SEEN_POWER]
    low, high = stats.chi2.interval(0.9999, 2 * LOOKS)
    a = channels.table[levels_of(30.0), RATIO]

    assert low < found.sum() / a < high


def test_gain_is_off_by_the_ratio_of_told_and_true_cn0() -> None:
    channels = channels_of("coherent", 5e-3, 1.6e9, 1e6)
    told_too_high = seen(channels, 37.0, (0.003, 0.0), 7, told_dbhz=40.0)[:, SEEN_RANGE]
    right = seen(channels, 37.0, (0.003, 0.0), 7)[:, SEEN_RANGE]

    assert told_too_high == pytest.approx(right * 10.0**-0.3, rel=1e-9)


@pytest.mark.parametrize(
    ("asked", "key"),
    [
        ({"tracking": "both"}, "tracking"),
        ({"phase_kind": "pq"}, "phase_kind"),
        ({"frequency_kind": "none"}, "frequency_kind"),
        ({"delay_kind": "x"}, "delay_kind"),
        ({"chip_hz": 0.0}, "chip_hz"),
        ({"spacing_chips": 2.5}, "spacing_chips"),
        ({"tracking": "noncoherent", "spacing_chips": 2.0}, "spacing_chips"),
        ({"step_s": -1.0}, "integration_s"),
    ],
)
def test_nonsense_is_told(asked: dict[str, object], key: str) -> None:
    wanted = {"tracking": "coherent", "step_s": 1e-3, "carrier_hz": 1.6e9, "chip_hz": 1e6}
    with pytest.raises(ConfigError) as error:
        channels_of(**{**wanted, **asked})  # type: ignore[arg-type]

    assert error.value.key == key
