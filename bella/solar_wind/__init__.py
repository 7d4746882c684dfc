"""The solar wind that a burst crosses: speeds in situ, and the speeds near the Sun that explain them."""

from bella.solar_wind.assimilation import WindAssimilation, assimilate_wind
from bella.solar_wind.field_line import field_line_longitude_deg
from bella.solar_wind.observations import hourly_speeds
from bella.solar_wind.steady import SteadyWind, accelerated_speed_km_s, steady_wind
from bella.solar_wind.upwind import InnerBoundary, WindHistory, upwind_wind

__all__ = [
    "InnerBoundary",
    "SteadyWind",
    "WindAssimilation",
    "WindHistory",
    "accelerated_speed_km_s",
    "assimilate_wind",
    "field_line_longitude_deg",
    "hourly_speeds",
    "steady_wind",
    "upwind_wind",
]
