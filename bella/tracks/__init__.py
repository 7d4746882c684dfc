"""Fits to the track of a burst: what its positions say about the field line the beam followed."""

from bella.tracks.piecewise import PiecewiseSpiral, SpiralSegment, fit_piecewise_spiral, piecewise_fit
from bella.tracks.two_step import SpiralLine, fit_spiral_line, track_fit

__all__ = [
    "PiecewiseSpiral",
    "SpiralLine",
    "SpiralSegment",
    "fit_piecewise_spiral",
    "fit_spiral_line",
    "piecewise_fit",
    "track_fit",
]
