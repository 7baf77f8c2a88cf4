"""Kinematics and dynamics of the comparison's robot, written in CasADi without this package.

Every link carries its standard Denavit-Hartenberg frame, in which the next joint is the z axis and
its own joint's axis and origin are constants; velocities, accelerations and forces are passed
along the chain in these frames (Newton-Euler). The numbers are those of the specification, not of
the robot's files. Frames: world NED, vehicle FRD. Units: SI.

    𝔮̇ = Γ(𝔮) ζ,   ζ̇ = f(𝔮, ζ) + u,   χ(𝔮) the end-effector's position and ZYX Euler angles
"""

from collections.abc import Callable

import casadi as ca
import numpy as np

GRAVITY = 9.81
DENSITY = 1000.0
ARM_BASE = (0.53, 0.0, 0.36)  # origin of Σ_0 in the vehicle's frame

# Denavit-Hartenberg table
A = (0.10, 0.26, 0.09, 0.0)
D = (0.0, 0.0, 0.0, 0.29)
ALPHA = (-np.pi / 2, 0.0, np.pi / 2, 0.0)

# Vehicle, about its origin; (x, y, z) or (x, y, z, roll, pitch, yaw)
VEHICLE_INERTIA = np.array([146.0, 146.0, 146.0, 15.0, 30.0, 30.0]) + np.array(
    [75.0, 150.0, 210.0, 10.0, 40.0, 35.0])  # rigid body + added mass
VEHICLE_LINEAR_DRAG = np.array([20.0, 40.0, 50.0, 10.0, 15.0, 15.0])
VEHICLE_QUADRATIC_DRAG = np.array([90.0, 180.0, 230.0, 30.0, 50.0, 50.0])
VEHICLE_BUOYANCY = 146.0 * GRAVITY  # neutral
CENTER_OF_BUOYANCY = (0.0, 0.0, -0.05)

# Links: cylinders of radius r along x (links 1 to 3) or z (link 4) of their frame
RADIUS = 0.04
MASS = (1.6, 1.9, 1.4, 1.1)
LENGTH = (0.10, 0.26, 0.09, 0.29)
CENTER = ((-0.05, 0.0, 0.0), (-0.13, 0.0, 0.0), (-0.045, 0.0, 0.0), (0.0, 0.0, -0.145))
LONG_AXIS = (0, 0, 0, 2)
NET_WEIGHT = 0.1  # weight less buoyancy, of the weight
ROTOR_INERTIA = np.array([0.6, 0.6, 0.4, 0.2])
JOINT_DAMPING = np.array([4.0, 4.0, 3.0, 2.0])

Symbol = ca.SX


def euler_rotation(angles: Symbol) -> Symbol:
    """Returns R = Rz(ψ) Ry(θ) Rx(φ) (3, 3)."""
    return _rotation(2, angles[2]) @ _rotation(1, angles[1]) @ _rotation(0, angles[0])


def euler_rate_matrix(angles: Symbol) -> Symbol:
    """Returns the matrix (3, 3) from body angular velocity to Euler rates."""
    s, c, t = ca.sin(angles[0]), ca.cos(angles[0]), ca.tan(angles[1])
    cos_pitch = ca.cos(angles[1])
    return ca.blockcat([[1, s * t, c * t], [0, c, -s], [0, s / cos_pitch, c / cos_pitch]])


def configuration_rate(config: Symbol, zeta: Symbol) -> Symbol:
    """Returns 𝔮̇ (10,)."""
    return ca.vertcat(euler_rotation(config[3:6]) @ zeta[:3],
                      euler_rate_matrix(config[3:6]) @ zeta[3:6], zeta[6:])


def task_pose(config: Symbol) -> Symbol:
    """Returns χ (6,) of the end-effector."""
    R = euler_rotation(config[3:6])
    p = config[:3] + R @ ca.DM(ARM_BASE)
    for i in range(4):
        p += R @ _rotation(2, config[6 + i]) @ ca.DM([A[i], 0.0, D[i]])
        R = R @ _link_rotation(i, config[6 + i])
    return _pose_vector(p, R @ _rotation(1, -np.pi / 2))


