"""Moving pictures of simulations."""

from pathlib import Path

import numpy as np
import pytest
from library_bench import joined
from matplotlib.animation import writers
from PIL import Image

from cartpend_dae import ModelError, assemble, simulate
from cartpend_dae.animate import ROD, _shapes, animate
from cartpend_dae.library import planar
from cartpend_dae.library.rotational import Inertia
from cartpend_dae.library.translational import Fixed, Mass, Spring
from cartpend_dae.study import load_model, model_reference


def swing():
    left, spring, body = Fixed(), Spring(c=100.0, s_rel0=0.5), Mass(m=1.0)
    ends = (left.flange, spring.flange_a), (spring.flange_b, body.flange_a)
    return assemble(joined(*ends, left=left, spring=spring, body=body))


def test_a_film_has_a_picture_for_each_instant(tmp_path):
    system = swing()
    film = animate(system, simulate(system, 1.0, start={"body.s": 0.6}), tmp_path / "swing.gif", frames_per_second=10)
    with Image.open(film) as picture:
        assert picture.n_frames == 11  # type: ignore[attr-defined]


def test_a_spring_reaches_from_its_wall_to_its_body():
    system = swing()
    trajectory = simulate(system, 1.0, start={"body.s": 0.6}, points=5)
    shapes = list(_shapes(system, set(trajectory.names), lambda name: trajectory[name]))
    spring = next(shape for shape in shapes if shape.x.shape[1] > 2)
    np.testing.assert_allclose(spring.x[:, 0], 0.0)
    np.testing.assert_allclose(spring.x[:, -1], trajectory["body.s"])


def double_pendulum():
    """A bar on a hinge, a body on a second hinge, and a spring from the bar to a held point."""
    parts = {
        "world": planar.World(),
        "shoulder": planar.Revolute(),
        "arm": planar.BodyShape(m=1.0, r_x=0.5, r_CM_x=0.25),
        "elbow": planar.Revolute(),
        "hand": planar.Body(m=1.0, r_CM_x=0.3),
        "wall": planar.Fixed(r_x=1.0, r_y=0.2),
        "spring": planar.Spring(c=5.0, s_unstretched=0.5),
    }
    ends = [
        ("world.frame_b", "shoulder.frame_a"),
        ("shoulder.frame_b", "arm.frame_a"),
        ("arm.frame_b", "elbow.frame_a"),
    ]
    ends += [("elbow.frame_b", "hand.frame_a"), ("wall.frame_b", "spring.frame_a"), ("spring.frame_b", "arm.frame_b")]
    pairs = [tuple(getattr(parts[end.split(".")[0]], end.split(".")[1]) for end in pair) for pair in ends]
    return assemble(joined(*pairs, **parts))


def test_bodies_hinges_and_springs_of_the_plane_hang_together():
    system = double_pendulum()
    run = simulate(system, 1.0, points=21)
    shapes = list(_shapes(system, set(run.names), lambda name: run[name]))
    rods = [shape for shape in shapes if shape.color == ROD]
    assert len(rods) == 2
    # the second begins where the first ends, and neither changes its length
    np.testing.assert_allclose(rods[0].x[:, 1], rods[1].x[:, 0], atol=1e-9)
    np.testing.assert_allclose(rods[0].y[:, 1], rods[1].y[:, 0], atol=1e-9)
    for rod, length in zip(rods, (0.5, 0.3), strict=True):
        np.testing.assert_allclose(np.hypot(np.diff(rod.x), np.diff(rod.y)), length, atol=1e-6)
    (spring,) = (shape for shape in shapes if shape.x.shape[1] > 2)
    np.testing.assert_allclose(spring.x[:, 0], 1.0)
    np.testing.assert_allclose(spring.y[:, 0], 0.2)
    np.testing.assert_allclose(spring.x[:, -1], rods[0].x[:, 1], atol=1e-9)
    assert sum(shape.marker == "o" for shape in shapes) == 2 and [s.marker for s in shapes].count(".") == 2


def test_a_rod_on_a_shaft_hangs_where_its_angle_is_zero():
    system = assemble(load_model(model_reference(str(Path(__file__).parent.parent / "models" / "rota_damp.py"))))
    run = simulate(system, 1.0, points=5)
    (rod,) = _shapes(system, set(run.names), lambda name: run[name])
    np.testing.assert_allclose(rod.x[:, 1], 0.86 * np.sin(run["rod.phi"]))
    np.testing.assert_allclose(rod.y[:, 1], -0.86 * np.cos(run["rod.phi"]))


def test_what_cannot_be_drawn_or_written_is_said(tmp_path):
    system = assemble(joined(body=Inertia(J=1.0)))
    with pytest.raises(ModelError, match="has nothing to draw"):
        animate(system, simulate(system, 1.0), tmp_path / "film.gif")
    with pytest.raises(ModelError, match=r"is a `\.gif` or an `\.mp4`, not `film\.avi`"):
        animate(system, simulate(system, 1.0), tmp_path / "film.avi")
    if not writers.is_available("ffmpeg"):
        with pytest.raises(ModelError, match="needs the program ffmpeg"):
            animate(system, simulate(system, 1.0), tmp_path / "film.mp4")
