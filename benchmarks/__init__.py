"""What README claims about speed, measured: ``make bench``."""
