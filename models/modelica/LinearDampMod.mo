model LinearDampMod "Cart between two springs with an inertial mass: third model file of the published study"
  parameter Real m_c(unit = "kg") = 4.609 "cart";
  parameter Real m_in(unit = "kg") = 6.8 "found by hand";
  parameter Real K_1(unit = "N/m") = 1197.3;
  parameter Real K_2(unit = "N/m") = 1320.1;
  parameter Real a(unit = "m") = 0.095 "stretch of both springs at x = 0";
  parameter Real b(unit = "N.s/m") = 51 "damping found by hand";
  parameter Real F(unit = "N") = 10 "the file adds a constant force, not friction";
  Real x(unit = "m", start = 0.1146, fixed = true);
  Real f(unit = "m/s", start = 0, fixed = true);
equation
  der(x) = f;
  (m_c + m_in) * der(f) + b * f + K_1 * (x + a) - K_2 * (a - x) + F = 0;
end LinearDampMod;
