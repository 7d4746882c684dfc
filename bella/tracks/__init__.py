"""Fits to the track of a burst: what its positions say about the field line the beam followed."""

from bella.tracks.density_excess import density_excess, inferred_density_cm3
from bella.tracks.piecewise import PiecewiseSpiral, SpiralSegment, fit_piecewise_spiral, piecewise_fit
from bella.tracks.scattering import CorrectedSource, ScatteringModel, corrected_source, scattering_model
from bella.tracks.two_step import SpiralLine, fit_spiral_line, track_fit

__all__ = [
    "CorrectedSource",
    "PiecewiseSpiral",
    "ScatteringModel",
    "SpiralLine",
    "SpiralSegment",
    "corrected_source",
    "density_excess",
    "fit_piecewise_spiral",
    "fit_spiral_line",
    "inferred_density_cm3",
    "piecewise_fit",
    "scattering_model",
    "track_fit",
]
