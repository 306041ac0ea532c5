"""Inertia that was forgotten or is not rigid."""

from cartpend_dae.effects.card import Card, R, T, level, shape
from cartpend_dae.library import rotational_loads, translational_loads


def inertial_cards() -> tuple[Card, ...]:
    """Return the cards of inertia."""
    return (
        Card(
            id="added_inertia",
            summary="a mass or rotor that was forgotten",
            insertion="parallel",
            components={R: rotational_loads.AddedInertia, T: translational_loads.AddedInertia},
            parameters=(level("J", "m"),),
            dissipative=False,
            nested_in=(),
            equivalent_to={},
            regressors=("a",),
            excited_by="fast changes of a known drive, or a spring or weight that is known",
            source="J. L. Lagrange, Mecanique analytique (1788)",
        ),
        Card(
            id="flexible_rod",
            summary="a rod that bends in its first mode",
            insertion="parallel",
            components={R: rotational_loads.FlexibleRod},
            parameters=(
                level("J_1"),
                shape("w_1", (10.0, 15.0, 22.0, 35.0, 60.0)),
                shape("D", (0.02,), lower=0.0, upper=1.0),
                shape("n", (0.0,), lower=0.0, corrects=True),
            ),
            dissipative=False,
            nested_in=(),
            equivalent_to={},
            regressors=("a",),
            excited_by="sudden changes of the motion of its pivot",
            source="L. Meirovitch, Analytical Methods in Vibrations (1967), chapter 7",
            resonates=True,
        ),
    )
