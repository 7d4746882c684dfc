"""How many simulated bursts are found, and how many are not there: one spacecraft at a time.

Truth is drawn with widths, densities, bands and brightnesses that scatter about the laws of the templates, among
nuisances. A burst counts if twelve channels of the search grid see it 3 dB over background, and it is not in a gap. A
detection of a weaker burst, or of a storm's, is neither right nor wrong.
"""

from dataclasses import dataclass, field
from datetime import date, timedelta

import numpy as np
import pandas as pd
import xarray as xr
from scipy.signal import find_peaks

from bella.bursts.detection import detect_bursts
from bella.bursts.matched_filter import FREQUENCY_MHZ
from bella.simulation.archive_days import sky_of
from bella.simulation.burst import SimulatedBurst, arrival_s, contrast_at
from bella.simulation.day import observe_day
from bella.simulation.instruments import Instrument, instruments
from bella.simulation.receiver import filled_in_frequency
from bella.simulation.sky import Sky
from bella.spectra import combine_receivers, over_background
from bella.spectra.minutes import with_visits
from bella.spectra.stereo import by_minute
from benchmarks.localisation import Row, seconds

FIRST_DAY = date(2021, 2, 1)
FLEET = {
    "WIND": ("WI_H1_WAV",),
    "STEREO-A": ("STEREO_LEVEL2_SWAVES",),
    "PSP": ("PSP_FLD_L2_RFS_LFR", "PSP_FLD_L2_RFS_HFR"),
    "SOLO": ("SOLO_L3_RPW-TNR-SURV-FLUX", "SOLO_L3_RPW-HFR-SURV-FLUX"),
}
LEAST_CHANNELS, BROAD_CHANNELS = 12, 25
LEAST_CONTRAST = 1.0  # 3 dB over background
NEAR_S = 240.0
MOMENTS = ("time", "sample_time")
ALONE_S = (20 * 60.0, 30 * 60.0)


@dataclass
class Received:
    """A burst as one spacecraft receives it."""

    start_s: float
    channels: int
    counts: bool
    is_isolated_broad: bool = False


@dataclass
class Score:
    """Counts over days."""

    days: int = 0
    found: int = 0
    missed: int = 0
    isolated_found: int = 0
    isolated_missed: int = 0
    false: int = 0
    mirrored: int = 0
    onset_s: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        """One line of the table."""
        recall = self.found / max(self.found + self.missed, 1)
        precision = self.found / max(self.found + self.false, 1)
        isolated = self.isolated_found / max(self.isolated_found + self.isolated_missed, 1)
        f1 = 2 * recall * precision / max(recall + precision, 1e-9)
        spread = float(np.quantile(np.abs(self.onset_s), 0.68)) if self.onset_s else np.nan
        return (
            f"{name:9s} {self.days:4d} {self.found + self.missed:5d} {recall:6.2f} "
            f"{self.isolated_found:4d}/{self.isolated_found + self.isolated_missed:<4d} {isolated:5.2f} "
            f"{precision:6.2f} {f1:5.2f} {self.false / max(self.days, 1):6.2f} "
            f"{self.mirrored / max(self.days, 1):6.2f} {spread:6.0f}"
        )


HEADER = "           days bursts recall isolated+broad  precis    F1   FA/day mirror onset s"


def spectrum_of(observatory: str, day: date, skies: list[Sky], seed: int) -> xr.Dataset:
    """Spectrum of a spacecraft-day, all receivers together, as it is read from the files."""
    parts = []
    for number, dataset in enumerate(FLEET[observatory]):
        rng = np.random.default_rng([seed, day.toordinal(), number, sorted(FLEET).index(observatory)])
        theirs = [one for one in instruments(dataset, day) if one.receiver.observatory == observatory]
        parts += [as_read(one, observe_day(one, skies, day, rng)) for one in theirs]
    return parts[0] if len(parts) == 1 else combine_receivers(*parts)


def as_read(instrument: Instrument, spectrum: xr.Dataset) -> xr.Dataset:
    """Without the times of samples, which files of averages do not have, and with what readers know of them."""
    if not instrument.averaged:
        return spectrum
    return with_visits(filled_in_frequency(spectrum)) if "interpolated" in spectrum else by_minute(without(spectrum))


def without(spectrum: xr.Dataset) -> xr.Dataset:
    """Without times of samples."""
    return spectrum.drop_vars(["sample_time", "sample_offset_s"], errors="ignore")


def received(burst: SimulatedBurst, observatory: str, midnight: np.datetime64) -> Received:
    """When and how widely a spacecraft receives a burst."""
    seen = contrast_at(burst, FREQUENCY_MHZ, observatory) >= LEAST_CONTRAST
    released_s = (burst.release_utc - midnight) / np.timedelta64(1, "s")
    if not seen.any():
        return Received(released_s + 500, 0, counts=False)
    highest = FREQUENCY_MHZ[seen][-1:]
    start_s = float(released_s + arrival_s(burst, highest, observatory)[0])
    return Received(start_s, int(seen.sum()), counts=int(seen.sum()) >= LEAST_CHANNELS)


