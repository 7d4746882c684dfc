"""What a SunPy search may ask of a service: ``a.bella.Catalogue`` and ``a.bella.Service``."""

from sunpy.net.attr import SimpleAttr

__all__ = ["Catalogue", "Service"]


class Catalogue(SimpleAttr):  # type: ignore[misc]
    """Catalogue to search: ``bursts``, ``tracks`` or ``detections``."""


class Service(SimpleAttr):  # type: ignore[misc]
    """Address of the service, such as ``http://127.0.0.1:8000``."""
