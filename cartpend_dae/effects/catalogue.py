"""The effects that `discover` tries."""

import numpy as np

from cartpend_dae.effects.card import Card, EffectParameter
from cartpend_dae.library import rotational, signals, translational

_R, _T = rotational.Flange, translational.Flange
_INF = float(np.inf)


def catalogue() -> tuple[Card, ...]:
    """Return the cards of all effects, ordered by the number of their parameters and then by id."""
    return (
        Card(
            id="constant_load",
            summary="a constant force, as of a tilted track, a weight or an offset of the drive",
            insertion="parallel",
            components={_R: rotational.ConstantLoad, _T: translational.ConstantLoad},
            parameters=(EffectParameter({_R: "tau_0", _T: "f_0"}, -_INF, _INF),),
            dissipative=False,
            nested_in=(),
            equivalent_to=("sensor_offset", "linear_stiffness"),
            regressors=("1",),
            excited_by="motion in both directions, or a run at another amplitude",
            source="gravity component m g sin(alpha) along the motion",
        ),
        Card(
            id="coulomb_friction",
            summary="dry friction of constant level that sticks at rest",
            insertion="parallel",
            components={_R: rotational.CoulombFriction, _T: translational.CoulombFriction},
            parameters=(EffectParameter({_R: "tau_c", _T: "f_c"}, 0.0, _INF),),
            dissipative=True,
            nested_in=("stribeck_friction", "asymmetric_friction"),
            equivalent_to=(),
            regressors=("sign v",),
            excited_by="motion at two amplitudes, with reversals",
            source="B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994), 1083-1138",
        ),
        Card(
            id="cubic_stiffness",
            summary="a spring force that grows with the cube of the displacement",
            insertion="parallel",
            components={_R: rotational.CubicStiffness, _T: translational.CubicStiffness},
            parameters=(EffectParameter({_R: "c3", _T: "c3"}, -_INF, _INF),),
            dissipative=False,
            nested_in=(),
            equivalent_to=(),
            regressors=("x^3",),
            excited_by="two amplitudes: the frequency changes with amplitude",
            source="G. Duffing, Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz (1918)",
        ),
        Card(
            id="linear_stiffness",
            summary="a spring force proportional to the displacement",
            insertion="parallel",
            components={_R: rotational.LinearStiffness, _T: translational.LinearStiffness},
            parameters=(EffectParameter({_R: "c", _T: "c"}, -_INF, _INF),),
            dissipative=False,
            nested_in=("cubic_stiffness",),
            equivalent_to=("constant_load",),
            regressors=("x",),
            excited_by="slow motion over the whole range",
            source="R. Hooke, De potentia restitutiva (1678)",
        ),
        Card(
            id="quadratic_drag",
            summary="drag that grows with the square of the speed, as of air",
            insertion="parallel",
            components={_R: rotational.QuadraticDrag, _T: translational.QuadraticDrag},
            parameters=(EffectParameter({_R: "d2", _T: "d2"}, 0.0, _INF),),
            dissipative=True,
            nested_in=(),
            equivalent_to=(),
            regressors=("v |v|",),
            excited_by="two amplitudes, the larger with high speed",
            source="1/2 rho c_w A v^2; L. Prandtl, Ergebnisse der aerodynamischen Versuchsanstalt (1921)",
        ),
        Card(
            id="sensor_offset",
            summary="a sensor whose zero is off by a constant",
            insertion="sensor",
            components={None: signals.SensorOffset},
            parameters=(EffectParameter({None: "y_0"}, -_INF, _INF),),
            dissipative=False,
            nested_in=(),
            equivalent_to=("constant_load",),
            regressors=("1",),
            excited_by="a motion whose rest position or symmetry is known, at two amplitudes",
            source="y = x + y_0",
        ),
        Card(
            id="viscous_friction",
            summary="friction proportional to the speed",
            insertion="parallel",
            components={_R: rotational.ViscousFriction, _T: translational.ViscousFriction},
            parameters=(EffectParameter({_R: "d", _T: "d"}, 0.0, _INF),),
            dissipative=True,
            nested_in=("stribeck_friction",),
            equivalent_to=(),
            regressors=("v",),
            excited_by="any motion of some duration",
            source="O. Reynolds, Phil. Trans. R. Soc. 177 (1886), 157-234",
        ),
    )
