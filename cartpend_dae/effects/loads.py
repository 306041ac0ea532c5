"""Forces and torques from outside."""

from cartpend_dae.effects.card import Card, R, T, choice, level, shape, size
from cartpend_dae.library import rotational, rotational_loads, rotational_losses, translational, translational_loads


def load_cards() -> tuple[Card, ...]:
    """Return the cards of loads and drag."""
    return (
        Card(
            id="constant_load",
            summary="a constant force, as of a tilted track, a weight or an offset of the drive",
            insertion="parallel",
            components={R: rotational.ConstantLoad, T: translational.ConstantLoad},
            parameters=(size("tau_0", "f_0"),),
            dissipative=False,
            nested_in=("linear_stiffness",),
            equivalent_to={
                "input_offset": "an actuator without dynamics whose current is not measured, at the same motion",
                "sensor_offset": "small amplitude about a rest position, with a free start",
                "imbalance": "small angles: its cosine part",
            },
            regressors=("1",),
            excited_by="motion in both directions, or a run at another amplitude",
            source="gravity component m g sin(alpha) along the motion",
        ),
        Card(
            id="quadratic_drag",
            summary="drag that grows with the square of the speed, as of air",
            insertion="parallel",
            components={R: rotational.QuadraticDrag, T: translational.QuadraticDrag},
            parameters=(level("d2"),),
            dissipative=True,
            nested_in=(),
            equivalent_to={},
            regressors=("v |v|",),
            excited_by="two amplitudes, the larger with high speed",
            source="1/2 rho c_w A v^2; L. Prandtl, Ergebnisse der aerodynamischen Versuchsanstalt (1921)",
        ),
        Card(
            id="cogging",
            summary="a torque that the teeth of a machine have without current",
            insertion="parallel",
            components={R: rotational_loads.Cogging},
            parameters=(
                size("tau_k_sin"),
                size("tau_k_cos"),
                size("tau_k_2_sin"),
                size("tau_k_2_cos"),
                choice("n", (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 24.0)),
            ),
            dissipative=False,
            nested_in=(),
            equivalent_to={},
            regressors=("sin kx",),
            excited_by="slow constant speed over several turns",
            source="T. M. Jahns, W. L. Soong, IEEE Trans. Ind. Electron. 43 (1996), 321-330, 10.1109/41.491356",
        ),
        Card(
            id="imbalance",
            summary="weight off the axis, or a pivot that is not where it should be",
            insertion="parallel",
            components={R: rotational_loads.Imbalance},
            parameters=(size("tau_sin"), size("tau_cos")),
            dissipative=False,
            nested_in=("cogging",),
            equivalent_to={
                "linear_stiffness": "small angles: its sine part",
                "constant_load": "small angles: its cosine part",
            },
            regressors=("sin x", "cos x"),
            excited_by="angles of more than a radian",
            source="torque m g r sin(phi + psi) of a weight at the radius r",
        ),
        Card(
            id="rail_unevenness",
            summary="weight on a rail that is not straight",
            insertion="parallel",
            components={T: translational_loads.RailUnevenness},
            parameters=(size("f_sin"), size("f_cos"), shape("k", (8.0, 30.0))),
            dissipative=False,
            nested_in=(),
            equivalent_to={"constant_load": "ways that are short against the wave: its cosine part"},
            regressors=("sin kx",),
            excited_by="slow motion over the whole range, both ways",
            source="force m g h'(s) on the height h(s)",
        ),
        Card(
            id="iron_loss",
            summary="loss in the iron of a machine that turns",
            insertion="parallel",
            components={R: rotational_losses.IronLoss},
            parameters=(level("d"), level("tau_c")),
            dissipative=True,
            nested_in=(),
            equivalent_to={
                "viscous_friction": "the same shaft: its eddy currents",
                "coulomb_friction": "the same shaft: its remagnetisation",
            },
            regressors=("v", "sign v"),
            excited_by="motion without current, at two speeds",
            source="G. Bertotti, IEEE Trans. Magn. 24 (1988), 621-630, 10.1109/20.43994",
        ),
    )
