"""Gears and wheels that are not ideal."""

from cartpend_dae.effects.card import Card, R, level, shape, size, wave_number
from cartpend_dae.library import kinematic_errors, rotational, rotational_links, rotational_parts

WHEELS = (rotational.IdealGear, rotational.IdealGearR2T, rotational.Sprocket, rotational_parts.IdealRollingWheel)


def kinematic_cards() -> tuple[Card, ...]:
    """Return the cards of gears and sprockets."""
    return (
        Card(
            id="gear_loss",
            summary="a share of the torque that a gear loses, whichever way the power goes",
            insertion="series",
            components={R: rotational_links.GearLoss},
            parameters=(level("e", upper=0.99),),
            dissipative=True,
            nested_in=(),
            equivalent_to={"load_dependent_friction": "the same joint, power one way: the friction per load"},
            regressors=("sign v", "i"),
            excited_by="motion at the same speed under two loads",
            source="R. Pelchen, C. Schweiger, M. Otter, 2nd International Modelica Conference (2002), 257-266",
            hosts=WHEELS,
        ),
        Card(
            id="eccentricity",
            summary="a gear or sprocket whose axis is not in its middle",
            insertion="series",
            components={R: kinematic_errors.Eccentricity},
            parameters=(
                size("e_sin", lower=-0.5, upper=0.5),
                size("e_cos", lower=-0.5, upper=0.5),
                wave_number("n", (1.0,)),
            ),
            along={R: "flange_a.phi"},
            dissipative=False,
            nested_in=(),
            equivalent_to={},
            regressors=("v sin kx", "i sin kx"),
            excited_by="constant speed over several turns, with a sensor on either side",
            source="W. D. Mark, J. Acoust. Soc. Am. 63 (1978), 1409-1430, 10.1121/1.381876",
            hosts=WHEELS,
        ),
        Card(
            id="chain_polygon",
            summary="a chain that lies on its sprocket as a polygon",
            insertion="series",
            components={R: kinematic_errors.ChainPolygon},
            parameters=(
                # a share below 0 is another phase with its cusps the wrong way, from which no fit comes back
                level("e", upper=5.0),
                wave_number("N", (12.0, 15.0, 20.0), lower=3.0),
                shape("psi", (0.0, 0.25, 0.5, 0.75), lower=-1.0, upper=2.0),
            ),
            along={R: "flange_a.phi"},
            dissipative=False,
            nested_in=(),
            equivalent_to={},
            regressors=("v sin kx", "i sin kx"),
            excited_by="constant speed over several teeth, with a sensor on either side",
            source="R. A. Morrison, Machine Design 24 (1952), 155-159 (polygonal action in chain drives)",
            hosts=WHEELS,
        ),
    )
