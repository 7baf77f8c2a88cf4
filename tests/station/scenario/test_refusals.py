"""Values of a scenario that its schema does not allow: one line with file, key, value, allowed."""

from support.refusals import refusals

test_a_value_that_no_run_can_use_is_refused_at_load = refusals("girona500_contact", {
    "seed=-1": r"seed = -1: must be zero or positive",
    "seed=1e30": r"seed = \d+: must be at most 9223372036854775807",
    "duration=0": r"duration = 0\.0: must be positive",
    "log_period=1e3": r"log_period = 1000\.0: must be at most the duration, 30 s",
    "current=[0, 0]": r"current = .*: must be 3 finite numbers",
    "start.eta=[0, 0, 0, 0, 0, 7]": r"start\.eta = .*: must be with angles within ±2π",
    "task.pose=[0, 0]": r"task\.pose = .*: must be 6 finite numbers",
    "task.force_tolerance=0": r"task\.force_tolerance = 0\.0: must be positive",
    "task.force_tolerance=20": r"force_tolerance = 20\.0: must be smaller than the desired force",
    "mpc.horizon=0": r"mpc\.horizon = 0: must be at least 1",
    "mpc.time_step=0": r"mpc\.time_step = 0\.0: must be positive",
    "mpc.iterations=0": r"mpc\.iterations = 0: must be at least 1",
    "mpc.solver=magic": r"mpc\.solver = 'magic': must be one of structured, clarabel",
    "mpc.terminal_radius=0": r"mpc\.terminal_radius = 0\.0: must be positive",
    "mpc.initial_state=old": r"mpc\.initial_state = 'old': must be one of nominal, measured",
    "mpc.hover=-1": r"mpc\.hover = -1\.0: must be zero or positive",
    "mpc.deadline=0": r"mpc\.deadline = 0\.0: must be positive",
    "certificate.tube_samples=0": r"certificate\.tube_samples = 0: must be from 10 to 1000000",
    "certificate.safety_factor=0.9": r"certificate\.safety_factor = 0\.9: must be at least 1",
    "certificate.seed=-1": r"certificate\.seed = -1: must be zero or positive",
    "certificate.plans=rest": r"certificate\.plans = 'rest': must be left out: drawn runs",
    "simulator.integration_scheme=euler": r"simulator\.integration_scheme = .* one of",
    "simulator.max_step_size=-1": r"simulator\.max_step_size = -1\.0: must be zero or positive",
    "simulator.accuracy=0": r"simulator\.accuracy = 0\.0: must be positive",
    "simulator.start_time=1": r"simulator\.start_time = 1\.0: must be 0",
    "name=a/b": r"name = 'a/b': must be usable as the name of a folder",
    "log_period=1e-6": r"log_period = 1e-06: must be at least 3e-05 s, .* 1.2e\+02 GB of memory",
    "simulator.max_step_size=1e-7": r"max_step_size = 1e-07: must be at least .* hours",
    "mpc.time_step=1e-7": r"mpc\.time_step = 1e-07: must be at least .* hours",
    "mpc.horizon=100000": r"mpc\.horizon = 100000: must be at most 1265: one plan would take",
    "mission.steps=[!Approach {}, !Retreat {}]; contact=!KnownSurface {}":
        r"mission\.steps = .*: must be left out, without a sensed contact",
})
