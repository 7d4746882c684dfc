"""Simulated bursts for the tests of the joint fit: three spacecraft at 1 au, forty frequencies."""

from dataclasses import replace

import numpy as np
from bella.tracks.joint_model import PHI0

from bella.arrivals import ArrivalGrid
from bella.tracks import DirectionTerms, JointModel
from bella.units import AU_RSUN, C_RSUN_S

FREQUENCY_MHZ = np.geomspace(0.15, 2.0, 40)
SIGMA_S = np.array([60.0, 38.0, 38.0])
LONGITUDES_DEG = np.array([0.0, 116.8, -116.8])
RELEASE_S = 500.0


def standard(model: JointModel, phi0_deg: float, v_sw_km_s: float) -> np.ndarray:
    """Parameters of a burst with all but longitude and wind at the prior mean, shape (P,)."""
    z = np.zeros(len(model.parameters))
    z[PHI0] = (phi0_deg - model.priors.phi0_deg) / model.priors.phi0_sd_deg
    z[1] = (model.priors.v_sw_km_s / v_sw_km_s - 1) / model.priors.slowness_sd
    return z


def simulated(
    z: np.ndarray, model: JointModel, rng: np.random.Generator | None, scale: float = 1.0, turned_deg: float = 0.0
) -> ArrivalGrid:
    """Arrival times of a burst, with noise as stated, or none."""
    angle = np.radians(LONGITUDES_DEG + turned_deg)
    place = AU_RSUN * np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
    receiver = np.tile(place, (FREQUENCY_MHZ.size, 1, 1))
    arrival = RELEASE_S + model.delay_s(z[None], FREQUENCY_MHZ, receiver)[0]
    sigma = np.broadcast_to(scale * SIGMA_S, arrival.shape)
    noise = rng.standard_normal(arrival.shape) * sigma if rng is not None else 0.0
    epoch = np.datetime64("2012-06-07T19:00", "ns")
    return ArrivalGrid(FREQUENCY_MHZ, ("A", "B", "C"), arrival + noise, sigma.copy(), receiver, epoch, "none")


def towards_source(
    z: np.ndarray, model: JointModel, rng: np.random.Generator, sigma_deg: float = 3.0
) -> DirectionTerms:
    """Wave directions at two of the spacecraft, every fourth frequency, with noise as stated."""
    angle = np.radians(LONGITUDES_DEG[1:])
    place = AU_RSUN * np.stack([np.cos(angle), np.sin(angle), np.zeros(2)], axis=1)
    frequency = np.repeat(FREQUENCY_MHZ[::4], 2)
    receiver = np.tile(place, (FREQUENCY_MHZ[::4].size, 1))
    parameters = model.natural(z[None])
    sight = model.position_rsun(parameters, model.range_rsun(parameters, frequency))[0] - receiver
    east_west = np.arctan2(sight[:, 1], sight[:, 0]) + np.radians(sigma_deg) * rng.standard_normal(frequency.size)
    north = np.radians(sigma_deg) * rng.standard_normal(frequency.size)
    towards = np.stack([np.cos(north) * np.cos(east_west), np.cos(north) * np.sin(east_west), np.sin(north)], axis=1)
    return DirectionTerms(frequency, receiver, towards, np.full(frequency.size, sigma_deg))


def reversed_rows(grid: ArrivalGrid) -> ArrivalGrid:
    """The same burst with its receivers in another order."""
    swapped = {name: getattr(grid, name)[:, ::-1] for name in ("arrival_s", "sigma_s", "receiver_rsun", "offset_sd_s")}
    return replace(grid, observatories=grid.observatories[::-1], **swapped)


def retrograde(rng: np.random.Generator) -> ArrivalGrid:
    """A source that turns west with distance, as no wind makes it."""
    range_rsun = 40.0 * 0.55 / FREQUENCY_MHZ
    angle = np.radians(20.0 + 0.3 * range_rsun)
    grid = simulated(standard(JointModel(), 20.0, 400.0), JointModel(), None)
    source = np.stack([range_rsun * np.cos(angle), range_rsun * np.sin(angle), 0 * angle], axis=1)
    light = np.linalg.norm(source[:, None] - grid.receiver_rsun, axis=2) / C_RSUN_S
    arrival = range_rsun[:, None] / (0.15 * C_RSUN_S) + light
    return replace(
        grid, arrival_s=arrival + 0.25 * SIGMA_S * rng.standard_normal(light.shape), sigma_s=grid.sigma_s / 4
    )
