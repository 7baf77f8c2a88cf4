"""Values of a scenario that its schema does not allow: one line with file, key, value, allowed."""

from support.laws import PAPER
from support.refusals import refusals

import uvms_drake as uv

WIDE = "limits.q_lower=null; limits.q_upper=null; limits.tip_pitch=0.8; limits.roll=0.3; " \
       "limits.pitch=0.3"
"""The joint limits of the robot itself, and a wide range of attitudes."""

test_a_value_that_no_run_can_use_is_refused_at_load = refusals("girona500_contact", {
    "seed=-1": r"seed = -1: must be zero or positive",
    "seed=1e30": r"seed = \d+: must be at most 9223372036854775807",
    "duration=0": r"duration = 0\.0: must be positive",
    "log_period=1e3": r"log_period = 1000\.0: must be at most the duration, 30 s",
    "current=[0, 0]": r"current = .*: must be 3 finite numbers",
    "start.eta=[0, 0, 0, 0, 0, 7]": r"start\.eta = .*: must be with angles within ±2π",
    "task.pose=[0, 0]": r"task\.pose = .*: must be 6 finite numbers",
    "task.force_tolerance=20": r"force_tolerance = 20\.0: must be smaller than the desired force",
    "mpc.horizon=0": r"mpc\.horizon = 0: must be at least 1",
    "mpc.solver=magic": r"mpc\.solver = 'magic': must be one of structured, clarabel",
    "certificate.tube_samples=0": r"certificate\.tube_samples = 0: must be from 10 to 1000000",
    "certificate.safety_factor=0.9": r"certificate\.safety_factor = 0\.9: must be at least 1",
    "certificate.plans=rest": r"certificate\.plans = 'rest': must be left out: drawn runs",
    "simulator.integration_scheme=euler": r"simulator\.integration_scheme = .* one of",
    "simulator.max_step_size=-1": r"simulator\.max_step_size = -1\.0: must be zero or positive",
    "simulator.start_time=1": r"simulator\.start_time = 1\.0: must be 0",
    "name=a/b": r"name = 'a/b': must be usable as the name of a folder",
    "log_period=1e-6": r"log_period = 1e-06: must be at least 3e-05 s, .* 1.2e\+02 GB of memory",
    "simulator.max_step_size=1e-7": r"max_step_size = 1e-07: must be at least .* hours",
    "mpc.time_step=1e-7": r"mpc\.time_step = 1e-07: must be at least .* hours",
    "mpc.horizon=100000": r"mpc\.horizon = 100000: must be at most 1265: one plan would take",
    "mission.steps=[!Approach {}, !Retreat {}]; contact=!KnownSurface {}":
        r"mission\.steps = .*: must be left out, without a sensed contact",
    "faults=[!LostState {}, !LostForce {}, !LostState {start: 3}]":
        r"faults\[2\] = 'LostState': must be of a kind that is not declared twice",
})

