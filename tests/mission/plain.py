"""Missions of several radars by plain loops over their looks, with no code of the package."""

from dataclasses import replace

import numpy as np
from studies.bands import cases
from studies.bands.model import Oracle


class PlainMissions:
    """P_D of every look of missions with drawn errors, or of the mission without errors.

    Between the rows of the route, states and variances are linear in time. The errors of a pose are
    a Gauss-Markov process.

    Attributes:
        times: Times of all looks, in order.
        p_d: P_D (runs,) by name of the radar and time of the look.
    """

    def __init__(self, content, route, runs=1, seed=None):
        """Take a scenario as YAML has it, and the text of its route: time, pose, and deviations.

        Without a seed there are no errors.
        """
        own = {"position_m": 0, "attitude_deg": 0, **content["uncertainty"].get("aircraft", {})}
        tau = float(str(content["uncertainty"]["aircraft_correlation_s"]).lstrip("."))
        problem = cases.of_document({**content, "uncertainty": {"aircraft": own}}, np.zeros(6))
        time, *cells = np.loadtxt(route.splitlines()[1:], delimiter=",").T
        states, std = np.array(cells[:6]), np.array(cells[6:])
        if not len(std):
            std = np.tile([own["position_m"]] * 3 + [own["attitude_deg"]] * 3, (len(time), 1)).T
        units = np.array([[1.0]] * 3 + [[np.pi / 180]] * 3)
        self.periods = {radar["name"]: radar["scan_period_s"] for radar in content["radars"]}
        start, end = time[[0, -1]].tolist()
        looks = {
            name: [start + k * period for k in range(int((end - start) / period) + 1)]
            for name, period in self.periods.items()
        }
        self.times = sorted({t for times in looks.values() for t in times})

        def at(t, rows):
            return np.array([[np.interp(t, time, row)] for row in rows])

        poses = {t: units * at(t, states) for t in self.times}
        whole = Oracle(problem)
        radars, rcs_error = whole.nominal_radars[:, None], 0.0
        if seed is not None:
            rng = np.random.default_rng(seed)
            _, radars, rcs_error, _ = whole.draw(rng, runs)
            error, last = rng.standard_normal((6, runs)), start
            for t in self.times:
                rho = np.exp(-(t - last) / tau) if tau else float(t == last)
                error = rho * error + np.sqrt(1 - rho**2) * rng.standard_normal((6, runs))
                poses[t] = poses[t] + units * np.sqrt(at(t, std**2)) * error
                last = t
        self.p_d = {}
        for i, (name, times) in enumerate(looks.items()):
            alone = Oracle(replace(problem, radars=problem.radars[i : i + 1]))
            for t in times:
                self.p_d[name, t] = alone.p_d(poses[t], radars[4 * i : 4 * i + 4], rcs_error)

    def fused(self, t, names):
        """Return P_D (runs,) of the radars among some that look at a time."""
        looking = [self.p_d[name, t] for name in names if (name, t) in self.p_d]
        return 1 - np.prod(1 - np.array(looking), axis=0)

    def events(self, m, n):
        """Return, by each time (K, runs), P of a detection and of m of n by radars of one period.

        The second goes through the outcomes of the last n - 1 looks that are no track yet.
        """
        missed = np.cumprod([1 - self.fused(t, self.periods) for t in self.times], axis=0)
        untracked = np.ones_like(missed)
        for period in set(self.periods.values()):
            group = [name for name, own in self.periods.items() if own == period]
            chance = {(): 1.0}
            for k, t in enumerate(self.times):
                if (group[0], t) in self.p_d:
                    p, later = self.fused(t, group), {}
                    for history, value in chance.items():
                        for hit in (0, 1):
                            window = (*history, hit)[-n:]
                            if sum(window) < m:
                                key = window[-(n - 1) :]
                                later[key] = later.get(key, 0) + value * (p if hit else 1 - p)
                    chance = later
                untracked[k] *= sum(chance.values())
        return 1 - missed, 1 - untracked
