"""Radar cross section from a table: measured or computed values, by angles in the body frame.

Azimuth is λ = atan2(y, x), 0 off the nose and 90° off the right wing. Elevation is
atan2(−z, √(x² + y²)), positive above the aircraft as in measured data. The paper's φ is positive
below. A table without elevations is one cut and holds for all elevations.

Steps between angles need not be equal. A step over 1.5 times as wide as both steps beside it counts
as a missing row, and a step over 90° as a gap. The first and the last step of elevations have one
step beside them, which does not tell a missing row from a coarser end: they are not compared.

Between the nodes ln σ_r is a cubic spline (a tensor product of two with elevations): twice
continuously differentiable, periodic in azimuth, exact at the nodes, and σ_r is positive
everywhere. Like any cubic spline it overshoots a little where the table jumps. At the lowest and
highest elevation its slope by elevation is zero. Beyond them σ_r is held constant, without a kink.
Within a step or two of these ends, σ_r differs by up to 5 % from a spline with free ends
("not-a-knot"). Straight above and below, azimuth has no meaning and all values must be the same.

With an envelope, σ_r is an upper bound of the spline, and twice continuously differentiable too.
The envelope is a cubic B-spline on a finer grid with equal steps. In each part of a cell of this
grid between nodes of the table, the spline is a polynomial, and at most its largest Bézier
coefficient (G. Farin, Curves and Surfaces for CAGD, 2002, ch. 6). A control value of the B-spline
affects four cells by four. The value is the largest bound of all cells within the angle of these.
The B-spline is a mean of its control values, with positive weights. The envelope is therefore
nowhere below the largest σ_r within the angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError
from radar_sense.limits import LARGEST, POSITIVE, SMALLEST, Limit, check_number
from radar_sense.model.geometry import elevation_of, join, split
from radar_sense.states import FloatArray, ReadOnly, read_only

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

#: Each cell between nodes has 16 coefficients of 8 bytes.
MAX_NODES = 1_000_000
#: Steps between nodes in the angle w of an envelope. More steps make a tighter envelope.
ENVELOPE_STEPS = 16
#: Most cells of an envelope (51 MB), unless the table has more. Steps are wider where needed.
ENVELOPE_CELLS = 400_000
#: Elevations of the envelope of a table without elevations: one every degree.
_ROWS = 180
#: Relative margin of an envelope, larger than the rounding of its evaluation.
_MARGIN = 1e-12

#: Least and largest step between angles [rad].
MIN_STEP, MAX_STEP = np.deg2rad(1e-3), np.deg2rad(90.0)
#: A step is a gap if it exceeds both steps beside it by this factor.
GAP = 1.5
ENVELOPE = Limit(above=0, at_most=90)
#: Standard deviation of σ_r [dB].
STD_DB = Limit(at_least=1e-3, at_most=20)
#: An elevation of this or more counts as straight above.
POLE = np.deg2rad(90.0 - 1e-9)


@dataclass(frozen=True, eq=False, repr=False)
class TableRCS(ReadOnly):
    """A cross section that is tabulated over azimuth, or over azimuth and elevation.

    Straight above and below the aircraft, λ is undefined. A table without elevations there uses
    λ = 0, and its gradient is NaN. A table with these elevations has one value and gradient 0.

    Attributes:
        azimuth: λ of the nodes (n,) [rad], ascending, less than one turn.
        rcs: σ_r at the nodes (n,) or (n, m) [m²], positive.
        elevation: Elevation of the nodes (m,) [rad], ascending, positive above; None if the table
            holds for all elevations.
        std_db: Standard deviation of σ_r at the nodes, like `rcs` [dB], of an error that all
            aspects share; None if σ_r is certain, or its error the same at all aspects.
        envelope: w [rad]. With it σ_r is nowhere less than the largest σ_r that the table without
            an envelope has within the angle w of the direction. The same holds for directions
            within ±w in azimuth and ±w in elevation.
    """

    isotropic: ClassVar[bool] = False

    azimuth: FloatArray
    rcs: FloatArray
    elevation: FloatArray | None = None
    envelope: float | None = None
    std_db: FloatArray | None = None
    #: The standard deviation by aspect [dB], interpolated as σ_r is, without an envelope.
    spread: TableRCS | None = field(init=False, repr=False, default=None)
    _around: _Axis = field(init=False, repr=False)
    _upward: _Axis | None = field(init=False, repr=False)
    #: Coefficients of the polynomial of each cell, (cells, 4) or (cells, 16).
    _cells: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("azimuth", "rcs", "elevation", "std_db"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, read_only(name, getattr(self, name)))
        self._check()
        around = _Axis.of(np.append(self.azimuth, self.azimuth[0] + math.tau), periodic=True)
        upward = None if self.elevation is None else _Axis.of(self.elevation, periodic=False)
        if self.envelope is None:
            cells = _interpolated(around, upward, np.log(self.rcs))
        else:
            around, upward, cells = _enveloped(around, upward, np.log(self.rcs), self.envelope)
        vars(self).update(_around=around, _upward=upward, _cells=cells)
        if self.std_db is not None:
            spread = TableRCS(self.azimuth, self.std_db, self.elevation)
            object.__setattr__(self, "spread", spread)

    def __repr__(self) -> str:
        nodes = " x ".join(str(size) for size in self.rcs.shape)
        low, high = self.rcs.min(), self.rcs.max()
        envelope = "" if self.envelope is None else f", envelope {np.rad2deg(self.envelope):g} deg"
        return f"<TableRCS: {nodes} nodes, {low:.3g} to {high:.3g} m^2{envelope}>"

    @property
    def detail(self) -> float:
        """Least distance [rad] of neighbouring nodes."""
        axes = (self._around,) if self._upward is None else (self._around, self._upward)
        return min(float(np.min(np.diff(axis.nodes))) for axis in axes)

    def cross_section(self, body_vector: FloatArray) -> FloatArray:
        """Return σ_r (...) [m²] towards body-frame vectors (..., 3)."""
        x, y, z = split(np.asarray(body_vector, dtype=float))
        with np.errstate(invalid="ignore"):  # NaN angles stay NaN
            cell, u, v = self._place(x, y, z)
            c = self._polynomials(cell)
            if v is None:
                return np.exp(_horner(c, u))
            return np.exp(_horner([_horner(c[4 * i : 4 * i + 4], v) for i in range(4)], u))

    def linearize(self, body_vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return σ_r (...) [m²] and its gradient (..., 3) [m²/m]."""
        x, y, z = split(np.asarray(body_vector, dtype=float))
        hh = x * x + y * y
        with np.errstate(divide="ignore", invalid="ignore"):
            cell, u, v = self._place(x, y, z)
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
        assert self._upward is not None
        low, high = self._upward.nodes[[0, -1]]
        flat = np.where(z < 0, high >= POLE, low <= -POLE)
        at_pole = (hh == 0) & (z != 0) & flat
        if np.any(at_pole):
            gradient[at_pole] = 0.0
        return sigma, gradient

    def uncovered(self, body_vector: FloatArray) -> NDArray[np.bool_]:
        """Return which body-frame vectors (..., 3) are outside the elevations of the table."""
        elevation = elevation_of(np.asarray(body_vector, dtype=float))
        if self.elevation is None:
            return np.zeros(elevation.shape, dtype=bool)
        rounding = 1e-9
        low, high = self.elevation[0] - rounding, self.elevation[-1] + rounding
        return (elevation < low) | (elevation > high)

    def _check(self) -> None:
        for name in ("azimuth", "rcs"):
            if getattr(self, name) is None:
                raise InputError(f"{name} must be an array of real numbers, got None")
        axes = {"azimuth": self.azimuth}
        if self.elevation is not None:
            axes["elevation"] = self.elevation
        for name, angles in axes.items():
            if angles.ndim != 1 or not angles.size or not np.all(np.isfinite(angles)):
                raise InputError(f"{name} must be finite and of shape (n,), with n > 0")
            if problem := out_of_order(name, angles) or gap(name, angles):
                raise InputError(problem[1])
        if self.azimuth[0] < -np.pi or self.azimuth[-1] > math.tau:
            raise InputError("azimuth must lie between -pi and 2 pi")
        if self.elevation is not None and abs(self.elevation).max() > np.pi / 2:
            raise InputError("elevation must lie between -pi/2 and pi/2")
        shape = tuple(len(angles) for angles in axes.values())
        if self.rcs.shape != shape:
            raise InputError(f"rcs must have shape {shape}, got {self.rcs.shape}")
        if self.rcs.size > MAX_NODES:
            raise InputError(f"a table may have {MAX_NODES:,} nodes, got {self.rcs.size:,}")
        if not np.all((self.rcs >= SMALLEST) & (self.rcs <= LARGEST)):
            raise InputError(f"rcs must be from {SMALLEST:g} to {LARGEST:g} m^2")
        if self.std_db is not None:
            if self.std_db.shape != shape:
                raise InputError(f"std_db must have shape {shape}, got {self.std_db.shape}")
            for std in (self.std_db.min(), self.std_db.max()):
                check_number("std_db", float(std), STD_DB)
        for values, unit in ((self.rcs, "m^2"), (self.std_db, "dB")):
            if self.elevation is None or values is None:
                continue
            if pole := differs_at_a_pole(self.elevation, values, unit):
                raise InputError(pole[1])
        if self.envelope is not None:
            object.__setattr__(self, "envelope", check_number("envelope", self.envelope, POSITIVE))
            check_number("envelope in degrees", float(np.rad2deg(self.envelope)), ENVELOPE)

    def _place(
        self, x: FloatArray, y: FloatArray, z: FloatArray
    ) -> tuple[NDArray[np.intp], FloatArray, FloatArray | None]:
        """Return the cell of each direction, and the angles from its edges."""
        azimuth, first = np.arctan2(y, x), self._around.nodes[0]
        # The first node is within a turn of −π, so one turn more or less is enough.
        azimuth = np.where(azimuth < first, azimuth + math.tau, azimuth)
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
        nodes: (n,) [rad], ascending; the last node of a periodic axis is the first plus one turn.
        periodic: Whether the angle is periodic. Functions of other angles are even about both ends.
        bins: Cell of the left end of each bin. Bins have equal widths and at most one node each, so
            that a cell is found without a search.
        per_radian: Bins in a radian.
    """

    nodes: FloatArray
    periodic: bool
    bins: NDArray[np.intp]
    per_radian: float

    @classmethod
    def of(cls, nodes: FloatArray, *, periodic: bool) -> _Axis:
        """Return the axis with given nodes."""
        width = 0.999 * float(np.min(np.diff(nodes)))
        edges = nodes[0] + width * np.arange(int((nodes[-1] - nodes[0]) / width) + 1)
        bins = np.searchsorted(nodes, edges, side="right") - 1
        return cls(nodes, periodic, np.minimum(bins, len(nodes) - 2), 1.0 / width)

    def place(self, angle: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the cell (...) of each angle (...), and the angle from its left end."""
        bins = ((angle - self.nodes[0]) * self.per_radian).astype(np.intp)
        cell = self.bins.take(bins, mode="clip")
        cell += (angle >= self.nodes.take(cell + 1)) & (cell < len(self.nodes) - 2)
        return cell, angle - self.nodes.take(cell)

    def spline(self, values: FloatArray) -> CubicSpline:
        """Return the cubic spline through values at the nodes (n, ...)."""
        from scipy.interpolate import CubicSpline  # slow to import

        if self.periodic:
            values = np.concatenate([values, values[:1]])
        return CubicSpline(self.nodes, values, bc_type="periodic" if self.periodic else "clamped")

    def bezier(self, values: FloatArray, edges: FloatArray) -> FloatArray:
        """Return Bézier coefficients (4, k, ...) of the spline through nodal values (n, ...).

        All nodes are among the edges (k + 1,) of the cells. Beyond them the spline is constant.
        """
        from scipy.interpolate import BPoly, PPoly  # slow to import

        spline, start = self.spline(values), edges[:-1]
        inside = (start >= self.nodes[0]) & (start < self.nodes[-1])
        start = np.clip(start, self.nodes[0], self.nodes[-1])
        power = [spline(start, order) / math.factorial(order) for order in (3, 2, 1, 0)]
        for coefficient in power[:3]:
            coefficient[~inside] = 0.0
        return BPoly.from_power_basis(PPoly(np.stack(power), edges)).c

    def with_control(self, values: FloatArray) -> FloatArray:
        """Return coefficients (4, cells, ...) of the cubic B-spline with control values (n, ...).

        The nodes have equal steps. The B-spline is a mean of four control values, with positive
        weights of sum 1 (C. de Boor, A Practical Guide to Splines, 1978, ch. IX).
        """
        if self.periodic:
            values = np.concatenate([values[-1:], values, values[:2]])
        else:
            values = np.pad(values, [(1, 1), *[(0, 0)] * (values.ndim - 1)], mode="reflect")
        a, b, c, d = (values[k : k + len(self.nodes) - 1] for k in range(4))
        h = (self.nodes[-1] - self.nodes[0]) / (len(self.nodes) - 1)
        return np.stack(
            [
                (a + 4.0 * b + c) / 6.0,
                (c - a) / (2.0 * h),
                (a - 2.0 * b + c) / (2.0 * h**2),
                (d - a + 3.0 * (b - c)) / (6.0 * h**3),
            ]
        )


