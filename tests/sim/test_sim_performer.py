"""Motion clips and built-in paths."""

from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hypermask_drivers.errors import HypermaskError
from hypermask_sim.performer import BUILT_IN, COLUMNS, find_motion, load_clip
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World

CLIPS = sorted((Path(__file__).parents[2].parent / "shared" / "data" / "motion").glob("*.csv"))
HEADER = ",".join(COLUMNS)
RAY = np.array([0.0, 0.1875, -1.0])


def clip_text(rows: int = 40, rate_hz: float = 120.0) -> str:
    t = np.arange(rows) / rate_hz
    angle = 0.3 * np.sin(2 * np.pi * t)
    columns = [t, 0.1 * np.sin(9 * t), 0 * t, 0.05 * np.cos(7 * t), np.cos(angle / 2)]
    columns += [0 * t, np.sin(angle / 2), 0 * t]
    lines = [",".join(f"{value:.5f}" for value in row) for row in np.stack(columns, 1)]
    return "\n".join([HEADER, *lines, ""])


def written(folder: Path, text: str) -> Path:
    path = folder / "clip.csv"
    path.write_text(text, "utf-8")
    return path


def test_between_samples_the_truth_is_smooth(tmp_path: Path) -> None:
    """Every second sample left out and interpolated comes back to within a tenth of a mm."""
    lines = clip_text(81).splitlines()
    clip = load_clip(written(tmp_path, "\n".join(lines[:1] + lines[1::2])))
    t = np.arange(80) / 120
    rotations, positions = clip.at(t)
    assert positions[:, 0] == pytest.approx(0.1 * np.sin(9 * t), abs=1e-4)
    yaw = np.arctan2(rotations[:, 0, 2], rotations[:, 2, 2])
    assert yaw == pytest.approx(0.3 * np.sin(2 * np.pi * t), abs=1e-3)
    assert np.linalg.det(rotations) == pytest.approx(1)


def test_samples_are_met_and_both_ends_hold(tmp_path: Path) -> None:
    clip = load_clip(written(tmp_path, clip_text()))
    _, positions = clip.at(clip.times)
    assert positions == pytest.approx(clip.rows[:, :3], abs=1e-12)
    _, outside = clip.at(np.array([-5.0, 100.0]))
    assert outside == pytest.approx(clip.rows[[0, -1], :3])


def test_q_and_minus_q_are_the_same_turn(tmp_path: Path) -> None:
    lines = clip_text().splitlines()
    for number in range(10, 20):
        values = lines[number].split(",")
        lines[number] = ",".join(values[:4] + [str(-float(v)) for v in values[4:]])
    turned = load_clip(written(tmp_path, "\n".join(lines)))
    plain = load_clip(written(tmp_path, clip_text()))
    t = np.linspace(0, 0.3, 100)
    assert turned.at(t)[0] == pytest.approx(plain.at(t)[0], abs=1e-9)


def test_an_absent_clip_is_named() -> None:
    with pytest.raises(HypermaskError, match=r"MOTION-ABSENT: .*gone\.csv"):
        find_motion(("gone.csv",), 1.0, RAY, 1.8)


