"""Solar wind around a burst: speeds in situ and the wind that explains them, the footpoint and the regions near it."""

from bella.solar_wind.along_track import (
    FieldLine,
    TrackSpiral,
    field_line_through,
    line_of_track,
    measured_wind,
    speed_at_sources,
    wind_companion,
)
from bella.solar_wind.assimilation import HALF_ROTATION, LeftOut, Places, Speeds, WindAssimilation, assimilate_wind
from bella.solar_wind.context import (
    Footpoint,
    connection_angles,
    footpoint,
    footpoint_companion,
    regions_near,
)
from bella.solar_wind.in_situ import InSitu, UsedFile, hourly_speeds, speeds_around
from bella.solar_wind.source_regions import (
    OLDEST_REGIONS,
    Regions,
    SourceRegion,
    read_active_regions,
    read_coronal_holes,
    region_files,
    region_sha256,
    regions_around,
)
from bella.solar_wind.steady import SteadyWind, accelerated_speed_km_s, field_lines_deg, steady_wind

__all__ = [
    "HALF_ROTATION",
    "OLDEST_REGIONS",
    "FieldLine",
    "Footpoint",
    "InSitu",
    "LeftOut",
    "Places",
    "Regions",
    "SourceRegion",
    "Speeds",
    "SteadyWind",
    "TrackSpiral",
    "UsedFile",
    "WindAssimilation",
    "accelerated_speed_km_s",
    "assimilate_wind",
    "connection_angles",
    "field_line_through",
    "field_lines_deg",
    "footpoint",
    "footpoint_companion",
    "hourly_speeds",
    "line_of_track",
    "measured_wind",
    "read_active_regions",
    "read_coronal_holes",
    "region_files",
    "region_sha256",
    "regions_around",
    "regions_near",
    "speed_at_sources",
    "speeds_around",
    "steady_wind",
    "wind_companion",
]
