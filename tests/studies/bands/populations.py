"""Random problems of one pose from four populations, made by a seed and a number.

- general: one to four radars, all kinds of RCS and detector, correlated errors, data sheets.
- short range: a network with one radar of short range, known to a kilometre or four.
- limits: a maximum range, a minimum range or a horizon within reach of the errors.
- lobes: lobes of 0.3 to 5 degrees that the errors of attitude and position sweep over.
"""

from dataclasses import replace

import numpy as np

from .model import BOLTZMANN, EFFECTIVE_RADIUS, Oracle, Problem, Radar, body_vector, detector

DEG = np.pi / 180
NEPERS = np.log(10) / 10
DETECTORS = ("north", "swerling1", "swerling3", "marcum")
#: RCS between the lobes [m²].
FLOOR = 0.01
#: Parameters of a data sheet with a tolerance: key, value, power of c_r, whether in decibels.
PARAMETERS = (
    ("gain_dbi", 34.0, 2, True),
    ("loss_db", 6.0, -1, True),
    ("noise_figure_db", 4.0, -1, True),
    ("peak_power_kw", 100.0, 1, False),
    ("temperature_k", 290.0, -1, False),
)


def problem(population, seed, number):
    """Return the problem of this number in a population."""
    rng = np.random.default_rng([seed, list(POPULATIONS).index(population), number])
    k = 2.0 if rng.random() < 0.15 else 3.0
    fields = POPULATIONS[population](rng)
    return Problem(population=population, number=number, k=k, **fields)


def problems(count, seed):
    """Yield this number of problems of each population, one population after the other in turn."""
    for number in range(count):
        for population in POPULATIONS:
            yield problem(population, seed, number)


def general(rng):
    """Return the fields of a problem of the general mix."""
    count = int(rng.choice([1, 1, 2, 3, 4]))
    distance = 10.0 ** rng.uniform(4.3, 5.6)
    aircraft = pose(rng, distance, -rng.uniform(500, 10e3))
    rcs = random_rcs(rng)
    near, far = 10.0 ** rng.uniform(0, 2.7, 2)
    turn = 10.0 ** rng.uniform(-1, 0.7) * DEG
    attenuated = rng.random() < 0.3
    radars, spreads = [], []
    for _ in range(count):
        position = [*rng.normal(size=2) * distance / 3, -rng.uniform(0, 50)]
        alpha = rng.uniform(0.5, 3) / distance if attenuated else 0.0
        radar = Radar(
            state=np.array([*position, 1.0]),
            detector=str(rng.choice(DETECTORS)),
            p_fa=10.0 ** rng.uniform(-8, -4),
            attenuation=alpha,
            attenuation_std=alpha * rng.uniform(0.1, 0.4),
            tolerances=data_sheet(rng) if rng.random() < 0.4 else (),
        )
        radars.append(with_snr(radar, aircraft, rcs, 10.0 ** rng.uniform(0.2, 1.3)))
        relative = 10.0 ** rng.uniform(-2.5, -0.7)
        spreads.append([far, far, far * rng.choice([0.05, 1.0]), relative])
    return {
        "aircraft": aircraft,
        "radars": tuple(radars),
        "rcs": rcs,
        "cov_aircraft": correlated(rng, [near] * 3 + [turn] * 3),
        "cov_radar": radar_covariance(rng, radars, spreads),
        "rcs_db": rng.uniform(0.3, 2) if rng.random() < 0.4 and not has_spread(rcs) else 0.0,
    }


def short_range(rng):
    """Return the fields of a network with one poorly known radar of short range."""
    # the range at which P_D of the short-range radar is 0.5, as a part of the distance
    known, reach = rng.uniform(1e3, 4e3), rng.uniform(0.1, 1.1)
    distance = rng.uniform(4e3, 30e3)
    if rng.random() < 0.7:  # that range is one to four standard deviations away
        reach = rng.uniform(0.15, 0.6)
        distance = known * rng.uniform(1.0, 3.8) / (1 - reach)
    down = -rng.choice([0.03, 0.1, 0.2]) * distance
    aircraft = pose(rng, distance, down)
    kind = rng.choice(["constant", "ellipsoid", "ellipsoid", "spikeball", "smooth"])
    rcs = random_rcs(rng, str(kind))
    short = Radar(np.array([0, 0, -5, 1.0]), str(rng.choice(DETECTORS)), 1e-6)
    short = with_snr(short, aircraft, rcs, snr_for(short, 0.5) * reach**4)
    radars, spreads = [short], [[known, known * rng.choice([1.0, 0.3]), 3.0, 0.1]]
    for _ in range(int(rng.integers(1, 4))):
        azimuth, apart = rng.uniform(0, 2 * np.pi), rng.uniform(60e3, 220e3)
        state = np.array([apart * np.cos(azimuth), apart * np.sin(azimuth), -30.0, 1.0])
        radar = Radar(state, str(rng.choice(DETECTORS)), 1e-6)
        wanted = 10.0 ** rng.uniform(-3, -0.3)
        radars.append(with_snr(radar, aircraft, rcs, snr_for(radar, wanted)))
        spreads.append([100.0, 100.0, 5.0, 0.05])
    order = rng.permutation(len(radars))
    return {
        "aircraft": aircraft,
        "radars": tuple(radars[i] for i in order),
        "rcs": rcs,
        "cov_aircraft": diagonal([50.0] * 3 + [DEG] * 3),
        "cov_radar": radar_covariance(
            rng, [radars[i] for i in order], [spreads[i] for i in order], share=0.2
        ),
        "rcs_db": rng.uniform(0.3, 1.5) if rng.random() < 0.2 else 0.0,
    }


