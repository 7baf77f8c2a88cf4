"""The measurements of `bench` as a table for a terminal."""

from collections.abc import Mapping, Sequence

from uvms_drake.studies.bench.bench import Bench
from uvms_drake.studies.bench.bench_controller import ControllerTimes, HorizonTimes, SolverTimes
from uvms_drake.studies.bench.bench_feedback import FeedbackTimes
from uvms_drake.studies.bench.bench_plant import DerivativeTimes
from uvms_drake.studies.bench.stopwatch import Timing


def format_bench(bench: Bench) -> str:
    """Returns the measurements as a table for a terminal."""
    versions, machine, simulation = bench.versions, bench.machine, bench.simulation
    load = ", ".join(f"{x:.1f}" for x in machine["load_average"] or ()) or "unknown"
    return "\n".join([
        f"{bench.scenario}: uvms_drake {versions['uvms_drake']}, Drake {versions['drake']}, "
        f"NumPy {versions['numpy']}, Python {versions['python']}",
        f"{machine['cpus']} processors, load average {load} before; this run got "
        f"{machine['cpu_share']:.0%} of one processor: compare times within a run only",
        "", *_controller_rows(bench.controller),
        "", *_derivative_rows(bench.derivative),
        *_feedback_rows(bench.feedback),
        "", f"simulation  {simulation.simulated_s:g} s in {simulation.wall_s:.2f} s, "
        f"{simulation.real_time_factor:.2f} times real time",
        "", *_solver_rows(bench.solvers),
        "", *_growth_rows(bench.growth)])


def _controller_rows(times: ControllerTimes) -> list[str]:
    counts = ", ".join(f"{count} in {steps} steps" for count, steps in times.conic_programs.items())
    return [
        *_part_rows(f"controller step, N = {times.horizon} [ms]", times.total, times.parts),
        f"  {'first plan':<32}{_numbers(times.first_plan)}",
        f"  {times.steps} steps, {times.failures} failures; conic programs: {counts}; "
        f"the first plan takes {times.first_iterations} iterations"]


def _derivative_rows(times: DerivativeTimes) -> list[str]:
    return [
        *_part_rows("derivative of the station [ms]", times.total, times.parts),
        f"  {times.evaluations} evaluations at {times.off_surface} states off the surface and "
        f"{times.on_surface} on it"]


def _feedback_rows(times: FeedbackTimes | None) -> list[str]:
    if times is None:
        return []
    head = "".join(f"{name:>9}" for name in vars(times.command))
    return ["", f"{'command of the feedback [ms]':<34}{head}",
            f"  {times.law:<32}{_numbers(times.command)}",
            f"  {'resolved, at the same states':<32}{_numbers(times.resolved)}",
            f"  {times.ratio:.2f} times as long, median over median"]


def _part_rows(title: str, total: Timing, parts: Mapping[str, Timing]) -> list[str]:
    head = "".join(f"{name:>9}" for name in (*vars(total), "share"))
    return [f"{title:<34}{head}", *(
        f"  {name:<32}{_numbers(part)}{part.mean / total.mean:>9.1%}"
        for name, part in {**parts, "total": total}.items())]


def _numbers(timing: Timing) -> str:
    return "".join(f"{value:>9.3f}" for value in vars(timing).values())


def _solver_rows(solvers: Sequence[SolverTimes]) -> list[str]:
    head = "".join(f"{name:>9}" for name in ("min", "p50", "max", "ratio"))
    title = f"controller step by solver, N = {solvers[0].horizon} [ms]"
    return [f"{title:<42}{head}{'steps':>9}", *(
        f"  {row.solver:<40}{row.step.min:>9.1f}{row.step.p50:>9.1f}{row.step.max:>9.1f}"
        f"{row.ratio:>9.1f}{row.steps:>9}" + (
            f"  {row.failures} failures" if row.failures else "") for row in solvers)]


def _growth_rows(growth: Sequence[HorizonTimes]) -> list[str]:
    head = "".join(f"{name:>9}" for name in ("min", "p50", "p95", "p50/N", "ratio"))
    return [f"{'step at other horizons [ms]':<34}{head}{'conic programs':>16}", *(
        f"  {f'N = {row.horizon}':<32}{row.step.min:>9.3f}{row.step.p50:>9.3f}{row.step.p95:>9.3f}"
        f"{row.per_interval:>9.3f}{row.ratio:>9.2f}{row.conic_programs:>16.2f}"
        + (f"  {row.failures} failures" if row.failures else "") for row in growth)]
