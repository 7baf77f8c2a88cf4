"""The rows of the law `tip first` on the robot's full dynamics."""

import numpy as np
from support.lagging import run
from support.transfer import impulse

from uvms_drake.control.laws import TipFirst
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.tube.row_gains import instant_gains

VEHICLE, TIP = (4.0, 2.0), (20.0, 10.0)  # k, σ [1/s]
STEP = 0.025


def test_an_adversary_takes_every_row_to_its_bound_and_none_beyond(model):
    """All rows at once: d = J_y⁻¹δ, |δᵢ| the bound of each, of the signs that move it furthest."""
    end, bound = 3.0, np.repeat([0.03, 0.1], [6, 4])

    def adversary(time: float, J: np.ndarray) -> np.ndarray:
        left = np.array([max(end - time, 0.5 * STEP)])
        signs = [np.sign(impulse([1.0], np.poly([-k, -sigma]), left)[0])
                 for k, sigma in (VEHICLE, TIP)]
        return np.linalg.solve(J, np.repeat(signs, [6, 4]) * bound)

    motion = run(model, TipFirst(BlockGains(*VEHICLE), BlockGains(*TIP)), adversary, end, step=STEP)
    gains = np.repeat([instant_gains(*each).position for each in (VEHICLE, TIP)], [6, 4])
    reached = np.max(np.abs(motion.error), axis=0) / (gains * bound)
    assert np.all((reached > 0.95) & (reached <= 1.0 + 1e-4)), "exact, but for the steps"
