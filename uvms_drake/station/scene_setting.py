"""The setting of a scenario's picture: its constants."""

import numpy as np

from uvms_drake.control.limits import resolved_radii, tighten
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.contact.bounds import safe_depth_margin
from uvms_drake.station.problem import limits_of, shown_surface
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.visual.scene import LimitUse, Setting

PAINTED = 1.5
"""End of the colour scale of a mission over its largest desired force."""


def setting_of(scenario: Scenario, model: ContactModel, *, certified: bool = False) -> Setting:
    """Returns the setting of a `Scene` of a run.

    Args:
        scenario: Scenario of the run, with the settings of the picture in `visual`.
        model: The controller's model.
        certified: Whether its tube is that of a certificate that holds.
    """
    force, limits = np.asarray(scenario.task.force, dtype=float), limits_of(scenario, model)
    wall = scenario.contact.declared_wall()
    return Setting(
        robot=scenario.model, model=model, surface=shown_surface(scenario, model),
        start=scenario.start.config, force=force,
        goal=model.surface.pose_for(force, scenario.task.pose),
        radius=float(resolved_radii(scenario.tube).position or 0.0),
        limit_use=LimitUse(model, limits, tighten(limits, scenario.tube)),
        horizon=scenario.mpc.horizon, visual=scenario.visual, certified=certified,
        direction=None if wall is None else wall.direction,
        margin=0.0 if wall is None else safe_depth_margin(scenario),
        painted=PAINTED * max(step.strongest for step in scenario.mission.steps)
        if scenario.mission.steps else None)
