"""The unknown wall of the main scenario, at a short distance."""

from dataclasses import replace

import numpy as np

import uvms_drake as uv


def close_to_the_wall(*overrides: str) -> uv.Scenario:
    """Returns the scenario for 6 s from 15 mm before x = 0, at the place and in the posture."""
    scenario = uv.load_scenario("girona500_contact", ["duration=6.0", *overrides])
    model = uv.load_model(scenario)
    y = np.concatenate([np.asarray(scenario.task.pose, dtype=float), scenario.task.posture])
    y[0] = -0.015
    config = model.configuration(y)
    scenario.start = replace(scenario.start, eta=config[:6], q=config[6:])
    return scenario
