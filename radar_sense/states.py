"""The two state vectors, and what the radar states of a scenario have besides.

Every array of states has the components on the last axis, in the order given here. The states of
several radars follow each other, (..., 4m). Besides its four states a radar may have the errors of
further parameters, nominally 0: (..., 7m) for m radars. A scenario has them always, with the
variance 0 where a parameter is certain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.errors import InputError

FloatArray: TypeAlias = NDArray[np.float64]
#: Numbers of an array that is computed at a time, one for each pose: 128 kB stay in a second-level
#: cache.
BLOCK = 16_384
#: Largest sizes of a component and of a radar constant: R⁴ and the ratio S may not overflow.
MOST, MOST_CONSTANT = 1e60, 1e200
#: x_a of the paper: position in the north-east-down frame [m] and ZYX Euler angles [rad].
AIRCRAFT = ("north", "east", "down", "roll", "pitch", "yaw")
#: x_r of the paper: position in the north-east-down frame [m] and radar constant c_r [J m²/K].
RADAR = ("north", "east", "down", "constant")
#: Parameters of factors of the signal, see `model.detection_model.Factor`. In the error budget each
#: is a source if it is uncertain.
FACTORS = ("attenuation", "tilt")
#: x_r, the error ε of the RCS at this radar (see `model.rcs`), and the errors of factors.
RADAR_AND_ERRORS = (*RADAR, *(f"the error of the {name}" for name in ("RCS", *FACTORS)))
POSITION = slice(0, 3)
ATTITUDE = slice(3, 6)
DOWN, YAW = 2, 5
CONSTANT, RCS_ERROR = 3, 4
#: Where the state of a radar has the error of each factor.
FACTOR_ERRORS = {name: len(RADAR) + 1 + i for i, name in enumerate(FACTORS)}


def of_each(radar: FloatArray, radars: int) -> list[FloatArray]:
    """Split states (..., 4m) or (..., 7m) of m radars into those of each, (..., 4) or (..., 7)."""
    size = radar.shape[-1] // radars if radar.ndim else 0
    if size not in (len(RADAR), len(RADAR_AND_ERRORS)) or radar.shape[-1] % radars:
        each = f" of each of {radars} radars" if radars > 1 else ""
        raise InputError(
            f"radar states must have shape (..., {len(RADAR) * radars}) for {', '.join(RADAR)}"
            f"{each}, got {radar.shape}"
        )
    return [radar[..., size * i : size * (i + 1)] for i in range(radars)]


def component(name: int, radars: int) -> slice:
    """Return where the states (..., 7m) of m radars have a component, such as `CONSTANT`."""
    return slice(name, len(RADAR_AND_ERRORS) * radars, len(RADAR_AND_ERRORS))


#: All components of the state of one radar.
_ALL = slice(0, len(RADAR_AND_ERRORS))


def of_radar(number: int, components: slice = _ALL) -> slice:
    """Return where the states (..., 7m) have some components of one radar, by default all."""
    first = len(RADAR_AND_ERRORS) * number
    return slice(first + components.start, first + components.stop)


def with_errors(array: FloatArray, radars: int, axes: int = 1) -> FloatArray:
    """Return states (..., 7m) for (..., 4m): the errors of further parameters are 0.

    Of a covariance (..., 4m, 4m) the last 2 axes are components.
    """
    if array.shape[-1] == len(RADAR_AND_ERRORS) * radars:
        return array
    given, wanted = (radars, len(RADAR)) * axes, (radars, len(RADAR_AND_ERRORS)) * axes
    shape = array.shape[:-axes]
    whole = np.zeros(shape + wanted)
    inside = (slice(None), slice(len(RADAR))) * axes
    whole[(..., *inside)] = array.reshape(shape + given)
    return whole.reshape(shape + (radars * len(RADAR_AND_ERRORS),) * axes)


def slices(count: int, size: int | None = None) -> Iterator[slice]:
    """Yield slices of a size, by default a block, that together are `count` poses."""
    size = size or BLOCK
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def blocks(shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
    """Yield the slices, one for each axis, that cut an array of a shape into blocks of poses."""
    if math.prod(shape) <= BLOCK:
        yield (slice(None),) * len(shape)
        return
    for first in slices(shape[0], max(1, BLOCK // math.prod(shape[1:]))):
        yield from ((first, *rest) for rest in blocks(shape[1:]))


def components_first(vectors: FloatArray) -> FloatArray:
    """Return a view (n, ...) of vectors (..., n). `np.moveaxis` takes ten times as long."""
    return vectors.transpose(-1, *range(vectors.ndim - 1))


def real_array(name: str, values: ArrayLike) -> FloatArray:
    """Return values as an array of floats, the array itself if it is one.

    Values that are masked, ragged or no real numbers are refused: NumPy would drop the mask and the
    imaginary parts, and would make numbers of text, booleans and dates.
    """
    if type(values) is np.ndarray and values.dtype == float:
        return values
    if isinstance(values, np.ma.MaskedArray):
        raise InputError(f"{name} must not be a masked array: give it without the masked values")
    try:
        given = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name} must be an array of numbers: {error}") from error
    if given.dtype.kind not in "iuf":
        raise InputError(f"{name} must be an array of real numbers, got {given.dtype}")
    return given.astype(float)


def read_only(name: str, values: ArrayLike) -> FloatArray:
    """Return values as an array of floats that cannot be written: a copy of what can be."""
    array = real_array(name, values)
    owner: Any = array if array.base is None else array.base
    if array.flags.writeable or not isinstance(owner, np.ndarray) or owner.flags.writeable:
        array = array.copy()
        array.flags.writeable = False
    return array


class ReadOnly:
    """A class that is pickled without cached properties, and whose arrays stay read-only."""

    def __getstate__(self) -> dict[str, Any]:
        return {
            name: value
            for name, value in vars(self).items()
            if not isinstance(getattr(type(self), name, None), cached_property)
        }

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        vars(self).update(state)
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False


def common_shape(*shapes: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape of poses that shapes of poses broadcast to."""
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError as error:
        each = ", ".join(map(str, shapes))
        raise InputError(
            f"shapes of poses must broadcast against each other, got {each}"
        ) from error


