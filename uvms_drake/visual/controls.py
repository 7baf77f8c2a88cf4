"""Buttons and sliders in Meshcat for the user who watches a run."""

import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import BasicVector, Context

from uvms_drake.common.errors import vector
from uvms_drake.common.wiring import WiredSystem, output_of

STOP, CLOSE = "Stop the run", "Close the page's server"
POLL = 0.05  # s
FORCE = "desired force [N]"
SLIDER_STEP = 0.5  # N
DISTURBANCE = "disturbance [%]"
HOME = "Send the mission home"


def add_slider(meshcat: Meshcat, name: str, *, end: float, step: float, value: float) -> float:
    """Adds a slider from 0, in place of an earlier run's, and returns its rounded value."""
    if name in meshcat.GetSliderNames():
        meshcat.DeleteSlider(name)
    return meshcat.AddSlider(name, 0.0, end, step, value)


def stop_button(meshcat: Meshcat) -> Callable[[], bool]:
    """Adds a button, and returns the function that reads whether it has been pressed."""
    meshcat.AddButton(STOP, "Escape")
    return lambda: meshcat.GetButtonClicks(STOP) > 0


def wait_for_browser(meshcat: Meshcat) -> None:
    """Returns as soon as a browser shows the scene."""
    while meshcat.GetNumActiveConnections() == 0:
        time.sleep(POLL)


def wait_for_end(meshcat: Meshcat) -> None:
    """Waits until the button or Ctrl-C is pressed."""
    if STOP in meshcat.GetButtonNames():
        meshcat.DeleteButton(STOP)
    meshcat.AddButton(CLOSE, "Escape")
    with suppress(KeyboardInterrupt):
        while meshcat.GetButtonClicks(CLOSE) == 0:
            time.sleep(POLL)


class ForceSlider(WiredSystem):
    """Source of the desired force: the task's, or with Meshcat the task's scaled by a slider.

    .. pydrake_system::

        name: ForceSlider
        output_ports:
        - force

    - `force` (6) [N, N m]: 𝔉_des.

    It has no state. A run with Meshcat is repeatable as long as the user leaves the slider alone,
    which starts exactly at the task's force.

    Args:
        force: 𝔉_des of the task (6,) [N, N m].
        meshcat: Meshcat of the slider, which ends at twice the task's force; None: no slider.
    """

    def __init__(self, force: np.ndarray, meshcat: Meshcat | None = None):
        super().__init__()
        self._force = vector("force", force, 6)
        magnitude = float(np.linalg.norm(self._force[:3]))
        # A slider rounds to its steps; its first value stands for exactly the task's force.
        self._first, self._magnitude = magnitude, magnitude
        self._meshcat = meshcat if magnitude > 0.0 else None
        if self._meshcat is not None:
            self._first = add_slider(
                self._meshcat, FORCE, end=2.0 * magnitude, step=SLIDER_STEP, value=magnitude)
        # The user moves the slider at any time: its value must not be cached.
        self.DeclareVectorOutputPort("force", 6, self._calc_force, {self.time_ticket()})

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        newton = self._first
        if self._meshcat is not None:
            newton = self._meshcat.GetSliderValue(FORCE)
        factor = 1.0 if newton == self._first else newton / self._magnitude
        output.SetFromVector(factor * self._force)


class HomeButton(WiredSystem):
    """Operator stop of a mission: a button that stays pressed.

    .. pydrake_system::

        name: HomeButton
        output_ports:
        - stop

    - `stop` (1): 1 if the button was pressed, else 0.

    It has no state: Meshcat counts.

    Args:
        meshcat: Meshcat of the button.
    """

    def __init__(self, meshcat: Meshcat):
        super().__init__()
        meshcat.AddButton(HOME, "KeyH")
        # The user presses it at any time: its value must not be cached.
        output_of(self, "stop", 1, lambda c: [meshcat.GetButtonClicks(HOME) > 0],
                  {self.time_ticket()})


class DisturbanceSlider(WiredSystem):
    """Gain of a slider on a disturbance, 0 to 100 %: never above the disturbance's bound.

    .. pydrake_system::

        name: DisturbanceSlider
        input_ports:
        - disturbance
        output_ports:
        - scaled

    - `disturbance`, `scaled` (size): d or w, and the scaled one.

    It has no state. The slider starts at 100 %, which changes nothing.

    Args:
        size: Size of the disturbance.
        meshcat: Meshcat of the slider.
    """

    def __init__(self, size: int, meshcat: Meshcat):
        super().__init__()
        add_slider(meshcat, DISTURBANCE, end=100.0, step=5.0, value=100.0)
        port = self.DeclareVectorInputPort("disturbance", size)
        output_of(self, "scaled", size,
                  lambda c: meshcat.GetSliderValue(DISTURBANCE) / 100.0 * port.Eval(c),
                  {self.all_sources_ticket()})
