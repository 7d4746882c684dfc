"""The edge of the paper: one width before the peak of a Gauss-Hermite curve fitted to a light curve.

Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747; the curve is that of van der Marel & Franx 1993,
ApJ 407, 525, doi:10.1086/172534. The published fit has no bounds, one start and no error; here the width is positive,
the skewness is bounded, several starts are tried, and the covariance of the fit gives the error of the edge. The rule
is the same for every spacecraft: its distance from the half-maximum grows with the width, so unlike rules would turn
into false delays.

The edge lies before the half-rise of simulated bursts, by 10 s and more at 0.5 MHz, and by how much depends on the
cadence and the window; it breaks when a second burst stands in the decay. It is kept to compare with the paper, not as
the default.
"""

import math

import numpy as np
import numpy.typing as npt
from scipy.optimize import OptimizeResult, least_squares

from bella.bursts.edge import FIT_FAILED, NO_SAMPLES, NO_SIGNAL, PEAK_OUTSIDE, Edge, no_edge
from bella.units import FloatArray

WIDTHS_BEFORE_PEAK = 1.0

C0, C1, C2, C3, C4 = math.sqrt(6) / 4, -math.sqrt(3), -math.sqrt(6), 2 * math.sqrt(3) / 3, math.sqrt(6) / 3
"""Coefficients of the Hermite polynomials (van der Marel & Franx 1993)."""

PARAMETERS = 6
WIDEST_H3, WIDEST_H4 = 0.4, 0.3
START_WIDTHS = (1.0, 2.5, 6.0)
"""Widths to start from, in spacings of the samples."""

DIFFERENCE = 1e-5
FARTHEST_WIDTHS = 6.0
NEGLIGIBLE = 1e-9


def gauss_hermite(time_s: FloatArray, parameters: npt.ArrayLike) -> FloatArray:
    """Gauss-Hermite curve.

    Parameters
    ----------
    time_s : numpy.ndarray
        Any shape, s.
    parameters : array_like, shape (6,)
        Height of the Gaussian over the background; its centre, s, and width, s; skewness h3; peakedness h4; background.

    Returns
    -------
    numpy.ndarray
        The shape of `time_s`.
    """
    height, centre_s, width_s, h3, h4, background = np.asarray(parameters, dtype=np.float64)
    x = (np.asarray(time_s) - centre_s) / width_s
    shape = 1 + h3 * x * (C3 * x**2 + C1) + h4 * (C0 + C2 * x**2 + C4 * x**4)
    return np.asarray(height * np.exp(-0.5 * x**2) * shape + background)


def mode_widths(h3: float, h4: float) -> float:
    """Where the curve is highest, in widths from its centre.

    Parameters
    ----------
    h3, h4 : float

    Returns
    -------
    float
        The root of the derivative that belongs to the highest maximum.
    """
    # a tiny leading coefficient spoils all roots of the companion matrix
    h3, h4 = (0.0 if abs(h) < NEGLIGIBLE else h for h in (h3, h4))
    derivative = [
        C4 * h4,
        C3 * h3,
        h4 * (C2 - 4 * C4),
        h3 * (C1 - 3 * C3),
        1 + h4 * (C0 - 2 * C2),
        -C1 * h3,
    ]
    roots = np.roots(derivative)
    # a small h4 puts roots far out, where the exponential leaves nothing
    real = roots[(np.abs(roots.imag) < 1e-9) & (np.abs(roots.real) < FARTHEST_WIDTHS)].real
    return float(real[np.argmax(gauss_hermite(real, [1.0, 0.0, 1.0, h3, h4, 0.0]))])


def gauss_hermite_edge(time_s: FloatArray, power: FloatArray) -> Edge:
    """Time one width before the peak of the fitted curve.

    Parameters
    ----------
    time_s : numpy.ndarray, shape (N,)
        Times of the samples, ascending, s.
    power : numpy.ndarray, shape (N,)
        Power above background in any unit; NaN where there are no data.

    Returns
    -------
    Edge
        With a reason and NaN when there is none: ``no_samples`` (not more than the six parameters), ``no_signal``,
        ``fit_failed``, ``peak_outside`` (the fitted peak or edge is outside the samples).
    """
    known = np.isfinite(power)
    time, height = time_s[known], power[known]
    if time.size <= PARAMETERS:
        return no_edge(NO_SAMPLES)
    if not height.max() > 0:
        return no_edge(NO_SIGNAL)
    fit = _best_fit(time, height / height.max())
    if fit is None:
        return no_edge(FIT_FAILED)
    arrival = _edge_s(fit.x)
    mode = arrival + WIDTHS_BEFORE_PEAK * fit.x[2]
    if not time[0] <= arrival < mode <= time[-1]:
        return no_edge(PEAK_OUTSIDE)
    sigma = _edge_sigma_s(fit, time.size)
    return Edge(arrival, sigma, "") if math.isfinite(sigma) else no_edge(FIT_FAILED)


def _edge_s(parameters: FloatArray) -> float:
    _, centre, width, h3, h4, _ = parameters
    return float(centre + width * (mode_widths(h3, h4) - WIDTHS_BEFORE_PEAK))


def _best_fit(time: FloatArray, height: FloatArray) -> OptimizeResult | None:
    """The fit of least residual from several starts; the samples weigh alike, as in the paper."""
    top, spacing, span = int(height.argmax()), float(np.median(np.diff(time))), float(time[-1] - time[0])
    low = [0.0, time[0], 0.25 * spacing, -WIDEST_H3, -WIDEST_H4, -1.0]
    high = [10.0, time[-1], span, WIDEST_H3, WIDEST_H4, 1.0]
    scale = [1.0, spacing, spacing, 0.1, 0.1, 0.1]

    def _residual(p: FloatArray) -> FloatArray:
        return gauss_hermite(time, p) - height

    fits = []
    for width in START_WIDTHS:
        start = np.clip([1.0, time[top], width * spacing, 0.1, 0.0, 0.0], low, high)
        fits.append(least_squares(_residual, start, bounds=(low, high), x_scale=scale))
    return min((fit for fit in fits if fit.success), key=lambda fit: float(fit.cost), default=None)


def _edge_sigma_s(fit: OptimizeResult, samples: int) -> float:
    """Standard deviation of the edge from the scatter of the residuals and the slope of the curve."""
    scatter = 2 * fit.cost / (samples - PARAMETERS)
    slope = np.empty(PARAMETERS)
    for i in range(PARAMETERS):
        step = np.zeros(PARAMETERS)
        step[i] = DIFFERENCE * max(1.0, abs(fit.x[i]))
        slope[i] = (_edge_s(fit.x + step) - _edge_s(fit.x - step)) / (2 * step[i])
    variance = scatter * slope @ np.linalg.pinv(fit.jac.T @ fit.jac) @ slope
    return math.sqrt(variance) if variance > 0 else math.nan
