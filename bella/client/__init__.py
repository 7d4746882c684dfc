"""A running service, as a Python program reads it: :class:`Client`; for SunPy, import :mod:`bella.client.fido`."""

from bella.client.client import Client

__all__ = ["Client"]
