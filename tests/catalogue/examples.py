"""Small publications that differ where a test wants them to."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from math import isnan
from typing import Any

from bella.catalogue import Burst, Localisation, Publication, Series, SourceFile
from bella.records import Interval, JointTrack, Moment, Parameter, Track

START = datetime(2012, 6, 7, 19, 29, tzinfo=UTC)
SERIES = Series("half_maximum", "posterior", "default", 2)
SPECTRUM = SourceFile("WI_H1_WAV", START.date(), "v01", "ab" * 32, "used", "file:///archive/wi_h1_wav.cdf")


def burst(burst_id: str = "T3-20120607-1929", start: datetime = START, **changes: Any) -> Burst:
    received = ("WIND", "STEREO-A", "STEREO-B")
    return replace(Burst(burst_id, start, start + timedelta(minutes=40), 0.15, 13.8, received), **changes)


def localisation(frequency_mhz: float, **changes: Any) -> Localisation:
    return replace(
        Localisation(
            frequency_mhz=frequency_mhz,
            x_rsun=20.5,
            y_rsun=-3.25,
            z_rsun=0.0,
            cov_xx_rsun2=4.0,
            cov_xy_rsun2=-0.5,
            cov_yy_rsun2=2.25,
            cov_xz_rsun2=None,
            cov_yz_rsun2=None,
            cov_zz_rsun2=None,
            area68_rsun2=22.0,
            area95_rsun2=58.0,
            modes=1,
            emission_utc=START + timedelta(microseconds=123456),
            v_over_c=1.0,
            v_over_c_sd=0.001,
            contraction_x=0.01,
            contraction_y=0.02,
            contraction_v=1.0,
            log_evidence=-12.5,
            flags="speed_not_constrained",
        ),
        **changes,
    )


def publication(
    inputs_hash: str = "h1", of: Burst | None = None, series: Series = SERIES, **changes: Any
) -> Publication:
    own = of or burst()
    tail = f"{series.edge}-{series.method}-{series.preset}-{series.dimensions}d-{inputs_hash}"
    return replace(
        Publication(
            burst=own,
            series=series,
            inputs_hash=inputs_hash,
            code_version="0.1.0",
            flags=("speed_not_constrained",),
            store_path=f"{own.burst_id}/{tail}.zarr.zip",
            store_sha256="cd" * 32,
            reference_utc=own.start_utc,
            localisations=(localisation(0.5), localisation(0.25)),
            track_fit={"frame": "HEE", "two_step": {"v_sw_km_s": {"mean": 400.0}}},
            sources=(SPECTRUM,),
        ),
        **changes,
    )


def fitted(middle_deg: float = 26.0, half_width_deg: float = 4.5, tier: str = "final", **changes: Any) -> Track:
    """Track with a longitude and a wind; without numbers where the middle is NaN."""

    def parameter(middle: float, half_width: float) -> Parameter:
        if isnan(middle):
            return Parameter()
        return Parameter(q16=middle - half_width, q50=middle, q84=middle + half_width, contraction=0.3)

    said = {
        "tier": tier,
        "phi0_68": (Interval(low=20.0, high=80.0, probability=0.7),) if tier == "preliminary" else (),
        "misfit_p": 0.4,
        **changes,
    }
    joint = JointTrack(
        model="joint",
        rotation_period_d=25.38,
        epoch_utc="2012-06-07T19:29:00Z",
        phi0_deg=parameter(middle_deg, half_width_deg),
        v_sw_km_s=parameter(590.0, 100.0),
        beam_speed_c=parameter(0.2, 0.01),
        release_utc=Moment(),
        **said,
    )
    return Track(remark="apparent", rotation_period_d=25.38, joint=joint)
