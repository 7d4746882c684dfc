"""The server that examples of the documentation read."""

from tests.conformance.conftest import address, filled

__all__ = ["address", "filled"]
