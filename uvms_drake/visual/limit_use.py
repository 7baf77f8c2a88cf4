"""How much of each limit is used, and which limits are active."""

from collections.abc import Callable

import numpy as np

from uvms_drake.control.limits import joint_limits, tighten
from uvms_drake.model.surface.law import static_force
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.scenario import Scenario

ACTIVE = 0.98
"""Part of a limit from which on it counts as active."""
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


class LimitUse:
    """Says which part of its limits a motion uses; 1 is all.

    Both the real motion, of the limits themselves, and the nominal one, of what the tube leaves of
    them, are looked at; what is said is the larger part. So a limit that holds the plan back is
    active, though the real robot stays off it.

    Args:
        scenario: Its limits and tube.
        model: The controller's.
    """

    def __init__(self, scenario: Scenario, model: UvmsModel):
        n, limits = model.num_joints, scenario.limits
        q_lower, q_upper = joint_limits(limits, model.q_lower, model.q_upper)
        nominal = tighten(limits, scenario.tube, model.q_lower, model.q_upper, model.surface,
                          accelerations=not scenario.kinematic)
        self._size, self._model = model.size, model
        self.names = ["ν₁", "ν₂", "q̇", "roll", "pitch", "tool",
                      *(f"q{i + 1}".translate(SUBSCRIPTS) for i in range(n))]
        if limits.static_force is not None:
            self.names.append("force")
        if not scenario.kinematic:
            self.names.append("u")
        self._part = [self._parts_of(limits, q_lower, q_upper),
                      self._parts_of(nominal, nominal.q_lower, nominal.q_upper)]

    def _parts_of(self, limits, lower: np.ndarray, upper: np.ndarray
                  ) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        blocks = np.array([limits.nu1, limits.nu2, limits.qdot])
        angles = np.array([limits.roll, limits.pitch, limits.tip_pitch])
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        n, bound = self._size, np.asarray(limits.u, dtype=float)

        def parts(state: np.ndarray, u: np.ndarray) -> np.ndarray:
            config, zeta = state[:n], state[n:]
            chi = self._model.task_pose(config)[:6]
            speeds = [np.linalg.norm(zeta[block]) for block in
                      (slice(0, 3), slice(3, 6), slice(6, None))]
            turned = np.abs([*config[3:5], chi[4]])
            force = ([float(static_force(self._model.surface, chi)) / limits.static_force]
                     if "force" in self.names else [])
            inputs = [np.max(np.abs(u) / bound)] if "u" in self.names else []
            return np.concatenate([speeds / blocks, turned / angles,
                                   np.abs(config[6:] - middle) / half, force, inputs])

        return parts

    def __call__(self, state: np.ndarray, u: np.ndarray, nominal_state: np.ndarray,
                 nominal_input: np.ndarray) -> np.ndarray:
        """Returns the parts (L,) in the order of `names`.

        Args:
            state: (𝔮, ζ) (2(6+n),).
            u: 𝔲 (6+n,); not read if the motion is kinematic.
            nominal_state: (𝔮̄, ζ̄) (2(6+n),).
            nominal_input: ū (6+n,), likewise.
        """
        real, nominal = self._part
        return np.maximum(real(state, u), nominal(nominal_state, nominal_input))
