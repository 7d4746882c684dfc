"""Solar wind that changes with time: an upwind march of Burgers' equation along every direction from the Sun.

Directions do not turn, the Sun below them does: each sees the boundary pass by, and its parcels move radially. The
scheme is that of HUX and HUXt (Riley & Lionello 2011, Sol. Phys. 270, 575, doi:10.1007/s11207-011-9766-x; Owens et al.
2020, Sol. Phys. 295, 43, doi:10.1007/s11207-020-01605-3), with the acceleration of :mod:`bella.solar_wind.steady`.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bella.exceptions import InputError
from bella.heliosphere import SIDEREAL_ROTATION_D
from bella.solar_wind.steady import (
    ACCELERATION,
    INNER_RSUN,
    OUTER_RSUN,
    SteadyWind,
    accelerated_speed_km_s,
    boundary_longitudes_deg,
    check_boundary,
)
from bella.units import DAY_S, R_SUN_KM, FloatArray

UPWIND_STEP_RSUN = 1.5
KEPT_EVERY_S = 4 * 3600.0
"""The Sun turns by 2.4 degrees between two kept states: less than a bin of 128."""

SETTLING = 1.5
"""How often the slowest parcel could cross the grid before the first state is kept (Owens et al. 2020)."""


@dataclass(frozen=True)
class InnerBoundary:
    """Speeds near the Sun that turn with it.

    Attributes
    ----------
    speed_km_s : ndarray, shape (M, L)
        Speed in L equal bins of Carrington longitude, km/s: M maps, linear in time between them.
    utc : ndarray of datetime64, shape (M,)
        Ascending; before the first and after the last the map stands.
    range_rsun : float
    rotation_period_d : float
        Sidereal, days.
    """

    speed_km_s: FloatArray
    utc: npt.NDArray[np.datetime64]
    range_rsun: float = INNER_RSUN
    rotation_period_d: float = SIDEREAL_ROTATION_D

    def __post_init__(self) -> None:
        if self.speed_km_s.ndim != 2 or not self.utc.size or self.utc.shape != self.speed_km_s.shape[:1]:
            raise InputError(f"maps of shape {self.speed_km_s.shape} at {self.utc.size} times: give one map for a time")
        if not (np.diff(self.utc) > np.timedelta64(0)).all():
            raise InputError("the times of the maps do not ascend: sort them, and leave out what occurs twice")
        for boundary in self.speed_km_s:
            check_boundary(boundary, self.range_rsun, np.inf)

    def at(self, utc: npt.NDArray[np.datetime64], carrington_deg: FloatArray) -> FloatArray:
        """Speed at times, under directions.

        Parameters
        ----------
        utc : ndarray of datetime64, shape (T,)
        carrington_deg : ndarray, shape (T, L)
            Carrington longitudes at each time, degrees.

        Returns
        -------
        ndarray, shape (T, L)
            km/s.
        """
        since = _seconds(utc, self.utc[0])
        map_at = np.interp(since, _seconds(self.utc, self.utc[0]), np.arange(self.utc.size))
        early = np.minimum(map_at.astype(int), max(self.utc.size - 2, 0))[:, None]
        late, share = np.minimum(early + 1, self.utc.size - 1), map_at[:, None] - early
        bins = self.speed_km_s.shape[1]
        turned = carrington_deg / 360.0 * bins - 0.5
        left = np.floor(turned).astype(int)
        right = turned - left

        def _under(which: npt.NDArray[np.intp]) -> FloatArray:
            near, far = self.speed_km_s[which, left % bins], self.speed_km_s[which, (left + 1) % bins]
            return np.asarray((1 - right) * near + right * far)

        return np.asarray((1 - share) * _under(early) + share * _under(late))


@dataclass(frozen=True)
class WindHistory:
    """Speed of a wind through time.

    Attributes
    ----------
    utc : ndarray of datetime64, shape (T,)
    range_rsun : ndarray, shape (R,)
        Solar radii, equal steps outward from the inner boundary.
    longitude_deg : ndarray, shape (L,)
        Fixed directions, named by the Carrington longitude under each at ``utc[0]``, degrees.
    speed_km_s : ndarray, shape (T, R, L)
    rotation_period_d : float
        Sidereal, days.
    """

    utc: npt.NDArray[np.datetime64]
    range_rsun: FloatArray
    longitude_deg: FloatArray
    speed_km_s: FloatArray
    rotation_period_d: float

    def snapshot(self, utc: np.datetime64) -> SteadyWind:
        """Wind at one time, by Carrington longitude.

        Parameters
        ----------
        utc : numpy.datetime64

        Returns
        -------
        SteadyWind
            What the wind would be if it turned with the Sun as it is now.

        Raises
        ------
        InputError
            If the time is not within those of the history.
        """
        if not self.utc[0] <= utc <= self.utc[-1]:
            raise InputError(f"{utc} is not between {self.utc[0]} and {self.utc[-1]}: run the wind over that time")
        since = _seconds(self.utc, self.utc[0])
        later = int(np.clip(np.searchsorted(self.utc, utc), 1, self.utc.size - 1))
        share = (float(_seconds(utc, self.utc[0])) - since[later - 1]) / (since[later] - since[later - 1])
        # each of the two is turned with the Sun to this time: streams do, and would be doubled otherwise
        early, late = (self._turned(index) for index in (later - 1, later))
        return SteadyWind(self.range_rsun, self.longitude_deg, (1 - share) * early + share * late)

    def _turned(self, index: int) -> FloatArray:
        """One kept state by Carrington longitude at its own time, shape (R, L)."""
        bins = self.longitude_deg.size
        shift = _turn_deg(self.utc[index], self.utc[0], self.rotation_period_d) / 360.0 * bins
        whole = int(np.floor(shift))
        state = self.speed_km_s[index]
        return np.asarray(
            (1 - shift + whole) * np.roll(state, -whole, 1) + (shift - whole) * np.roll(state, -whole - 1, 1)
        )

    def at(self, utc: np.datetime64, range_rsun: FloatArray, longitude_deg: FloatArray) -> FloatArray:
        """Speed at points at one time.

        Parameters
        ----------
        utc : numpy.datetime64
        range_rsun, longitude_deg : ndarray, shape (N,)
            Solar radii, and Carrington longitude at that time in degrees.

        Returns
        -------
        ndarray, shape (N,)
            km/s; NaN inside the inner boundary and beyond the outer one.

        Raises
        ------
        InputError
            If the time is not within those of the history.
        """
        return self.snapshot(utc).at(range_rsun, longitude_deg)


def upwind_wind(
    boundary: InnerBoundary, start_utc: np.datetime64, days: float, outer_rsun: float = OUTER_RSUN
) -> WindHistory:
    """March the wind of a boundary through time.

    Parameters
    ----------
    boundary : InnerBoundary
    start_utc : numpy.datetime64
        First time kept; the march starts earlier, until what it started from has left the grid.
    days : float
        How long, days.
    outer_rsun : float
        Solar radii.

    Returns
    -------
    WindHistory

    Raises
    ------
    InputError
        If the boundaries are not in order, or the time is not above 0.
    """
    if not 0 < days < np.inf or np.isnat(start_utc):
        raise InputError(f"{days:g} days from {start_utc} is no span of time: give a start and more than 0 days")
    check_boundary(boundary.speed_km_s[0], boundary.range_rsun, outer_rsun)
    range_rsun = np.arange(boundary.range_rsun, outer_rsun + 0.5 * UPWIND_STEP_RSUN, UPWIND_STEP_RSUN)
    longitude = boundary_longitudes_deg(boundary.speed_km_s.shape[1])
    elapsed_s, before, steps = _schedule(boundary, range_rsun[-1], days)
    utc = start_utc.astype("datetime64[ns]") + np.rint(elapsed_s * 1e9).astype("timedelta64[ns]")
    inflow = boundary.at(utc, longitude - _turn_deg(utc, start_utc, boundary.rotation_period_d)[:, None])
    states = _marched(inflow, range_rsun, elapsed_s[1] - elapsed_s[0], before, steps)
    return WindHistory(utc[before::steps], range_rsun, longitude, states, boundary.rotation_period_d)


def _schedule(boundary: InnerBoundary, outer_rsun: float, days: float) -> tuple[FloatArray, int, int]:
    """Times of the march after the start, s; how many of them come before it; steps from one kept state to the next."""
    # Courant number at most 1, and a whole number of steps between kept states
    fastest = (1.0 + ACCELERATION) * float(boundary.speed_km_s.max())
    steps = int(np.ceil(KEPT_EVERY_S * fastest / (UPWIND_STEP_RSUN * R_SUN_KM)))
    settling_s = SETTLING * (outer_rsun - boundary.range_rsun) * R_SUN_KM / float(boundary.speed_km_s.min())
    before = int(np.ceil(settling_s / KEPT_EVERY_S)) * steps
    after = max(1, int(np.ceil(days * DAY_S / KEPT_EVERY_S))) * steps
    return np.asarray(KEPT_EVERY_S / steps * np.arange(-before, after + 1)), before, steps


def _marched(inflow: FloatArray, range_rsun: FloatArray, step_s: float, before: int, steps: int) -> FloatArray:
    """Every `steps`-th state from the index `before` on, shape (T, R, L), for inflow of shape (N, L).

    v_i += (dt/dr) [v_i (v_{i-1} - v_i) + v_{i-1}^2 g_i], g_i the relative gain of an undisturbed parcel in one cell.
    """
    ratio = step_s / (UPWIND_STEP_RSUN * R_SUN_KM)
    pushed = ratio * (accelerated_speed_km_s(np.ones(1), range_rsun[1:], range_rsun[:-1])[:, None] - 1.0)
    speed = accelerated_speed_km_s(inflow[0], range_rsun[:, None], range_rsun[0])
    states = np.empty(((len(inflow) - 1 - before) // steps + 1, *speed.shape))
    inner, outer = speed[:-1], speed[1:]
    change, push = np.empty_like(outer), np.empty_like(outer)
    for index, boundary in enumerate(inflow):
        if index:
            # in place: new arrays of this size would double the time
            np.subtract(inner, outer, out=change)
            change *= outer
            change *= ratio
            np.multiply(inner, inner, out=push)
            push *= pushed
            change += push
            outer += change
        speed[0] = boundary
        if index >= before and (index - before) % steps == 0:
            states[(index - before) // steps] = speed
    return states


def _turn_deg(
    utc: np.datetime64 | npt.NDArray[np.datetime64], since: np.datetime64, rotation_period_d: float
) -> FloatArray:
    """How far the Sun has turned below a fixed direction, degrees."""
    return np.asarray(360.0 * _seconds(utc, since) / (rotation_period_d * DAY_S))


def _seconds(utc: np.datetime64 | npt.NDArray[np.datetime64], since: np.datetime64) -> FloatArray:
    return np.asarray((utc - since) / np.timedelta64(1, "ns"), dtype=np.float64) / 1e9
