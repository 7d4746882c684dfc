"""Fits to the track of a burst: what its positions say about the field line the beam followed."""

from bella.tracks.burst import TrackRecipe, fit_track
from bella.tracks.fused import FusedFit, IngredientWeight, fit_fused, fused_json
from bella.tracks.joint import ModelEvidence, compare_models, fit_ingredients, fit_joint, track_positions, wind_knots
from bella.tracks.joint_directions import DirectionTerms, check_directions, direction_terms, read_directions
from bella.tracks.joint_fit import JointFit, joint_json
from bella.tracks.joint_ingredients import Ingredients, JointOptions
from bella.tracks.joint_model import JointModel, JointPriors
from bella.tracks.joint_nuts import sample_joint_nuts
from bella.tracks.joint_observed import WindPrior
from bella.tracks.scattering import ScatteringModel, apparent_over_true, density_excess, scattering_models
from bella.tracks.spiral import Segment, Spiral, fit_spiral, piecewise_fit, track_fit
from bella.tracks.wave_directions import wave_directions

__all__ = [
    "DirectionTerms",
    "FusedFit",
    "IngredientWeight",
    "Ingredients",
    "JointFit",
    "JointModel",
    "JointOptions",
    "JointPriors",
    "ModelEvidence",
    "ScatteringModel",
    "Segment",
    "Spiral",
    "TrackRecipe",
    "WindPrior",
    "apparent_over_true",
    "check_directions",
    "compare_models",
    "density_excess",
    "direction_terms",
    "fit_fused",
    "fit_ingredients",
    "fit_joint",
    "fit_spiral",
    "fit_track",
    "fused_json",
    "joint_json",
    "piecewise_fit",
    "read_directions",
    "sample_joint_nuts",
    "scattering_models",
    "track_fit",
    "track_positions",
    "wave_directions",
    "wind_knots",
]
