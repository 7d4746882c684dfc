"""Fits to the track of a burst: what its positions say about the field line the beam followed."""

from bella.tracks.burst import TrackRecipe, fit_track
from bella.tracks.density_excess import density_excess, inferred_density_cm3
from bella.tracks.joint import ModelEvidence, compare_models, fit_joint, track_positions
from bella.tracks.joint_fit import JointFit, joint_json
from bella.tracks.joint_model import JointModel, JointPriors
from bella.tracks.joint_nuts import sample_joint_nuts
from bella.tracks.piecewise import PiecewiseSpiral, SpiralSegment, fit_piecewise_spiral, piecewise_fit
from bella.tracks.scattering import CorrectedSource, ScatteringModel, corrected_source, scattering_model
from bella.tracks.two_step import SpiralLine, fit_spiral_line, track_fit

__all__ = [
    "CorrectedSource",
    "JointFit",
    "JointModel",
    "JointPriors",
    "ModelEvidence",
    "PiecewiseSpiral",
    "ScatteringModel",
    "SpiralLine",
    "SpiralSegment",
    "TrackRecipe",
    "compare_models",
    "corrected_source",
    "density_excess",
    "fit_joint",
    "fit_piecewise_spiral",
    "fit_spiral_line",
    "fit_track",
    "inferred_density_cm3",
    "joint_json",
    "piecewise_fit",
    "sample_joint_nuts",
    "scattering_model",
    "track_fit",
    "track_positions",
]
