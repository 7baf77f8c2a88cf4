"""Effect of each model error and imperfection on a realistic vehicle, one at a time.

The vehicle is that of `girona500_real_loop`: thrusters with lag, 50 Hz, noisy navigation, an
unknown wall, 8 s of hovering; without its current and mass error, from a closer start. `--before`
does the same to `girona500_ideal`: the law `resolved`, an ideal loop, a known wall.
"""

import argparse

import numpy as np

import uvms_drake as uv

REAL = ["start.eta=[-1.09, -0.04, -0.04, 0.0, 0.0, 0.02]", "start.q=[0.0, 1.17, 0.4, 0.0]",
        "current=[0.0, 0.0, 0.0]", "model_error.mass=1.0"]
BEFORE = ["disturbance.bound=0.0"]
ROUND = ["waves=[{amplitude: 0.25, period: 6.0, depth: 2.4}]"]
FOR_WAVES = [  # A faster vehicle, a more bent elbow, and limits and a tube wide enough for both.
    "ancillary.vehicle.k=4.0", "ancillary.vehicle.observer=3.0", "task.pose=[0, 0, 0, 0, -0.17, 0]",
    "task.posture=[0.0, 1.05, 0.35, 0.0]", "start.q=[0.0, 1.05, 0.35, 0.0]", "tube.e=0.25",
    "start.eta=[-1.17, -0.03, -0.11, 0.0, 0.0, 0.02]", "limits.q_lower=[-0.45, 0.5, -0.25, -0.6]",
    "contact.tool_angle=0.5", "tube.joints=0.22", "tube.orientation=0.14"]
AT_20_HZ = ["actuation.0.period=0.05", "ancillary.observer_period=0.05"]
DVL = "{rate: 10.0, gap: 0.4, lost: 1.0, noise: [0.0017, 0.0017, 0.0017]}"
ROBOT = {
    "nothing": [], "mass + 20 %": ["model_error.mass=1.2"], "mass - 20 %": ["model_error.mass=0.8"],
    "payload 0.5 kg": ["model_error.payload.mass=0.5"],
    "buoyancy + 2 %": ["model_error.buoyancy=1.02"],
    "buoyancy - 2 %": ["model_error.buoyancy=0.98"],
    "friction 0.5 N m": ["model_error.joint_friction={coulomb: [0.5], creep: 0.02}",
                         "simulator.max_step_size=0.002"],
    "current 0.25 m/s": ["current=[0.0, 0.25, 0.0]"],
    "waves": ROUND,
    "wall 50 mm off": ["surface_error.shift=[0.05, 0.0, 0.0]"],
    "wall turned by 5 deg": ["surface_error.turn=[0.0, 0.0, 0.0873]"],
    **{f"wall of {by} x N/m": [f"surface_error.stiffness={by}"] for by in (1.4, 0.5)}}
"""Errors of robot, water and wall, unknown to the controller; waves of 0.2 m/s, 6 s."""
LOOP: dict[str, tuple[list[str], list[str] | None]] = {
    "waves, for them": (ROUND + FOR_WAVES, None),
    "thrusters + 10 %": (["actuation.1.error=[0.1]"], None),
    "thrusters - 10 %": (["actuation.1.error=[-0.1]"], None),
    "20 Hz": (AT_20_HZ, ["actuation=[!SampledCommand {period: 0.05, delay: 0.01}]"]),
    "20 Hz, faster tip": (
        [*AT_20_HZ, "ancillary.tip.k=24.0", "ancillary.tip.sigma=12.0"], None),
    "DVL gaps of 0.4 s": ([f"sensing.0.dvl={DVL}"],
                          [f"sensing=[!Navigation {{dvl: {DVL}, drift: {{rate: 0.0}}}}]"])}
"""Changes of the loop now and before, None without counterpart: no thrusters before."""
ROWS = {**{name: (each, each) for name, each in ROBOT.items()}, **LOOP}
AFTER = 5.0
"""Time from the first touch to the steady state [s]."""
PARTS = ("position", "orientation", "joints", "z")
"""Parts of the tube."""


def measured(record: uv.Record) -> str:
    """Returns the row of a run: largest errors overall, then errors in the steady state."""
    tip, vehicle = (1e3 * np.linalg.norm(now[:, :3] - planned[:, :3], axis=1)
                    for now, planned in ((record.chi, record.chi_nominal),
                                         (record.state, record.nominal_state)))
    tubes = {part: record.ratio_of(part) for part in PARTS}
    row = f"{np.max(tip):8.2f}{np.max(vehicle):8.1f}{max(tubes.values()):8.2f}"
    touching = record.penetration > 0.0
    steady = record.time >= AFTER + (record.time[np.argmax(touching)] if touching.any() else np.inf)
    if not steady.any():
        return f"{row}  not pressed for {AFTER:g} s"
    desired = record.desired_force[-1] / np.linalg.norm(record.desired_force[-1])
    error = (record.force - record.desired_force)[steady] @ desired
    lost = np.count_nonzero(np.diff(touching[steady].astype(int)) < 0)
    constraints = record.summary()["constraints"]
    violated = [name for name, row in constraints.items() if row["margin"] < 0.0]
    violated += ["cut"] * bool(record.input_limited.any())
    violated += [f"tube of {part}" for part in PARTS if tubes[part] > 1.0]
    return (f"{row}{np.max(tip[steady]):8.2f}{np.sqrt(np.mean(error**2)):8.2f}"
            f"{np.max(np.abs(error)):8.2f}{lost:6d}  {', '.join(violated) or 'all kept'}")


def main() -> None:
    """Prints the row of every run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, help="of each run [s]; 20, and 16 before")
    parser.add_argument("--row", choices=ROWS, action="append", help="all if it is left out")
    parser.add_argument("--before", action="store_true", help="the law before, in its ideal loop")
    arguments = parser.parse_args()
    name, common = ("girona500_ideal", BEFORE) if arguments.before else (
        "girona500_real_loop", REAL)
    duration = arguments.duration or (16.0 if arguments.before else 24.0)
    print(f"{'':<22}{'tip mm':>8}{'vehicle':>8}{'/ tube':>8}{'steady':>8}{'rms N':>8}{'worst':>8}"
          f"{'lost':>6}  violated")
    for row in arguments.row or ROWS:
        if (overrides := ROWS[row][arguments.before]) is not None:
            scenario = uv.load_scenario(name, [f"duration={duration}", *common, *overrides])
            print(f"{row:<22}{measured(uv.simulate(scenario))}", flush=True)


if __name__ == "__main__":
    main()
