"""Friction that a joint can have."""

from dataclasses import replace

from cartpend_dae.effects.card import Card, R, T, choice, level, shape, size, wave_number
from cartpend_dae.library import (
    rotational,
    rotational_links,
    rotational_losses,
    translational,
    translational_losses,
)

ARMSTRONG = (
    "B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994), 1083, 10.1016/0005-1098(94)90209-7"
)
WS = shape("w_s", (0.1, 1.0), ("v_s", (0.005, 0.05)))
# speed below which a contact creeps
W_R = shape("w_r", (0.05,), ("v_r", (0.005,)))
# a peak at rest alone: a wide band would be another Stribeck curve
BAND = choice("w_s", (0.02, 0.004), ("v_s", (0.001, 0.0002)))
AT_REST = {"tau_s": "tau_c", "f_s": "f_c"}
PHI_S = shape("phi_s", (0.005, 0.05), ("s_s", (0.001, 0.01)))


def friction_cards() -> tuple[Card, ...]:
    """Return the cards of friction."""
    coulomb = Card(
        id="coulomb_friction",
        summary="dry friction of constant level that sticks at rest",
        insertion="parallel",
        components={R: rotational.CoulombFriction, T: translational.CoulombFriction},
        parameters=(level("tau_c", "f_c"),),
        dissipative=True,
        nested_in=(
            "stribeck_friction",
            "breakaway_friction",
            "asymmetric_friction",
            "position_dependent_friction",
            "load_dependent_friction",
            "iron_loss",
        ),
        equivalent_to={"dahl_friction": "swings that are long against the presliding length"},
        regressors=("sign v",),
        excited_by="motion at two amplitudes, with reversals",
        source=f"C. A. Coulomb, Theorie des machines simples (1785); {ARMSTRONG}",
    )
    creeping = replace(
        coulomb,
        summary="dry friction of constant level that creeps below some speed instead of sticking",
        components={R: rotational_losses.CreepingFriction, T: translational_losses.CreepingFriction},
        parameters=(*coulomb.parameters, W_R),
        source="S. Andersson, A. Soderberg, S. Bjorklund, Tribology International 40 (2007), 580-587, "
        "10.1016/j.triboint.2005.11.014",
    )
    return (
        replace(coulomb, creeping=creeping),
        Card(
            id="viscous_friction",
            summary="friction proportional to the speed",
            insertion="parallel",
            components={R: rotational.ViscousFriction, T: translational.ViscousFriction},
            parameters=(level("d"),),
            dissipative=True,
            nested_in=("stribeck_friction", "asymmetric_friction", "lugre_friction", "iron_loss"),
            equivalent_to={},
            regressors=("v",),
            excited_by="any motion of some duration",
            source="O. Reynolds, Phil. Trans. R. Soc. 177 (1886), 157-234, 10.1098/rstl.1886.0005",
        ),
        Card(
            id="stribeck_friction",
            summary="dry friction whose level falls from a peak at rest to that of Coulomb, beside viscous friction",
            insertion="parallel",
            components={R: rotational_losses.StribeckFriction, T: translational_losses.StribeckFriction},
            parameters=(level("tau_c", "f_c"), level("tau_s", "f_s"), WS, level("d")),
            dissipative=True,
            nested_in=("lugre_friction",),
            equivalent_to={},
            regressors=("sign v", "v", "t"),
            excited_by="slow ramps through zero speed beside fast motion",
            source=f"R. Stribeck, Z. VDI 46 (1902), 1341-1348; {ARMSTRONG}",
            peaks=AT_REST,
        ),
        Card(
            id="breakaway_friction",
            summary="dry friction that is larger at rest than while sliding",
            insertion="parallel",
            components={R: rotational_losses.BreakawayFriction, T: translational_losses.BreakawayFriction},
            parameters=(level("tau_c", "f_c"), level("tau_s", "f_s"), BAND),
            dissipative=True,
            nested_in=("stribeck_friction",),
            equivalent_to={
                "stribeck_friction": "speeds that are mostly above the band, or data too coarse to see its shape"
            },
            regressors=("sign v",),
            excited_by="starts from rest under a slowly growing drive",
            source="D. Karnopp, J. Dyn. Syst. Meas. Control 107 (1985), 100-103, 10.1115/1.3140698",
            peaks=AT_REST,
        ),
        Card(
            id="asymmetric_friction",
            summary="friction that differs between forward and backward motion",
            insertion="parallel",
            components={R: rotational_losses.AsymmetricFriction, T: translational_losses.AsymmetricFriction},
            parameters=(level("tau_c_pos", "f_c_pos"), level("tau_c_neg", "f_c_neg"), level("d_pos"), level("d_neg")),
            dissipative=True,
            nested_in=(),
            equivalent_to={
                "constant_load": "motion without rest: the difference of both levels is twice a constant load"
            },
            regressors=("sign v", "v", "1", "|v|"),
            excited_by="the same motion forward and backward, and rests",
            source=ARMSTRONG,
        ),
        Card(
            id="position_dependent_friction",
            summary="dry friction whose level changes along the way",
            insertion="parallel",
            components={
                R: rotational_losses.PositionDependentFriction,
                T: translational_losses.PositionDependentFriction,
            },
            parameters=(
                level("tau_c", "f_c"),
                size("tau_c_sin", "f_c_sin"),
                size("tau_c_cos", "f_c_cos"),
                wave_number("n", (1.0, 4.0), ("k", (15.0, 60.0))),
            ),
            along={R: "phi_rel", T: "s_rel"},
            dissipative=True,
            nested_in=(),
            equivalent_to={},
            regressors=("sign v", "sin kx"),
            excited_by="constant speed over the whole range, both ways",
            source=ARMSTRONG,
        ),
        Card(
            id="load_dependent_friction",
            summary="dry friction that grows with the force in a bearing",
            insertion="parallel",
            components={R: rotational_losses.RadialLoadFriction},
            parameters=(
                level("tau_c"),
                level("r_f"),
                level("r_2"),
                shape("k_s", (0.0, 1.0), lower=0.0, upper=1.0, corrects=True),
            ),
            dissipative=True,
            nested_in=(),
            equivalent_to={},
            regressors=("sign v", "v^2"),
            excited_by="swings of two amplitudes, the larger with high speed",
            source="mu r N of a journal, and the square of the load as in M. Duclusaud, G. Passault, V. Padois, O. Ly "
            "(2024), Extended Friction Models for the Physics Simulation of Servo Actuators, 10.48550/arXiv.2410.08650",
            load="N",
            load_at_rest="N_s",
        ),
        Card(
            id="load_dependent_friction",
            summary="dry friction that grows with the load that a gear or joint passes on",
            insertion="series",
            components={R: rotational_links.LoadDependentFriction},
            parameters=(
                level("tau_c"),
                level("mu", upper=1.0),
                shape("p", (0.0,), lower=-0.5, upper=1.0, corrects=True),
            ),
            dissipative=True,
            nested_in=(),
            equivalent_to={"gear_loss": "the same joint: the friction per load is the lost share"},
            regressors=("sign v", "i"),
            excited_by="motion at the same speed under two loads",
            source="M. Duclusaud, G. Passault, V. Padois, O. Ly (2024), Extended Friction Models for the Physics "
            "Simulation of Servo Actuators, 10.48550/arXiv.2410.08650; of a power of the load: A. Palmgren, Ball and "
            "Roller Bearing Engineering (1959), chapter 2",
            is_elsewhere=True,
        ),
        Card(
            id="dahl_friction",
            summary="friction with a spring before it slides",
            insertion="parallel",
            components={R: rotational_losses.DahlFriction, T: translational_losses.DahlFriction},
            parameters=(level("tau_c", "f_c"), PHI_S, choice("a", (1.0, 2.0))),
            dissipative=True,
            nested_in=("lugre_friction",),
            equivalent_to={"coulomb_friction": "swings that are long against the presliding length"},
            regressors=("sign v", "x"),
            excited_by="small reversals around rest",
            source="P. R. Dahl, AIAA Journal 14 (1976), 1675-1682, 10.2514/3.61511",
        ),
        Card(
            id="lugre_friction",
            summary="friction with bristles: presliding, a Stribeck curve and a lag behind the speed",
            insertion="parallel",
            components={R: rotational_losses.LuGreFriction, T: translational_losses.LuGreFriction},
            parameters=(
                level("tau_c", "f_c"),
                # measured peaks are 1 to 2 times the level of sliding (Armstrong-Helouvry 1994); beyond 3 another law
                shape("r_s", (1.5,), lower=1.0, upper=3.0),
                WS,
                PHI_S,
                level("d_1"),
                level("d"),
            ),
            dissipative=True,
            nested_in=(),
            equivalent_to={},
            regressors=("sign v", "v", "x"),
            excited_by="small reversals around rest, and slow ramps through zero speed",
            source="C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, IEEE Trans. Autom. Control 40 (1995), "
            "419-425, 10.1109/9.376053",
        ),
        Card(
            id="maxwell_slip_friction",
            summary="friction of several contacts that slip one after the other",
            insertion="parallel",
            components={R: rotational_losses.MaxwellSlipFriction, T: translational_losses.MaxwellSlipFriction},
            parameters=(
                level("tau_c", "f_c"),
                PHI_S,
                shape("p", (0.0, 1.0), lower=-0.5, upper=3.0, corrects=True),
            ),
            dissipative=True,
            nested_in=(),
            equivalent_to={"dahl_friction": "swings that are long against the presliding length"},
            regressors=("sign v", "x"),
            excited_by="small reversals of several widths around rest",
            source="F. Al-Bender, V. Lampaert, J. Swevers, IEEE Trans. Autom. Control 50 (2005), 1883-1887, "
            "10.1109/TAC.2005.858676; its power: D. J. Segalman, J. Appl. Mech. 72 (2005), 752-760, 10.1115/1.1989354",
        ),
    )
