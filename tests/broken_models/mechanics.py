"""Drives and bodies: too much held, nothing held, moved twice."""

from library_bench import joined

from broken_models.case import broken
from cartpend_dae import Component, ModelError, StructureError, assemble, port, signal, simulate
from cartpend_dae.library import rotational, thermal, translational
from cartpend_dae.library.rotational import Fixed, IdealGear, Inertia, Torque
from cartpend_dae.library.rotational_sources import Accelerate, ConstantSpeed
from cartpend_dae.library.translational import Force, Mass, Rod, Spring


def drive(*nodes, **parts):
    joints = [[getattr(parts[p], q) for p, q in (end.split(".") for end in node.split())] for node in nodes]
    return joined(*joints, **parts)


@broken(
    StructureError,
    r"force at `push\.flange` acts on nothing; connect it to a mass.*left for: unconnected push.flange: sum of f",
)
def force_on_nothing():
    return assemble(joined(push=Force()))


@broken(StructureError, r"sources in series: `one` \(Force\), `two` \(Force\) prescribe the force.*connect a mass")
def two_forces_against_each_other():
    return assemble(drive("one.flange two.flange", one=Force(), two=Force()))


@broken(StructureError, r"unconnected port: the torque at `gear\.flange_b` acts on nothing; connect it to an inertia")
def torque_on_a_gear_without_load():
    return assemble(drive("torque.flange gear.flange_a", torque=Torque(), gear=IdealGear(ratio=2.0)))


@broken(
    StructureError,
    r"missing ground or body: nothing fixes the position of `one` \(Spring\), `two` \(Spring\); connect a `Fixed` or a",
)
def springs_without_body():
    return assemble(drive("one.flange_b two.flange_a", one=Spring(c=1.0), two=Spring(c=2.0)))


@broken(StructureError, r"missing ground or body: nothing fixes the position of `rod` \(Rod\).*`Fixed` or a mass")
def rod_in_the_air():
    return assemble(joined(rod=Rod(L=1.0)))


@broken(
    StructureError,
    r"constraint given twice .*`left` \(Fixed\), `right` \(Fixed\) hold the same position.*remove one of them.*spring",
)
def two_walls_at_one_place():
    return assemble(drive("left.flange right.flange", left=translational.Fixed(), right=translational.Fixed()))


@broken(
    StructureError,
    r"connection of left\.flange, right\.flange: equal s contradicts .*0\.5 = 0\. "
    r"Two constraints .*`left` \(Fixed\), `right` \(Fixed\); remove one",
)
def two_walls_at_different_places():
    return assemble(drive("left.flange right.flange", left=translational.Fixed(), right=translational.Fixed(s0=0.5)))


@broken(
    StructureError,
    r"given twice .*`body` \(Mass\), `left` .*, `right` .* hold the same position.*remove one of them.*spring",
)
def body_fixed_at_both_ends():
    return assemble(
        drive(
            "left.flange body.flange_a",
            "body.flange_b right.flange",
            left=translational.Fixed(),
            body=Mass(m=1.0),
            right=translational.Fixed(),
        )
    )


@broken(
    StructureError,
    r"connection of body\.flange_b, right\.flange: equal s contradicts .*0\.1 = 0.*`body` .*, `left` .*, `right` .*;",
)
def long_body_between_two_walls_too_near():
    return assemble(
        drive(
            "left.flange body.flange_a",
            "body.flange_b right.flange",
            left=translational.Fixed(),
            body=Mass(m=1.0, L=0.3),
            right=translational.Fixed(s0=0.2),
        )
    )


@broken(
    StructureError,
    r"given twice .*`left` .*, `right` .*, `shaft` \(Inertia\) hold the same angle.*remove one of them",
)
def shaft_fixed_at_both_ends():
    return assemble(
        drive(
            "left.flange shaft.flange_a",
            "shaft.flange_b right.flange",
            left=Fixed(),
            shaft=Inertia(J=1.0),
            right=Fixed(),
        )
    )


@broken(
    StructureError,
    r"at `one\.ratio` = 3, `two\.ratio` = 3 \(shared .*constraint given .*: `one` \(IdealGear\), `two` \(IdealGear\) "
    r"hold the same angle.*remove one",
)
def two_equal_gears_side_by_side():
    return simulate(gear_loop(3.0, 3.0), 1.0, start={"a.w": 1.0})


@broken(
    StructureError,
    r"holds only where `b\.phi` stands still, .*, at `one\.ratio` = 3, `two\.ratio` = 4: `one` .*, `two` .* lock each",
)
def two_unequal_gears_side_by_side():
    return simulate(gear_loop(3.0, 4.0), 1.0, start={"a.w": 1.0})