def _interpolated(around: _Axis, upward: _Axis | None, values: FloatArray) -> FloatArray:
    """Return coefficients (cells, 4) or (cells, 16) of the spline through values (n,) or (n, m)."""
    by_azimuth = around.spline(values).c[::-1]
    if upward is None:
        return np.ascontiguousarray(by_azimuth.T)
    return _by_cell(upward.spline(np.moveaxis(by_azimuth, 2, 0)).c[::-1])


def _by_cell(coefficients: FloatArray) -> FloatArray:
    """Return coefficients (4, cells upward, 4, cells around) by cell (cells, 16)."""
    return np.ascontiguousarray(coefficients.transpose(3, 1, 2, 0).reshape(-1, 16))


def _enveloped(
    around: _Axis, upward: _Axis | None, values: FloatArray, width: float
) -> tuple[_Axis, _Axis, FloatArray]:
    """Return the axes of an envelope of width w [rad], and its coefficients (cells, 16).

    It is that of ln σ_r (n,) or (n, m) at the azimuths and elevations of a table. It reaches from
    straight below to straight above, whatever the table covers.
    """
    from scipy.ndimage import maximum_filter1d  # slow to import

    most = max(ENVELOPE_CELLS, values.size)
    step = max(width / ENVELOPE_STEPS, np.pi * np.sqrt(2.0 / most))
    rows, columns = int(np.ceil(np.pi / step)), int(np.ceil(math.tau / step))
    if upward is None:
        rows, columns = _ROWS, int(min(np.ceil(math.tau * ENVELOPE_STEPS / width), most // _ROWS))
    first, last = around.nodes[[0, -1]]
    azimuth = _Axis.of(np.linspace(first, last, columns + 1), periodic=True)
    elevation = _Axis.of(np.linspace(-np.pi / 2, np.pi / 2, rows + 1), periodic=False)

    def window(angle: float, step: float) -> int:
        """Return how many cells lie within an angle of the four that a control value affects."""
        return 2 * math.ceil(angle / step + 1e-9) + 4

    bounds = _bounds(around, upward, values, azimuth.nodes, elevation.nodes)
    bounds = np.pad(bounds, [(0, 1), (0, 0)], mode="edge")  # there is a node more than cells
    control = maximum_filter1d(bounds, window(width, np.pi / rows), axis=0, mode="nearest")
    # From an elevation ε, the angle w reaches as far in azimuth as arcsin(sin w / cos ε), ...
    steepest = np.minimum(abs(elevation.nodes) + 2.0 * np.pi / rows, np.pi / 2)
    polar = steepest + width >= np.pi / 2 - 1e-9  # ... or all around
    sine = np.minimum(np.sin(width) / np.cos(steepest), 1.0)
    reach = np.where(polar, np.pi, np.arcsin(sine))
    for row, sideways in zip(control, reach, strict=True):
        row[:] = maximum_filter1d(row, window(sideways, math.tau / columns), mode="wrap")
    control += _MARGIN
    by_azimuth = np.moveaxis(azimuth.with_control(control.T), 2, 0)
    return azimuth, elevation, _by_cell(elevation.with_control(by_azimuth))


def _bounds(
    around: _Axis,
    upward: _Axis | None,
    values: FloatArray,
    azimuth: FloatArray,
    elevation: FloatArray,
) -> FloatArray:
    """Return a bound of the spline in each cell of an envelope (k, j), with edges (j + 1), (k + 1).

    In a part of a cell between two nodes of the table, the spline is at most its largest Bézier
    coefficient.
    """
    edges = np.union1d(around.nodes, azimuth)
    by_azimuth = around.bezier(values, edges)
    starts = np.searchsorted(edges, azimuth[:-1])
    if upward is None:
        return np.tile(np.maximum.reduceat(by_azimuth.max(axis=0), starts), (len(elevation) - 1, 1))
    edges_upward = np.union1d(upward.nodes, elevation)
    starts_upward = np.searchsorted(edges_upward, elevation[:-1])
    parts = np.max([upward.bezier(c.T, edges_upward).max(axis=0) for c in by_azimuth], axis=0)
    return np.maximum.reduceat(np.maximum.reduceat(parts, starts_upward), starts, axis=1)


#: A fault of a table: the index of the faulty value, and a description.
Problem = tuple[int, str]


def out_of_order(name: str, angles: FloatArray) -> Problem | None:
    """Return the first angle [rad] that is not above the previous one, or None."""
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
    """Return the first step between angles [rad] that is a gap, or None."""
    around = name == "azimuth"
    closed = np.append(angles, angles[0] + math.tau) if around else angles
    steps = np.diff(closed)
    beside = np.pad(steps, 1, mode="wrap") if around else np.pad(steps, 1, constant_values=np.inf)
    neighbour = np.maximum(beside[:-2], beside[2:])
    wide = np.flatnonzero(steps > np.minimum(MAX_STEP, GAP * neighbour) * (1 + 1e-9))
    if not len(wide):
        return None
    i = int(wide[0])
    start, stop = np.rad2deg(closed[i : i + 2])
    most = np.rad2deg(min(MAX_STEP, GAP * neighbour[i]))
    message = (
        f"a gap in {name}, from {start:.6g} to {stop:.6g} deg; allowed are {most:.6g} deg here: "
        f"{GAP:g} times the wider step beside it, and {np.rad2deg(MAX_STEP):g} deg at most"
    )
    if around and i == len(steps) - 1:
        message = (
            f"azimuths must go once around; none from {start:.6g} to {stop:.6g} deg "
            "(mirror: true completes a table of one half)"
        )
    return min(i + 1, len(angles) - 1), message


def differs_at_a_pole(elevation: FloatArray, rcs: FloatArray, unit: str) -> Problem | None:
    """Return the first value at a pole that differs from the value of azimuth 0, or None."""
    for j, reached, pole in (
        (0, elevation[0] <= -POLE, "below"),
        (len(elevation) - 1, elevation[-1] >= POLE, "above"),
    ):
        differ = np.flatnonzero(rcs[:, j] != rcs[0, j])
        if reached and len(differ):
            i = int(differ[0])
            return i * len(elevation) + j, (
                f"straight {pole} the aircraft azimuth has no meaning: the value must be the same "
                f"at each, got {rcs[0, j]:.10g} and {rcs[i, j]:.10g} {unit}"
            )
    return None


def _horner(coefficients: list[FloatArray], t: FloatArray) -> FloatArray:
    """Return the value of a cubic, constant coefficient first."""
    c0, c1, c2, c3 = coefficients
    return ((c3 * t + c2) * t + c1) * t + c0


def _slope(coefficients: list[FloatArray], t: FloatArray) -> FloatArray:
    """Return the slope of a cubic, constant coefficient first."""
    _, c1, c2, c3 = coefficients
    return (3.0 * c3 * t + 2.0 * c2) * t + c1