def drift(config: Symbol, zeta: Symbol, chi_eq: np.ndarray, smoothing: float) -> Symbol:
    """Returns f (10,), the acceleration at u = 0, with an end-effector on the spring K = I₆.

    Args:
        config: 𝔮 (10,).
        zeta: ζ (10,).
        chi_eq: Pose of the undeformed spring (6,) [m, rad].
        smoothing: s of |v| ≈ √(v² + s) in the drag [m²/s², rad²/s²].
    """
    acceleration = ca.SX.sym("acceleration", 10)
    tau = _inverse_dynamics(config, zeta, acceleration, chi_eq, smoothing)
    bias = ca.substitute(tau, acceleration, ca.SX.zeros(10))
    return -ca.ldl_solve(bias, *ca.ldl(ca.jacobian(tau, acceleration)))


def drift_jacobian(config: Symbol, zeta: Symbol, chi_eq: np.ndarray, smoothing: float) -> Symbol:
    """Returns ∂f/∂(𝔮, ζ) (10, 20), with the arguments of `drift`, as an expert would write it.

    From M f + b = 0: ∂f = −M⁻¹ ∂(M ζ̇ + b) at constant ζ̇ = f; M⁻¹ is not differentiated.
    """
    acceleration = ca.SX.sym("acceleration", 10)
    tau = _inverse_dynamics(config, zeta, acceleration, chi_eq, smoothing)
    by_state = ca.substitute(ca.jacobian(tau, ca.vertcat(config, zeta)), acceleration,
                             drift(config, zeta, chi_eq, smoothing))
    return -ca.ldl_solve(by_state, *ca.ldl(ca.jacobian(tau, acceleration)))


def runge_kutta(rate: Callable[[Symbol, Symbol], Symbol], x: Symbol, u: Symbol, h: float) -> Symbol:
    """Returns x after one classical step of ẋ = rate(x, u) with constant input."""
    k1 = rate(x, u)
    k2 = rate(x + h / 2 * k1, u)
    k3 = rate(x + h / 2 * k2, u)
    k4 = rate(x + h * k3, u)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def runge_kutta_jacobian(
    rate: Callable[[ca.MX, ca.MX], tuple[ca.MX, ca.MX, ca.MX]], x: ca.MX, u: ca.MX, h: float
) -> tuple[ca.MX, ca.MX]:
    """Returns the derivatives of `runge_kutta` by x and u, chained by hand.

    Args:
        rate: Returns ẋ and its derivatives by x and u.
        x: State (nx,).
        u: Input (nu,).
        h: Step [s].
    """
    k1, k1_x, k1_u = rate(x, u)
    k2, A, B = rate(x + h / 2 * k1, u)
    k2_x, k2_u = A + h / 2 * A @ k1_x, B + h / 2 * A @ k1_u
    k3, A, B = rate(x + h / 2 * k2, u)
    k3_x, k3_u = A + h / 2 * A @ k2_x, B + h / 2 * A @ k2_u
    _, A, B = rate(x + h * k3, u)
    k4_x, k4_u = A + h * A @ k3_x, B + h * A @ k3_u
    return (ca.MX.eye(x.numel()) + h / 6 * (k1_x + 2 * k2_x + 2 * k3_x + k4_x),
            h / 6 * (k1_u + 2 * k2_u + 2 * k3_u + k4_u))


def _rotation(axis: int, angle: Symbol | float) -> Symbol:
    c, s = ca.cos(angle), ca.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = ca.SX.eye(3)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def _link_rotation(i: int, angle: Symbol) -> Symbol:
    """Returns the attitude of link i + 1 in the frame before it; α is a multiple of π/2."""
    return _rotation(2, angle) @ np.round(ca.DM(_rotation(0, ALPHA[i])).full())


def _pose_vector(p: Symbol, R: Symbol) -> Symbol:
    return ca.vertcat(p, ca.atan2(R[2, 1], R[2, 2]), -ca.asin(R[2, 0]), ca.atan2(R[1, 0], R[0, 0]))


def _along(i: int, axial: float, across: float) -> np.ndarray:
    """Returns (3,) of a value along and one across link i + 1."""
    values = np.full(3, across)
    values[LONG_AXIS[i]] = axial
    return values


def _drag(v: Symbol, linear: np.ndarray, quadratic: np.ndarray, smoothing: float) -> Symbol:
    return (linear + quadratic * ca.sqrt(v**2 + smoothing)) * v


