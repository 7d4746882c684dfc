"""Where the receivers were: a compact ephemeris table, its interpolation, and the HEE frame."""

from bella.spacecraft.ephemeris import BODIES, FRAME, OBSERVATORIES, coverage, fleet, position_hee

__all__ = ["BODIES", "FRAME", "OBSERVATORIES", "coverage", "fleet", "position_hee"]