test_what_no_station_can_be_made_of_is_named = refusals("girona500_ideal", {
    "start.eta.3=0.296; limits.roll=0.299": r"^start\.eta = ",
    f"start.q.1=0.1; {WIDE}": r"^start\.eta = ",  # The tip's pitch.
    f"start.q.2=0.7295; {WIDE}": r"^start\.q = ",
    "limits.q_lower=[-0.4, 0.8995, -1, -3]": r"^start\.q = ",
    "limits.q_lower=[-0.53, -0.1, -1, -3]": r"^limits\.q_lower = ",
    "limits.q_upper=[1.4, 1.3, 0.7]": r"^limits\.q_upper = ",
    "limits.q_upper=[1.4, 1.0, 0.7, 3]": r"^task\.posture = ",
    "task.posture=[0, 1.35, 0.4, 0]": r"^task\.posture = ",
    f"task.posture=[0, 1.1, 0, 0]; {WIDE}": r"^task\.posture = ",
    "task.posture=[0, 1.1]": r"^task\.posture = ",
    "task.pose=null": r"^task\.pose = ",
    "task.pose.4=0.9": r"^task\.pose = ",
    "task.force=[-20, 0, 0, 0, 0, 0]": r"^task\.force = ",
    "task.force=[20, 5, 0, 0, 0, 0]": r"^task\.force = ",
    "task.force=[0, 0, 0, 0, 0, 0]": r"^task\.force = ",
    "task.force=[400, 0, 0, 0, 0, 0]": r"^task\.force = ",
    "task.force.0=400; limits.static_force=500": r"^limits\.u = ",
    "limits.u.4=0.14": r"^limits\.u\[4\] = ",
    "limits.tau=[1, 1, 1, 1, 1, 1, 1, 1, 1, 1]": r"^limits\.tau = ",
    "limits.tau=[1, 1, 1]": r"^limits\.tau = ",
    "limits.static_force=1.5": r"^limits\.static_force = ",
    "limits.nu1=0.03; tube.nu1=0.03": r"^limits\.nu1 = ",
    "limits.roll=0.003; tube.roll=0.004": r"^limits\.roll = ",
    f"tube.joints=0.75; {WIDE}": r"^limits\.q2 = ",
    "disturbance.weights=[1, 1, 1, 1, 1, 1]": r"^disturbance\.weights = ",
    "model=no_such_robot": r"^model = ",
    "faults=[!StuckJoint {joint: 4}]": r"^faults\[0\]\.joint = 4: must be an index from 0",
    "faults=[!LostForce {}]": r"^faults\[0\] = 'LostForce': must be left out: no part measures",
    f"{PAPER}; sensing=[!ForceSensor {{}}]; ancillary=!Transpose {{}}":
        r"^ancillary = 'transpose': must be a law that takes the measured force",
    "surface=!ShapedSurface {}": r"static_force = 45\.0: must be null, or the ShapedSurface one",
    "limits.static_force=null; surface=!ShapedSurface {geometry: !Plane {normal: [-0.6, 0, 0.8]}}":
        r"task\.force = .*: must be along a normal of the surface near the pose, which is \[0\.6,",
}, uv.make_station)

test_what_no_station_with_a_spring_can_be_made_of_is_named = refusals("girona500_bilateral", {
    "limits.static_force=25": r"^start\.eta = ",
    "task.pose=[0, 0, 0, 0, 0, 0]": r"^task\.pose = ",
    "surface.stiffness.0.1=51": r"^surface\.stiffness = ",
}, uv.make_station)

test_what_no_station_of_an_unknown_wall_can_be_made_of_is_named = refusals("girona500_contact", {
    "sensing=[]": "sensing",
    "sensing=[!ForceSensor {}, !ForceSensor {rate: 50}]":
        r"^sensing\[1\] = 'ForceSensor': must be left out: sensing\[0\] measures the force",
    "task.force.0=40.0": r"task\.force.*less than",
    "contact.force_error=12.0": r"task\.force",
    "limits.static_force=30":
        r"^limits\.static_force = 30\.?0?: must be left out \(null\) .* contact\.force limits$",
}, uv.make_station)

test_a_plant_alone_has_a_step_and_nothing_that_needs_a_station = refusals("girona500_ideal", {
    "simulator.max_step_size=0.01; disturbance=!AdversarialDisturbance {bound: 0.1}":
        r"disturbance = 'AdversarialDisturbance': must be a function of time alone",
    "simulator.max_step_size=0": r"max_step_size = 0\.0: .*uv\.with_step\(",
}, uv.make_plant)

test_a_simulation_of_its_own_has_no_plant = refusals("paper_kinematic", {
    "simulator.max_step_size=0.01": "simulation = .*: must be left out"}, uv.make_plant)

test_the_papers_spring_keeps_the_papers_angles = refusals("paper_dynamic", {
    "task.frame=[0, 0.1, 0]": r"task\.frame"}, uv.load_model)

test_a_step_that_is_too_long_is_refused = refusals("girona500_ideal", {
    "simulator={integration_scheme: runge_kutta2, use_error_control: true}":
        r"simulator\.use_error_control",
    "ancillary.k=200; ancillary.sigma=200; simulator.max_step_size=0.02":
        r"^simulator\.max_step_size = 0\.02: must be at most 0\.0055 s with runge_kutta3: the "
        r"feedback law \(ancillary\.k = 200 1/s\) has a rate of 200 1/s, and longer steps are ina",
    "model_error.joint_friction.coulomb=[0.5]; simulator.max_step_size=0.02":
        r"at most 0\.000\d+ s .* a rate of 1\.\d+e\+03",
    "surface=!ShapedSurface {friction: 0.3, creep: 0.005}; limits.static_force=null; "
    "simulator.max_step_size=0.02":
        r"must be at most 0\.00\d+ s with runge_kutta3: the friction on the end-effector and in "
        r"the joints \(surface\.friction, surface\.creep = 0\.005 m/s\) has a rate of \d+ 1/s, and",
}, uv.with_step)
