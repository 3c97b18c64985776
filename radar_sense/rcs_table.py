"""Radar cross section from a table: measured or computed values, by angles in the body frame.

Azimuth is λ = atan2(y, x), 0 off the nose and 90° off the right wing. Elevation is
atan2(−z, √(x² + y²)), positive above the aircraft as in measured data; the paper's φ is positive
below it. A table without elevations holds for all of them: it is one cut, used above and below as
well.

Steps between angles need not be equal, but one that is over 1.5 times as wide as both steps beside
it is a row that is missing, and one over 90° is too wide to say anything about what lies in it.

Between the nodes ln σ_r is a cubic spline (a tensor product of two with elevations): twice
continuously differentiable, periodic in azimuth, exact at the nodes, and σ_r is positive
everywhere. Like any cubic spline it overshoots a little where the table jumps. At the lowest and
highest elevation its slope is zero, so that it goes on beyond them as a constant without a kink.
Where that is straight above or below, azimuth has no meaning and all values there must be the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from radar_sense.geometry import join, split
from radar_sense.limits import Limit
from radar_sense.reader import LARGEST, SMALLEST
from radar_sense.states import FloatArray

#: Each cell between nodes has 16 coefficients of 8 bytes.
MAX_NODES = 1_000_000

#: Angles nearer to each other than this are the same, and farther apart than this unrelated.
MIN_STEP, MAX_STEP = np.deg2rad(1e-3), np.deg2rad(90.0)
#: A step so many times as wide as both beside it is a gap.
GAP = 1.5

ENVELOPE = Limit(above=0, at_most=90)

TURN = 2.0 * np.pi
_POLE = np.deg2rad(90.0 - 1e-9)


@dataclass(frozen=True, eq=False)
class TableRCS:
    """A cross section that is tabulated over azimuth, or over azimuth and elevation.

    Straight above and below, a table with azimuths alone takes λ = 0, and its gradient is NaN; so
    does one whose elevations do not reach that far.

    Attributes:
        azimuth: λ of the nodes (n,) [rad], ascending, less than one turn.
        rcs: σ_r at the nodes (n,) or (n, m) [m²], positive.
        elevation: Elevation of the nodes (m,) [rad], ascending, positive above; None if the table
            holds for all elevations.
        envelope: w [rad]. With it σ_r is nowhere less than any node within ±w in azimuth (and in
            elevation), nor than the nodes next to it; and nowhere more than the largest node
            within ±w and four steps.
    """

    isotropic: ClassVar[bool] = False
    lobed: ClassVar[bool] = True

    azimuth: FloatArray
    rcs: FloatArray
    elevation: FloatArray | None = None
    envelope: float | None = None
    _around: _Axis = field(init=False, repr=False)
    _upward: _Axis | None = field(init=False, repr=False)
    #: Coefficients of the polynomial of each cell, (cells, 4) or (cells, 16).
    _cells: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("azimuth", "rcs", "elevation"):
            if getattr(self, name) is not None:
                values = np.array(getattr(self, name), dtype=float)
                values.flags.writeable = False
                object.__setattr__(self, name, values)
        self._check()
        object.__setattr__(self, "_around", _Axis.closed(self.azimuth))
        upward = None if self.elevation is None else _Axis.of(self.elevation, periodic=False)
        object.__setattr__(self, "_upward", upward)
        object.__setattr__(self, "_cells", self._coefficients())

    def cross_section(self, body_vector: FloatArray) -> FloatArray:
        """σ_r (...) [m²] towards body-frame vectors (..., 3)."""
        x, y, z = split(np.asarray(body_vector, dtype=float))
        with np.errstate(invalid="ignore"):  # a NaN among the angles stays one
            cell, u, v = self._place(np.arctan2(y, x), x, y, z)
            c = self._polynomials(cell)
            if v is None:
                return np.exp(_horner(c, u))
            return np.exp(_horner([_horner(c[4 * i : 4 * i + 4], v) for i in range(4)], u))

    def linearize(self, body_vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """σ_r (...) [m²] and its gradient (..., 3) [m²/m]."""
        x, y, z = split(np.asarray(body_vector, dtype=float))
        hh = x * x + y * y
        with np.errstate(divide="ignore", invalid="ignore"):
            cell, u, v = self._place(np.arctan2(y, x), x, y, z)
            c = self._polynomials(cell)
            if v is None:
                sigma = np.exp(_horner(c, u))
                # ∇λ = (−y, x, 0)/h²
                along = sigma * _slope(c, u) / hh
                return sigma, join((-y * along, x * along, np.where(hh > 0, 0.0, np.nan)))
            rows = [c[4 * i : 4 * i + 4] for i in range(4)]
            in_v = [_horner(row, v) for row in rows]
            sigma = np.exp(_horner(in_v, u))
            along = sigma * _slope(in_v, u) / hh
            # With ε = −φ the elevation, ∇ε = (xz, yz, −h²)/(h r²)
            up = sigma * _horner([_slope(row, v) for row in rows], u)
            h = np.sqrt(hh)
            up = up / (h * (hh + z * z))
            gradient = join((up * x * z - along * y, up * y * z + along * x, -up * hh))
        # Where the table reaches straight above or below, σ_r is flat there.
        assert self.elevation is not None
        flat = np.where(z < 0, self.elevation[-1] >= _POLE, self.elevation[0] <= -_POLE)
        at_pole = (hh == 0) & (z != 0) & flat
        if np.any(at_pole):
            gradient[at_pole] = 0.0
        return sigma, gradient

    def uncovered(self, body_vector: FloatArray) -> NDArray[np.bool_]:
        """Say which body-frame vectors (..., 3) are above or below all elevations of the table."""
        x, y, z = split(np.asarray(body_vector, dtype=float))
        if self.elevation is None:
            return np.zeros(x.shape, dtype=bool)
        elevation = np.arctan2(-z, np.hypot(x, y))
        rounding = 1e-9
        low, high = self.elevation[0] - rounding, self.elevation[-1] + rounding
        outside: NDArray[np.bool_] = (elevation < low) | (elevation > high)
        return outside

    def _check(self) -> None:
        axes = {"azimuth": self.azimuth}
        if self.elevation is not None:
            axes["elevation"] = self.elevation
        for name, angles in axes.items():
            if angles.ndim != 1 or not np.all(np.isfinite(angles)):
                raise ValueError(f"{name} must be finite and of shape (n,)")
            found = out_of_order(name, angles) or gap(name, angles)
            if found:
                raise ValueError(found[1])
        if self.azimuth[0] < -np.pi or self.azimuth[-1] > TURN:
            raise ValueError("azimuth must lie between -pi and 2 pi")
        if self.elevation is not None and abs(self.elevation).max() > np.pi / 2:
            raise ValueError("elevation must lie between -pi/2 and pi/2")
        shape = tuple(len(angles) for angles in axes.values())
        if self.rcs.shape != shape:
            raise ValueError(f"rcs must have shape {shape}, got {self.rcs.shape}")
        if self.rcs.size > MAX_NODES:
            raise ValueError(f"a table may have {MAX_NODES:,} nodes, got {self.rcs.size:,}")
        if not np.all((self.rcs >= SMALLEST) & (self.rcs <= LARGEST)):
            raise ValueError(f"rcs must be from {SMALLEST:g} to {LARGEST:g} m^2")
        pole = None if self.elevation is None else differs_at_a_pole(self.elevation, self.rcs)
        if pole:
            raise ValueError(pole[1])
        if self.envelope is not None and not ENVELOPE.allows(np.rad2deg(self.envelope)):
            raise ValueError(f"envelope in degrees must be {ENVELOPE}")

    def _coefficients(self) -> FloatArray:
        values = np.log(self.rcs)
        fit: Callable[[_Axis, FloatArray], FloatArray] = _Axis.through
        if self.envelope is not None:
            fit = _Axis.with_control
            values = self._around.highest(values, self.envelope)
        if self._upward is None:
            return np.ascontiguousarray(fit(self._around, values).T)
        if self.envelope is not None:
            values = self._upward.highest(values.T, self.envelope).T
            # The two control points that make up the value at a pole
            for reached, rows in (
                (self._upward.nodes[0] <= -_POLE, slice(0, 2)),
                (self._upward.nodes[-1] >= _POLE, slice(-2, None)),
            ):
                if reached:
                    values[:, rows] = values[:, rows].max()
        by_azimuth = np.moveaxis(fit(self._around, values), 2, 0)  # (m, 4, n)
        both = fit(self._upward, by_azimuth)  # (4, m − 1, 4, n)
        return np.ascontiguousarray(both.transpose(3, 1, 2, 0).reshape(-1, 16))

    def _place(
        self, azimuth: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray
    ) -> tuple[NDArray[np.intp], FloatArray, FloatArray | None]:
        """Find the cell of each direction, and how far in it lies."""
        first = self._around.nodes[0]
        # The first node is within a turn of −π, so one turn more or less is enough.
        azimuth = np.where(azimuth < first, azimuth + TURN, azimuth)
        i, u = self._around.place(azimuth)
        if self._upward is None:
            return i, u, None
        nodes = self._upward.nodes
        elevation = np.arctan2(-z, np.sqrt(x * x + y * y))
        j, v = self._upward.place(np.minimum(np.maximum(elevation, nodes[0]), nodes[-1]))
        return i * (len(nodes) - 1) + j, u, v

    def _polynomials(self, cell: NDArray[np.intp]) -> list[FloatArray]:
        rows = self._cells.take(cell, axis=0, mode="clip")
        return list(np.moveaxis(rows, -1, 0))


@dataclass(frozen=True, eq=False)
class _Axis:
    """The nodes along one angle.

    Attributes:
        nodes: (n,) [rad], ascending; of a periodic axis the last is the first, one turn on.
        periodic: Whether it goes around; else functions along it are even about both ends.
        bins: The cell that the left end of each bin is in. Bins have one width and no more than one
            node in them, which makes finding a cell quicker than a search would.
        per_radian: Bins in a radian.
    """

    nodes: FloatArray
    periodic: bool
    bins: NDArray[np.intp]
    per_radian: float

    @classmethod
    def closed(cls, azimuth: FloatArray) -> _Axis:
        """Make the axis of azimuths, wherever they begin."""
        return cls.of(np.append(azimuth, azimuth[0] + TURN), periodic=True)

    @classmethod
    def of(cls, nodes: FloatArray, *, periodic: bool) -> _Axis:
        """Make an axis of all its nodes."""
        width = 0.999 * float(np.min(np.diff(nodes)))
        edges = nodes[0] + width * np.arange(int((nodes[-1] - nodes[0]) / width) + 1)
        bins = np.searchsorted(nodes, edges, side="right") - 1
        return cls(nodes, periodic, np.minimum(bins, len(nodes) - 2), 1.0 / width)

    def place(self, angle: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Find the cell (...) that each angle (...) is in, and how far from its left end."""
        bins = ((angle - self.nodes[0]) * self.per_radian).astype(np.intp)
        cell = self.bins.take(bins, mode="clip")
        cell += (angle >= self.nodes.take(cell + 1)) & (cell < len(self.nodes) - 2)
        return cell, angle - self.nodes.take(cell)

    def through(self, values: FloatArray) -> FloatArray:
        """Coefficients (4, cells, ...) of the cubic spline through values (n, ...) at the nodes."""
        from scipy.interpolate import CubicSpline  # slow to import

        if self.periodic:
            values = np.concatenate([values, values[:1]])
        ends = "periodic" if self.periodic else "clamped"
        found: FloatArray = CubicSpline(self.nodes, values, bc_type=ends).c[::-1]
        return found

    def with_control(self, values: FloatArray) -> FloatArray:
        """Coefficients (4, cells, ...) of the cubic B-spline with control values (n, ...).

        It is a mean of the four control values about it, with positive weights that add up to 1
        (C. de Boor, A Practical Guide to Splines, 1978, ch. IX): between the least and the greatest
        of them.
        """
        from scipy.interpolate import BSpline, CubicHermiteSpline  # slow to import

        nodes, rest = self.nodes, [(0, 0)] * (values.ndim - 1)
        if self.periodic:
            knots = np.concatenate([nodes[-4:-1] - TURN, nodes, nodes[1:4] + TURN])
            control = np.concatenate([values[-1:], values, values[:2]])
        else:
            knots = np.pad(nodes, 3, mode="reflect", reflect_type="odd")
            control = np.pad(values, [(1, 1), *rest], mode="reflect")
        spline = BSpline(knots, control, 3)
        at_nodes = spline(nodes), spline.derivative()(nodes)
        found: FloatArray = CubicHermiteSpline(nodes, *at_nodes).c[::-1]
        return found

    def highest(self, values: FloatArray, width: float) -> FloatArray:
        """Control values (n, ...) with which the B-spline is an upper envelope of values (n, ...).

        The control value of a node weighs in up to two nodes away from it. So it is the largest
        within ±width of anywhere there.
        """
        nodes, offset, tiled = self.nodes, 0, values
        if self.periodic:
            once = nodes[:-1]
            nodes = np.concatenate([once - TURN, once, once + TURN])
            tiled, offset = np.concatenate([values] * 3), len(once)
        rounding = 1e-9
        found = np.empty_like(values)
        for i in range(len(values)):
            left = nodes[max(i + offset - 2, 0)] - width - rounding
            right = nodes[min(i + offset + 2, len(nodes) - 1)] + width + rounding
            start, stop = np.searchsorted(nodes, [left, right])
            found[i] = tiled[start:stop].max(axis=0)
        return found


