"""The radar equation: signal-to-noise ratio, and the radar constant from what it is made of."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.constants import Boltzmann

from radar_sense.limits import POSITIVE, Limit, check_parameters, parameter
from radar_sense.states import FloatArray

DECIBELS = Limit(at_least=-200, at_most=200)


@dataclass(frozen=True)
class SurveillanceRadar:
    """A radar that searches a volume, and what its radar constant is made of.

    Attributes:
        average_power: Average transmitted power P_av [W].
        aperture: Antenna aperture A [m²].
        temperature: Noise reference temperature T_0 [K].
        scan_time: Time T_sc for one scan of the search volume [s].
        search_volume: Solid angle Ω searched [sr].
        loss_db: Losses L [dB].
        noise_figure_db: Noise figure F [dB].
    """

    average_power: float = parameter("average_power_w", POSITIVE)
    aperture: float = parameter("aperture_m2", POSITIVE)
    temperature: float = parameter("temperature_k", POSITIVE)
    scan_time: float = parameter("scan_time_s", POSITIVE)
    search_volume: float = parameter("search_volume_sr", POSITIVE)
    loss_db: float = parameter("loss_db", DECIBELS)
    noise_figure_db: float = parameter("noise_figure_db", DECIBELS)

    def __post_init__(self) -> None:
        check_parameters(self)

    def constant(self) -> float:
        """Radar constant c_r [J m²/K], `eq:c_r_surv`: P_av A / (16 T_0 L F) · T_sc / Ω."""
        loss: float = 10.0 ** ((self.loss_db + self.noise_figure_db) / 10.0)
        power_aperture = self.average_power * self.aperture
        return (
            power_aperture * self.scan_time / (16.0 * self.temperature * loss * self.search_volume)
        )


def snr(constant: FloatArray, cross_section: FloatArray, range_squared: FloatArray) -> FloatArray:
    """Signal-to-noise ratio S = c_r σ_r / (k R⁴), `eq:SNR`.

    Args:
        constant: Radar constant c_r (...) [J m²/K].
        cross_section: σ_r (...) [m²].
        range_squared: R² (...) [m²].

    Returns:
        (...), a ratio of powers.
    """
    noise: FloatArray = Boltzmann * range_squared * range_squared
    return constant * cross_section / noise
