"""The paper's fit of the mesh to a photograph: 84 landmarks and Hardy's multiquadric."""

import numpy as np
import pytest

from hypermask.face.mesh import LANDMARKS, load_mesh
from hypermask.texture.fit import PAPER_LANDMARKS, hardy_fit, multiquadric, stiffness


@pytest.fixture
def face() -> np.ndarray:
    """(468, 2) pixels: the mesh's own places, turned, bent and moved as in a photograph."""
    rest = load_mesh().rest[:LANDMARKS] * 1000
    x = 300 + 2.1 * rest[:, 0] + 0.2 * rest[:, 1] + 0.003 * rest[:, 0] ** 2
    y = 400 - 2.2 * rest[:, 1] + 0.1 * rest[:, 0] - 0.002 * rest[:, 1] ** 2
    return np.column_stack([x, y])


def test_there_are_84_landmarks_on_both_sides_alike() -> None:
    assert len(PAPER_LANDMARKS) == len(set(PAPER_LANDMARKS)) == 84
    mirror = load_mesh().mirror
    assert {int(mirror[i]) for i in PAPER_LANDMARKS} == set(PAPER_LANDMARKS)


def test_the_stiffness_is_the_distance_of_the_nearest_neighbour() -> None:
    centres = np.array([[0, 0], [3, 4], [3, 5], [100, 0]], float)
    np.testing.assert_allclose(stiffness(centres), [5, 1, 1, np.hypot(97, 4)])


def test_the_multiquadric_is_hardys() -> None:
    centres = np.array([[0, 0], [2, 0]], float)
    value = multiquadric(np.array([[3.0, 4.0]]), centres)
    np.testing.assert_allclose(value, [[np.sqrt(25 + 4), np.sqrt(17 + 4)]])


def test_the_fit_equals_a_direct_solve_for_x_and_for_y(face: np.ndarray) -> None:
    rest = load_mesh().rest
    centres, wanted = rest[list(PAPER_LANDMARKS)], face[list(PAPER_LANDMARKS)]
    nearest = [
        min(np.hypot(*(a - b)) for j, b in enumerate(centres) if j != i)
        for i, a in enumerate(centres)
    ]
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    system = np.sqrt(gaps**2 + np.array(nearest)[None] ** 2)
    for axis in (0, 1):
        weights = np.linalg.solve(system, wanted[:, axis])
        for vertex in (0, 10, 50, 205, 467, 479):
            distance = np.linalg.norm(rest[vertex] - centres, axis=1)
            direct = np.sqrt(distance**2 + np.array(nearest) ** 2) @ weights
            assert hardy_fit(face)[vertex, axis] == pytest.approx(direct, abs=1e-4)


def test_the_84_are_met_and_the_others_are_near(face: np.ndarray) -> None:
    fitted = hardy_fit(face)
    chosen = list(PAPER_LANDMARKS)
    np.testing.assert_allclose(fitted[chosen], face[chosen], atol=1e-5)
    error = np.linalg.norm(fitted[:LANDMARKS] - face, axis=1)
    assert error.mean() < 1.5 and np.median(error) < 0.5
