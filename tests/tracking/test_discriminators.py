"""Discriminators: the thesis's figures, closed forms against integrals and against simulation, ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, special

from insgnss.errors import ConfigError
from insgnss.tracking.admissible import signal_ratio
from insgnss.tracking.correlators import PROMPT, Correlators
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.discriminator_outputs import DELAY_KINDS, FREQUENCY_KINDS, PHASE_KINDS
from insgnss.tracking.discriminators import (
    DiscriminatorModel,
    equivalent_variance,
    linear_range,
    pull_in_range,
    simulate,
)
from insgnss.tracking.frequency_discriminators import FrequencyDiscriminator
from insgnss.tracking.phase_discriminators import PhaseDiscriminator

A_37 = signal_ratio(37.0, 1e-3)  # the thesis's example: 37 dBHz, 1 ms
GLONASS_CHIP_S = 1.0 / 511e3
GLONASS_HZ = 1.6e9  # the thesis's carrier

ALL: dict[str, tuple[DiscriminatorModel, tuple[float, ...]]] = {
    **{f"delay-{k}": (DelayDiscriminator(k, Correlators(0.8)), (0.0, 0.2, 0.6)) for k in DELAY_KINDS},
    **{f"phase-{k}": (PhaseDiscriminator(k), (0.0, 0.3, 1.2)) for k in PHASE_KINDS},
    **{f"frequency-{k}": (FrequencyDiscriminator(k), (0.0, 300.0, 1200.0)) for k in FREQUENCY_KINDS[1:]},
}


# ------------------------------------------------------------ figures of the thesis


def test_delay_curve_of_the_thesis() -> None:
    product = DelayDiscriminator()
    # recalculated independently of this project, to four decimals
    expected = [18.0856, 37.6783, 50.2377, 18.8391, 0.0]
    assert product.mean([0.1, 0.25, 0.5, 0.75, 1.0], A_37) == pytest.approx(expected, abs=5e-5)
    assert np.argmax(product.mean(np.linspace(0.0, 1.0, 101), A_37)) == 50
    assert product.slope(A_37) == pytest.approx(200.951, abs=5e-4)


def test_delay_slope_has_the_square_of_the_integration_time() -> None:
    # the thesis's program writes T^3: a thousandth of the true slope, found here by differences of the curve
    product, h = DelayDiscriminator(), 1e-5
    by_difference = float(product.mean(h, A_37) - product.mean(-h, A_37)) / (2.0 * h)
    q, T = 10.0**3.7, 1e-3
    assert by_difference == pytest.approx(8.0 * q**2 * T**2, rel=1e-4)
    assert by_difference > 900.0 * 8.0 * q**2 * T**3


def test_variances_of_the_thesis() -> None:
    product, iq = DelayDiscriminator(), PhaseDiscriminator("iq")
    assert float(product.variance(0.0, A_37)) == pytest.approx(
        2215.23, abs=0.005
    )  # (2.4); 8.002e-8 s is printed
    tau_s2 = equivalent_variance(product, A_37) * GLONASS_CHIP_S**2
    assert tau_s2 == pytest.approx(2.1009e-13, rel=1e-4)  # (2.7)
    assert math.sqrt(tau_s2) * 299_792_458.0 == pytest.approx(137.4, abs=0.05)
    assert float(iq.variance(0.0, A_37)) == pytest.approx(1107.6, abs=0.05)  # (2.10)
    assert equivalent_variance(iq, A_37) == pytest.approx(0.10972, abs=5e-6)  # (2.12)
    range_m = math.sqrt(equivalent_variance(iq, A_37)) * 299_792_458.0 / (2.0 * math.pi * GLONASS_HZ)
    assert range_m == pytest.approx(9.878e-3, abs=5e-7)  # (2.15)


def test_phase_curve_of_the_thesis() -> None:
    iq, a = PhaseDiscriminator("iq"), signal_ratio(26.0, 1e-3)
    phases = np.linspace(0.0, math.pi / 2.0, 181)
    assert np.max(iq.mean(phases, a)) == pytest.approx(0.316979, abs=5e-7)
    assert phases[np.argmax(iq.mean(phases, a))] == pytest.approx(math.pi / 4.0)


def test_variance_of_iq_does_not_depend_on_the_phase_offset(rng: np.random.Generator) -> None:
    found = simulate(PhaseDiscriminator("iq"), [0.0, 0.4, math.pi / 4.0, 1.3], A_37, 100_000, rng)
    assert np.abs(found.variance - 1107.6157) / found.sd_variance == pytest.approx(0.0, abs=4.0)


def test_frequency_offset_shifts_the_zero_of_the_phase_curve() -> None:
    T, w = 1e-3, 400.0
    correlators, iq = Correlators(), PhaseDiscriminator("iq")
    Z = correlators.mean(A_37, 0.0, np.array([-0.5 * w * T, 0.0]), w, T)[..., PROMPT]
    u = iq.output(Z)
    assert u[0] == pytest.approx(0.0, abs=1e-12)
    # (2.9) at no phase offset, and its slope there: (2.11) times cos(w T)
    sinc2 = (math.sin(w * T / 2.0) / (w * T / 2.0)) ** 2
    assert u[1] == pytest.approx(0.5 * A_37**2 * math.sin(w * T) * sinc2, rel=1e-12)
    h = 1e-5
    beside = iq.output(correlators.mean(A_37, 0.0, np.array([-h, h]), w, T)[..., PROMPT])
    assert (beside[1] - beside[0]) / (2 * h) == pytest.approx(A_37**2 * sinc2 * math.cos(w * T), rel=1e-8)


def test_loss_of_a_delay_offset_lowers_the_phase_discriminator() -> None:
    rho = 0.7
    found = equivalent_variance(PhaseDiscriminator("iq", loss=rho**2), A_37)
    p = A_37 * rho**2
    assert found == pytest.approx((1.0 + 1.0 / p) / p)  # (2.12)


def test_optimal_discriminator_is_the_derivative_of_the_likelihood_over_both_signs() -> None:
    # f = exp(z) + exp(-z), (1.6) as corrected, z the prompt in-phase value: d ln f / d tau = th(z) dz/dtau
    Z = Correlators(1e-3).mean(A_37, 0.2, 0.3)
    z_late, z, z_early = Z[2].real, Z[1].real, Z[0].real
    by_likelihood = np.log(np.cosh(z_late)) - np.log(np.cosh(z_early))
    found = float(DelayDiscriminator("tanh", Correlators(1e-3)).output(Z))
    assert found == pytest.approx(by_likelihood, rel=1e-3)
    assert float(np.tanh(z)) < 1.0


def test_tanh_is_the_product_at_small_and_the_sign_at_large_signals() -> None:
    weak, strong = Correlators().mean(0.3, 0.1), Correlators().mean(300.0, 0.1)
    outputs = {kind: DelayDiscriminator(kind) for kind in DELAY_KINDS}
    # (1.11) for |I| < 0.5, within tanh(x) = x - x^3/3; (1.12) for |I| > 2
    assert outputs["tanh"].output(weak) == pytest.approx(outputs["product"].output(weak), rel=0.03)
    assert outputs["tanh"].output(strong) == pytest.approx(outputs["sign"].output(strong), rel=1e-12)


# ------------------------------------------------------------ closed forms against other ways


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("a", [0.5, 3.0, 15.0])
def test_mean_and_variance_agree_with_simulated_correlators(
    name: str, a: float, rng: np.random.Generator
) -> None:
    discriminator, offsets = ALL[name]
    found = simulate(discriminator, offsets, a, 60_000, rng)
    # 13 kinds, 3 ratios, 3 offsets, twice: 234 values, the largest of which is below 4.4 sigma in 99.7 % of cases
    assert np.abs(found.mean - discriminator.mean(offsets, a)) / found.sd_mean == pytest.approx(0.0, abs=4.4)
    deviation = np.abs(found.variance - discriminator.variance(offsets, a)) / found.sd_variance
    assert deviation == pytest.approx(0.0, abs=4.4)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("a", [0.5, 3.0, 15.0, 400.0])
def test_slope_is_the_derivative_of_the_curve(name: str, a: float) -> None:
    discriminator, offsets = ALL[name]
    h = 1e-4 * offsets[-1]
    by_difference = float(discriminator.mean(h, a) - discriminator.mean(-h, a)) / (2.0 * h)
    assert discriminator.slope(a) == pytest.approx(
        by_difference, rel=2e-4
    )  # curvature, and the kink of the peak
    assert by_difference > 0.0  # a signal that is later, further in phase or faster gives a positive output


def phase_density(x: float, g: float) -> float:
    """Return the density of the phase of a mean in complex noise."""
    b = math.sqrt(g) * math.cos(x)
    return (math.exp(-g) + math.sqrt(math.pi) * b * math.exp(b * b - g) * (1.0 + math.erf(b))) / (
        2.0 * math.pi
    )


@pytest.mark.parametrize("a", [0.5, 3.0, 15.0])
def test_angles_have_the_moments_of_the_density_of_a_phase(a: float) -> None:
    for kind, fold in (("atan2", 1), ("atan", 2)):
        e = 0.4

        def wrapped(x: float, e: float = e, fold: int = fold) -> float:
            return math.remainder(x + e, 2.0 * math.pi / fold)

        edges = [-e + math.pi / fold * k for k in (-1, 0, 1)]
        moments = [
            integrate.quad(
                lambda x, p=p: wrapped(x) ** p * phase_density(x, a / 2.0),
                -math.pi,
                math.pi,
                points=edges,
                limit=300,
            )[0]
            for p in (1, 2)
        ]
        found = PhaseDiscriminator(kind)
        assert float(found.mean(e, a)) == pytest.approx(moments[0], rel=1e-7)
        assert float(found.variance(e, a)) == pytest.approx(moments[1] - moments[0] ** 2, rel=1e-7)


@pytest.mark.parametrize("a", [0.2, 2.0, 50.0])
def test_tanh_of_a_likelihood_has_equal_mean_and_mean_square(a: float) -> None:
    # I ~ N(a, a) is a log-likelihood ratio: E tanh(I) = E tanh(I)^2; both against an adaptive integral
    discriminator = DelayDiscriminator("tanh")
    first, second = discriminator._decision(np.array(a), a)
    expected = integrate.quad(
        lambda u: math.tanh(a + math.sqrt(a) * u) * math.exp(-u * u / 2.0) / math.sqrt(2.0 * math.pi), -12.0, 12.0,
        points=[-math.sqrt(a)], epsabs=1e-13,
    )[0]  # fmt: skip
    assert float(first) == pytest.approx(expected, abs=1e-10)
    assert float(second) == pytest.approx(expected, abs=1e-10)


def test_sign_discriminators_lose_what_the_error_function_says() -> None:
    a = 2.0
    lost = special.erf(math.sqrt(a / 2.0))
    assert PhaseDiscriminator("sign").slope(a) == pytest.approx(lost * a)
    assert DelayDiscriminator("sign").slope(a) == pytest.approx(lost * 2.0 * a)


def test_all_phase_discriminators_approach_the_bound_at_high_ratios() -> None:
    a = 1e4
    for kind in PHASE_KINDS:
        assert equivalent_variance(PhaseDiscriminator(kind), a) == pytest.approx(
            1.0 / a, rel=2e-3
        )  # 1 / (2 q T)


def test_squaring_loss_orders_the_discriminators_at_low_ratios() -> None:
    found = {kind: equivalent_variance(PhaseDiscriminator(kind), 1.0) for kind in PHASE_KINDS}
    assert found["q"] == pytest.approx(1.0) and found["iq"] == pytest.approx(2.0)  # (1 + 1/a) / a
    assert found["q"] < found["iq"] < found["atan"]


def test_narrow_spacing_lowers_the_noise_of_the_delay_in_its_proportion() -> None:
    wide = equivalent_variance(DelayDiscriminator("product", Correlators(1.0)), A_37)
    narrow = equivalent_variance(DelayDiscriminator("product", Correlators(0.1)), A_37)
    assert narrow / wide == pytest.approx(0.1)


def test_outputs_bear_a_change_of_sign_of_the_data() -> None:
    # missing brackets, I E - L for I (E - L), would give another number for the other sign
    Z = Correlators().mean(A_37, 0.2, 0.3) + np.array([1.0, -2.0 + 1j, 0.5j])
    for kind in DELAY_KINDS:
        assert DelayDiscriminator(kind).output(-Z) == pytest.approx(float(DelayDiscriminator(kind).output(Z)))
    for kind in ("iq", "sign", "atan"):
        found = PhaseDiscriminator(kind)
        assert found.output(-Z[1]) == pytest.approx(float(found.output(Z[1])))


# ------------------------------------------------------------ ranges


def test_iq_is_linear_to_ten_percent_at_four_tenths_and_unstable_at_a_quarter_turn() -> None:
    iq = PhaseDiscriminator("iq")
    assert math.sin(0.8) / 0.8 == pytest.approx(0.897, abs=5e-4)
    assert linear_range(iq, A_37, 2.0) == pytest.approx(0.3933, abs=1e-4)  # sin 2x / 2x = 0.9
    assert pull_in_range(iq, A_37, 2.0) == pytest.approx(math.pi / 2.0)


def test_ranges_of_the_other_curves() -> None:
    assert pull_in_range(PhaseDiscriminator("q"), 10.0, 4.0) == pytest.approx(math.pi)
    # rho(e) is zero from a chip on: found to the step of the search, 1.4 / 2000
    assert pull_in_range(DelayDiscriminator(), A_37, 1.4) == pytest.approx(1.0, abs=7e-4)
    # atan stays straight further than iq, at high ratios up to its edge
    assert linear_range(PhaseDiscriminator("atan"), 1000.0, 1.57) > 1.4
    assert FrequencyDiscriminator("atan", 0.01).pull_in_radps == pytest.approx(2.0 * math.pi * 25.0)
    assert pull_in_range(FrequencyDiscriminator("atan"), 50.0, 3000.0) == pytest.approx(
        math.pi / 2e-3, rel=1e-6
    )


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: PhaseDiscriminator("iqq"), "nearest: 'iq'"),
        (lambda: DelayDiscriminator("prduct"), "nearest: 'product'"),
        (lambda: FrequencyDiscriminator("none"), "frequency discriminator"),
        (lambda: FrequencyDiscriminator("atan", 0.0), "above 0"),
        (lambda: PhaseDiscriminator("iq", loss=1.5), "share of power"),
        (lambda: DelayDiscriminator("product", Correlators(3.0)).mean(0.0, 1.0), "see the peak"),
        (lambda: equivalent_variance(DelayDiscriminator(phase_rad=math.pi / 2), 0.0), "no slope"),
    ],
)
def test_senseless_discriminators_are_refused(make: object, word: str) -> None:
    with pytest.raises(ConfigError, match=word):
        make()  # type: ignore[operator]
