model RotaDamp "Rod pendulum on a held cart: first model file of the published study"
  parameter Real m(unit = "kg") = 0.1791 "mass of the rod, as typed in the file (the table has 0.1719)";
  parameter Real L(unit = "m") = 0.86 "length of the rod";
  parameter Real g(unit = "m/s2") = 9.81;
  parameter Real I(unit = "kg.m2") = 0.0424 "inertia about the pivot, rounded";
  parameter Real b(unit = "N.m.s/rad") = 0.0375 "damping found by hand";
  parameter Real c(unit = "N.m.s/rad") = 0 "typed as c f, so that it is viscous too";
  Real theta(unit = "rad", start = -0.351, fixed = true) "angle, 0 = hanging";
  Real f(unit = "rad/s", start = 0, fixed = true) "speed";
equation
  der(theta) = f;
  I * der(f) + b * f + m * g * L / 2 * sin(theta) + c * f = 0;
end RotaDamp;