def limits(rng):
    """Return the fields of a problem with a limit within reach."""
    kind = str(rng.choice(["max_range", "disc", "min_range", "horizon", "low"]))
    rcs = random_rcs(rng, str(rng.choice(["constant", "ellipsoid", "ellipsoid_exact", "smooth"])))
    position, turn = 10.0 ** rng.uniform(0.7, 2.7), rng.uniform(0.3, 3) * DEG
    own = [10.0 ** rng.uniform(0.7, 2.9)] * 2 + [rng.uniform(2, 20)]
    vertical = position
    height, mast, limit = rng.uniform(50, 5e3), rng.uniform(3, 60), {}
    if kind in ("horizon", "low"):
        height, mast = 10.0 ** rng.uniform(1, 2.7), 10.0 ** rng.uniform(0.5, 2)
        vertical, own[2] = height * rng.uniform(0.05, 0.8), mast * rng.uniform(0.05, 0.8)
        if kind == "low" and rng.random() < 0.3:
            own[2] = 500.0
        # the errors of the heights move the horizon by about this, to first order
        factor = np.sqrt(0.5 * EFFECTIVE_RADIUS)
        moved = factor * np.hypot(vertical / np.sqrt(height), min(own[2], mast) / np.sqrt(mast))
        edge = np.sqrt(2 * EFFECTIVE_RADIUS) * (np.sqrt(height) + np.sqrt(mast))
        spread = np.sqrt(moved**2 + position**2 + own[0] ** 2)
        # below the horizon by up to 6 deviations, or above it by as many
        distance = max(edge + rng.uniform(-5, 6) * spread, 0.2 * edge, 2e3)
        limit["horizon"] = True
    elif kind == "disc":
        distance = rng.uniform(5e3, 30e3)
        own[:2] = [distance * rng.uniform(0.1, 0.5)] * 2
        limit["max_range"] = distance * rng.uniform(0.2, 0.95)
        height = rng.uniform(0.02, 0.1) * distance
    else:
        distance = 10.0 ** rng.uniform(4, 5.1)
        spread = np.hypot(position, own[0])
        edge = distance + rng.uniform(-6, 6) * spread
        limit[kind] = max(edge, 0.3 * distance)
        height = min(height, 0.5 * distance)
    aircraft = pose(rng, distance, -height, slant=True)
    radar = Radar(np.array([0, 0, -mast, 1.0]), str(rng.choice(DETECTORS)), 1e-6, **limit)
    radar = with_snr(radar, aircraft, rcs, snr_for(radar, 10.0 ** rng.uniform(-1.5, -0.01)))
    radars, spreads = [radar], [[*own, rng.uniform(0.03, 0.15)]]
    for _ in range(int(rng.choice([0, 0, 1, 2]))):
        azimuth, apart = rng.uniform(0, 2 * np.pi), rng.uniform(60e3, 200e3)
        state = np.array([apart * np.cos(azimuth), apart * np.sin(azimuth), -30.0, 1.0])
        other = Radar(state, str(rng.choice(DETECTORS)), 1e-6)
        wanted = 10.0 ** rng.uniform(-3, -0.5)
        radars.append(with_snr(other, aircraft, rcs, snr_for(other, wanted)))
        spreads.append([100.0, 100.0, 5.0, 0.05])
    return {
        "aircraft": aircraft,
        "radars": tuple(radars),
        "rcs": rcs,
        "cov_aircraft": correlated(rng, [position, position, vertical, turn, turn, turn], 0.3),
        "cov_radar": radar_covariance(rng, radars, spreads, share=0.3),
    }


