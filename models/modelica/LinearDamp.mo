model LinearDamp "Cart between two springs with the whole drive: second model file of the published study"
  parameter Real m_c(unit = "kg") = 4.609 "cart";
  parameter Real K_1(unit = "N/m") = 1197.3;
  parameter Real K_2(unit = "N/m") = 1320.1;
  parameter Real a(unit = "m") = 0.095 "stretch of both springs at x = 0";
  parameter Real b(unit = "N.s/m") = 48 "damping found by hand";
  parameter Real F_c(unit = "N") = 10 "friction read from a spring scale";
  // The file reflects inertias and damping without the squares, so that its sums do not measure a mass or a damping:
  // these quantities have no unit here.
  parameter Real r_1 = 0.0164;
  parameter Real r_2 = 0.0252;
  parameter Real r_3 = 0.0181;
  parameter Real I_1 = 3.698e-6;
  parameter Real I_s = 5.687e-4;
  parameter Real I_3 = 4.406e-6;
  parameter Real J_m = 1.20e-4;
  parameter Real J_b = 0.219 "as printed, 1,000 times too large";
  parameter Real c_m = 2.094e-6;
  parameter Real c_b = 7.330e-7;
  parameter Real M = m_c + 2 * (I_1 + I_s) / r_1 + (2 * I_3 + J_b + J_m) * r_2 / (r_1 * r_3);
  parameter Real D = (c_m + c_b) * r_2 / (r_1 * r_3) + b;
  Real x(unit = "m", start = 0.1146, fixed = true);
  Real f(unit = "m/s", start = 0, fixed = true);
equation
  der(x) = f;
  M * der(f) + D * f + K_1 * (x + a) - K_2 * (a - x) + F_c * sign(f) = 0;
end LinearDamp;
