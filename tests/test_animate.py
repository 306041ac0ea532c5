"""Moving pictures of simulations."""

import numpy as np
import pytest
from library_bench import joined
from matplotlib.animation import writers
from PIL import Image

from cartpend_dae import ModelError, assemble, simulate
from cartpend_dae.animate import _shapes, animate
from cartpend_dae.library.rotational import Inertia
from cartpend_dae.library.translational import Fixed, Mass, Spring


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


def test_what_cannot_be_drawn_or_written_is_said(tmp_path):
    system = assemble(joined(body=Inertia(J=1.0)))
    with pytest.raises(ModelError, match="has nothing to draw"):
        animate(system, simulate(system, 1.0), tmp_path / "film.gif")
    with pytest.raises(ModelError, match=r"is a `\.gif` or an `\.mp4`, not `film\.avi`"):
        animate(system, simulate(system, 1.0), tmp_path / "film.avi")
    if not writers.is_available("ffmpeg"):
        with pytest.raises(ModelError, match="needs the program ffmpeg"):
            animate(system, simulate(system, 1.0), tmp_path / "film.mp4")
