"""Circuits, from the mistakes of a first course."""

from library_bench import joined

from broken_models.case import broken
from cartpend_dae import StructureError, assemble
from cartpend_dae.library.electrical import (
    Capacitor,
    ConstantVoltage,
    DCMotor,
    Ground,
    Inductor,
    Resistor,
    VoltageSource,
)
from cartpend_dae.library.electrical_sources import ConstantCurrent, CurrentSource, IdealOpAmp


def circuit(*nodes, **parts):
    """A node is a text such as "source.pin_p r.pin_p"."""
    joints = [[getattr(parts[p], q) for p, q in (end.split(".") for end in node.split())] for node in nodes]
    return assemble(joined(*joints, **parts))


@broken(StructureError, r"missing ground: nothing fixes the voltage of `r` \(Resistor\), `source` .*connect a `Ground`")
def missing_ground():
    return circuit("source.pin_p r.pin_p", "source.pin_n r.pin_n", source=ConstantVoltage(V=5.0), r=Resistor(R=1.0))


@broken(StructureError, r"missing ground: nothing fixes the voltage of `c` \(Capacitor\), `r` .*connect a `Ground`")
def missing_ground_with_state():
    return circuit(
        "source.pin_p r.pin_p",
        "r.pin_n c.pin_p",
        "source.pin_n c.pin_n",
        source=ConstantVoltage(V=5.0),
        r=Resistor(R=1.0),
        c=Capacitor(C=1.0),
    )


@broken(
    StructureError,
    r"missing ground: nothing fixes the voltage of .*`(one|two)` .*connect a `Ground`",
)
def missing_ground_with_branches():
    return circuit(
        "source.pin_p one.pin_p two.pin_p",
        "one.pin_n two.pin_n load.pin_p",
        "source.pin_n load.pin_n",
        source=ConstantVoltage(V=5.0),
        one=Resistor(R=1.0),
        two=Resistor(R=2.0),
        load=Resistor(R=3.0),
    )


@broken(StructureError, r"missing ground: nothing fixes the voltage of .*`right` .*connect a `Ground`")
def second_circuit_without_ground():
    return circuit(
        "source.pin_p r.pin_p",
        "source.pin_n r.pin_n ground.pin",
        "right.pin_p load.pin_p",
        "right.pin_n load.pin_n",
        source=ConstantVoltage(V=5.0),
        r=Resistor(R=1.0),
        ground=Ground(),
        right=ConstantVoltage(V=1.0),
        load=Resistor(R=1.0),
    )


@broken(StructureError, r"missing ground: nothing fixes the voltage of .*`r` .*connect a `Ground`")
def resistor_on_its_own():
    return circuit(r=Resistor(R=1.0))


@broken(StructureError, r"missing ground: nothing fixes the voltage of .*`motor\..*connect a `Ground`")
def motor_without_ground():
    return circuit(
        "source.pin_p motor.pin_p",
        "source.pin_n motor.pin_n",
        source=ConstantVoltage(V=5.0),
        motor=DCMotor(R=1.0, k=0.1, J=1e-3, L=1e-3),
    )


@broken(
    StructureError,
    r"two grounds in one circuit: `g1` \(Ground\), `g2` \(Ground\) hold the same voltage.*remove one of them",
)
def two_grounds_at_one_node():
    return circuit(
        "source.pin_p r.pin_p",
        "source.pin_n r.pin_n g1.pin g2.pin",
        source=ConstantVoltage(V=5.0),
        r=Resistor(R=1.0),
        g1=Ground(),
        g2=Ground(),
    )


@broken(
    StructureError,
    r"source: equation 3 contradicts.*5 = 0\..*`g1` \(Ground\), `g2` \(Ground\), `source` .*; remove one of them, or",
)
def source_between_two_grounds():
    return circuit(
        "source.pin_p r.pin_p g1.pin",
        "source.pin_n r.pin_n g2.pin",
        source=ConstantVoltage(V=5.0),
        r=Resistor(R=1.0),
        g1=Ground(),
        g2=Ground(),
    )


