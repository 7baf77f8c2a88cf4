"""Times of `step` in a free-running loop of real time: worst, p99, delayed plans, memory.

No tick is left out: after a step that has taken long the next ones come as fast as they can.

Run `python examples/your_loop/real_time.py --rate 50 --minutes 10` on a machine that is idle.
"""

import argparse
import resource
import time

import numpy as np

import uvms_drake as uv


def main() -> None:
    """Runs the loop, with the nominal motion for measurements, and prints the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="girona500_tip_first")
    parser.add_argument("--rate", type=float, default=50.0, help="[Hz]")
    parser.add_argument("--minutes", type=float, default=10.0, help="of real time")
    parser.add_argument("--wait", type=float, default=0.002, help="longest wait for a plan [s]")
    parser.add_argument("--set", nargs="*", default=[], help="overrides of the scenario")
    arguments = parser.parse_args()
    period = 1.0 / arguments.rate
    scenario = uv.load_scenario(arguments.scenario, [
        "mpc.in_advance=true", f"contact.period={max(period, 0.01)}", *arguments.set])
    controller = uv.Controller(scenario, period=period, wait=arguments.wait)
    state, rng = np.append(scenario.start.config, np.zeros(controller.model.size)), (
        np.random.default_rng(0))
    controller.reset(state)
    took, used, overdue, plans, delayed, memory = [], [], [], 0, 0, []
    start, sample = time.perf_counter(), None
    for tick in range(round(60.0 * arguments.minutes / period)):
        while (ahead := start + tick * period - time.perf_counter()) > 0.0:
            time.sleep(ahead)
        began, processor = time.perf_counter(), time.process_time()
        command = controller.step(began - start, state, 0.1 * rng.standard_normal(6))
        took.append(time.perf_counter() - began)
        used.append(time.process_time() - processor)
        overdue.append(began - start - tick * period)
        state = controller.signal("nominal_state").copy()
        if (now := controller.signal("report")[0]) != sample:
            sample, plans = now, plans + 1
            delayed += any("deadline" in alarm for alarm in command.alarms)
        if tick % round(10.0 / period) == 0:
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    ms = 1e3 * np.array(took)
    print(f"{arguments.rate:g} Hz, {len(ms)} ticks: step {np.median(ms):.1f} ms, p99 "
          f"{np.percentile(ms, 99):.1f} ms, worst {np.max(ms):.1f} ms")
    print(f"tick after its time by {1e3 * np.percentile(overdue, 99):.1f} ms (p99), "
          f"{1e3 * np.max(overdue):.1f} ms at most, at {np.argmax(overdue) * period:.0f} s; "
          f"{np.sum(np.array(overdue) > 0.5 * period)} ticks by more than half a period")
    print(f"of the processor: step {1e3 * np.median(used):.1f} ms, p99 "
          f"{1e3 * np.percentile(used, 99):.1f} ms, worst {1e3 * np.max(used):.1f} ms")
    print(f"plans: {plans}, delayed {delayed}; memory {memory[0]:.0f} MB, then "
          f"{memory[-1]:.0f} MB; at the end: {command.mode}")


if __name__ == "__main__":
    main()
