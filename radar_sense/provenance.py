"""The origin of the arrays of a scenario: files, orbits, places and data sheets.

Each object keeps the arrays made from the file, orbit, place or data sheet. A record has the object
only if the scenario still has these arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from radar_sense.errors import shorten, shorten_list
from radar_sense.model.horizon import Horizon
from radar_sense.model.radar_constant import DataSheet
from radar_sense.model.rcs_table import TableRCS
from radar_sense.states import FloatArray


@dataclass(frozen=True)
class Orbit:
    """A level circle.

    Attributes:
        radius: Horizontal radius [m].
        down: Down coordinate [m].
        sweep: First and last azimuth, and step [deg].
        azimuth_from: Direction of azimuth 0, "east" or "north".
    """

    radius: float
    down: float
    sweep: tuple[float, float, float]
    azimuth_from: str


@dataclass(frozen=True)
class Conventions:
    """Conventions of a route file that the file does not state.

    Attributes:
        altitude_above: Zero of the altitudes, "ellipsoid", "sea" or "pressure"; None for the
            convention of the format.
        geoid_height_m: Height of the sea level above the ellipsoid [m], or None.
        speed_m_s: Speed between waypoints without times [m/s], or None.
        icao24: Address of the aircraft in ADS-B state vectors, or None.
    """

    altitude_above: str | None = None
    geoid_height_m: float | None = None
    speed_m_s: float | None = None
    icao24: str | None = None


@dataclass(frozen=True)
class Path:
    """A path from a route file.

    Attributes:
        file: Name of the file, relative to the working folder if inside.
        sha256: Digest of the file.
        origin: Latitude, longitude [rad] and height [m] of the origin of the frame, or None.
        step_s: Step of the interpolation [s]; None if the rows of the file are the poses.
        method: Interpolation in time.
        max_gap_s: Longest step of time allowed in the file [s], or None.
        conventions: Conventions of the file.
    """

    file: str
    sha256: str
    origin: tuple[float, float, float] | None = None
    step_s: float | None = None
    method: str = "legs"
    max_gap_s: float | None = None
    conventions: Conventions = field(default_factory=Conventions)


@dataclass(frozen=True, eq=False)
class TableFile:
    """An RCS table from a file.

    Attributes:
        file: Name of the file, relative to the working folder if inside.
        sha256: Digest of the file.
        mirror: Whether the file has one half of a symmetric aircraft.
        table: Table made from the file.
    """

    file: str
    sha256: str
    mirror: bool
    table: TableRCS


@dataclass(frozen=True, eq=False)
class StatedCovariance:
    """A covariance as a scenario file states it.

    Attributes:
        stated: The covariance in SI units, in the frame of the file; None for a route file.
        made: The covariance in the frame of the scenario.
    """

    stated: FloatArray | None = field(repr=False)
    made: FloatArray = field(repr=False)


@dataclass(frozen=True, eq=False)
class RadarSource:
    """The origin of the state and the covariances of one radar.

    Attributes:
        state: State made from the file (4,).
        place: Latitude, longitude [rad] and height [m]; None for north, east, down.
        data_sheet: Parameters of the radar constant, or None.
        covariances: C_rr of each level.
    """

    state: FloatArray = field(repr=False)
    place: tuple[float, float, float] | None = None
    data_sheet: DataSheet | None = None
    covariances: Mapping[str, StatedCovariance] = field(default_factory=dict, repr=False)


@dataclass(frozen=True, eq=False)
class Provenance:
    """The origin of the arrays of a scenario; empty for a scenario made in Python.

    Attributes:
        geometry: The orbit or the path.
        aircraft: States made from the orbit or the path (n, 6).
        cov_aircraft: C_aa.
        rcs: The file of an RCS table.
        radars: The radars, by name; the name of a single radar is "".
        earth: The horizon of radars that have one.
    """

    geometry: Orbit | Path | None = None
    aircraft: FloatArray | None = field(default=None, repr=False)
    cov_aircraft: StatedCovariance | None = None
    rcs: TableFile | None = None
    radars: Mapping[str, RadarSource] = field(default_factory=dict)
    earth: Horizon = field(default_factory=Horizon)

    def __repr__(self) -> str:
        parts = []
        if isinstance(self.geometry, Path):
            parts.append(f"path {shorten(self.geometry.file)}")
        elif self.geometry is not None:
            parts.append("orbit")
        if self.rcs is not None:
            parts.append(f"RCS table {shorten(self.rcs.file)}")
        if self.radars:
            names = shorten_list([name for name in self.radars if name])
            parts.append(f"radars {names}" if names else "radar")
        return f"<Provenance: {', '.join(parts) or 'made in Python'}>"
