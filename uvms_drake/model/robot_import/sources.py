"""Axes of the water's numbers by their source, with the place in its code where they are seen.

uuv_simulator, and dave and plankton, which have its code: matrices in FRD.
`HMFossen::ApplyHydrodynamicForces` takes `ToNED` of both velocities in the link (y and z change
sign), multiplies, and takes `FromNED` of the force. The centre of buoyancy is in the link's axes:
`BuoyantObject::ApplyBuoyancyForce` has `AddForceAtRelativePosition(force, GetCoB())`. Quadratic
drag is its diagonal.

gz-sim: matrices in the link's axes. `Hydrodynamics::PreUpdate` turns the world's velocity less the
current by the link's pose alone. A current is in the world's axes, z up, as in uuv_simulator.

SDFormat's `fluid_added_mass`: in the link's axes. gz-math's `Inertial`: "The added mass matrix is
expressed in the link origin frame F".

Ours, hydrodynamics.yaml: in the body's axes, which are FRD of the vehicle.

A source that is FRD where the link's z is up has every entry that couples (surge, roll) with (sway,
heave, pitch, yaw) of the other sign than in the link's axes.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Source:
    """A convention of axes."""

    name: str
    axes: str
    """Axes of its matrices, with the evidence."""
    turn: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Diagonal of the rotation from these axes to the link's."""

    def in_link(self, M: np.ndarray) -> np.ndarray:
        """Returns a matrix (6, 6) of added mass or drag in the link's axes."""
        T = np.diag(2 * self.turn)
        return T @ M @ T


GZ = Source("gz-sim", "the link's own: its Hydrodynamics.cc turns velocities by the link's pose")
UUV = Source("uuv_simulator", "FRD: its HydrodynamicModel.cc turns velocities by ToNED before it "
             "multiplies, and centres of buoyancy are in the link's axes", (1.0, -1.0, -1.0))
SDF = Source("fluid_added_mass", "the link's own: so SDFormat's Inertial.hh")
