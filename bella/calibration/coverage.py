"""How often a credible region holds the source it was made for."""

from dataclasses import dataclass

from scipy import stats

TARGETS = {0.68: (0.64, 0.72), 0.95: (0.93, 0.97)}
"""Shares between which the coverage of a level should lie."""
CONFIDENCE = 0.95
SURE = 0.9999
"""A region that holds its source as often as it says is rejected with less than one minus this."""


@dataclass(frozen=True)
class Coverage:
    """Sources inside their regions.

    Attributes
    ----------
    level : float
        Probability that the regions claim.
    """

    level: float
    hits: int
    sources: int

    @property
    def share(self) -> float:
        """Share of sources inside."""
        return self.hits / self.sources

    @property
    def interval(self) -> tuple[float, float]:
        """Binomial 95 % interval of the true share (Clopper & Pearson 1934, doi:10.1093/biomet/26.4.404)."""
        interval = stats.binomtest(self.hits, self.sources).proportion_ci(CONFIDENCE, method="exact")
        return float(interval.low), float(interval.high)

    @property
    def accepted(self) -> tuple[float, float]:
        """Shares that pass.

        The target, widened as far as binomial noise takes the share of true regions in 9999 cases of 10 000.
        """
        low, high = TARGETS[self.level]
        fewest, most = stats.binom.interval(SURE, self.sources, self.level)
        return min(low, float(fewest) / self.sources), max(high, float(most) / self.sources)

    @property
    def passes(self) -> bool:
        """Whether the share lies among those that pass."""
        low, high = self.accepted
        return low <= self.share <= high