@pytest.mark.parametrize(
    ("line", "text", "why"),
    [
        (1, "t,x,y,z", "header"),
        (5, "0.02500,0.1,0.0", "3 values instead of 8"),
        (5, "0.02500,0.1,0.0,0.0,1.0,0.0,0.0,zero", "not a number"),
        (5, "0.02500,nan,0.0,0.0,1.0,0.0,0.0,0.0", "not finite"),
        (5, "0.02500,inf,0.0,0.0,1.0,0.0,0.0,0.0", "not finite"),
        (5, "0.00100,0.0,0.0,0.0,1.0,0.0,0.0,0.0", "does not increase"),
        (41, "9.00000,0.0,0.0,0.0,1.0,0.0,0.0,0.0", "gap"),
        (5, "0.02500,0.0,0.0,0.0,0.9,0.0,0.0,0.0", "length is not 1"),
        (5, "0.02500,0.0,0.0,0.0,0.0,0.0,0.0,0.0", "length is not 1"),
        (5, "0.02500,1e9,0.0,0.0,1.0,0.0,0.0,0.0", "over 5 m"),
        (5, "0.02500,2.0,0.0,0.0,1.0,0.0,0.0,0.0", "faster than"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, line: int, text: str, why: str) -> None:
    lines = clip_text().splitlines()
    lines[line - 1] = text
    with pytest.raises(HypermaskError) as caught:
        load_clip(written(tmp_path, "\n".join(lines)))
    assert caught.value.code == "MOTION-FORMAT"
    assert f"line {line}: " in str(caught.value) and why in str(caught.value)
    assert caught.value.exit_code == 1


def test_a_nearly_unit_quaternion_is_normalised(tmp_path: Path) -> None:
    lines = clip_text().splitlines()
    lines[4] = lines[4].replace("0.99", "1.00", 1)
    rotations, _ = load_clip(written(tmp_path, "\n".join(lines))).at(np.array([0.025]))
    assert rotations[0] @ rotations[0].T == pytest.approx(np.eye(3), abs=1e-9)


@given(st.integers(0, 2000), st.binary(max_size=12), st.integers(0, 12))
def test_a_garbled_clip_is_read_or_refused(place: int, junk: bytes, cut: int) -> None:
    """Never a traceback: bytes overwritten anywhere, or the file cut short."""
    data = clip_text().encode()
    garbled = data[:place] + junk + data[place + cut :]
    with NamedTemporaryFile(suffix=".csv") as file:
        file.write(garbled)
        file.flush()
        try:
            rotations, positions = load_clip(Path(file.name)).at(np.linspace(0, 1, 50))
        except HypermaskError as error:
            assert error.code == "MOTION-FORMAT"
            return
    assert np.isfinite(rotations).all() and np.abs(positions).max() < 10


@pytest.mark.skipif(not CLIPS, reason="no ../shared/data/motion")
@pytest.mark.parametrize("path", CLIPS, ids=lambda path: path.stem)
def test_real_clips_are_read(path: Path) -> None:
    clip = load_clip(path)
    assert clip.duration_s is not None and clip.duration_s > 4
    rotations, _ = clip.at(np.linspace(0, clip.duration_s, 500))
    pitch = np.degrees(np.arcsin(-rotations[:, 1, 2]))
    yaw = np.degrees(np.arctan2(rotations[:, 0, 2], rotations[:, 2, 2]))
    # The clips are limited to 20 and 30 degrees in another order of turns.
    assert np.abs(pitch).max() < 23 and np.abs(yaw).max() < 35


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_paths_stay_in_both_pictures(name: str) -> None:
    """The mask's whole outline, at any time, is in the camera's and the projector's picture."""
    world = World(Scenario().with_changes([f"performer.motion={name}"]))
    outline = world.mask.settings.outline
    x, y = outline.half_width_m, outline.half_height_m
    rim = np.array([[x, y * 0.6, 0], [x * 0.7, y, 0], [x, -y * 0.6, 0], [x * 0.7, -y, 0]])
    rim = np.concatenate([rim, rim * [-1, 1, 1]])
    rotations, positions = world.camera_from_masks(np.linspace(0, 40, 2000))
    points = rim @ rotations.transpose(0, 2, 1) + positions[:, None]
    for view in (world.camera, world.projector):
        pixels = view.project(points)
        assert np.all(pixels > -0.5) and np.all(pixels < np.array(view.size) - 0.5)


def test_the_mask_may_move_20_cm_to_each_side_and_stays_in_both_pictures() -> None:
    world = World(Scenario())
    outline = world.mask.settings.outline
    rim = np.array([[outline.half_width_m, 0, 0], [0, outline.half_height_m, 0]])
    rim = np.concatenate([rim, -rim])
    rotation, rest = world.camera_from_mask(0.0)
    for offset in np.array([[0.2, 0, 0], [-0.2, 0, 0], [0, 0.2, 0], [0, -0.2, 0]]):
        points = rim @ rotation.T + rest + offset
        for view in (world.camera, world.projector):
            pixels = view.project(points)
            assert np.all(pixels > -0.5) and np.all(pixels < np.array(view.size) - 0.5)


def test_sweep_covers_the_working_range() -> None:
    world = World(Scenario().with_changes(["performer.motion=sweep"]))
    rotations, positions = world.motion.at(np.linspace(0, world.duration_s, 4000))
    roll = np.degrees(np.unwrap(np.arctan2(rotations[:, 1, 0], rotations[:, 1, 1])))
    pitch = np.degrees(np.arcsin(-rotations[:, 1, 2]))
    yaw = np.degrees(np.arctan2(rotations[:, 0, 2], rotations[:, 2, 2]))
    assert np.ptp(roll) >= 360
    assert (pitch.min(), pitch.max()) == pytest.approx((-20, 20), abs=0.1)
    assert (yaw.min(), yaw.max()) == pytest.approx((-30, 30), abs=0.1)
    depth = world.rest[2] - positions[:, 2]
    assert (depth.min(), depth.max()) == pytest.approx((1.2, 2.4), abs=1e-3)


def test_speed_makes_a_built_in_path_faster() -> None:
    slow = find_motion(("sway",), 1.0, RAY, 1.8)
    fast = find_motion(("sway",), 2.0, RAY, 1.8)
    assert fast.at(np.array([0.3]))[1] == pytest.approx(slow.at(np.array([0.6]))[1])


def test_a_clip_cut_in_the_middle_of_its_last_number_is_refused(tmp_path: Path) -> None:
    whole = clip_text().rstrip("\n")
    load_clip(written(tmp_path, whole))
    with pytest.raises(HypermaskError, match=r"MOTION-FORMAT: .*in the middle of a number"):
        load_clip(written(tmp_path, whole[:-2]))
