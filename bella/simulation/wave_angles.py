"""Where the waves come from, as a receiver with direction finding says: from the bursts, and else from anywhere."""

from collections.abc import Sequence

import numpy as np

from bella.simulation.burst import SimulatedBurst, source_position_rsun
from bella.simulation.receiver import Receiver, received_power
from bella.spacecraft import position_hee
from bella.units import FloatArray

COLATITUDE, AZIMUTH = "wave_colatitude_hee_deg", "wave_azimuth_hee_deg"
SCATTER_DEG = 2.0
"""Error of a direction that no background disturbs."""


def wave_angles(
    receiver: Receiver,
    bursts: Sequence[SimulatedBurst],
    start_utc: np.datetime64,
    middle_s: FloatArray,
    rng: np.random.Generator,
) -> dict[str, FloatArray]:
    """Directions towards the sources, weighted by what is received from each, with a background from anywhere.

    Parameters
    ----------
    receiver : Receiver
    bursts : sequence of SimulatedBurst
    start_utc : numpy.datetime64
        What the middles are counted from.
    middle_s : numpy.ndarray, shape (N,)
        Middles of the records, ascending, s.
    rng : numpy.random.Generator

    Returns
    -------
    dict of str to numpy.ndarray, shape (N, C)
        ``wave_colatitude_hee_deg`` and ``wave_azimuth_hee_deg``, HEE, degrees: apparent sources are true ones here.

    Raises
    ------
    NoDataError
        If the ephemeris does not have the spacecraft.
    """
    towards = rng.standard_normal((middle_s.size, receiver.frequency_mhz.size, 3))
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    for burst in bursts:
        power = received_power(receiver, [burst], start_utc, middle_s)
        rows = np.flatnonzero(power.any(axis=1))
        towards[rows] += power[rows][:, :, None] * _sight(burst, receiver)
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    towards += np.radians(SCATTER_DEG) * rng.standard_normal(towards.shape)
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    return {
        COLATITUDE: np.degrees(np.arccos(towards[..., 2])),
        AZIMUTH: np.degrees(np.arctan2(towards[..., 1], towards[..., 0])),
    }


def _sight(burst: SimulatedBurst, receiver: Receiver) -> FloatArray:
    """Unit vectors from the spacecraft to the source of each channel in the band of the burst, else 0, (C, 3)."""
    frequency = receiver.frequency_mhz
    inside = (frequency >= burst.f_low_mhz) & (frequency <= burst.f_high_mhz)
    place = position_hee(receiver.observatory, np.array([burst.release_utc]), burst.release_utc)[0]
    sight = np.zeros((frequency.size, 3))
    sight[inside] = source_position_rsun(burst, frequency[inside]) - place
    return np.asarray(sight / np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-9))
