"""The error of the RCS: its factor, its gradient, and the standard deviation of a table."""

import dataclasses

import numpy as np
import pytest
from helpers import (
    csv_text,
    document,
    paper_network,
    read_back,
    refusal,
    scenario,
    scenario_of,
    sheet_document,
    single,
    slopes,
    with_arrays,
    write,
    write_path,
    yaml_text,
)
from numpy.testing import assert_allclose, assert_array_equal
from routes import HEAD, STD

import radar_sense as rs
from radar_sense.model.detectors import required_snr
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import Radar
from radar_sense.model.rcs import ConstantRCS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.propagation import propagate_scenario, unreliable_in_scenario
from radar_sense.scenario_file.rcs_file import load_rcs_table

RNG = np.random.default_rng(17)
AZIMUTH = np.deg2rad(np.arange(-180, 180, 20.0))
ELEVATION = np.deg2rad(np.arange(-60, 61, 20.0))
TABLE = TableRCS(
    AZIMUTH,
    np.exp(RNG.normal(-2, 0.5, (len(AZIMUTH), len(ELEVATION)))),
    ELEVATION,
    std_db=RNG.uniform(0.5, 3.0, (len(AZIMUTH), len(ELEVATION))),
)
CUT = TableRCS(AZIMUTH, TABLE.rcs[:, 3], std_db=TABLE.std_db[:, 0])
MODELS = {
    "constant": ConstantRCS(0.1),
    "ellipsoid": rs.EllipsoidRCS(0.15, 0.13, 0.21),
    "spikeball": rs.SpikeballRCS(4, 0.18, 0.1),
    "table": TABLE,
    "cut": CUT,
}


def states(count):
    """Random states of an aircraft and a radar, with the error of the RCS."""
    aircraft = np.concatenate(
        [RNG.uniform(-3e5, 3e5, (count, 3)), RNG.uniform(-1, 1, (count, 3))], axis=1
    )
    radar = np.concatenate(
        [RNG.uniform(-1e4, 1e4, (count, 3)), RNG.uniform(1, 200, (count, 1))], axis=1
    )
    return aircraft, radar, RNG.uniform(-3, 3, count)


def with_error(radar, error):
    """States (n, 7) of a radar with an error of the RCS."""
    error = np.broadcast_to(error, len(radar))
    return np.column_stack([radar, error, 0 * error, 0 * error])


@pytest.mark.parametrize("name", MODELS)
def test_partials_are_those_of_differences(name):
    model = rs.DetectionModel(MODELS[name], 1e-6, rs.Swerling1())
    aircraft, radar, error = states(60)
    full = with_error(radar, error)
    lin = model.linearize(aircraft, full)
    assert lin.jac_radar.shape == (60, 7)
    whole, steps = np.hstack([aircraft, full]), [1.0] * 3 + [1e-5] * 3 + [1.0] * 3 + [1e-4] * 4
    expected = slopes(lambda s: model.p_d(s[:, :6], s[:, 6:]), whole, steps)
    off, scale = abs(np.hstack([lin.jac_aircraft, lin.jac_radar]) - expected), abs(expected).max(0)
    # a spline's third derivative jumps at nodes
    assert np.all(np.quantile(off, 0.9, axis=0) <= 1e-6 * scale)
    assert np.all(off <= 1e-3 * scale)
    assert_array_equal(model.p_d(aircraft, with_error(radar, 1e6)), 1.0)


