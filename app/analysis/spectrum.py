"""Chattering of a torque: its amplitude spectrum and its total variation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# coefficients of the flat-top window of ISO 18431-2, as in scipy.signal.windows.flattop, which takes 0.6 s to import
_FLAT_TOP = (0.21557895, -0.41663158, 0.277263158, -0.083578947, 0.006947368)
STEADINESS = 0.01  # by which the sampling interval may vary


@dataclass(frozen=True)
class Spectrum:
    """Amplitude spectrum.
    frequency: (K,) Hz without 0.
    amplitude: (K, n); a sine of amplitude A shows a peak of height A."""

    frequency: np.ndarray
    amplitude: np.ndarray

    def thinned(self, buckets: int) -> Spectrum:
        """Spectrum of at most this many points, one for each bucket of a logarithmic axis: its highest peaks, at the
        frequency of the highest of them."""
        if len(self.frequency) <= buckets:
            return self
        edges = np.geomspace(self.frequency[0], self.frequency[-1] * (1 + 1e-9), buckets + 1)
        begin = np.unique(np.searchsorted(self.frequency, edges[:-1]))
        peaks = np.maximum.reduceat(self.amplitude, begin, axis=0)
        highest = self.amplitude.max(axis=1)
        ends = np.append(begin[1:], len(highest))
        at = [first + int(highest[first:end].argmax()) for first, end in zip(begin, ends, strict=True)]
        return Spectrum(self.frequency[at], peaks)


def amplitude_spectrum(t: np.ndarray, values: np.ndarray) -> Spectrum:
    """Spectrum of values (N, n) at t (N,) s without their mean, with a flat-top window: right in amplitude but within
    its width, some 4 / (t[-1] - t[0]) Hz, of 0 and of the Nyquist frequency. Only the last rows that are equally far
    apart count; empty for fewer than 16."""
    steps = np.diff(t)
    uneven = np.flatnonzero(np.abs(steps - steps[-1:]) > STEADINESS * steps[-1:])
    values = values[uneven[-1] + 1 :] if len(uneven) else values
    count = len(values)
    if count < 16:
        return Spectrum(np.empty(0), np.empty((0, values.shape[1])))
    phase = 2 * np.pi * np.arange(count) / count
    window = np.cos(np.outer(phase, np.arange(len(_FLAT_TOP)))) @ np.array(_FLAT_TOP)
    weighted = window[:, None] * (values - values.mean(axis=0))
    amplitude = 2.0 * np.abs(np.fft.rfft(weighted, axis=0)) / window.sum()
    amplitude[-3:] /= 2.0  # at the Nyquist frequency a peak is its own mirror image, not one of two
    return Spectrum(np.fft.rfftfreq(count, steps[-1])[1:], amplitude[1:])


def variation_rate(t: np.ndarray, values: np.ndarray, span: float) -> np.ndarray:
    """Total variation per second of values (N,) over the last `span` s before each t (N,) s; nan in the first `span`
    s."""
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))])
    rate = (travelled - np.interp(t - span, t, travelled)) / span
    rate[t - t[0] < span * (1 - 1e-9)] = np.nan
    return rate