@broken(
    StructureError,
    r"voltage sources in parallel: `one` \(ConstantVoltage\), `two` .* hold .*remove one of them, or put a resistor",
)
def equal_sources_in_parallel():
    return circuit(
        "one.pin_p two.pin_p r.pin_p",
        "one.pin_n two.pin_n r.pin_n ground.pin",
        one=ConstantVoltage(V=5.0),
        two=ConstantVoltage(V=5.0),
        r=Resistor(R=1.0),
        ground=Ground(),
    )


@broken(
    StructureError,
    r"(one|two): equation \d contradicts .* 1 = 0\. .*`one` \(ConstantVoltage\), `two` \(ConstantVoltage\); remove",
)
def unequal_sources_in_parallel():
    return circuit(
        "one.pin_p two.pin_p r.pin_p",
        "one.pin_n two.pin_n r.pin_n ground.pin",
        one=ConstantVoltage(V=5.0),
        two=ConstantVoltage(V=6.0),
        r=Resistor(R=1.0),
        ground=Ground(),
    )


@broken(
    StructureError,
    r"two voltage sources in parallel: `one` \(VoltageSource\), `two` .* hold .*remove one of them, or put a resistor",
)
def driven_sources_in_parallel():
    return circuit(
        "one.pin_p two.pin_p",
        "one.pin_n two.pin_n ground.pin",
        one=VoltageSource(),
        two=VoltageSource(),
        ground=Ground(),
    )


@broken(
    StructureError,
    r"sources in series: `one` \(CurrentSource\), `two` \(CurrentSource\) prescribe the current.*connect a resistor",
)
def driven_current_sources_in_series():
    return circuit(
        "one.pin_n two.pin_p",
        "one.pin_p two.pin_n ground.pin",
        one=CurrentSource(),
        two=CurrentSource(),
        ground=Ground(),
    )


@broken(
    StructureError,
    r"connection of one\.pin_n, two\.pin_p: sum of i contradicts .*1 = 0.*`one` \(ConstantCurrent\), `two` .*; remove",
)
def unequal_current_sources_in_series():
    return circuit(
        "one.pin_n two.pin_p",
        "one.pin_p two.pin_n ground.pin",
        one=ConstantCurrent(I=1.0),
        two=ConstantCurrent(I=2.0),
        ground=Ground(),
    )


@broken(
    StructureError, r"an unconnected port: the current at `source\.pin_p` acts on nothing; connect it to a resistor"
)
def open_current_source():
    return circuit("source.pin_n ground.pin", source=CurrentSource(), ground=Ground())


@broken(
    StructureError,
    r"a short circuit: `source` \(VoltageSource\) stands where .*take it out, or put a resistor in series",
)
def shorted_source():
    return circuit("source.pin_p source.pin_n ground.pin", source=VoltageSource(), ground=Ground())


@broken(
    StructureError,
    r"twice, by source: equation 3; replace .*`load\.i`, the current of .*`op` \(IdealOpAmp\); .*back to its input",
)
def operational_amplifier_without_feedback():
    return circuit(
        "op.p1 source.pin_p",
        "op.n1 op.n2 source.pin_n ground.pin",
        "op.p2 load.pin_p",
        "load.pin_n ground.pin",
        op=IdealOpAmp(),
        source=VoltageSource(),
        load=Resistor(R=1.0),
        ground=Ground(),
    )


@broken(
    StructureError,
    r"derivative of its input `source\.u`, at `c` \(Capacitor\), .*: a voltage is .* at a capacitor.*[Pp]ut a resistor",
)
def capacitor_on_a_driven_source():
    return circuit(
        "source.pin_p c.pin_p",
        "source.pin_n c.pin_n ground.pin",
        source=VoltageSource(),
        c=Capacitor(C=1.0),
        ground=Ground(),
    )


@broken(
    StructureError,
    r"derivative of its input `source\.i`, at `coil` \(Inductor\), .*or a current at an inductor.*[Pp]ut a resistor",
)
def inductor_on_a_driven_current():
    return circuit(
        "source.pin_p coil.pin_p",
        "source.pin_n coil.pin_n ground.pin",
        source=CurrentSource(),
        coil=Inductor(L=1.0),
        ground=Ground(),
    )
