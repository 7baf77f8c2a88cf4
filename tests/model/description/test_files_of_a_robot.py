"""Files of a robot: hydrodynamics.yaml and thrusters.yaml, their physics and their refusals."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import Propeller, PropellerInfo
from pydrake.systems.framework import DiagramBuilder
from support.thrusters import eight_thrusters, t200

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.schema import check_values
from uvms_drake.model.description.hydrodynamics_file import (
    AddedMass,
    BodyHydrodynamics,
    Drag,
    HydrodynamicParameters,
    added_mass_about_origin,
)
from uvms_drake.model.description.thruster_file import (
    CurveData,
    ThrusterData,
    thrust_map,
)
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

TWO = [ThrusterData("t200", np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, -2.0])),
       ThrusterData("t200", np.array([-0.5, 0.4, 0.2]), np.array([0.0, -0.6, 0.8]))]


def test_the_robot_moves_as_by_drakes_propellers():
    """ζ̇ by the wrench B f, and by Drake's forces at the thrusters' places."""
    builder = DiagramBuilder()
    uvms = builder.AddSystem(make_uvms_plant(
        "girona500_arm5e", surface=None, disturbance=None))
    vehicle = uvms.GetSubsystemByName("plant").GetBodyByName("vehicle").index()
    propeller = builder.AddSystem(Propeller([PropellerInfo(vehicle, RigidTransform(
        RotationMatrix.MakeFromOneVector(item.axis, 2), item.position)) for item in TWO]))
    builder.Connect(uvms.GetOutputPort("body_poses"), propeller.get_body_poses_input_port())
    builder.Connect(propeller.get_spatial_forces_output_port(),
                    uvms.GetInputPort("applied_spatial_force"))
    context = (diagram := builder.Build()).CreateDefaultContext()
    own = uvms.GetMyMutableContextFromRoot(context)
    set_state(uvms, own, np.linspace(-0.3, 0.4, 20))
    forces, command, tau, d = np.array([7.0, -3.0]), propeller.get_command_input_port(), (
        uvms.GetInputPort("tau")), uvms.GetInputPort("disturbance")
    d.FixValue(own, np.zeros(10))

    def acceleration(thrusts: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        command.FixValue(propeller.GetMyMutableContextFromRoot(context), thrusts)
        tau.FixValue(own, np.append(wrench, np.zeros(4)))
        return uvms.GetOutputPort("acceleration").Eval(own).copy()

    by_map = acceleration(np.zeros(2), thrust_map(TWO) @ forces)
    np.testing.assert_allclose(by_map, acceleration(forces, np.zeros(6)), atol=1e-10)
    assert np.linalg.norm(by_map - acceleration(np.zeros(2), np.zeros(6))) > 0.01
    assert diagram.num_input_ports() == 0


def with_thruster(**changes):
    parameters = eight_thrusters()
    parameters.thrusters["up0"] = replace(parameters.thrusters["up0"], **changes)
    return parameters


def with_kind(**changes):
    return replace(eight_thrusters(), kinds={"t200": replace(t200(), **changes)})


def with_curve(command, force):
    return with_kind(curves=[CurveData(16.0, np.array(command), np.array(force))])


def of_hull(**values):
    return HydrodynamicParameters(bodies={"hull": BodyHydrodynamics(**values)})


@pytest.mark.parametrize(("parameters", "message"), [
    (replace(eight_thrusters(), voltage=0.0), r"^voltage = 0\.0: must be positive"),
    (replace(eight_thrusters(), thrusters={}), r"^thrusters = \[\]: must be 1 to 16 by name"),
    (replace(eight_thrusters(), undriven=["rol"]), r"undriven = \['rol'\]: must be different ones"),
    (replace(eight_thrusters(), undriven=["roll"]), r"undriven = .* do not drive: 0, such as none"),
    (with_thruster(kind="t100"), r"^thrusters\.up0\.kind = 't100': must be one of t200"),
    (with_thruster(axis=np.zeros(3)), r"^thrusters\.up0\.axis = .*: must be not zero"),
    (with_kind(smallest=60.0), r"^kinds\.t200\.curves\[0\]\.force = .*: must be beyond the small"),
    (with_kind(curves=[]), r"^kinds\.t200\.curves = \[\]: must be one curve or more"),
    (with_kind(curves=t200().curves[::-1]), r"curves\.voltage = \[16\.0, 12\.0\]: must be posi"),
    (with_kind(curves=[CurveData(12.0, np.array([1000.0, 1900]), np.array([-30.0, 30.0])),
                       t200().curves[1]]), r"curves\.command = .*: must be from the same to"),
    (with_curve([1.0], [0.0]), r"curves\[0\]\.command = .*: must be two numbers or more"),
    (with_curve([0.0, 1.0], [0.0, 1.0, 2.0]), r"curves\[0\]\.force = .*: must be 2 finite numbers"),
    (with_curve([-1.0, 0.0, 1.0], [-1.0, -1.0, 1.0]), r"force = .*: must be rising, or zero over"),
    (with_curve([0.0, 1.0], [1.0, 2.0]), r"force = .*: must be zero at some command"),
    (HydrodynamicParameters(fluid_density=0.0), r"^fluid_density = 0\.0: must be positive"),
    (of_hull(center_of_buoyancy=np.zeros(2)), r"^bodies\.hull\.center_of_buoyancy = .*: must be 3"),
    (of_hull(added_mass=[AddedMass(), AddedMass(np.eye(6) + np.eye(6, k=4))]),
     r"^bodies\.hull\.added_mass\[1\]\.matrix = .*row 1, column 5: 1 against 0 in row 5"),
    (of_hull(added_mass=[AddedMass(np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]))]),
     r"added_mass\[0\]\.matrix = .*its smallest eigenvalue is -1"),
    (of_hull(added_mass=[AddedMass(np.eye(5))]), r"added_mass\[0\]\.matrix = .*6×6 matrix"),
    (of_hull(drag=[Drag(), Drag(quadratic=-np.ones(6))]), r"drag\[1\]\.quadratic = .*zero or posi"),
])
def test_what_has_no_meaning_is_refused_in_one_line(parameters, message):
    with pytest.raises(InvalidParameter, match=message) as error:
        check_values(parameters)
    assert "\n" not in str(error.value)


def test_axes_that_no_thruster_drives_have_to_be_named():
    """Without the vertical ones, heave, roll and pitch are left; a wrong name is not enough."""
    parameters = eight_thrusters()
    parameters.thrusters = {name: item for name, item in parameters.thrusters.items()
                            if name.startswith("across")}
    for undriven in ([], ["heave", "roll", "yaw"]):
        parameters.undriven = undriven
        with pytest.raises(InvalidParameter, match=r"drive: 3, such as heave, roll, pitch$"):
            check_values(parameters)
    parameters.undriven = ["heave", "roll", "pitch"]
    check_values(parameters)


def test_the_girona_500_has_five_thrusters_and_no_roll(girona):
    """Levers and largest wrenches by the vehicle's own controller: 210, 105, 210 N, 46.3 N m."""
    parameters = girona.thrusters
    assert parameters.undriven == ["roll"] and len(parameters.thrusters) == 5
    B = thrust_map(list(parameters.thrusters.values()))
    curve = parameters.kinds["girona500"].curves[0]
    forward, reverse = curve.force[-1], -curve.force[0]
    largest = np.maximum(B, 0.0) @ np.full(5, forward) + np.maximum(-B, 0.0) @ np.full(5, reverse)
    np.testing.assert_allclose(largest[[0, 2]], 2.0 * 104.659)
    assert largest[1] == pytest.approx(95.122)  # The other way it is 104.659.
    turn = np.zeros(5)
    turn[:2] = -reverse, reverse
    assert -(B @ turn)[5] == pytest.approx(46.267, abs=1e-3)


def test_a_semidefinite_added_mass_is_accepted():
    """A slender cylinder has no added inertia about its axis."""
    body = BodyHydrodynamics(added_mass=[AddedMass(matrix=np.array([0, 1, 1, 0, 1, 1.0]))])
    check_values(HydrodynamicParameters(bodies={"rod": body}))


def test_added_mass_about_the_origin_has_the_energy_of_the_motion_of_its_point():
    """½ V_Boᵀ M V_Bo = ½ Σ V_Pᵀ M_P V_P with v_P = v + ω × p, for items that add up."""
    rng = np.random.default_rng(seed=6)
    roots = rng.normal(size=(3, 6, 6))
    items = [AddedMass(matrix=L @ L.T, point=rng.normal(size=3)) for L in roots]
    M = added_mass_about_origin(items)
    np.testing.assert_allclose(M, M.T, atol=1e-12)
    for V in rng.normal(size=(20, 6)):
        energy = 0.0
        for item in items:
            V_P = np.concatenate([V[:3] + np.cross(V[3:], item.point), V[3:]])
            energy += 0.5 * V_P @ item.matrix @ V_P
        np.testing.assert_allclose(0.5 * V @ M @ V, energy, rtol=1e-12)
