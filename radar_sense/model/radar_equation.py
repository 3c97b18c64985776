"""The radar equation: signal-to-noise ratio, and the radar constant from its parameters.

A radar is described by the parameters of its data sheet. The radar constant c_r is a number times a
product with one factor for each parameter: a power of the parameter, or 10^(± dB/10).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

import numpy as np
from scipy.constants import Boltzmann, speed_of_light

from radar_sense.errors import InputError
from radar_sense.limits import POSITIVE, Checked, Limit, check_number
from radar_sense.states import FloatArray

#: ln of a ratio of powers of 1 dB.
NEPERS = math.log(10.0) / 10.0
#: Largest ln of the factor of an error. P_D is 1 far below, and a larger factor overflows.
MOST_NEPERS = 300.0
DECIBELS = Limit(at_least=-200, at_most=200)
#: Losses and noise figures [dB] are not negative.
LOSSES = Limit(at_least=0, at_most=200)
COUNT = Limit(at_least=1, at_most=1e6, whole=True)
#: Key of the losses by name.
LOSSES_KEY = "losses_db"
#: Standard noise temperature [K], the reference of noise figures (IEEE Std 686, "noise figure").
#: T_0 of a scenario file that leaves the key out.
STANDARD_K = 290.0
#: The whole sphere is 4π.
SOLID_ANGLE = Limit(above=0, at_most=12.5664)
#: Divisors of the power-aperture product in c_r, by name in a scenario. A beam of solid angle λ²/A
#: gives 4π (M. I. Skolnik, "Introduction to Radar Systems", 2001; MATLAB's radareqsearchpap). A
#: beam of solid angle (λ/D)² and a circular aperture A = π D²/4 give 16 (B. R. Mahafza, "Radar
#: Systems Analysis and Design Using MATLAB", 2000, and the paper). With 4π, as in the programs of
#: Mahafza's 3rd edition (2013), c_r is 1.05 dB larger.
SEARCH_FACTORS: Mapping[str, float] = {"16": 16.0, "4pi": 4.0 * math.pi}


@dataclass(frozen=True)
class Unit:
    """A unit of a parameter in a scenario: SI value = scale · value^power.

    Attributes:
        scale: The SI value of 1 in the unit.
        power: 1, or -1 for a unit of the inverse.
        meaning: What the number is, if it is not the parameter itself.
    """

    scale: float = 1.0
    power: int = 1
    meaning: str = ""

    def to_si(self, value: float) -> float:
        """Turn a value in this unit into SI."""
        return self.scale * value**self.power


_SI = Unit()
_ROTATION = Unit(60.0, -1, "Rotation rate of the antenna, with one scan a turn.")
_FREQUENCY = Unit(speed_of_light / 1e9, -1, "Carrier frequency.")
_PULSE = Unit(1e6, -1, "Width of the pulse before compression, the inverse of the bandwidth.")


def _factor(
    meaning: str,
    power: int,
    limit: Limit = POSITIVE,
    *,
    decibels: bool = False,
    default: Any = MISSING,
    **units: Unit,
) -> Any:
    """Declare a parameter with its units by key.

    c_r is proportional to parameter^power, or to 10^(power · dB/10) if it is in decibels. One with
    a default has no tolerance.
    """
    of_c_r = {"meaning": meaning, "power": power, "decibels": decibels}
    return field(default=default, metadata={**of_c_r, "kind": limit, "units": units})


class _Parameters(Checked):
    """The parameters of a radar constant, declared with `_factor`, and losses by name."""

    losses_db: Mapping[str, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.losses_db, Mapping):
            raise InputError(f"losses_db must be losses by name, got {self.losses_db!r}")
        object.__setattr__(self, "losses_db", dict(self.losses_db))
        for name, loss in self.losses_db.items():
            check_number(f"{LOSSES_KEY}.{name}", loss, LOSSES)


@dataclass(frozen=True)
class SurveillanceRadar(_Parameters):
    """A radar that searches a volume, by the parameters of its radar constant.

    All the energy of one scan on the target counts as a single pulse in the signal-to-noise ratio.
    Integration of pulses gives no further gain.

    Attributes:
        search_factor: Divisor of the product, 16 in the paper, 4π elsewhere.
        losses_db: Further losses by name [dB].
    """

    average_power: float = _factor(
        "Average transmitted power P_av.", 1, average_power_w=_SI, average_power_kw=Unit(1e3)
    )
    aperture: float = _factor("Antenna aperture A.", 1, aperture_m2=_SI)
    temperature: float = _factor("Noise reference temperature T_0.", -1, temperature_k=_SI)
    scan_time: float = _factor(
        "Time T_sc for one scan of the search volume.", 1, scan_time_s=_SI, rotation_rpm=_ROTATION
    )
    search_volume: float = _factor("Solid angle Ω searched.", -1, SOLID_ANGLE, search_volume_sr=_SI)
    loss_db: float = _factor("Losses L.", -1, LOSSES, decibels=True, loss_db=_SI)
    noise_figure_db: float = _factor(
        "Noise figure F.", -1, LOSSES, decibels=True, noise_figure_db=_SI
    )
    search_factor: float = 16.0
    losses_db: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.search_factor not in SEARCH_FACTORS.values():
            raise InputError(f"search_factor must be 16 or 4π, got {self.search_factor}")

    def constant(self) -> float:
        """Radar constant c_r [J m²/K], eq. (4) of the paper: P_av A / (16 T_0 L F) · T_sc / Ω."""
        return _product(self) / self.search_factor


@dataclass(frozen=True)
class TrackingRadar(_Parameters):
    """A radar that stares at its target with one antenna, by the parameters of its constant.

    The signal-to-noise ratio is of a single pulse,

        S = P_t G² λ² σ / ((4π)³ k T_0 B F L R⁴),

    without any gain of noncoherent integration (Mahafza 2000; Skolnik 2001; Richards 2005). The
    detector accounts for noncoherent integration. Pulses that are integrated coherently multiply S
    by their number. B is the bandwidth of the matched filter, 1/τ for a plain pulse of width τ.
    With pulse compression τ is the width of the uncompressed pulse, because S depends on the
    energy.

    Attributes:
        losses_db: Further losses by name [dB].
    """

    peak_power: float = _factor(
        "Peak transmitted power P_t.", 1, peak_power_w=_SI, peak_power_kw=Unit(1e3)
    )
    gain_db: float = _factor(
        "Gain G of the antenna, the same for transmission and reception.",
        2,
        DECIBELS,
        decibels=True,
        gain_dbi=_SI,
    )
    wavelength: float = _factor("Wavelength λ.", 2, frequency_ghz=_FREQUENCY, wavelength_m=_SI)
    bandwidth: float = _factor(
        "Noise bandwidth B.", -1, bandwidth_mhz=Unit(1e6), pulse_width_us=_PULSE
    )
    temperature: float = _factor("Noise reference temperature T_0.", -1, temperature_k=_SI)
    loss_db: float = _factor("Losses L.", -1, LOSSES, decibels=True, loss_db=_SI)
    noise_figure_db: float = _factor(
        "Noise figure F.", -1, LOSSES, decibels=True, noise_figure_db=_SI
    )
    coherent_pulses: int = _factor(
        "Number of pulses that are integrated coherently into one.",
        1,
        COUNT,
        default=1,
        coherent_pulses=_SI,
    )
    losses_db: Mapping[str, float] = field(default_factory=dict)

    def constant(self) -> float:
        """Radar constant c_r [J m²/K]: n P_t G² λ² / ((4π)³ T_0 B F L)."""
        return _product(self) / (4.0 * math.pi) ** 3


#: The kinds of radar that a scenario can describe by their parameters.
RADARS: Mapping[str, type[SurveillanceRadar] | type[TrackingRadar]] = {
    "surveillance": SurveillanceRadar,
    "tracking": TrackingRadar,
}


def _product(radar: Any) -> float:
    """Return the product of the factors of c_r, as the fields declare them, and of all losses."""
    product, decibels = 1.0, -sum(radar.losses_db.values())
    for f in fields(radar):
        if f.metadata.get("decibels"):
            decibels += f.metadata["power"] * getattr(radar, f.name)
        elif "power" in f.metadata:
            product *= getattr(radar, f.name) ** f.metadata["power"]
    return float(product * 10.0 ** (decibels / 10.0))


def boltzmann_r4(range_squared: FloatArray) -> FloatArray:
    """Return k R⁴ (...) [J m⁴/K], by which S = c_r σ_r / (k R⁴), eq. (3) of the paper."""
    return np.asarray(Boltzmann * range_squared * range_squared)
