"""What goes wrong between a command and its actuator."""

from cartpend_dae.effects.card import Card, choice, level, shape, size
from cartpend_dae.library import signal_errors


def input_cards() -> tuple[Card, ...]:
    """Return the cards of amplifiers."""
    return (
        Card(
            id="input_offset",
            summary="an amplifier whose zero is off by a constant",
            insertion="input",
            components={None: signal_errors.InputOffset},
            parameters=(size("u_0"),),
            dissipative=False,
            nested_in=(),
            equivalent_to={
                "constant_load": "an actuator without dynamics whose current is not measured, at the same motion"
            },
            regressors=("1",),
            excited_by="command 0, and motion in both directions",
            source="y = u + u_0",
        ),
        Card(
            id="input_gain",
            summary="an amplifier whose gain is wrong",
            insertion="input",
            components={None: signal_errors.InputGain},
            parameters=(size("e", lower=-0.9, upper=1.0),),
            dissipative=False,
            nested_in=(),
            equivalent_to={"sensor_gain": "a linear model with one sensor, driven from rest"},
            regressors=("u",),
            excited_by="any command, where a force or a mass is known",
            source="y = (1 + e) u",
        ),
        Card(
            id="dead_zone",
            summary="an amplifier or valve that does not answer small commands",
            insertion="input",
            components={None: signal_errors.DeadZone},
            parameters=(level("u_pos"), level("u_neg")),
            dissipative=False,
            nested_in=(),
            equivalent_to={"coulomb_friction": "motion that has the sign of the command"},
            regressors=("sign u",),
            excited_by="slow ramps of the command through zero",
            source="G. Tao, P. V. Kokotovic, IEEE Trans. Autom. Control 39 (1994), 59-68, 10.1109/9.273339",
        ),
        Card(
            id="saturation",
            summary="an amplifier that has a limit",
            insertion="input",
            components={None: signal_errors.Saturation},
            parameters=(level("e", upper=1.0), shape("u_max", (1.0, 4.0, 16.0))),
            dissipative=False,
            nested_in=(),
            equivalent_to={},
            regressors=("u",),
            excited_by="large commands beside small ones",
            source="D. S. Bernstein, A. N. Michel, Int. J. Robust Nonlinear Control 5 (1995), 375-380, "
            "10.1002/rnc.4590050502",
        ),
        Card(
            id="rate_limit",
            summary="an amplifier that follows no faster than a slope",
            insertion="input",
            components={None: signal_errors.RateLimit},
            parameters=(level("e", upper=1.0), shape("r", (10.0, 100.0))),
            dissipative=False,
            nested_in=(),
            equivalent_to={},
            regressors=("du/dt",),
            excited_by="steps of the command of several heights",
            source="D. C. McRuer, Pilot-Induced Oscillations and Human Dynamic Behavior, NASA CR-4683 (1995)",
            is_linear=False,
        ),
        Card(
            id="input_delay",
            summary="dead time between command and actuator, as of sampling or PWM",
            insertion="input",
            components={None: signal_errors.InputDelay},
            parameters=(level("T_d"), choice("k", (1.0, 2.0)), choice("b", (1.0, 0.0))),
            dissipative=False,
            nested_in=(),
            equivalent_to={"sensor_delay": "a linear model with one sensor, driven from rest"},
            regressors=("du/dt",),
            excited_by="steps or fast changes of the command",
            source="H. Pade, Ann. sci. Ecole Norm. Sup. 9 (1892), 3-93, 10.24033/asens.378",
            is_linear=False,
        ),
    )
