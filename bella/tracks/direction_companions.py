"""One fit to arrival times, wave directions and a known wind, beside the joint fit."""

from typing import Any

from bella.exceptions import InputError
from bella.tracks.fused import fit_fused, fused_json
from bella.tracks.joint_ingredients import Ingredients, JointOptions
from bella.tracks.joint_model import JointModel


def fused_companion(known: Ingredients, rotation_period_d: float, options: JointOptions) -> dict[str, Any]:
    """One fit to arrival times, wave directions and a known wind, and what each adds.

    Parameters
    ----------
    known : Ingredients
    rotation_period_d : float
        Rotation period of the Sun, days.
    options : JointOptions

    Returns
    -------
    dict
        Ready for JSON, as :func:`bella.tracks.fused_json` returns it.

    Raises
    ------
    InputError
        If there are arrival times alone, which the joint fit has.
    """
    if len(known.names) < 2:
        raise InputError("there are neither wave directions nor a measured wind: the joint fit has the arrival times")
    return fused_json(fit_fused(known, JointModel(rotation_period_d=rotation_period_d), options))
