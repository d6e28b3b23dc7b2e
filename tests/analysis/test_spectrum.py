"""Amplitude spectrum of sampled signals, and their total variation per second."""

import numpy as np
import pytest

from app.analysis.spectrum import amplitude_spectrum, variation_rate


@pytest.mark.parametrize("frequency", [3.0, 17.3, 123.4, 480.0])
def test_spectrum_of_a_sine_has_its_amplitude_at_its_frequency(frequency: float):
    t = 5.0 + np.arange(4000) * 1e-3
    values = np.stack([7.0 + 2.5 * np.sin(2 * np.pi * frequency * t), 0.1 * t], axis=1)
    spectrum = amplitude_spectrum(t, values)
    peak = int(spectrum.amplitude[:, 0].argmax())
    assert spectrum.amplitude[peak, 0] == pytest.approx(2.5, rel=2e-3)
    assert spectrum.frequency[peak] == pytest.approx(frequency, abs=0.6 / 4.0)
    few = spectrum.thinned(60)
    assert len(few.frequency) <= 60
    assert few.amplitude[:, 0].max() == spectrum.amplitude[peak, 0]


def test_chattering_from_sample_to_sample_has_its_amplitude_at_half_the_sampling_rate():
    t = np.arange(4000) * 1e-3
    spectrum = amplitude_spectrum(t, 3.0 * (-1.0) ** np.arange(4000)[:, None])
    assert spectrum.frequency[-1] == pytest.approx(500.0)
    assert spectrum.amplitude.max() == spectrum.amplitude[-1, 0] == pytest.approx(3.0, rel=1e-3)


def test_spectrum_takes_only_what_is_evenly_sampled():
    t = np.concatenate([np.arange(50) * 0.02, 1.0 + np.arange(2000) * 1e-3])
    spectrum = amplitude_spectrum(t, np.sin(2 * np.pi * 50.0 * t)[:, None])
    assert spectrum.frequency[-1] == pytest.approx(500.0)
    assert spectrum.amplitude.max() == pytest.approx(1.0, rel=2e-3)
    assert len(amplitude_spectrum(t[:3], np.zeros((3, 1))).frequency) == 0


def test_total_variation_per_second_of_a_triangle():
    t = np.arange(2000) * 1e-3
    triangle = 0.5 - np.abs((5.0 * t) % 1.0 - 0.5)  # up and down 0.5 five times a second
    rate = variation_rate(t, triangle, 0.2)
    assert np.isnan(rate[:200]).all()
    np.testing.assert_allclose(rate[201:], 5.0, rtol=1e-2)


def test_a_thinned_spectrum_has_its_peaks_where_they_are():
    t = np.arange(10_000) * 1e-3
    for frequency in (123.4, 251.7):
        thinned = amplitude_spectrum(t, np.sin(2 * np.pi * frequency * t)[:, None]).thinned(600)
        assert len(thinned.frequency) <= 600
        assert abs(thinned.frequency[thinned.amplitude[:, 0].argmax()] - frequency) < 0.06
