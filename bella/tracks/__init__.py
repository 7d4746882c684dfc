"""Fits to the track of a burst: what its positions say about the field line the beam followed."""

from bella.tracks.two_step import SpiralLine, fit_spiral_line, track_fit

__all__ = ["SpiralLine", "fit_spiral_line", "track_fit"]