def gear_loop(first, second):
    return drive(
        "a.flange_b one.flange_a two.flange_a",
        "one.flange_b two.flange_b b.flange_a",
        a=Inertia(J=1.0),
        b=Inertia(J=1.0),
        one=IdealGear(ratio=first),
        two=IdealGear(ratio=second),
    )


@broken(
    StructureError,
    r"motion prescribed twice.*`one` \(Accelerate\), `shaft` .*, `two` .* hold the same angle.*remove one",
)
def motion_prescribed_twice():
    return assemble(
        drive(
            "one.flange shaft.flange_a",
            "shaft.flange_b two.flange",
            one=Accelerate(),
            two=Accelerate(),
            shaft=Inertia(J=1.0),
        )
    )


@broken(
    StructureError,
    r"motion prescribed twice.*`one` \(ConstantSpeed\), `shaft` \(Inertia\), `two` \(ConstantSpeed\) hold.*remove one",
)
def two_speeds_on_one_shaft():
    return assemble(
        drive(
            "one.flange shaft.flange_a",
            "shaft.flange_b two.flange",
            one=ConstantSpeed(w_fixed=1.0),
            two=ConstantSpeed(w_fixed=2.0),
            shaft=Inertia(J=1.0),
        )
    )


@broken(
    StructureError,
    r"source: equation 3 contradicts the other equations.*1 = 0\. .*`shaft` .*, `source` .*, `wall` .*; remove one",
)
def speed_prescribed_on_a_fixed_shaft():
    return assemble(
        drive(
            "wall.flange shaft.flange_a",
            "shaft.flange_b source.flange",
            wall=Fixed(),
            source=ConstantSpeed(w_fixed=1.0),
            shaft=Inertia(J=1.0),
        )
    )


@broken(ModelError, r"dry friction at `brake` stands between points that never move.*connect it to a body that moves")
def friction_between_fixed_points():
    model = drive(
        "one.flange brake.flange_a",
        "two.flange brake.flange_b",
        one=Fixed(),
        two=Fixed(),
        brake=rotational.BearingFriction(tau_c=1.0),
    )
    return simulate(model, 1.0)


@broken(
    StructureError,
    r"body: equation 5 does not determine `body\.a`, .* zero at `body\.m` = 0 \(shared by .*\)\. Change `body\.m`",
)
def mass_of_zero():
    return simulate(drive("push.flange body.flange_a", push=Force(), body=Mass(m=0.0)), 1.0, inputs={"push.f": 1.0})


@broken(
    StructureError,
    r"shaft: equation 5 does not determine `shaft\.a`, .* zero at `shaft\.J` = 0 \(shared by .*\)\. Change",
)
def inertia_of_zero():
    model = drive("torque.flange shaft.flange_a", torque=Torque(), shaft=Inertia(J=0.0))
    return simulate(model, 1.0, inputs={"torque.tau": 1.0})


@broken(StructureError, r"nothing fixes the temperature of `wall` \(ThermalConductor\); connect a `FixedTemperature`")
def wall_between_nothing():
    return assemble(joined(wall=thermal.ThermalConductor(G=1.0)))


@broken(StructureError, r"heat flow at `heater\.port` acts on nothing; connect it to a `HeatCapacitor`")
def heat_into_nothing():
    return assemble(joined(heater=thermal.PrescribedHeatFlow()))


@broken(
    StructureError,
    r"`one` \(FixedTemperature\), `two` \(FixedTemperature\) hold the same temperature.*remove one.*`ThermalConductor`",
)
def two_baths_at_one_temperature():
    return assemble(
        drive("one.port two.port", one=thermal.FixedTemperature(T=300.0), two=thermal.FixedTemperature(T=300.0))
    )


@broken(StructureError, r"derivative of its input `source\.f`.*[Dd]rive it by a force")
def position_prescribed_without_its_speed():
    class Prescribed(Component):
        flange = port(translational.Flange)
        f = signal("in", unit="m")

        def equations(self):
            yield self.flange.s == self.f

    return assemble(drive("source.flange mass.flange_a", source=Prescribed(), mass=Mass(m=1.0)))


@broken(
    StructureError,
    r"derivative of its input `push\.f`, at `push` \(Force\), `spring` \(Spring\): a force .*Put a mass",
)
def speed_of_a_force_without_mass():
    parts = {"push": Force(), "wall": translational.Fixed(), "sensor": translational.SpeedSensor()}
    return assemble(
        drive(
            "wall.flange spring.flange_a",
            "spring.flange_b push.flange sensor.flange",
            spring=Spring(c=1.0),
            **parts,
        )
    )


@broken(
    StructureError,
    r"derivative of its input `hot\.T`, at `block` \(HeatCapacitor\), `hot` \(Pre.*\): .*`ThermalConductor`",
)
def temperature_prescribed_at_a_heat_capacitor():
    return assemble(
        drive("hot.port block.port", hot=thermal.PrescribedTemperature(), block=thermal.HeatCapacitor(C=2.0))
    )
