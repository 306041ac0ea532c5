"""The chain as Modelica text, in the idiom of the Modelica Standard Library."""

from child import DAMPING, MASS, SPRING, start

LIBRARY = """
connector Flange
  Real s;
  flow Real f;
end Flange;

model Fixed
  parameter Real s0 = 0;
  Flange flange;
equation
  flange.s = s0;
end Fixed;

model Mass
  parameter Real m;
  parameter Real L = 0;
  Flange flange_a;
  Flange flange_b;
  Real s;
  Real v;
  Real a;
equation
  flange_a.s = s - 0.5*L;
  flange_b.s = s + 0.5*L;
  v = der(s);
  a = der(v);
  m*a = flange_a.f + flange_b.f;
end Mass;

model SpringDamper
  parameter Real c;
  parameter Real d;
  parameter Real s_rel0 = 0;
  Flange flange_a;
  Flange flange_b;
  Real s_rel;
  Real v_rel;
  Real f;
equation
  s_rel = flange_b.s - flange_a.s;
  v_rel = der(s_rel);
  f = c*(s_rel - s_rel0) + d*v_rel;
  flange_b.f = f;
  flange_a.f = -f;
end SpringDamper;
"""


def chain(n):
    """Return the text of a chain of `n` masses."""
    parts, connections, end = [], [], "ground.flange"
    for i in range(n):
        fixed = f"s(start={start(i)}, fixed=true), v(start=0, fixed=true)"
        parts += [f"  SpringDamper spring{i}(c={SPRING}, d={DAMPING});", f"  Mass mass{i}(m={MASS}, {fixed});"]
        connections.append(f"  connect({end}, spring{i}.flange_a);")
        connections.append(f"  connect(spring{i}.flange_b, mass{i}.flange_a);")
        end = f"mass{i}.flange_b"
    lines = ["model Chain", "  Fixed ground;", *parts, "equation", *connections, "end Chain;"]
    return LIBRARY + "\n".join(lines) + "\n"
