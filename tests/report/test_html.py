"""Tests of `uvms_drake.report.html`."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.probability import made
from support.synthetic import synthetic_record

from uvms_drake.certificate.certificate import (
    Certificate,
    probability_fingerprint,
    write_certificate,
)
from uvms_drake.certificate.run_verdict import BROKEN, verdict_of
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.control.feedback.tube_monitor import TUBE_REPORT
from uvms_drake.report.figures import make_figures
from uvms_drake.report.html import format_report, load_run
from uvms_drake.report.summary import EVENT_LINES, summarise
from uvms_drake.station.record import save_record
from uvms_drake.tube.conditions import Condition

HOLDS = Condition("tube in limits.nu1", 0.1, "<", 0.3, theorem="t", kind="tightening", about="nu1")


def certificate(record, **changes):
    return replace(Certificate(
        scenario=record.scenario.name, law="resolved", k=20.0, sigma=5.0, d_bound=0.1, files={},
        inputs="", versions={}, conditions=(HOLDS,), tube=record.scenario.tube,
        bounds={"force": 2.64}), **changes)


@pytest.fixture(scope="module")
def record():
    return synthetic_record(4.0)


def test_it_is_one_file_with_figures_in_it_that_loads_nothing(record, tmp_path):
    text = format_report(record, make_figures(record, tmp_path), None)
    assert text.startswith("<!DOCTYPE html>")
    assert text.count('src="data:image/png;base64,') == 9
    assert text.index('alt="The robot at the end') < text.index("<h2>Summary</h2>")
    assert not re.search(r'(src|href)="(?!data:)|url\(|@import', text)


def test_it_says_what_it_is_about_what_is_certified_and_how_to_run_it_again(record):
    text, certified = (format_report(record, [], each) for each in (None, certificate(record)))
    for part in ("girona500_ideal", "stiffness: 1000.0", "Run without a certificate",
                 "uvms-drake run scenario.yaml --uncertified"):
        assert part in text and (part not in certified) == ("certif" in part), part
    for part in ("certified: all 1 conditions hold", "± 2.64 N", "tube in limits.nu1"):
        assert part in certified, part


def test_all_events_are_listed_however_many(record):
    status = np.arange(len(record.mpc_status)) % 4.0
    text = format_report(replace(record, mpc_status=status), [], None)
    assert "2.02 s to the end   contact, " in text
    assert np.count_nonzero(status) > EVENT_LINES
    assert text.count("the solver failed") == np.count_nonzero(status == 1.0)
    assert "the solver failed" not in format_report(record, [], None)


def test_what_the_scenario_says_cannot_become_html(record):
    scenario = replace(record.scenario, description="<script>alert(1)</script>")
    text = format_report(replace(record, scenario=scenario), [], None)
    assert "<script" not in text
    assert "&lt;script&gt;" in text


def test_a_run_is_loaded_with_its_certificate(record, tmp_path):
    certified = replace(record, certified=np.array(True))
    save_record(record, tmp_path)
    (tmp_path / "certificate.json").write_text("another one's", encoding="utf-8")
    assert load_run(tmp_path)[1] is None
    (tmp_path / "certificate.json").unlink()
    save_record(certified, tmp_path)
    with pytest.raises(InvalidParameter, match=r"its certificate[.]json is missing"):
        load_run(tmp_path)
    write_certificate(certificate(record), tmp_path)
    assert load_run(tmp_path)[1].conditions == (HOLDS,)
    other = replace(record.scenario.tube, nu1=0.02)
    write_certificate(certificate(record, tube=other), tmp_path)
    with pytest.raises(InvalidParameter, match="made for another run"):
        load_run(tmp_path)
    (tmp_path / "certificate.json").write_text("{}", encoding="utf-8")
    with pytest.raises(RunFailed, match="SHA-256"):
        load_run(tmp_path)


@pytest.mark.parametrize(("name", "content", "message"), [
    ("log.npz", None, r"\(log.npz: No such file or directory\)"),
    ("log.npz", b"junk", r"\(its log.npz .* is damaged\)"),
    ("log.npz", "older", r"acceleration is not a file in the archive"),
    ("timing.npz", None, r"\(timing.npz: No such"),
    ("scenario.yaml", None, r"\(.*scenario.yaml"),
    ("scenario.yaml", b"seed: x", r"\(seed = 'x': .*scenario.yaml")])
def test_a_folder_that_is_no_run_is_refused_in_a_line(record, tmp_path, name, content, message):
    save_record(record, tmp_path)
    with np.load(tmp_path / "log.npz") as log:
        older = {name: log[name] for name in log.files if name != "acceleration"}
    (tmp_path / name).unlink()
    if content == "older":
        np.savez(tmp_path / name, **older)
    elif content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidParameter, match=message) as caught:
        load_run(tmp_path)
    assert "\n" not in str(caught.value)


def test_the_verdict_is_that_of_the_run_and_comes_before_what_its_certificate_says(record):
    certified = replace(record, certified=np.array(True))
    left = replace(certified, tube_report=np.where(
        np.array(TUBE_REPORT) == "set_exits", 2.0, record.tube_report))
    cut = replace(certified, tau=np.where(np.arange(10) == 7, 71.0, record.tau))  # Of 70 N m.
    for run, verdict, kind in ((certified, "all guarantees kept", ""),
                               (cut, "NO GUARANTEE: a motor cut the torque of a joint, which the "
                                "certificate assumes not to be asked for", " no"),
                               (left, "GUARANTEES BROKEN: the tube, set-wise", " no")):
        text = format_report(run, [], certificate(record))
        assert f'<p class="verdict{kind}">{verdict[0].upper()}{verdict[1:]}.' in text
        assert (".<br>Largest force " in text) == (run is certified)
        assert text.index(f"Of this run: {verdict}. ") < text.index("certified: all 1 conditions")


def test_the_verdict_in_probability_has_the_runs_own_failures(record):
    summary = summarise(record, made())
    also = {**summary, "verdict": verdict_of(summary, ["it lost the contact"])}
    assert also["verdict"]["status"] == BROKEN
    assert '"verdict no">This run FAILED: it lost the contact; certified in prob' in format_report(
        record, [], made(), also)
    assert "This run did not fail: tube and all limits kept; certified in prob" in format_report(
        record, [], made())


def test_a_run_that_ended_early_keeps_its_certificate_in_probability(tmp_path):
    """As a mission that is done: its record is of a shorter duration than was declared."""
    whole = synthetic_record(4.0)
    mine = replace(made(), inputs=probability_fingerprint(whole.scenario)["inputs"])
    short = replace(whole, scenario=replace(whole.scenario, duration=3.0))
    for name, run, fits in (("whole", whole, True), ("short", short, False), (
            "early", replace(short, declared_duration=np.array(4.0)), True)):
        (tmp_path / name).mkdir()
        run.save(tmp_path / name)
        write_certificate(mine, tmp_path / name)
        assert (load_run(tmp_path / name)[1] is not None) == fits, name