@pytest.mark.parametrize(("detector", "sigma"), [(rs.Marcum, 0.2348), (rs.Swerling1, 0.0758)])
def test_a_decibel_at_a_probability_of_a_half(detector, sigma):
    model = rs.DetectionModel(ConstantRCS(1.0), 1e-6, detector())
    aircraft = np.array([[1e5, 0, 0, 0, 0, 0]])
    low = required_snr(model.detector, 1e-6, 0.5) / model.snr(aircraft, [0, 0, 0, 1.0])[0]
    nothing = np.zeros((6, 6)), {"one": np.zeros((4, 4))}
    s = scenario_of(model, [0, 0, 0, low], aircraft, *nothing, rcs_db=1.0)
    moments = propagate_scenario(s, method="linear")
    assert moments.p_d[0] == pytest.approx(0.5, abs=1e-9)
    assert moments.std[0] == pytest.approx(sigma, abs=5e-5)
    # only the factor is uncertain: bounds by form are P_D at ±3 dB
    ends = propagate_scenario(s, method="form")
    for value, decibels in ((ends.lower, -3.0), (ends.upper, 3.0)):
        at = model.p_d(aircraft, np.array([0, 0, 0, low * 10 ** (decibels / 10)]))
        assert_allclose(value, at, atol=3e-5)
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    p_d = model.p_d(aircraft, np.array([[0, 0, 0, low * 10 ** (u / 10)] for u in nodes]))
    mean = np.sum(weights * p_d) / np.sum(weights)
    std = np.sqrt(np.sum(weights * (p_d - mean) ** 2) / np.sum(weights))
    assert ends.mean[0] == pytest.approx(mean, abs=5e-5)
    assert ends.std[0] == pytest.approx(std, rel=1e-3)


@pytest.mark.parametrize("method", ["linear", "probit", "form"])  # others draw the two apart
@pytest.mark.parametrize("limits", [{}, {"max_range": 220.3e3}])
@pytest.mark.all_draws
def test_the_rcs_error_of_one_radar_equals_a_loss(method, limits):
    """A loss with a tolerance of 1.5 dB gives c_r the distribution that σ_r has with rcs_db."""
    of_loss = rs.parse_scenario(yaml_text(sheet_document(tolerances={"loss_db": 1.5})))
    content = sheet_document(tolerances={"loss_db": 0})
    content["uncertainty"]["aircraft"]["rcs_db"] = 1.5
    of_rcs = rs.parse_scenario(yaml_text(content))
    limited = NetworkModel((Radar(single(of_rcs), **limits),))
    pair = [with_arrays(s, model=limited) for s in (of_loss, of_rcs)]
    one, other = (propagate_scenario(s, method=method) for s in pair)
    for field in ("p_d", "mean", "std", "lower", "upper"):
        assert_allclose(getattr(one, field), getattr(other, field), rtol=1e-5, atol=1e-9)
    assert one.std.min() > 0.01
    warned = [
        unreliable_in_scenario(s.with_analysis(method=method), m)
        for s, m in zip(pair, (one, other), strict=True)
    ]
    assert_array_equal(*warned)
    assert warned[0].any() or not limits


def test_the_rcs_error_is_read_and_read_back(tmp_path):
    plain = {"position_m": 10, "attitude_deg": 1}
    given = scenario(uncertainty__aircraft={**plain, "rcs_db": 1.5})
    assert (given.rcs_db, given.rcs_std) == (1.5, 1.5)
    assert given.states().radar[0].tolist() == [0, 0, 0, 167, 0, 0, 0]
    assert_array_equal(np.diagonal(given.states().cov_radar[0]), [1e4, 1e4, 1e4, 25, 2.25, 0, 0])
    assert given.resolved()["uncertainty"]["aircraft"] == {**plain, "rcs_db": 1.5}
    read_back(given)
    matrix = np.diag([1.0, 2, 3, 4, 5, 6]).tolist()
    assert scenario(uncertainty__aircraft={"covariance": matrix, "rcs_db": 2}).rcs_db == 2
    for s in (scenario(), scenario(uncertainty__aircraft={**plain, "rcs_db": 0})):
        assert s.rcs_std == 0
        assert_array_equal(s.states().cov_radar[0], np.pad(s.cov_radar, (0, 3)))
        assert s.resolved()["uncertainty"]["aircraft"] == plain
    text = csv_text(
        ",".join([HEAD, *STD]), [(60 * i, 1e4 * i, 4e5, -3000, *[1] * 6) for i in (0, 1)]
    )
    flown = rs.load_scenario(write_path(tmp_path, text, uncertainty__aircraft={"rcs_db": 0.5}))
    assert flown.rcs_db == 0.5
    assert flown.resolved()["uncertainty"]["aircraft"] == {"rcs_db": 0.5}


