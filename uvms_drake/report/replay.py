"""Animation of a run in one HTML file that needs no server."""

import html
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat

from uvms_drake.report.summary import summarise
from uvms_drake.station.diagram import setting_of
from uvms_drake.station.record import Record
from uvms_drake.visual.contact import KNOWN
from uvms_drake.visual.scene import Moment, Scene
from uvms_drake.visual.stage import INSTANT, open_meshcat

MOST_FRAMES = 1800
"""Largest number of pictures in a replay, of 4 kB each; the browser interpolates."""


BANNER = ('<body><div style="position: fixed; z-index: 1; left: 1em; top: 4px; max-width: 75%; '
          'font: 13px sans-serif; color: #fff; pointer-events: none">{}</div>')
"""Verdict of the run, above the bars of the picture."""


def write_replay(record: Record, path: Path, verdict: str | None = None) -> None:
    """Writes the run as an animation that plays at true speed, with its verdict.

    Args:
        record: The run.
        path: The file.
        verdict: Text of the verdict of its summary, which is made here if it is left out.
    """
    verdict = verdict or summarise(record)["verdict"]["text"]
    rate = min(record.scenario.visual.rate, MOST_FRAMES / max(float(record.time[-1]), 1e-9))
    meshcat = open_meshcat()
    scene = scene_of(record, meshcat)
    meshcat.StartRecording(frames_per_second=1.0 / INSTANT,
                           set_visualizations_while_recording=False)
    for i in frame_indices(record.time, rate):
        scene.show(moment_of(record, i), record.time[i] + 1e-6)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page = meshcat.StaticHtml().replace("<body>", BANNER.format(html.escape(verdict)), 1)
    path.write_text(page, encoding="utf-8")


def scene_of(record: Record, meshcat: Meshcat) -> Scene:
    """Returns the scene of a run."""
    return Scene(meshcat, setting_of(
        record.scenario, record.model, certified=bool(record.certified)))


def moment_of(record: Record, index: int) -> Moment:
    """Returns the picture at a sample of a record.

    A record has no plans: the path is the one that the nominal robot then took over the horizon.
    """
    mpc = record.scenario.mpc
    future = record.time[index] + mpc.time_step * np.arange(mpc.horizon + 1)
    path = np.column_stack([np.interp(future, record.time, x)
                            for x in record.chi_nominal[:, :3].T])
    return Moment(state=record.state[index], nominal_state=record.nominal_state[index],
                  u=record.u[index], nominal_input=record.nominal_input[index],
                  desired_force=record.desired_force[index], path=path,
                  force=record.force[index],
                  estimate={name: record.signals[name][index] for name in KNOWN}
                  if KNOWN.keys() <= record.signals.keys() else {},
                  retreats=not record.followed[index])


def frame_indices(time: np.ndarray, rate: float) -> np.ndarray:
    """Returns the samples of `time` (T,) [s] to show, at most `rate` in a second."""
    frames = np.floor(time * rate + 1e-9)
    return np.flatnonzero(np.diff(frames, prepend=-1.0) > 0.0)
