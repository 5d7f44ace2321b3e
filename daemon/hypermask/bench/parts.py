"""Parts measured alone: prediction, tracking, drawing, and the flips of a real-time run."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from rich.console import Console
from rich.progress import Progress

from hypermask import paths
from hypermask.bench.runs import clips, scenario
from hypermask.bench.table import Table
from hypermask.face.emotions import EMOTIONS, emotion_units
from hypermask.face.mouth import MOUTH_SHAPES
from hypermask.geometry import Pose
from hypermask.mask import Mask, load_mask
from hypermask.rehearsal.cart import true_procam
from hypermask.stage.renderer import StageRenderer
from hypermask.workers.cast import Cast
from hypermask_sim.world import World


def realtime(progress: bool) -> Table:
    """Real-time rehearsals on the reference cart, 20 s each; in the last a photograph comes."""
    from hypermask.rehearsal.realtime import play_realtime

    rows = []
    photo = paths.configs() / "characters" / "mean" / "texture.png"
    visit = f'performer.photos=[[8.0, "{photo}", "visitor"]]'
    for name, *changes in (("mean", ""), ("dots", ""), ("mean", visit)):
        of = scenario(
            "reference-cart",
            f"character={name}",
            "performer.motion=dance",
            "duration_s=20",
            *filter(None, changes),
        )
        with tempfile.TemporaryDirectory() as folder:
            report: dict[str, Any] = play_realtime(of, Path(folder), False, not progress)
        rows.append(_realtime_row(name, report))
    return Table(
        "realtime",
        "Against the real clock: 60 Hz projector, 120 Hz camera, a process a worker",
        (
            "show", "flips", "missed", "on time", "tracking p50 ms", "stage p50 ms", "lead p50 ms",
            "registration rms mm", "photo to its first light s", "missed in the 3 s after it",
        ),
        rows,
        ("Software GL; the simulated camera and projector run on the same two cores.",
         "Target: at least 99 % on time; a photograph's first light within 1 s, no flip missed."),
    )  # fmt: skip


def _realtime_row(name: str, report: dict[str, Any]) -> tuple[Any, ...]:
    compute = report["compute_ms"]
    arrival = next(iter(report["arrivals"]), None)
    swap: tuple[Any, ...] = ("", "")
    if arrival is not None:
        since = arrival["ordered_s"]
        missed = [time_s for time_s in report["missed_flips_at_s"] if 0 <= time_s - since <= 3]
        swap = (arrival["photo_to_light_s"], len(missed))
    return (
        f"reference-cart, {name}" + (", and a photograph" if arrival else ""),
        report["frames"],
        report["missed_flips"],
        f"{report['flips_on_time']:.2%}",
        compute["tracking"]["p50"],
        compute["stage"]["p50"],
        report["lead_ms"]["p50"],
        report["registration_mm"]["rms"],
        *swap,
    )


def stage(progress: bool) -> Table:
    from hypermask.stage.bench import run
    from hypermask_drivers.projector.gles import create_context

    mask = load_mask(paths.configs() / "masks" / "reference")
    result = run(create_context, mask)
    result = {"character_mean_posed_and_drawn": _character(create_context, mask)} | result
    title = "Drawing at 1280x720, software GL"
    return _times("stage", title, result, "Target: a face <= 5 ms p50.")


def _character(create_context: Callable[[], moderngl.Context], mask: Mask) -> dict[str, float]:
    """Milliseconds to pose and draw the built-in character with its mouth moving."""
    context, size = create_context(), (1280, 720)
    renderer = StageRenderer(context, size, mask)
    cast = Cast({"mean": "mean"}, mask, renderer)
    with context:
        framebuffer = context.framebuffer(
            [context.texture(size, 4)], context.depth_renderbuffer(size)
        )
    world = World(scenario("reference-cart", "performer.motion=dance"))
    projector, times = true_procam(world), []
    happiness = emotion_units()[EMOTIONS.index("happiness")]
    for frame in range(330):
        pose = Pose(*world.camera_from_mask(frame / 60))
        mouth = MOUTH_SHAPES["a"] * abs(np.sin(frame / 7))
        began = time.perf_counter()
        items = cast.items([("mean", 1.0)], happiness, mouth, frame / 60)
        renderer.draw(framebuffer, projector.projector_from_mask(pose), items, 1.0)
        with context:
            context.finish()
        times.append((time.perf_counter() - began) * 1e3)
    p50, p99 = np.percentile(times[30:], [50, 99])
    return {"p50": float(p50), "p99": float(p99)}


def tracking(progress: bool) -> Table:
    from hypermask.tracking.bench import run

    return _times(
        "tracking",
        "Tracking at 1280x800, one thread, the same frames for all",
        run(),
        "Target: locked <= 0.6 ms, searching <= 1.5 ms p50.",
    )


def _times(name: str, title: str, result: dict[str, Any], note: str) -> Table:
    rows = [
        (key.replace("_", " "), _ms(value, "p50"), _ms(value, "p99"))
        for key, value in result.items()
        if isinstance(value, dict)
    ]
    return Table(name, title, ("what", "p50 ms", "p99 ms"), rows, (note,), data={"raw": result})


def _ms(value: dict[str, Any], quantile: str) -> float:
    found = value[f"{quantile}_ms"] if f"{quantile}_ms" in value else value[quantile]
    return float(found)


def prediction(progress: bool) -> Table:
    """Every clip predicted by models fitted on other clips (5 folds), measurement noise added."""
    from hypermask.tracking import motion_bench

    with Progress(console=Console(stderr=True), disable=not progress) as bar:
        task = bar.add_task("prediction", total=1.0)
        result = motion_bench.run(
            clips()[0].parent, progress=lambda done: bar.update(task, completed=done)
        )
    rows = []
    for condition in result["conditions"]:
        for lead in condition["leads"]:
            modes = lead["modes"]
            medians = [modes[name]["median_mm"] for name in ("off", "kalman", "default")]
            name = f"{condition['name']}, {lead['lead_ms']:.0f} ms"
            rows.append((name, *medians, modes["default"]["ratio"]))
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "plot.png"
        motion_bench.plot(result, picture)
        drawn = picture.read_bytes()
    return Table(
        "prediction",
        "Prediction alone, clips left out of the training: median rms over the mask, mm",
        ("cart, lead", "off", "Kalman", "default", "default / off"),
        rows,
        ("Perpendicular to the line of sight, at 1.8 m; the models are fitted on other clips.",),
        plot=drawn,
        data={"raw": result},
    )