def aircraft_states(values: ArrayLike) -> FloatArray:
    """Return states of the aircraft (..., 6) as an array, of which only the shape is checked."""
    states = real_array("aircraft states", values)
    if states.shape[-1:] != (len(AIRCRAFT),):
        raise InputError(
            f"aircraft states must have shape (..., {len(AIRCRAFT)}) for {', '.join(AIRCRAFT)}, "
            f"got {states.shape}"
        )
    return states


def checked_states(
    aircraft: ArrayLike, radar: ArrayLike, radars: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Return states of the aircraft (..., 6), and of the radars (..., 4m) or (..., 7m), checked."""
    aircraft, radar = aircraft_states(aircraft), real_array("radar states", radar)
    of_each(radar, radars)
    common_shape(aircraft.shape[:-1], radar.shape[:-1])
    check_finite("aircraft", aircraft)
    check_finite("radar", radar, radars)
    constants = radar[..., CONSTANT :: radar.shape[-1] // radars]
    if constants.min(initial=0.0) < 0:
        raise InputError(f"radar constant must not be negative, got {constants.min()}")
    return aircraft, radar


def check_finite(whose: str, states: FloatArray, radars: int = 1) -> None:
    """Raise InputError if states (..., n) of "aircraft" or "radar" are not finite, or too large.

    The error names the first value that is not allowed, its component and its pose, from 0.
    """
    if states.min(initial=0.0) >= -MOST and states.max(initial=0.0) <= MOST:  # False for NaN
        return
    names = AIRCRAFT if whose == "aircraft" else RADAR_AND_ERRORS[: states.shape[-1] // radars]
    most = np.full(states.shape[-1], MOST)
    if whose == "radar":
        most[CONSTANT :: len(names)] = MOST_CONSTANT
    wrong = np.argwhere(~(abs(states) <= most))
    if not len(wrong):
        return
    *pose, place = wrong[0].tolist()
    name = names[place % len(names)]
    if states.shape[-1] > len(names):
        name += f" of radar {place // len(names) + 1}"
    value = states[tuple(wrong[0])]
    allowed = f"at most {most[place]:g} in size" if np.isfinite(value) else "finite"
    raise InputError(f"{whose} states must be {allowed}, got {value:g} for {name}{at_pose(pose)}")


def at_pose(index: Sequence[int]) -> str:
    """Return the pose of an index for an error; "" for ()."""
    if not index:
        return ""
    return f" at pose {', '.join(map(str, index))} (counted from 0)"