#: What is wrong with a table: the index of the value that shows it, and the problem.
Problem = tuple[int, str]


def out_of_order(name: str, angles: FloatArray) -> Problem | None:
    """Find the first angle [rad] that does not come after the one before."""
    wrong = np.flatnonzero(np.diff(angles) < MIN_STEP)
    if not len(wrong):
        return None
    i = int(wrong[0]) + 1
    before, angle = np.rad2deg(angles[i - 1 : i + 1])
    if angles[i] == angles[i - 1]:
        return i, f"{name} {angle:g} deg is repeated"
    return i, (
        f"{name} must ascend, by {np.rad2deg(MIN_STEP):g} deg or more: "
        f"{angle:.10g} deg comes after {before:.10g}"
    )


def gap(name: str, angles: FloatArray) -> Problem | None:
    """Find a step that is wider than the table around it explains."""
    around = name == "azimuth"
    closed = np.append(angles, angles[0] + TURN) if around else angles
    steps = np.diff(closed)
    beside = np.pad(steps, 1, mode="wrap") if around else np.pad(steps, 1)
    neighbour = np.maximum(beside[:-2], beside[2:])
    if len(steps) == 1:
        neighbour = steps
    wide = np.flatnonzero(steps > np.minimum(MAX_STEP, GAP * neighbour) * (1 + 1e-9))
    if not len(wide):
        return None
    i = int(wide[0])
    start, stop = np.rad2deg(closed[i : i + 2])
    message = (
        f"a gap in {name}, from {start:.6g} to {stop:.6g} deg; allowed is {GAP:g} times the wider "
        f"step beside it, {np.rad2deg(neighbour[i]):.6g} deg, and {np.rad2deg(MAX_STEP):g} deg "
        "at most"
    )
    if around and i == len(steps) - 1:
        message = (
            f"azimuths must go once around; none from {start:.6g} to {stop:.6g} deg "
            "(mirror: true completes a table of one half)"
        )
    return min(i + 1, len(angles) - 1), message


def differs_at_a_pole(elevation: FloatArray, rcs: FloatArray) -> Problem | None:
    """Find a value straight above or below that is not that of the first azimuth."""
    for j, reached, pole in (
        (0, elevation[0] <= -_POLE, "below"),
        (len(elevation) - 1, elevation[-1] >= _POLE, "above"),
    ):
        differ = np.flatnonzero(rcs[:, j] != rcs[0, j])
        if reached and len(differ):
            i = int(differ[0])
            return i * len(elevation) + j, (
                f"straight {pole} the aircraft azimuth has no meaning: the value must be the same "
                f"at each, got {rcs[0, j]:.10g} and {rcs[i, j]:.10g} m^2"
            )
    return None


def _horner(coefficients: list[FloatArray], t: FloatArray) -> FloatArray:
    """Value of a cubic, its constant coefficient first."""
    c0, c1, c2, c3 = coefficients
    return ((c3 * t + c2) * t + c1) * t + c0


def _slope(coefficients: list[FloatArray], t: FloatArray) -> FloatArray:
    """Slope of a cubic, its constant coefficient first."""
    _, c1, c2, c3 = coefficients
    return (3.0 * c3 * t + 2.0 * c2) * t + c1
