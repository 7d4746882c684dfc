"""Points between frames: what the ephemeris says of a spacecraft in each of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bella.exceptions import InputError
from bella.spacecraft import FRAMES, cartesian, hee_from, hee_to, polar, position

BURST = np.datetime64("2012-06-07T19:30", "ns")


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("name", ["EARTH", "STEREO-A", "STEREO-B"])
def test_a_spacecraft_is_where_the_ephemeris_has_it_in_every_frame(frame: str, name: str) -> None:
    here = position(name, [BURST], "hee")
    np.testing.assert_allclose(hee_to(frame, here, BURST), position(name, [BURST], frame), atol=1e-9)
    np.testing.assert_allclose(hee_from(frame, position(name, [BURST], frame), BURST), here, atol=1e-9)


@given(r=st.floats(1.0, 300.0), longitude=st.floats(-179.9, 179.9), latitude=st.floats(-89.0, 89.0))
def test_polar_and_cartesian_are_inverse(r: float, longitude: float, latitude: float) -> None:
    back = np.concatenate(polar(cartesian(r, longitude, latitude)))
    np.testing.assert_allclose(back, [r, longitude, latitude], rtol=1e-9, atol=1e-9)


def test_points_without_three_coordinates_are_refused() -> None:
    with pytest.raises(InputError, match="are not N x 3"):
        hee_to("heeq", np.zeros((2, 2)), BURST)
