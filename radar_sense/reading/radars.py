"""The radars of a scenario file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.constants import speed_of_light

from radar_sense import covariance, keys
from radar_sense.errors import did_you_mean
from radar_sense.limits import MAX_RADARS
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import DETECTORS, Detector, PulseDetector
from radar_sense.model.geodesy import ned_from_geodetic, turn_to_origin
from radar_sense.model.network import NetworkModel, Radar, name_problem
from radar_sense.model.radar_constant import DataSheet
from radar_sense.model.radar_equation import RADARS
from radar_sense.provenance import RadarSource, StatedCovariance
from radar_sense.reading.data_sheet import read_data_sheet
from radar_sense.reading.detector import read_detector
from radar_sense.reading.geometry import Poses
from radar_sense.reading.trajectory import read_place
from radar_sense.reading.uncertainty import Levels, read_levels
from radar_sense.reading.yaml_reader import Entry, Section
from radar_sense.states import POSITION, RADAR, FloatArray


@dataclass(frozen=True, eq=False)
class RadarEntry:
    """A radar of a scenario file.

    Attributes:
        state: North, east, down [m] and c_r (4,). `place_radar` sets the position of a radar with a
            `place`.
        p_fa: Probability of false alarm.
        detector: Detector.
        data_sheet: Parameters of c_r, or None.
        place: Latitude, longitude [rad] and height [m], or None.
        place_entry: The place in the file, for errors.
        scan_period: Time from one look to the next [s], or None.
        attenuation: One-way attenuation [dB/m].
        name: Name among several radars, else "".
        max_range: Slant range beyond which it detects nothing [m].
        min_range: Slant range within which it detects nothing [m].
        horizon: Whether P_D is 0 below the horizon.
        levels: Uncertainty of the radar, in the frame of the poses after `place_radar`.
        stated: Uncertainty of the radar as in the file.
    """

    state: FloatArray
    p_fa: float
    detector: Detector
    data_sheet: DataSheet | None = None
    place: tuple[float, float, float] | None = None
    place_entry: Entry | None = None
    scan_period: float | None = None
    attenuation: float = 0.0
    name: str = ""
    max_range: float = math.inf
    min_range: float = 0.0
    horizon: bool = False
    levels: Levels = field(default_factory=Levels)
    stated: Levels = field(default_factory=Levels)

    @property
    def called(self) -> str:
        """Name of the radar in errors."""
        return f"radar {self.name!r}" if self.name else "the radar"

    @property
    def source(self) -> RadarSource:
        """The state and the covariances before and after `place_radar`, for the record."""
        covariances = {
            level: StatedCovariance(matrix, self.levels.covariance[level])
            for level, matrix in self.stated.covariance.items()
        }
        return RadarSource(self.state, self.place, self.data_sheet, covariances)


def read_radar(
    entry: Entry, required: Sequence[str] = (), optional: Sequence[str] = ()
) -> RadarEntry:
    """Read the keys of every radar.

    Args:
        entry: The mapping.
        required: Further required keys, which the caller reads.
        optional: Further optional keys, which the caller reads.
    """
    position, place = keys.RADAR_POSITION.name, keys.RADAR_PLACE.name
    present = entry.entries()
    if position in present and place in present:
        raise present[place].error("stands beside 'position_m'; give only one of the two")
    first, other = (place, []) if place in present else (position, [place])
    constants = [keys.CONSTANT.name, *RADARS]
    further = [keys.DETECTOR.name, keys.SCAN_PERIOD.name, keys.ATTENUATION.name]
    limits = [key.name for key in keys.LIMITS]
    optional = [*other, *constants, *further, *limits, *optional]
    entries = entry.mapping([*required, first, keys.P_FA.name], optional)
    chosen = [key for key in constants if key in entries]
    if len(chosen) != 1:
        *others, last = (f"'{key}'" for key in constants)
        raise entry.error(
            f"needs one of the keys {', '.join(others)} and {last}, and not "
            + ("both" if len(chosen) < 3 else "more")
        )
    section = Section(entries)
    radar_position, radar_place = [0.0] * 3, None
    if first == place:
        radar_place = read_place(entries[place])
    else:
        radar_position = section.value(keys.RADAR_POSITION)
    sheet: DataSheet | None = None
    constant = section.value(keys.CONSTANT)
    if constant is None:
        sheet = read_data_sheet(entries[chosen[0]], chosen[0])
        constant = sheet.constant
    p_fa = section.value(keys.P_FA)
    detector: Detector = DETECTORS[keys.DETECTOR.default]()
    if keys.DETECTOR in section:
        detector = read_detector(section[keys.DETECTOR], p_fa)
        if sheet and sheet.kind == "surveillance" and _looks(detector) > 1:
            raise section[keys.DETECTOR].error(
                "must be of one pulse with 'surveillance', which takes all the energy of a scan "
                "for a single pulse; 'tracking' and 'constant' take one of several pulses"
            )
    return RadarEntry(
        state=np.array([*radar_position, constant]),
        p_fa=p_fa,
        detector=detector,
        data_sheet=sheet,
        place=radar_place,
        place_entry=entries.get(place),
        scan_period=section.value(keys.SCAN_PERIOD),
        attenuation=section.si(keys.ATTENUATION),
        max_range=section.si(keys.MAX_RANGE),
        min_range=_read_min_range(section, sheet, section.si(keys.MAX_RANGE)),
        horizon=section.value(keys.HORIZON),
    )


def _looks(detector: Detector) -> int:
    """Return the number of pulses behind one P_D."""
    if not isinstance(detector, PulseDetector):
        return 1
    return detector.pulses * (detector.binary.n if detector.binary else 1)


def place_radar(radar: RadarEntry, poses: Poses) -> RadarEntry:
    """Return a radar with its position in the frame of the poses."""
    if radar.place is None or radar.place_entry is None:
        return radar
    if poses.origin is None:
        raise radar.place_entry.error(
            "needs a path whose route is in latitude and longitude, with its geometry.origin; "
            "here give position_m"
        )
    state = radar.state.copy()
    state[POSITION] = ned_from_geodetic(radar.place, poses.origin)
    return with_levels(dataclasses.replace(radar, state=state), radar.stated, poses)


def with_levels(radar: RadarEntry, levels: Levels, poses: Poses) -> RadarEntry:
    """Return a radar with its uncertainty.

    For a radar in latitude and longitude, the file has C_rr relative to north, east and down at the
    radar. The result is in the frame of the poses.
    """
    made = levels
    if radar.place is not None and poses.origin is not None:
        turn = np.eye(len(RADAR))
        turn[POSITION, POSITION] = turn_to_origin(radar.place, poses.origin)
        turned = {level: turn @ matrix @ turn.T for level, matrix in levels.covariance.items()}
        made = dataclasses.replace(
            levels,
            covariance={
                level: covariance.without_rounding((matrix + matrix.T) / 2)
                for level, matrix in turned.items()
            },
        )
    return dataclasses.replace(radar, levels=made, stated=levels)


def read_radars(entry: Entry) -> list[RadarEntry]:
    """Read the radars of a network."""
    if not entry.is_list() or not entry.items():
        raise entry.wrong("a list of one radar or more, each with a name")
    entries = entry.items()
    if len(entries) > MAX_RADARS:
        raise entry.error(f"has {len(entries)} radars, allowed are {MAX_RADARS}")
    radars: list[RadarEntry] = []
    for radar_entry in entries:
        radar = _read_one_of_several(radar_entry)
        name = radar_entry.entries()[keys.RADAR_NAME.name]
        if radar.name in (other.name for other in radars):
            raise name.error(f"must be a name that no other radar has, got {radar.name!r}")
        problem = name_problem([*(other.name for other in radars), radar.name])
        if problem:
            raise name.error(problem)
        levels = radar_entry.entries()[keys.RADAR_UNCERTAINTY.name]
        _refuse_other_levels(levels, radar, (radars or [radar])[0])
        radars.append(radar)
    return radars


def _read_one_of_several(entry: Entry) -> RadarEntry:
    uncertainty = keys.RADAR_UNCERTAINTY.name
    radar = read_radar(entry, [keys.RADAR_NAME.name], [uncertainty])
    section = Section(entry.entries())
    name = section.value(keys.RADAR_NAME)
    if uncertainty not in section:
        raise entry.error("missing key 'uncertainty'; every radar of 'radars' needs this key")
    levels = read_levels(section[uncertainty], radar.data_sheet, radar.attenuation)
    return dataclasses.replace(radar, name=name, levels=levels, stated=levels)


def _read_min_range(section: Section, sheet: DataSheet | None, max_range: float) -> float:
    """Read the slant range [m] within which a radar detects nothing."""
    min_range: float = section.si(keys.MIN_RANGE)
    where = keys.MIN_RANGE
    if section.value(keys.ECLIPSING):
        pulse = {} if sheet is None else sheet.values
        if "pulse_width_us" not in pulse:
            raise section[keys.ECLIPSING].error(
                "needs the length of the pulse, pulse_width_us of 'tracking'; "
                f"here give {keys.MIN_RANGE.name}"
            )
        eclipsed = 0.5 * speed_of_light * pulse["pulse_width_us"] * 1e-6
        if eclipsed > min_range:
            min_range, where = eclipsed, keys.ECLIPSING
    if min_range >= max_range:
        raise section[where].error(
            f"hides the target within {min_range / 1e3:g} km, must be less than "
            f"{keys.MAX_RANGE.name}, {max_range / 1e3:g} km"
        )
    return min_range


def _refuse_other_levels(entry: Entry, radar: RadarEntry, first: RadarEntry) -> None:
    """Raise InputError unless a radar has the levels of the first."""
    expected, levels = list(first.levels.covariance), entry.entries()
    for level, level_entry in levels.items():
        if level not in expected:
            raise level_entry.error(
                f"must be a level that {first.called} has too: {', '.join(expected)}"
                + did_you_mean(level, set(expected) - set(levels))
            )
    missing = [level for level in expected if level not in levels]
    if missing:
        raise entry.error(
            f"missing level '{missing[0]}'; {radar.called} must have the levels that "
            f"{first.called} has: {', '.join(expected)}"
        )


def network(
    radars: Sequence[RadarEntry], models: Sequence[DetectionModel], poses: Poses
) -> NetworkModel:
    """Return the network of the radars."""
    return NetworkModel(
        tuple(
            Radar(
                model,
                name=radar.name,
                max_range=radar.max_range,
                min_range=radar.min_range,
                horizon=poses.earth if radar.horizon else None,
                scan_period=radar.scan_period,
            )
            for radar, model in zip(radars, models, strict=True)
        )
    )
