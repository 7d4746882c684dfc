"""Python and SunPy clients against a server on the loopback."""
