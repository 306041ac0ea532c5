"""What an estimation can be asked for: priors, ties, logarithms, parameters per run, pieces, rest, robust loss."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from test_identify import experiment_of

from cartpend_dae import Component, ModelError, Param, Statements, assemble, connect, initial, insert, param, simulate
from cartpend_dae.data import Channel, Start
from cartpend_dae.directions import blind_directions
from cartpend_dae.discover import FreeSpec, Setup, Workbench, refit
from cartpend_dae.effects import catalogue, insertion_at
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import estimate
from cartpend_dae.library import electrical, rotational, translational
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.residual_noise import noise_model
from cartpend_dae.shooting import linearised
from cartpend_dae.uncertainty import seen_inverse
from cartpend_dae.unknowns import Prior, tie
from models.rota_damp import RotaDamp

D = 0.0375


def release(angle, *, seed=0, noise=1e-3, name="run", duration=5.0, **parameters):
    start = {"bearing.phi": Start(angle, False), "bearing.w": Start(0.0, False)}
    run = simulate(
        RotaDamp(),
        duration,
        points=int(100 * duration) + 1,
        start={"bearing.phi": angle, "bearing.w": 0.0},
        parameters={k.replace("__", "."): v for k, v in parameters.items()},
    )
    return experiment_of(run, {"bearing.phi": "rad"}, start, noise=noise, seed=seed, name=name)


def test_a_prior_pulls_by_its_share_of_the_information():
    """Between two normal distributions of one quantity the mean is weighted by the inverse variances."""
    system, run = assemble(RotaDamp()), release(0.5)
    data = estimate(make_problem(system, (free_parameter(system, "bearing.d"),), (run,))).parameters[0]
    known = Prior(D + 3 * data.sd, data.sd)
    both = estimate(make_problem(system, (free_parameter(system, "bearing.d", prior=known),), (run,))).parameters[0]
    # the curvature of the cost over a few standard deviations is constant to 1e-3; sd comes with the noise estimate
    assert both.value == pytest.approx((data.value + known.value) / 2, abs=0.05 * data.sd)
    assert both.sd == pytest.approx(data.sd / np.sqrt(2), rel=0.05)


def test_the_logarithm_has_the_same_optimum_and_a_lopsided_interval():
    system, run = assemble(RotaDamp()), release(0.5)
    plain = estimate(make_problem(system, (free_parameter(system, "bearing.d", guess=0.02),), (run,))).parameters[0]
    log = free_parameter(system, "bearing.d", guess=0.02, is_log=True)
    found = estimate(make_problem(system, (log,), (run,))).parameters[0]
    assert found.value == pytest.approx(plain.value, rel=1e-6)
    assert found.sd == pytest.approx(plain.sd, rel=1e-4)
    low, high = found.interval
    assert low * high == pytest.approx(found.value**2, rel=1e-9)
    with pytest.raises(ModelError, match=r"`bearing\.d` starts at 0 .*must be positive"):
        free_parameter(system, "bearing.d", guess=0.0, is_log=True)


def test_an_unknown_name_of_a_start_is_said_before_the_first_fit():
    """It was said by the first fit, which called it a divergence."""
    run = release(0.5)
    wrong = replace(run, start=run.start | {"bearing.phy": Start(0.1, False)})
    why = r"The start of run `run` names `bearing\.phy`: RotaDamp has no variable .* did you mean `bearing\.phi`"
    with pytest.raises(ModelError, match=why):
        make_problem(RotaDamp(), (), (wrong,))
    with pytest.raises(ModelError, match=why):
        refit(Workbench(Setup(RotaDamp(), (), (wrong,), (), ())), ())


def test_what_cannot_be_fitted_is_not_called_a_divergence():
    run = replace(release(0.5), start={"bearing.flange_b.tau": Start(0.0, True)})
    with pytest.raises(SolverError, match=r"The fit with `baseline` cannot be done: .* cannot be free: it is not a st"):
        refit(Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), (run,), (), ())), ())


def test_what_is_refitted_is_an_effect_at_its_place():
    bench = Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), (release(0.5),), (), ()))
    with pytest.raises(
        TypeError, match=r"'coulomb_friction' is none; write `\(insertion_at\(setup\.model, 'coulomb_fr"
    ):
        refit(bench, ("coulomb_friction",))
    with pytest.raises(TypeError, match=r"'quadratic_drag' is none"):
        refit(bench, tuple(card for card in catalogue() if card.id == "quadratic_drag"))
    with pytest.raises(TypeError, match="takes a tuple of effects; put a comma behind it"):
        refit(bench, insertion_at(RotaDamp(), "coulomb_friction", "bearing"))


class TwoSprings(Component):
    """A mass between two springs."""

    def __post_init__(self) -> None:
        self.mass = translational.Mass(m=2.0)
        self.left, self.right = translational.Spring(c=50.0), translational.Spring(c=100.0)
        self.rail, self.ground = translational.RailFriction(d=0.5), translational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.left.flange_a, self.rail.flange_a, self.right.flange_b)
        yield connect(self.left.flange_b, self.mass.flange_a, self.rail.flange_b, self.right.flange_a)
        yield initial(self.mass.s == 0.1)
        yield initial(self.mass.v == 0.0)


def springs_run(noise=1e-4):
    run = simulate(TwoSprings(), 4.0, points=401)
    return experiment_of(run, {"mass.s": "m"}, {}, noise=noise, seed=1)


def test_tied_parameters_follow_and_have_their_own_uncertainty():
    system = assemble(TwoSprings())
    free = (free_parameter(system, "left.c", guess=30.0), free_parameter(system, "rail.d", guess=0.2))
    fit = estimate(make_problem(system, free, (springs_run(),), ties=(tie(system, "right.c", "2 * left.c"),)))
    left = fit.parameters[0]
    assert left.value == pytest.approx(50.0, abs=4 * left.sd)
    assert fit.tied[0].name == "right.c"
    assert fit.tied[0].value == pytest.approx(2 * left.value, rel=1e-12)
    assert fit.tied[0].sd == pytest.approx(2 * left.sd, rel=1e-9)
    assert fit.values_in()["right.c"] == fit.tied[0].value


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_sensitivities_beyond_all_bounds_end_a_fit_with_a_sentence(number):
    with pytest.raises(SolverError, match="grow beyond all bounds"):
        seen_inverse(np.array([[1.0, 0.1], [0.1, number]]))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("2 *", "cannot be read"),
        ("__import__('os').system('true')", "neither a number nor the name"),
        ("left.c if 1 else 2", "neither a number nor the name"),
        ("2 * right.c", "names the parameter itself"),
        ("3.0", "names no parameter"),
        ("2 * left.k", "no parameter `left.k`; did you mean"),
    ],
)
def test_a_tie_that_is_no_expression_is_refused(text, why):
    with pytest.raises(ModelError, match=why.replace("(", r"\(")):
        tie(assemble(TwoSprings()), "right.c", text)


def test_a_tie_of_a_free_parameter_or_of_a_tied_one_is_refused():
    system = assemble(TwoSprings())
    free = (free_parameter(system, "left.c"),)
    with pytest.raises(ModelError, match=r"`left\.c` is tied to `right\.c` and free"):
        make_problem(system, free, (springs_run(),), ties=(tie(system, "left.c", "right.c"),))
    ties = (tie(system, "right.c", "2 * mass.m"), tie(system, "mass.m", "rail.d"))
    with pytest.raises(ModelError, match=r"names `mass\.m`, which is tied itself; put `rail\.d` in its place"):
        make_problem(system, free, (springs_run(),), ties=ties)


def test_a_parameter_of_each_run_gets_the_value_of_its_run():
    system = assemble(RotaDamp())
    runs = (release(0.5, name="dry", bearing__d=0.02), release(0.4, seed=1, name="oiled", bearing__d=0.05))
    free = (free_parameter(system, "bearing.d", is_per_run=True), free_parameter(system, "rod.l", guess=0.8))
    fit = estimate(make_problem(system, free, runs))
    found = {e.name: e for e in fit.parameters}
    assert list(found) == ["dry:bearing.d", "oiled:bearing.d", "rod.l"]
    for name, truth in (("dry:bearing.d", 0.02), ("oiled:bearing.d", 0.05), ("rod.l", 0.86)):
        assert found[name].value == pytest.approx(truth, abs=4 * found[name].sd)
    assert fit.values_in("dry")["bearing.d"] == found["dry:bearing.d"].value
    # what belongs to one run is not seen in the other: a correlation through `rod.l` only
    alone = estimate(make_problem(system, (free_parameter(system, "bearing.d"),), (runs[0],)))
    assert found["dry:bearing.d"].sd == pytest.approx(alone.parameters[0].sd, rel=0.1)


def test_pieces_of_a_run_have_starts_of_their_own_and_share_the_parameters():
    system = assemble(RotaDamp())
    whole = release(0.5)
    pieces = replace(whole, piece=1.0)
    fit = estimate(make_problem(system, (free_parameter(system, "bearing.d", guess=0.01),), (pieces,)))
    item = fit.parameters[0]
    assert item.value == pytest.approx(D, abs=4 * item.sd)
    assert [e.name for e in fit.starts][:3] == ["run#2:bearing.phi", "run#2:bearing.w", "run#3:bearing.phi"]
    assert len(fit.runs) == 1 and fit.runs[0].time.size == whole.time.size
    assert fit.noise_sd[0] == pytest.approx(1e-3, rel=0.1)
    with pytest.raises(ModelError, match=r"pieces of 0\.02 s, of which one has 1 samples; at least 5"):
        make_problem(system, (), (replace(whole, piece=0.02),))


class Sagging(Component):
    """A mass on a spring that a force pulls down; it starts where both balance."""

    def __post_init__(self) -> None:
        self.force, self.mass = translational.Force(), translational.Mass(m=2.0)
        self.spring, self.rail = translational.SpringDamper(c=50.0, d=4.0), translational.RailFriction(d=0.1)
        self.ground = translational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.force.flange, self.mass.flange_a, self.spring.flange_b, self.rail.flange_b)
        yield connect(self.ground.flange, self.spring.flange_a, self.rail.flange_a)


def test_a_run_that_starts_at_rest_starts_where_the_estimated_stiffness_puts_it():
    system = assemble(Sagging())
    times = np.linspace(0.0, 4.0, 401)
    pull = np.where(times < 1.0, 5.0, 2.0)
    run = simulate(
        system, times=times, inputs={"force.f": (times, pull, "zoh")}, start={"mass.s": 0.1, "mass.v": 0.0}, rtol=1e-9
    )
    channel = {"force.f": Channel(pull, "zoh", None, "N", 0.0)}
    steady = replace(experiment_of(run, {"mass.s": "m"}, {}, noise=1e-4, inputs=channel), steady=True)
    free = (free_parameter(system, "spring.c", guess=80.0), free_parameter(system, "spring.d", guess=2.0))
    problem = make_problem(system, free, (steady,))
    fit = estimate(problem)
    for item, truth in zip(fit.parameters, (50.0, 4.0), strict=True):
        assert item.value == pytest.approx(truth, abs=4 * item.sd)
    # f = c s at rest: the start moves with the stiffness, which says a little more of it than a start of its own
    assert fit.runs[0].start[0] == pytest.approx(5.0 / fit.values["spring.c"], rel=1e-9)
    own = replace(steady, steady=False, start={"mass.s": Start(None, True), "mass.v": Start(0.0, False)})
    loose = estimate(make_problem(system, free, (own,)))
    assert fit.parameters[0].sd < loose.parameters[0].sd


def test_robust_loss_is_not_moved_by_outliers():
    system, run = assemble(RotaDamp()), release(0.5)
    channel = run.outputs["bearing.phi"]
    values = channel.values.copy()
    values[::25] *= 1.5  # as if the pendulum swung on
    spoilt = replace(run, outputs={"bearing.phi": replace(channel, values=values)})
    free = (free_parameter(system, "bearing.d"), free_parameter(system, "rod.l"))
    clean, squares, robust = (
        estimate(make_problem(system, free, (data,), huber=huber)).values["bearing.d"]
        for data, huber in ((run, None), (spoilt, None), (spoilt, 1.5))
    )
    assert abs(robust - clean) < 0.1 * abs(squares - clean)


def test_coloured_residuals_make_larger_standard_deviations():
    """An AR(1) noise with coefficient a multiplies the variance of a slow parameter by (1 + a)/(1 - a)."""
    system, run = assemble(RotaDamp()), release(0.5, noise=0.0, duration=20.0)
    generator, a = np.random.default_rng(3), 0.9
    noise = np.zeros(run.time.size)
    for k in range(1, noise.size):
        noise[k] = a * noise[k - 1] + 1e-3 * np.sqrt(1 - a**2) * generator.standard_normal()
    channel = run.outputs["bearing.phi"]
    coloured = replace(run, outputs={"bearing.phi": replace(channel, values=channel.values + noise, sd=1e-3)})
    fit = estimate(make_problem(system, (free_parameter(system, "bearing.d"),), (coloured,)))
    white = release(0.5, noise=1e-3, duration=20.0)
    known = estimate(make_problem(system, (free_parameter(system, "bearing.d"),), (white,)))
    # the pendulum swings with 4 rad/s, slow against the noise: spectrum of AR(1) there over its variance
    w = 4.13 * 0.01
    expected = (1 - a**2) / (1 - 2 * a * np.cos(w) + a**2)
    assert (fit.parameters[0].sd / known.parameters[0].sd) ** 2 == pytest.approx(expected, rel=0.25)
    assert not fit.noise.is_white and known.noise.is_white


def test_the_noise_model_finds_the_order_of_an_autoregression():
    generator = np.random.default_rng(0)
    x = np.zeros((20000, 2))
    for k in range(2, len(x)):
        white = generator.standard_normal(2) @ np.array([[1.0, 0.0], [0.5, 1.0]]).T
        x[k, 0] = 1.2 * x[k - 1, 0] - 0.5 * x[k - 2, 0] + white[0]
        x[k, 1] = white[1]
    x[::7, 1] = np.nan
    noise = noise_model([x])
    np.testing.assert_allclose(noise.filters[0], [1.0, -1.2, 0.5], atol=0.03)
    assert len(noise.filters[1]) == 1
    np.testing.assert_allclose(noise.covariance, [[1.0, 0.5], [0.5, 1.25]], atol=0.04)


def test_noise_of_an_output_that_is_measured_at_each_second_sample_follows_from_its_own_samples():
    generator, x = np.random.default_rng(1), np.full((40000, 2), np.nan)
    x[:, 0] = generator.standard_normal(len(x))
    own = np.zeros(len(x) // 2)
    for k in range(1, len(own)):
        own[k] = 0.8 * own[k - 1] + generator.standard_normal()
    x[1::2, 1] = own
    noise = noise_model([x])
    assert len(noise.filters[0]) == 1
    np.testing.assert_allclose(noise.filters[1], [1.0, 0.0, -0.8], atol=0.02)
    np.testing.assert_allclose(np.diag(noise.covariance), [1.0, 1.0], rtol=0.03)


def test_directions_that_the_data_leave_open_are_named():
    names, values = ("cart.m", "motor.k", "rail.d"), np.array([4.0, 0.2, 3.0])
    together = np.array([[4.0], [0.2], [0.0]])
    assert blind_directions(names, values, together) == (
        "`cart.m` and `motor.k` can be scaled together: only `cart.m/motor.k` is identified",
    )
    square = np.array([[8.0], [0.2], [-3.0]])
    assert "`cart.m*rail.d^2` and `motor.k*rail.d` are identified" in blind_directions(names, values, square)[0]
    # two masses of which only the sum moves: no product of powers stays
    apart = blind_directions(("cart.m", "drive.m"), np.array([4.609, 6.763]), np.array([[1.0], [-1.0]]))
    assert apart == ("`cart.m` and `drive.m` move the outputs alike: only a combination of them is identified",)
    assert blind_directions(names, values, np.array([[0.0], [1.0], [0.0]])) == ("`motor.k` does not reach the outputs",)


@pytest.mark.parametrize("scale", [None, 100.0])
def test_a_pendulum_on_its_rod_alone_names_the_ratio(scale):
    system = assemble(RotaDamp())
    free = (free_parameter(system, "bearing.d", guess=0.03, scale=scale), free_parameter(system, "rod.m", guess=0.2))
    fit = estimate(make_problem(system, free, (release(0.5),)))
    assert fit.blind == ("`bearing.d` and `rod.m` can be scaled together: only `bearing.d/rod.m` is identified",)
    assert {e.status for e in fit.parameters} == {"unidentifiable"}


class Brush(electrical.OnePort):
    """Voltage drop of a brush, u = V tanh(i/i_b)."""

    V: Param = param(unit="V", min=0, doc="drop at high current")
    i_b: Param = param(unit="A", min=0, doc="current at which it has 76 % of that")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.V * ca.tanh(self.i / self.i_b)


class Brushed(Component):
    """A motor without inductance, whose current follows from a nonlinear equation."""

    def __post_init__(self) -> None:
        self.source, self.resistor = electrical.VoltageSource(), electrical.Resistor(R=2.0)
        self.brush, self.emf = Brush(V=1.0, i_b=0.3), electrical.EMF(k=0.1)
        self.rotor, self.bearing = rotational.Inertia(J=1e-3), rotational.BearingFriction(d=1e-4)
        self.zero, self.ground = electrical.Ground(), rotational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.source.pin_p, self.resistor.pin_p)
        yield connect(self.resistor.pin_n, self.brush.pin_p)
        yield connect(self.brush.pin_n, self.emf.pin_p)
        yield connect(self.emf.pin_n, self.source.pin_n, self.zero.pin)
        yield connect(self.emf.flange, self.rotor.flange_a, self.bearing.flange_b)
        yield connect(self.bearing.flange_a, self.ground.flange)


def test_algebraic_variables_at_a_jump_of_an_input_are_those_after_it():
    times = np.linspace(0.0, 2.0, 201)
    voltage = 6.0 * np.sin(2 * np.pi * 0.7 * times)
    run = simulate(Brushed(), times=times, inputs={"source.u": (times, voltage, "zoh")})
    drop = 2.0 * run["resistor.i"] + np.tanh(run["resistor.i"] / 0.3) + 0.1 * run["rotor.w"]
    np.testing.assert_allclose(drop, run["source.u"], atol=1e-6)


def test_algebraic_variables_are_estimated_through():
    system = assemble(Brushed())
    assert system.algebraics
    times = np.linspace(0.0, 4.0, 401)
    voltage = 6.0 * np.sin(2 * np.pi * 0.7 * times)
    run = simulate(system, times=times, inputs={"source.u": (times, voltage, "foh")}, rtol=1e-9, atol=1e-11)
    inputs = {"source.u": Channel(voltage, "foh", None, "V", 0.0)}
    outputs = {"rotor.w": "rad/s", "resistor.i": "A"}
    experiment = experiment_of(run, outputs, {}, noise=1e-3, inputs=inputs)
    truth = {"resistor.R": 2.0, "brush.V": 1.0, "brush.i_b": 0.3, "rotor.J": 1e-3}
    free = tuple(free_parameter(system, name, guess=1.2 * value, lower=value / 50) for name, value in truth.items())
    problem = make_problem(system, free, (experiment,))
    fit = estimate(problem, guess=estimate(problem, bandwidth=20.0).point)
    assert fit.success
    for item in fit.parameters:
        assert item.value == pytest.approx(truth[item.name], abs=4 * item.sd)
        assert item.sd < 0.03 * item.value
    # the derivatives through the iterations are those of finite differences
    point, names = dict(fit.point), [item.name for item in free]
    linear = linearised(problem, point, 0.0, problem.prior_sd)
    for k, name in enumerate(names):
        step = 1e-5 * truth[name]
        costs = []
        for sign in (1, -1):
            shifted = linearised(problem, point | {name: point[name] + sign * step}, 0.0, problem.prior_sd)
            costs.append(shifted.gradients.sum(axis=0)[k])
        curvature = (costs[0] - costs[1]) / (2 * step) * linear.variables[k].scale
        assert curvature == pytest.approx(linear.grams.sum(axis=0)[k, k], rel=0.05)  # Gauss-Newton leaves out r''


@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e5])
@pytest.mark.parametrize("upper", [1.0, 0.03])
def test_a_value_stands_on_its_bound_whatever_its_scale(scale, upper):
    """0.0375 with a scale of 1e5 is 4e-7 off its lower bound for the solver, and a thousand standard deviations."""
    system = assemble(RotaDamp())
    free = free_parameter(system, "bearing.d", guess=0.02, lower=0.0, upper=upper, scale=scale)
    problem = make_problem(system, (free,), (release(0.5),))
    (item,) = estimate(problem).parameters
    if upper < D:
        assert item.status == "at-bound"
        assert item.value == pytest.approx(upper, rel=1e-9)
    else:
        assert item.status == "ok"
        assert item.value == pytest.approx(D, abs=4 * item.sd) and item.sd < 1e-3


def test_a_fit_whose_only_parameter_stands_on_its_bound_has_residuals_that_may_be_white():
    system = assemble(RotaDamp())
    free = free_parameter(system, "bearing.d", guess=0.02, upper=D * (1 - 1e-4))
    fit = estimate(make_problem(system, (free,), (release(0.5),)))
    assert fit.noise.is_white and fit.parameters[0].status == "at-bound" and not fit.starts


def test_starts_of_pieces_keep_their_names_in_a_model_with_an_effect_in_series():
    """What gives way in the bearing makes the arm's angle a state in place of the bearing's."""
    run = replace(release(0.5), piece=1.0)
    plain = make_problem(assemble(RotaDamp()), (), (run,))
    inside = insert(RotaDamp(), "compliance", "bearing.flange_a")
    given = make_problem(assemble(inside), (), (run,))
    missing = {item.name for item in plain.variables} - {item.name for item in given.variables}
    assert not missing
    starts = [name for name in (item.name for item in given.variables) if name.endswith((".phi", ".w"))]
    assert len(starts) == len(plain.variables), starts


def test_directions_that_say_the_same_are_one():
    names, values = ("cart.m", "rail.d"), np.array([4.0, 2.0])
    twice = np.array([[4.0, 8.0], [2.0, 4.0]])
    assert blind_directions(names, values, twice) == blind_directions(names, values, twice[:, :1])
    lost = np.array([[4.0, np.nan, 0.0], [2.0, 1.0, 0.0]])
    assert blind_directions(names, values, lost) == blind_directions(names, values, twice[:, :1])
