"""Words about the radars of a scenario in the report."""

import yaml
from helpers import document

import radar_sense as rs
from radar_sense.reporting.scenario_words import radar_table


def test_detector_and_limits_are_in_words():
    content = document(geometry__azimuth_deg={"start": 0, "stop": 0, "step": 1})
    radar = content.pop("radar")
    detector = {"model": "marcum", "pulses": 4, "cfar": {"type": "cell_averaging", "cells": 16}}
    content["radars"] = [
        {
            **radar,
            "name": "one",
            "detector": detector,
            "min_range_km": 30,
            "max_range_km": 400,
            "horizon": True,
            "uncertainty": content["uncertainty"].pop("radar"),
        }
    ]
    scenario = rs.parse_scenario(yaml.safe_dump(content))
    text = str(radar_table(scenario, {}))
    assert "marcum, pulses 4, cfar: cell_averaging cells 16" in text
    assert "from 30 km, up to 400 km, horizon" in text
