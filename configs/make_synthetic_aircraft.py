"""Write synthetic_aircraft.csv, an RCS table to try things with. No aircraft looks like this.

The cross section is a sum of powers, a rounded body and a few flashes:

- a body that is small from the nose, larger from the tail and largest abeam;
- the leading edge of a wing swept by 35 degrees, a narrow flash 35 degrees off the nose;
- the side of the fuselage, a flash abeam;
- the trailing edge, a fainter flash at 155 degrees;
- the engine's outlet, a broad one at the tail.

Each flash is a bell in azimuth and in elevation. The two halves of the aircraft are alike, so half
of it is written: `mirror: true` in the scenario makes it whole.
"""

from pathlib import Path

import numpy as np

AZIMUTH = np.arange(0, 181, 1)
ELEVATION = np.arange(-30, 31, 5)

#: Azimuth, elevation [deg], their widths [deg], and the height of the flash [m^2].
FLASHES = (
    (35, 0, 1.5, 12, 0.40),
    (90, 0, 4.0, 15, 1.00),
    (155, 0, 2.0, 12, 0.15),
    (180, 0, 15.0, 15, 0.12),
)


def cross_section(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """RCS [m^2] by azimuth and elevation [deg]."""
    turn = np.deg2rad(azimuth)
    tilt = np.deg2rad(elevation)
    body = (0.03 + 0.08 * np.sin(turn) ** 2 + 0.02 * (1 - np.cos(turn)) / 2) / np.cos(tilt) ** 2
    flashes = (
        height * np.exp(-0.5 * (((azimuth - a) / da) ** 2 + ((elevation - e) / de) ** 2))
        for a, e, da, de, height in FLASHES
    )
    return body + sum(flashes)


def text() -> str:
    """Return the content of the file."""
    rows = [
        "# SYNTHETIC: the RCS of no real aircraft, made by configs/make_synthetic_aircraft.py.",
        "# The right half; elevation is positive above the aircraft.",
        "azimuth_deg,elevation_deg,rcs_dbsm",
    ]
    for elevation in ELEVATION:
        for azimuth in AZIMUTH:
            level = 10 * np.log10(cross_section(azimuth, elevation))
            rows.append(f"{azimuth},{elevation},{level:.2f}")
    return "\n".join([*rows, ""])


if __name__ == "__main__":
    Path(__file__).with_name("synthetic_aircraft.csv").write_text(text(), encoding="utf-8")
