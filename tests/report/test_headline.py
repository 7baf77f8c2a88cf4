"""The sentence at the top of a summary."""

from dataclasses import replace

import numpy as np
from support.synthetic import desiring, synthetic_record

from uvms_drake.report.summary import format_summary, headline, summarise


def test_the_normal_error_leads_and_the_tangential_one_is_told_apart():
    """20 N along x with 3 N and 4 N across it: the force is right, though 5 N off in norm."""
    record = synthetic_record()
    force = record.force.copy()
    force[:, 1:3] = [3.0, 4.0]
    force[:, 0] = np.where(record.time > 4.0, 20.25, force[:, 0])
    summary = summarise(replace(record, force=force))
    assert summary["force"]["final_error_tangential"] == 5.0
    assert abs(summary["force"]["final_error_normal"]) == 0.25
    assert "normal force off by 0.25 N at the end" in headline(summary)
    lines = [line.strip() for line in format_summary(summary).splitlines()]
    normal = lines.index("normal error 0.25 N at the end, at most 0.25 N in the last 5 s")
    assert lines[normal + 1] == "tangential error 5 N at the end, at most 5 N in the last 5 s"


def test_it_says_force_settling_largest_force_tube_and_limits():
    record = synthetic_record()
    summary = summarise(record)
    largest = np.max(np.linalg.norm(record.force[:, :3], axis=1))
    assert headline(summary) == (
        f"girona500_ideal: 20 N held within 2 N from {summary['force']['settling_time_s']:.2f} s "
        f"on, normal force off by {abs(20.0 - record.force[-1, 0]):.2g} N at the end; at most "
        f"{largest:.3g} N in contact; 40 % of the declared tube (not certified) used; "
        "all limits kept.")
    assert format_summary(summary).splitlines()[0] == headline(summary)
    certified = summarise(replace(record, certified=np.array(True)))
    assert "; 40 % of the certified tube used; " in headline(certified)


def test_a_violated_limit_and_a_surface_that_was_never_touched_are_in_it():
    record = synthetic_record()
    u = record.u.copy()
    u[0, 0] = 9.0
    nowhere = replace(record, u=u, force=np.zeros_like(record.force),
                      penetration=np.zeros_like(record.penetration))
    text = headline(summarise(nowhere))
    assert "20 N desired, the surface was never touched; " in text
    assert text.endswith("VIOLATED: u_surge.")


def test_without_a_force_the_pose_counts():
    record = desiring([0] * 6, synthetic_record())
    chi = record.chi.copy()
    chi[-1] = record.chi_des + [3e-3, 0.0, 4e-3, 1e-3, 0.0, 0.0]
    text = headline(summarise(replace(record, chi=chi)))
    assert "no force desired, end-effector off by 5 mm and 1 mrad at the end" in text
