"""The server that the conformance tests look at."""

from tests.conformance.conftest import address, filled

__all__ = ["address", "filled"]
