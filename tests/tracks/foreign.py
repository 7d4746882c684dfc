"""Arrival times of bursts whose laws the fit does not know: written from the physics, sharing nothing with it."""

from dataclasses import dataclass

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.units import FloatArray

LIGHT_RSUN_S = 299_792.458 / 695_700.0
TURN_RAD_S = 2 * np.pi / (25.38 * 86_400.0)
UTC = np.datetime64("2012-06-07T19:30", "ns")
THREE = np.array([[216.0, 0.0, 0.0], [-93.0, 184.0, 0.2], [-97.0, -192.5, 0.3]])
FOUR = np.array([[216.0, 0.0, 0.0], [-93.0, 184.0, 0.2], [-97.0, -192.5, 0.3], [40.0, -60.0, 3.0]])
FREQUENCY_MHZ = np.geomspace(0.16, 1.9, 30)


@dataclass(frozen=True)
class Burst:
    """A beam on a spiral, with its truth."""

    phi0_deg: float = 30.0
    v_sw_km_s: float = 430.0
    beam_speed_c: float = 0.15
    slowing: float = 0.0
    kappa: float = 0.0
    harmonic: int = 2
    density: float = 1.3

    @property
    def rise_s(self) -> FloatArray:
        """Half width of the rise."""
        return np.asarray(28.0 * FREQUENCY_MHZ**-0.9)

    @property
    def range_rsun(self) -> FloatArray:
        """Distance by Saito 1977 (doi:10.1007/BF00150879), equatorial, times a factor."""
        r = np.geomspace(1.5, 400, 5000)
        density_cm3 = self.density * (1.36e6 * r**-2.14 + 1.68e8 * r**-6.13)
        emitted = self.harmonic * 8.98e-3 * np.sqrt(density_cm3)
        return np.asarray(np.interp(-FREQUENCY_MHZ, -emitted, r))

    @property
    def source_rsun(self) -> FloatArray:
        """HEE, shape (F, 3)."""
        r = self.range_rsun
        angle = np.radians(self.phi0_deg) - TURN_RAD_S * 695_700.0 / self.v_sw_km_s * (r - 1)
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0 * r], axis=1)

    @property
    def emission_s(self) -> FloatArray:
        """When the beam passes the sources, by summing small steps along the spiral."""
        turn = TURN_RAD_S * 695_700.0 / self.v_sw_km_s
        steps = [np.linspace(1.0, r, 3001) for r in self.range_rsun]
        path = [np.sqrt(1 + (turn * x) ** 2) * x**self.slowing / (self.beam_speed_c * LIGHT_RSUN_S) for x in steps]
        return np.array([np.trapezoid(y, x) for x, y in zip(steps, path, strict=True)])

    @property
    def mean_speed_c(self) -> float:
        """Along the spiral between the highest and the lowest frequency."""
        turn = TURN_RAD_S * 695_700.0 / self.v_sw_km_s
        steps = [np.linspace(1.0, r, 3001) for r in self.range_rsun[[0, -1]]]
        far, near = (np.trapezoid(np.sqrt(1 + (turn * x) ** 2), x) for x in steps)
        return float((far - near) / (self.emission_s[0] - self.emission_s[-1]) / LIGHT_RSUN_S)

    def arrivals(
        self,
        rng: np.random.Generator | None = None,
        *,
        receivers: FloatArray = THREE,
        sigma_s: float = 3.0,
        shape: float = 0.05,
        offset_s: float = 2.0,
    ) -> ArrivalGrid:
        """Times with noise as stated; its smooth part is a sum of waves, not the Gaussian process of the fit."""
        source = self.source_rsun
        sight = receivers[None] - source[:, None]
        distance = np.linalg.norm(sight, axis=2)
        cosine = np.einsum("fni,fi->fn", sight, source) / distance / self.range_rsun[:, None]
        late = self.kappa * self.rise_s[:, None] * (1 - cosine)
        times = self.emission_s[:, None] + distance / LIGHT_RSUN_S + late
        if rng is not None:
            log = np.log(FREQUENCY_MHZ)[:, None]
            for column in range(len(receivers)):
                waves = np.cos(rng.uniform(0.5, 3.5, 6) * log + rng.uniform(0, 2 * np.pi, 6)).sum(axis=1) / np.sqrt(3)
                times[:, column] += sigma_s * rng.standard_normal(log.size) + shape * self.rise_s * waves
                times[:, column] += offset_s * rng.standard_normal()
        wide = times.shape
        return ArrivalGrid(
            FREQUENCY_MHZ,
            tuple("ABCDE"[: len(receivers)]),
            times,
            np.full(wide, sigma_s),
            np.broadcast_to(receivers, (*wide, 3)).copy(),
            UTC,
            "none",
            shape_sd_s=np.broadcast_to(shape * self.rise_s[:, None], wide),
            offset_sd_s=np.full(wide, offset_s),
            rise_s=np.broadcast_to(self.rise_s[:, None], wide),
        )


def drawn(seed: int, slowing: bool = False) -> tuple[Burst, ArrivalGrid]:
    """A burst of random place and laws, with its arrival times."""
    rng = np.random.default_rng(seed)
    exponent = float(rng.uniform(0.2, 0.45)) if slowing else 0.0
    burst = Burst(
        phi0_deg=float(rng.uniform(-180, 180)),
        v_sw_km_s=float(rng.uniform(300, 650)),
        beam_speed_c=float(rng.uniform(0.09, 0.25)) * (2.2 if slowing else 1.0),
        slowing=exponent,
        kappa=float(rng.choice([0.0, 0.1, 0.2])),
        harmonic=int(rng.integers(1, 3)),
        density=float(rng.uniform(0.7, 2.5)),
    )
    return burst, burst.arrivals(rng)