def lobes(rng):
    """Return the fields of a problem with sharp lobes near the nominal aspect."""
    count = int(rng.choice([1, 1, 1, 2, 3]))
    distance = 10.0 ** rng.uniform(4.3, 5.3)
    aircraft = pose(rng, distance, -rng.uniform(500, 8e3))
    turn = 10.0 ** rng.uniform(-1.3, 0.7) * DEG
    near, far = 10.0 ** rng.uniform(0, 2.5, 2)
    width = 10.0 ** rng.uniform(np.log10(0.3), np.log10(5)) * DEG
    if rng.random() < 0.15:
        rcs = ("spikeball", int(np.pi / width), 10.0 ** rng.uniform(-1.5, 0), FLOOR)
    else:
        # a lobe this many deviations off the nominal aspect towards the first radar, at the origin
        spread = np.hypot(turn, np.hypot(near, far) / distance)
        aspect = nominal_aspect(aircraft, np.zeros(3))
        first = aspect[0] + rng.uniform(-6, 6) * spread, aspect[1]
        rcs = lobed_table(rng, width, first)
    radars, spreads = [], []
    for i in range(count):
        position = [*(rng.normal(size=2) * distance / 3 if i else np.zeros(2)), -10.0]
        radar = Radar(np.array([*position, 1.0]), str(rng.choice(DETECTORS)), 1e-6)
        low = "constant", rcs[3] if rcs[0] == "spikeball" else FLOOR
        radars.append(with_snr(radar, aircraft, low, 10.0 ** rng.uniform(-1.5, 0.9)))
        spreads.append([far, far, far * 0.1, 10.0 ** rng.uniform(-2.5, -1)])
    return {
        "aircraft": aircraft,
        "radars": tuple(radars),
        "rcs": rcs,
        "cov_aircraft": correlated(rng, [near] * 3 + [turn] * 3, 0.3),
        "cov_radar": radar_covariance(rng, radars, spreads, share=0.3),
    }


POPULATIONS = {"general": general, "short range": short_range, "limits": limits, "lobes": lobes}


def pose(rng, distance, down, slant=False):
    """Return an aircraft state at a horizontal distance, or at a slant range, from the origin."""
    azimuth = rng.uniform(0, 2 * np.pi)
    level = np.sqrt(distance**2 - down**2) if slant else distance
    angles = rng.uniform(-1, 1, 3) * [0.4, 0.2, np.pi]
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), down, *angles])


def random_rcs(rng, kind=None):
    """Return an RCS of a kind, or of any kind."""
    kinds = ("constant", "ellipsoid", "ellipsoid_exact", "spikeball", "table", "smooth", "spread")
    kind = kind or str(rng.choice(kinds))
    if kind == "constant":
        return "constant", 10.0 ** rng.uniform(-2, 0)
    if kind in ("ellipsoid", "ellipsoid_exact"):
        return (kind, *rng.uniform(0.12, 0.3, 3))
    if kind == "spikeball":
        return ("spikeball", int(rng.integers(1, 7)), *rng.uniform(0.02, 0.2, 2))
    if kind == "table":  # one cut
        azimuth = np.arange(-180, 180, float(rng.choice([1, 2, 5])))
        return "table", azimuth * DEG, 10 ** (harmonics(rng, azimuth * DEG) / 10 - 1), None, None
    azimuth, elevation = np.arange(-180, 180, 5.0) * DEG, np.arange(-90, 91, 5.0) * DEG
    decibels = harmonics(rng, azimuth)[:, None] * np.cos(elevation)
    decibels += rng.normal(0, 4) * np.sin(elevation) ** 2
    decibels[:, [0, -1]] = decibels[0, [0, -1]]  # one value straight above and below
    std_db = None
    if kind == "spread":
        std_db = rng.uniform(0.5, 1) + 0.4 * np.cos(azimuth + rng.uniform(0, 6))[:, None] * np.cos(
            elevation
        )
        std_db[:, [0, -1]] = std_db[0, [0, -1]]
    return "table", azimuth, 10 ** (decibels / 10 - 1), elevation, std_db


def harmonics(rng, azimuth):
    """Return a sum of eight harmonics of azimuth [dB]."""
    return sum(rng.normal(0, 4 / n) * np.cos(n * azimuth + rng.uniform(0, 6)) for n in range(1, 9))