def table_text(std):
    """A table of one half, with a column std_db."""
    nodes = [(a, e) for e in (-90, 0, 90) for a in (0, 90, 180)]
    rows = [(a, e, 0.1 if e else 0.2, std(a, e)) for a, e in nodes]
    return csv_text("azimuth_deg,elevation_deg,rcs_m2,std_db", rows)


def smooth_std(azimuth, elevation):
    return 2.0 if elevation else 1 + azimuth / 180


def test_a_table_has_a_standard_deviation_by_aspect(tmp_path):
    (tmp_path / "rcs.csv").write_text(table_text(smooth_std))
    for envelope in (None, np.deg2rad(60)):
        table = load_rcs_table(tmp_path / "rcs.csv", mirror=True, envelope=envelope)
        body = np.array([[1.0, 0, 0], [0, 1, 0], [0, -1, 0], [-1, 0, 0], [0, 0, 1]])
        assert_allclose(table.spread.cross_section(body), [1, 1.5, 1.5, 2, 2], rtol=1e-12)
    content = document(aircraft__rcs={"model": "table", "file": "rcs.csv", "mirror": True})
    (tmp_path / "s.yaml").write_text(yaml_text(content))
    s = rs.load_scenario(tmp_path / "s.yaml")
    assert (s.rcs_db, s.rcs_std, s.states().cov_radar[0, 4, 4]) == (0.0, 1.0, 1.0)
    assert "rcs_db" not in s.resolved()["uncertainty"]["aircraft"]
    assert rs.analyses.budget(s).table["three_sigma_aircraft_rcs"].min() > 0
    made = rs.analyses.rcs(s).table
    nose = (made["azimuth_deg"] == 0) & (made["elevation_deg"] == 0)
    assert made["std_db"][nose].item() == pytest.approx(1.0)


def test_refusals_name_the_key_or_the_line(tool):
    aircraft = {"position_m": 10, "attitude_deg": 1}
    given = {"model": "table", "file": "rcs.csv", "mirror": True}
    for std, changes, message in (
        (smooth_std, {**aircraft, "rcs_db": 1}, "rcs_db: stands beside the column std_db"),
        (lambda a, e: 0, aircraft, "rcs.csv:2: std_db: must be"),
        (lambda a, e: 1 + a / 180, aircraft, "got 1.5 and 1 dB"),
    ):
        write(table_text(std), "rcs.csv")
        text = yaml_text(document(aircraft__rcs=given, uncertainty__aircraft=changes))
        assert message in refusal(tool, text)


def test_the_classes_refuse_what_the_reader_refuses():
    paper = rs.load_scenario()
    with pytest.raises(ValueError, match="rcs_db must be"):
        dataclasses.replace(paper, rcs_db=-1)
    with pytest.raises(ValueError, match="exclude each other"):
        with_arrays(paper, model=rs.DetectionModel(TABLE, 1e-6), rcs_db=1)
    one, other = paper_network([(0, 0, 0)] * 2, [80, 80]).radars
    other = dataclasses.replace(other, band="x", model=rs.DetectionModel(TABLE, 1e-6))
    with pytest.raises(ValueError, match="exclude each other"):  # one of two is enough
        dataclasses.replace(paper, radars=(one, other), rcs_db=1)
    for std in (np.ones(3), np.zeros(len(AZIMUTH)), np.full(len(AZIMUTH), np.nan)):
        with pytest.raises(ValueError, match="std_db must"):
            TableRCS(AZIMUTH, TABLE.rcs[:, 0], std_db=std)
    model = rs.DetectionModel(ConstantRCS(1.0), 1e-6)
    with pytest.raises(ValueError, match="got nan for the error of the RCS"):
        model.p_d(np.ones(6), np.array([0, 0, 0, 1, np.nan, 0, 0]))
    for network in (NetworkModel((Radar(model),)), model):
        for size in (3, 6):
            with pytest.raises(ValueError, match="radar states must have shape"):
                network.p_d(np.ones(6), np.zeros(size))
