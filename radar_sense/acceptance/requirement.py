"""What is required of P_D at every pose, in spite of its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import ndtr

from radar_sense.propagation import Band
from radar_sense.propagation.draws import Estimate
from radar_sense.states import FloatArray


@dataclass(frozen=True)
class Requirement:
    """P_D + kσ is at most a limit P_max; or P_D − kσ at least a limit P_min.

    The first is asked of a path that is not to be detected, the second of radars that are to
    detect. Either bound of P_D is a quantile, see `threshold`.

    Attributes:
        limit: P_max, or P_min.
        k: Number of σ.
        at_least: Whether the limit is P_min.
        probability: The largest probability of P_D beyond the limit, Φ(−k), where it was given in
            place of k. P_D itself may then be beyond the limit.
        width: Whether the limit is one of kσ, half the width of the band, and not of P_D.
    """

    limit: float
    k: float = 3.0
    at_least: bool = False
    probability: float | None = None
    width: bool = False

    @property
    def numbers(self) -> dict[str, float]:
        """The limit, k, and the probability if it was given, for a record."""
        given = {} if self.probability is None else {"probability": self.probability}
        return {"p_min" if self.at_least else "p_max": self.limit, "k": self.k, **given}

    @property
    def tail(self) -> float:
        """The largest probability of P_D beyond the limit."""
        return float(ndtr(-self.k))

    @property
    def room(self) -> float:
        """How far the limit is from the end of P_D that is nearer, for P_min, or from 0."""
        return min(self.limit, 1.0 - self.limit) if self.at_least else self.limit

    def margin(self, p_d: FloatArray) -> FloatArray:
        """Return how far values of P_D (...) are within the limit, negative beyond it."""
        return p_d - self.limit if self.at_least else self.limit - p_d

    def bound(self, band: Band) -> FloatArray:
        """Return the bound of P_D (n,) on the side of the limit; or half the width of the band."""
        if self.width:
            return 0.5 * (band.upper - band.lower)
        return band.lower if self.at_least else band.upper

    def beyond(self, found: Estimate) -> tuple[FloatArray, FloatArray]:
        """Return the probability (n,) of P_D beyond the limit, and its standard error (n,)."""
        return found.below if self.at_least else found.above
