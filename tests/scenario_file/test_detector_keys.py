"""The detector of a scenario: a name, or a mapping with its pulses, CFAR and looks."""

import dataclasses

import numpy as np
import pytest
from helpers import SURVEILLANCE, cov_by_level, document, read_back, scenario, single, yaml_text
from scenario_file.refused import refused

import radar_sense as rs
from radar_sense.limits import POSITIVE, parameter
from radar_sense.model.detectors import DETECTORS, North, required_snr
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario_file.load import parse_scenario

CELLS = {"type": "cell_averaging", "cells": 24}
RANKED = {"type": "ordered_statistics", "cells": 24, "rank": 18}
GOOD = [
    ("marcum", rs.Marcum()),
    ({"model": "marcum"}, rs.Marcum()),
    ({"model": "north"}, rs.North()),
    ({"model": "swerling2", "pulses": 10, "cfar": CELLS},
     rs.Swerling2(pulses=10, cfar=rs.CellAveraging(24))),
    ({"model": "swerling1", "cfar": RANKED}, rs.Swerling1(cfar=rs.OrderedStatistics(24, 18))),
    ({"model": "swerling4", "pulses": 2, "binary": {"m": 3, "n": 5}},
     rs.Swerling4(pulses=2, binary=rs.BinaryIntegration(3, 5))),
    ({"model": "swerling3", "pulses": 1000}, rs.Swerling3(pulses=1000)),
]  # fmt: skip


@pytest.mark.parametrize(("given", "expected"), GOOD)
def test_a_detector_is_read_and_recorded(given, expected):
    s = scenario(radar__detector=given)
    assert single(s).detector == expected
    if isinstance(given, dict):
        given = {"pulses": 1, **given} if len(given) > 1 else given["model"]
    assert s.resolved()["radar"]["detector"] == given
    read_back(s)


BAD = [
    ({"model": "swerling1", "cfar": {**RANKED, "rank": 25}},
     "radar.detector.cfar: rank must be at most 24, the cells; got 25"),
    ({"model": "swerling3", "cfar": RANKED}, "is for swerling1 and swerling2 with one pulse; "
     "cell_averaging is for all"),
    ({"model": "swerling1", "binary": {"m": 1, "n": 2}}, "it is for marcum, swerling2 and"),
    ({"model": "swerling2", "binary": {"m": 3, "n": 2}}, "binary: m must be at most 2"),
    ({"model": "marcum", "cfar": {"type": "cell_averaging", "cells": 1}}, "cfar needs more cells"),
    ({"model": "north", "pulses": 3}, "'pulses', allowed: model; it is a key of marcum, swerling1"),
    ("swerling0", "got 'swerling0'; write 'marcum'"),
]  # fmt: skip


@pytest.mark.parametrize(("given", "says"), BAD)
def test_refusals(given, says):
    with refused(f"my.yaml:...: ...{says}"):
        parse_scenario(yaml_text(document(radar__detector=given)), "my.yaml")


def test_pulses_of_a_surveillance_radar_are_in_its_energy():
    radar = {"position_m": [0, 0, 0], "surveillance": SURVEILLANCE, "p_fa": 1e-6}
    for several in ({"pulses": 2}, {"binary": {"m": 1, "n": 2}}):
        with refused("takes all the energy of a scan for a single pulse"):
            scenario(radar={**radar, "detector": {"model": "marcum", **several}})


def test_a_detector_from_outside_has_keys_of_its_own(monkeypatch):
    """One class, in one file: its fields are the keys of a scenario."""

    @dataclasses.dataclass(frozen=True)
    class Scaled(North):
        """North's, for a signal some times as strong."""

        factor: float = parameter("factor", "Factor of the signal.", POSITIVE, default=2.0)

        def linearize_probit(self, snr, p_fa):
            z, slope = super().linearize_probit(self.factor * snr, p_fa)
            return z, self.factor * slope

        def p_d(self, snr, p_fa):
            return super().p_d(self.factor * snr, p_fa)

    monkeypatch.setitem(DETECTORS, "scaled", Scaled)
    s = scenario(radar__detector={"model": "scaled", "factor": 3})
    assert s.resolved()["radar"]["detector"] == {"model": "scaled", "factor": 3.0}
    assert single(scenario(radar__detector="scaled")).detector == Scaled(2.0)
    np.testing.assert_allclose(s.p_d(), scenario(radar__constant=3 * 167).p_d(), rtol=1e-12)
    with refused("factor: must be a number greater than 0"):
        scenario(radar__detector={"model": "scaled", "factor": 0})


# The configurations.


def test_airport_surveillance():
    """σ is 1.5 times the σ of one pulse with the gain of integration in c_r."""
    s = rs.load_scenario("configs/airport_surveillance.yaml")
    model = single(s)
    assert model.detector == rs.Swerling3(pulses=18, cfar=rs.CellAveraging(16))
    lowest = s.p_d().argmin()
    assert 0.4 < s.p_d()[lowest] < 0.6
    one = rs.DetectionModel(model.rcs, model.p_fa, rs.Swerling1())
    gain = np.divide(*(required_snr(m.detector, m.p_fa, 0.5) for m in (one, model)))
    cov = cov_by_level(s)["data_sheet"]
    sigma, of_one = (
        m.linearize(s.aircraft, s.radar * [1, 1, 1, factor]).std(np.zeros((6, 6)), factor**2 * cov)
        for m, factor in ((model, 1.0), (one, gain))
    )
    assert sigma[lowest] / of_one[lowest] == pytest.approx(1.5, abs=0.05)
    assert 3 * propagate_scenario(s).std.max() == pytest.approx(0.43, abs=0.005)
