"""The solar wind that a burst crosses: speeds in situ, and the speeds near the Sun that explain them."""

from bella.solar_wind.along_track import FieldLine, field_line_through, speed_at_sources_km_s
from bella.solar_wind.assimilation import WindAssimilation, assimilate_wind
from bella.solar_wind.context import Footpoint, connection_angles, footpoint, regions_near
from bella.solar_wind.field_line import field_line_longitude_deg
from bella.solar_wind.observations import hourly_speeds
from bella.solar_wind.source_regions import SourceRegion, read_active_regions, read_coronal_holes
from bella.solar_wind.steady import SteadyWind, accelerated_speed_km_s, steady_wind
from bella.solar_wind.upwind import InnerBoundary, WindHistory, upwind_wind

__all__ = [
    "FieldLine",
    "Footpoint",
    "InnerBoundary",
    "SourceRegion",
    "SteadyWind",
    "WindAssimilation",
    "WindHistory",
    "accelerated_speed_km_s",
    "assimilate_wind",
    "connection_angles",
    "field_line_longitude_deg",
    "field_line_through",
    "footpoint",
    "hourly_speeds",
    "read_active_regions",
    "read_coronal_holes",
    "regions_near",
    "speed_at_sources_km_s",
    "steady_wind",
    "upwind_wind",
]