def _inverse_dynamics(config: Symbol, zeta: Symbol, acceleration: Symbol, chi_eq: np.ndarray,
                      smoothing: float) -> Symbol:
    """Returns τ (10,) at which ζ̇ is the acceleration."""
    q, q_dot, q_ddot = config[6:], zeta[6:], acceleration[6:]
    R_WB = euler_rotation(config[3:6])

    # Outwards: velocity and its rate of change in the link's axes, and the vertical.
    v, w, v_dot, w_dot = zeta[:3], zeta[3:6], acceleration[:3], acceleration[3:6]
    base = ca.DM(ARM_BASE)
    v, v_dot, down = v + ca.cross(w, base), v_dot + ca.cross(w_dot, base), R_WB[2, :].T
    R_WL, p_WL = R_WB, config[:3] + R_WB @ base
    rotations, offsets, axes, loads = [], [], [], []
    for i in range(4):
        R = _link_rotation(i, q[i])
        axis = ca.DM(np.round([0.0, np.sin(ALPHA[i]), np.cos(ALPHA[i])]))
        offset = A[i] * ca.DM([1.0, 0.0, 0.0]) + D[i] * axis
        spin, v_in, w_in = axis * q_dot[i], R.T @ v, R.T @ w
        w = w_in + spin
        w_dot = R.T @ w_dot + ca.cross(w_in, spin) + axis * q_ddot[i]
        v = v_in + ca.cross(w, offset)
        v_dot = R.T @ v_dot + ca.cross(v_in, spin) + ca.cross(w_dot, offset)
        down = R.T @ down
        R_WL = R_WL @ R
        p_WL += R_WL @ offset
        rotations.append(R)
        offsets.append(offset)
        axes.append(axis)
        loads.append(_link_load(i, v, w, v_dot, w_dot, down, smoothing))

    # The spring acts at the tip: 𝔉 is a force in the world and a torque on the Euler rates.
    R_E = _rotation(1, -np.pi / 2)
    chi = _pose_vector(p_WL, R_WL @ R_E)
    spring = chi - ca.DM(chi_eq)
    force, torque = loads[-1]
    force += R_WL.T @ spring[:3]
    torque += R_E @ euler_rate_matrix(chi[3:]).T @ spring[3:]
    loads[-1] = force, torque

    # Inwards.
    tau = ROTOR_INERTIA * q_ddot + JOINT_DAMPING * q_dot
    force, torque = ca.SX.zeros(3), ca.SX.zeros(3)
    for i in reversed(range(4)):
        force, torque = force + loads[i][0], torque + loads[i][1]
        torque += ca.cross(offsets[i], force)  # now about the joint
        tau[i] += ca.dot(axes[i], torque)
        force, torque = rotations[i] @ force, rotations[i] @ torque
    torque += ca.cross(base, force)
    return ca.vertcat(ca.vertcat(force, torque)
                      + _vehicle_load(zeta[:6], acceleration[:6], R_WB[2, :].T, smoothing), tau)


def _link_load(i: int, v: Symbol, w: Symbol, v_dot: Symbol, w_dot: Symbol, down: Symbol,
               smoothing: float) -> tuple[Symbol, Symbol]:
    """Returns force and torque about the frame's origin that link i + 1 needs, in its axes."""
    m, r, L, center = MASS[i], RADIUS, LENGTH[i], ca.DM(CENTER[i])
    displaced = DENSITY * np.pi * r**2 * L
    M = m + _along(i, 0.1 * m, displaced)
    inertia = _along(i, m * r**2 / 2, m * (3 * r**2 + L**2) / 12 + displaced * L**2 / 12)
    v, v_dot = v + ca.cross(w, center), v_dot + ca.cross(w_dot, center)
    force = (M * v_dot + ca.cross(w, M * v) - NET_WEIGHT * m * GRAVITY * down
             + _drag(v, _along(i, L, 5 * L), _along(i, 4.4 * L, 44 * L), smoothing))
    torque = inertia * w_dot + ca.cross(w, inertia * w) + ca.cross(v, M * v) + 0.05 * w
    return force, torque + ca.cross(center, force)


def _vehicle_load(nu: Symbol, nu_dot: Symbol, down: Symbol, smoothing: float) -> Symbol:
    """Returns force and torque (6,) that the vehicle needs, in its axes."""
    v, w = nu[:3], nu[3:]
    momentum = VEHICLE_INERTIA * nu
    gyroscopic = ca.vertcat(ca.cross(w, momentum[:3]),
                            ca.cross(v, momentum[:3]) + ca.cross(w, momentum[3:]))
    buoyancy = ca.cross(ca.DM(CENTER_OF_BUOYANCY), -VEHICLE_BUOYANCY * down)
    return (VEHICLE_INERTIA * nu_dot + gyroscopic - ca.vertcat(0, 0, 0, buoyancy)
            + _drag(nu, VEHICLE_LINEAR_DRAG, VEHICLE_QUADRATIC_DRAG, smoothing))
