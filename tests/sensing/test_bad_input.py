"""Bad input of the parts of the loop, of faults, unknowns, laws and missions: one line each."""

from support.refusals import refusals

test_a_part_a_fault_or_an_unknown_without_meaning_is_named = refusals("girona500_contact", {
    "sensing.0.rate=0.0": r"sensing\[0\].rate = 0.0: must be positive",
    "sensing.0.tare=0.001": r"sensing\[0\].tare = 0.001: must be 0, or at least one sample long",
    "sensing.0.tool.error=2.0": r"sensing\[0\].tool.error = 2.0: must be from -1 to 1",
    "sensing=[!Navigation {dvl: {gap: 0.01}}]": r"sensing\[0\].dvl.gap = 0.01: must be from one",
    "sensing=[!Navigation {position: {latency: 9.0}}]": r"position.latency = 9.0: must be from 0",
    "actuation=[!SampledCommand {period: 0.0}]": r"actuation\[0\].period = 0.0: must be at least",
    "actuation=[!SampledCommand {period: 0.02, delay: 2.1}]": "delay = 2.1: must be from 0 to 100",
    "actuation=[!Thrusters {dead_time: 0.012}]": "dead_time = 0.012: must be a multiple of the per",
    "actuation=[!Thrusters {error: [0.1, -1.1]}]": "error = .*: must be numbers from -1 to 1",
    "actuation=[!IdealWrench {undriven: [rol]}]": "= .rol.: must be one of surge, sway, heave",
    "actuation=[!IdealWrench {}, !SampledCommand {}]": r"actuation\[\d\]",
    "actuation=[!Thrusters {}, !IdealWrench {}]": r"actuation\[\d\]",
    "faults=[!ExcessDisturbance {factor: 1.0}]": r"faults\[0\].factor = 1.0: must be above 1",
    "waves=[{amplitude: 9.0}]": r"waves\[0\].amplitude = 9.0: must be from 0 to 2.5 m: lower than",
    "model_error.joint_friction={coulomb: [-1]}": "coulomb = .*: must be from 0 to 10000 N m",
    "ancillary=!TipFirst {undriven: [surge]}": r"undriven.0. = .surge.: must be one of roll, pitch",
})

test_an_error_of_a_surface_that_none_has_is_named = refusals("girona500_ideal", {
    "surface_error.stiffness=0.001": "surface_error.stiffness = 0.001: must be from 0.01",
    "surface_error.turn=[0, 0, 4]": "surface_error.turn = .*: must be a rotation of at most π"})

STEPS = "mission.steps="
test_a_mission_that_makes_no_sense_is_refused = refusals("girona500_inspection", {
    STEPS + "[!Hold {}, !Retreat {}]": r"steps\[0\] = 'Hold': must be an !Approach",
    STEPS + "[!Approach {}, !Approach {}, !Retreat {}]": r"steps\[1\] = .*: must be !Hold",
    STEPS + "[!Approach {}, !Hold {}]": r"steps\[1\] = 'Hold': must be a !Retreat, as the last",
    STEPS + "[!Approach {timeout: -1.0}, !Retreat {}]": r"\[0\].timeout = -1.0: must be positive",
    STEPS + "[!Approach {on_failure: hope}, !Retreat {}]": "on_failure = 'hope': must be one of",
    STEPS + "[!Approach {}, !Slide {speed: 0.001}, !Retreat {}]": "more than the 200 s that it",
    STEPS + "[!Approach {}, !Slide {along: [0, 0]}, !Retreat {}]": r"steps\[1\].along = .*: must",
    STEPS + "[!Approach {}, !Slide {amplitude: 11.0}, !Retreat {}]": "less than the force, 10 N",
    "mission.retries=-1": "mission.retries = -1: must be from 0 to 100"})
