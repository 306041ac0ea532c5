"""Bodies with Stribeck friction under a sine force, and one on a spring that hits hard stops."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import signals, translational, translational_friction

SPEC = "Modelica.Mechanics.Translational.Examples.Friction"
F_POS = (
    (0.0, 15.0),
    (0.2448979592, 11.37241229),
    (0.4897959184, 9.244439102),
    (0.7346938776, 8.035356867),
    (0.9795918367, 7.38932638),
    (1.224489796, 7.088306657),
    (1.469387755, 6.998692774),
    (1.714285714, 7.038618123),
    (1.959183673, 7.157918822),
    (2.204081633, 7.325856879),
    (2.448979592, 7.523597549),
    (2.693877551, 7.739599811),
    (2.93877551, 7.966791891),
    (3.183673469, 8.200840547),
    (3.428571429, 8.43909058),
    (3.673469388, 8.679915013),
    (3.918367347, 8.922316913),
    (4.163265306, 9.165685408),
    (4.408163265, 9.409646186),
    (4.653061224, 9.653969887),
    (4.897959184, 9.898515968),
    (5.142857143, 10.14319831),
    (5.387755102, 10.38796415),
    (5.632653061, 10.63278116),
    (5.87755102, 10.87762951),
    (6.12244898, 11.12249708),
    (6.367346939, 11.36737641),
    (6.612244898, 11.61226296),
    (6.857142857, 11.85715392),
    (7.102040816, 12.1020476),
    (7.346938776, 12.34694293),
    (7.591836735, 12.59183928),
    (7.836734694, 12.83673625),
    (8.081632653, 13.08163361),
    (8.326530612, 13.3265312),
    (8.571428571, 13.57142893),
    (8.816326531, 13.81632675),
    (9.06122449, 14.06122462),
    (9.306122449, 14.30612253),
    (9.551020408, 14.55102046),
    (9.795918367, 14.7959184),
    (10.04081633, 15.04081635),
    (10.28571429, 15.2857143),
    (10.53061224, 15.53061225),
    (10.7755102, 15.77551021),
    (11.02040816, 16.02040817),
    (11.26530612, 16.26530612),
    (11.51020408, 16.51020408),
    (11.75510204, 16.75510204),
    (12.0, 17.0),
)


class Friction(Component):
    """Bodies with Stribeck friction under a sine force, and one on a spring that hits hard stops."""

    def __post_init__(self) -> None:
        self.stop1 = translational_friction.MassWithStopAndFriction(
            L=1.0, smax=25.0, smin=-25.0, m=1.0, F_prop=1.0, F_Coulomb=5.0, F_Stribeck=10.0, fexp=2.0
        )
        self.force = translational.Force()
        self.sineForce = signals.Sine(amplitude=25.0, f=0.25)
        self.stop2 = translational_friction.MassWithStopAndFriction(
            L=1.0, smax=0.9, smin=-0.9, F_Coulomb=3.0, F_Stribeck=5.0, m=1.0, F_prop=1.0, fexp=2.0
        )
        self.spring = translational.Spring(s_rel0=1.0, c=500.0)
        self.fixed2 = translational.Fixed(s0=-1.75)
        self.force2 = translational.Force()
        self.mass = translational.Mass(L=1.0, m=1.0)
        self.supportFriction = translational_friction.SupportFriction(f_pos=F_POS)

    def equations(self) -> Statements:
        yield connect(self.spring.flange_b, self.stop2.flange_a)
        yield connect(self.sineForce.y, self.force.f)
        yield connect(self.spring.flange_a, self.fixed2.flange)
        yield connect(self.force.flange, self.stop1.flange_a)
        yield connect(self.force2.flange, self.mass.flange_a)
        yield connect(self.mass.flange_b, self.supportFriction.flange_a)
        yield connect(self.sineForce.y, self.force2.f)
        yield initial(self.stop1.s == 0.0)
        yield initial(self.stop1.v == 0.0)
        yield initial(self.stop2.s == 0.0)
        yield initial(self.stop2.v == -5.0)
        yield initial(self.mass.s == 0.0)
        yield initial(self.mass.v == 0.0)
