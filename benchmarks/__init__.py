"""What docs/speed.md says about speed, measured: ``make bench``."""