def truths(sky: Sky, observatory: str) -> list[Received]:
    """Every burst of a day as a spacecraft receives it."""
    midnight = np.datetime64(sky.day, "ns")
    bursts = [received(burst, observatory, midnight) for burst in sky.bursts]
    storm = [received(burst, observatory, midnight) for burst in sky.storm]
    gaps = sky.conditions[observatory].gaps_s
    for one in bursts:
        in_gap = any(start - 600 < one.start_s < stop + 300 for start, stop in gaps)
        one.counts &= not in_gap and 900 < one.start_s < 84_600
        near = [
            other
            for other in (*bursts, *storm)
            if other is not one and other.channels and -ALONE_S[0] < other.start_s - one.start_s < ALONE_S[1]
        ]
        one.is_isolated_broad = one.counts and not near and one.channels >= BROAD_CHANNELS
    for one in storm:
        one.counts = False
    return bursts + storm


def add_day(score: Score, spectrum: xr.Dataset, truth: list[Received], midnight: np.datetime64) -> pd.DataFrame:
    """Score the detections of a spacecraft-day; returns those that are false."""
    found = detect_bursts(spectrum)
    found = found[found["tier"] == "catalogued"]
    starts = ((found["start_utc"] - midnight) / np.timedelta64(1, "s")).to_numpy(dtype=float)
    score.days += 1
    taken = np.zeros(starts.size, dtype=bool)
    for one in sorted(truth, key=lambda one: -one.channels):
        near = np.flatnonzero(~taken & (np.abs(starts - one.start_s) < NEAR_S))
        if near.size:
            best = near[np.abs(starts[near] - one.start_s).argmin()]
            taken[best] = True
            score.onset_s += [float(starts[best] - one.start_s)] if one.is_isolated_broad else []
        if one.counts:
            score.found += bool(near.size)
            score.missed += not near.size
        if one.is_isolated_broad:
            score.isolated_found += bool(near.size)
            score.isolated_missed += not near.size
    explained = np.array([any(abs(start - one.start_s) < 2 * NEAR_S for one in truth) for start in starts], dtype=bool)
    score.false += int((~taken & ~explained).sum())
    return found[~taken & ~explained]


def mirrored(spectrum: xr.Dataset) -> xr.Dataset:
    """The day backwards: what drifts upwards is no burst."""
    backwards = spectrum.isel(time=slice(None, None, -1))
    time = spectrum["time"].to_numpy()
    turned = {name: time[0] + (time[-1] - spectrum[name].to_numpy())[::-1] for name in MOMENTS if name in spectrum}
    return (
        without(backwards)
        .assign_coords(time=turned.pop("time"))
        .assign({name: (("time", "frequency"), moments) for name, moments in turned.items()})
    )


def score_days(days: int, seed: int, first: date = FIRST_DAY, *, with_mirror: bool = True) -> dict[str, Score]:
    """Scores by spacecraft over simulated days."""
    scores = {name: Score() for name in FLEET}
    for number in range(days):
        day = first + timedelta(days=number)
        skies = [sky_of(other, seed) for other in (day - timedelta(days=1), day, day + timedelta(days=1))]
        for name in FLEET:
            spectrum = spectrum_of(name, day, skies, seed)
            midnight = np.datetime64(day, "ns")
            wrong = add_day(scores[name], spectrum, truths(skies[1], name), midnight)
            if len(wrong) and __name__ == "__main__":
                kinds = [one.kind for one in skies[1].conditions[name].nuisances]
                shown = wrong[["start_utc", "f_low_mhz", "f_high_mhz", "score", "drift", "channels"]]
                print(name, day, shown.to_string(index=False, header=False), sorted(set(kinds)))
            if with_mirror:
                backwards = detect_bursts(mirrored(spectrum))
                scores[name].mirrored += int((backwards["tier"] == "catalogued").sum())
    return scores


def rows() -> list[Row]:
    """Speed: a spacecraft-day, over peaks of every channel by itself."""
    skies = [sky_of(FIRST_DAY, 1)]
    spectra = [spectrum_of(name, FIRST_DAY, skies, 1) for name in FLEET]
    searched_s = seconds(lambda: [detect_bursts(one) for one in spectra]) / len(spectra)
    peaks_s = seconds(lambda: [channel_peaks(one) for one in spectra]) / len(spectra)
    return [
        ("search a spacecraft-day for bursts, mean of four receivers", f"{searched_s:.2f} s", "0.2 s"),
        ("peaks in every channel of it (scipy), over that", f"{peaks_s / searched_s:.1f}", ""),
    ]


def channel_peaks(spectrum: xr.Dataset) -> int:
    """How many peaks the channels of a spectrum have over their background, each by itself."""
    over = over_background(spectrum)["intensity"].to_numpy()
    return sum(find_peaks(channel, height=3.0, prominence=2.0)[0].size for channel in over.T)


def main(days: int, seed: int) -> None:
    """Print the table."""
    scores = score_days(days, seed)
    print(HEADER)
    total = Score()
    for name, score in scores.items():
        print(score.row(name))
        for key, value in vars(score).items():
            setattr(total, key, getattr(total, key) + value)
    print(total.row("all"))


if __name__ == "__main__":
    import sys

    main(int(sys.argv[1]), int(sys.argv[2]))