def lobed_table(rng, width, first):
    """Return a table with lobes of a width at half their height in decibels [rad].

    One lobe is at the aspect `first`, azimuth and elevation [rad].
    """
    upward = rng.random() < 0.3
    width = max(width, 1 * DEG) if upward else width
    azimuth = np.linspace(-np.pi, np.pi, int(np.ceil(2 * np.pi / (width / 4))), endpoint=False)
    elevation = np.arange(-30, 31, 2.0) * DEG if upward else np.zeros(1)
    decibels = np.zeros((len(azimuth), len(elevation)))
    for i in range(int(rng.choice([1, 3, 10, 30]))):
        at = first if i == 0 else (rng.uniform(-np.pi, np.pi), rng.normal(0, 10 * DEG))
        apart = np.mod(azimuth - at[0] + np.pi, 2 * np.pi) - np.pi
        lobe = np.exp(-np.log(2) * (2 * apart / width) ** 2)
        if upward:
            tall = max(width, 6 * DEG)
            over = np.exp(-np.log(2) * (2 * (elevation - at[1]) / tall) ** 2)
        else:
            over = np.ones(1)
        decibels = np.maximum(decibels, rng.uniform(5, 30) * lobe[:, None] * over)
    values = FLOOR * 10 ** (decibels / 10)
    return "table", azimuth, values if upward else values[:, 0], elevation if upward else None, None


def has_spread(rcs):
    """Return whether an RCS has an uncertainty of its own."""
    return rcs[0] == "table" and rcs[4] is not None


def data_sheet(rng):
    """Return one to four tolerances of a radar constant."""
    chosen = rng.choice(len(PARAMETERS), size=int(rng.integers(1, 5)), replace=False)
    tolerances = []
    for key, value, power, decibels in (PARAMETERS[i] for i in chosen):
        std = rng.uniform(0.1, 1.0) if decibels else value * rng.uniform(0.02, 0.12)
        tolerances.append((key, value, float(std), power, decibels))
    return tuple(tolerances)


def slope(tolerance):
    """Return σ of ln c_r from one tolerance, to first order."""
    _, value, std, power, decibels = tolerance
    return power * std * (NEPERS if decibels else 1 / value)


def radar_covariance(rng, radars, spreads, share=0.5):
    """Return C_rr (4m, 4m) from the deviations of each radar; that of c_r is relative.

    A share of all problems has correlations within each radar.
    """
    std = np.array(spreads, dtype=float)
    for row, radar in zip(std, radars, strict=True):
        if radar.tolerances:
            row[3] = np.sqrt(sum(slope(t) ** 2 for t in radar.tolerances))
        row[3] *= radar.state[3]
    correlation = np.eye(std.size)
    if rng.random() < share:
        correlation = random_correlation(rng, std.size)
        owner = np.arange(std.size) // 4
        correlation[owner[:, None] != owner] = 0.0
        for i, radar in enumerate(radars):
            if radar.tolerances:
                row = 4 * i + 3
                correlation[row, :] = correlation[:, row] = 0.0
                correlation[row, row] = 1.0
    std = std.ravel()
    return np.outer(std, std) * correlation


def correlated(rng, std, share=0.5):
    """Return a covariance with these standard deviations, correlated in a share of all problems."""
    if rng.random() >= share:
        return diagonal(std)
    return np.outer(std, std) * random_correlation(rng, len(std))


def diagonal(std):
    """Return the covariance of independent components."""
    return np.diag(np.square(std))


def random_correlation(rng, size):
    """Return a correlation matrix (n, n) with moderate correlations."""
    matrix = rng.normal(size=(size, size)) + np.sqrt(size) * np.eye(size)
    matrix /= np.linalg.norm(matrix, axis=1, keepdims=True)
    return matrix @ matrix.T


def with_snr(radar, aircraft, rcs, snr):
    """Return a radar whose c_r gives a signal-to-noise ratio at the nominal states."""
    alone = Problem("", 0, aircraft, (radar,), rcs, np.zeros((6, 6)), np.zeros((4, 4)))
    ratio = Oracle(alone).snr(0, aircraft[:, None], radar.state[:, None])[0]
    constant = radar.state[3] * snr / ratio
    assert BOLTZMANN < constant < 1e12, constant
    return replace(radar, state=np.array([*radar.state[:3], constant]))


def snr_for(radar, p_d):
    """Return the signal-to-noise ratio at which a radar has a P_D."""
    function, low, high = detector(radar.detector, radar.p_fa), 1e-6, 1e6
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if function(np.array(middle)) < p_d else (low, middle)
    return middle


def nominal_aspect(aircraft, radar):
    """Return azimuth and elevation [rad] of a radar at a position from the aircraft."""
    x, y, z = body_vector((radar - aircraft[:3])[:, None], aircraft[3:, None])
    return float(np.arctan2(y, x)[0]), float(np.arctan2(-z, np.hypot(x, y))[0])
