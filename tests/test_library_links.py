"""Links that give way, against closed forms."""

import pytest
from library_bench import joined

from cartpend_dae import simulate
from cartpend_dae.library import rotational, rotational_links, translational, translational_links

DOMAINS = {
    "rotational": (rotational, rotational_links, rotational.Inertia(J=0.5), "tau", "tau_0"),
    "translational": (translational, translational_links, translational.Mass(m=0.5), "f", "f_0"),
}


@pytest.mark.parametrize("load", [0.5, -2.0, 40.0])
@pytest.mark.parametrize("n", [0.0, 0.3])
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_link_that_hardens_gives_way_by_less_under_more_load(domain, n, load):
    module, links, body, effort, constant = DOMAINS[domain]
    ground, link = module.Fixed(), links.Compliance(h=0.02, w_c=100.0, D=0.5, n=n)
    against = module.ConstantLoad(**{constant: -load})
    model = joined(
        (ground.flange, link.flange_a),
        (link.flange_b, body.flange_b),
        (ground.flange, against.flange_a),
        (against.flange_b, body.flange_b),
        ground=ground,
        link=link,
        body=body,
        against=against,
    )
    result = simulate(model, 30.0, points=11, rtol=1e-9)
    assert result[f"link.{effort}"][-1] == pytest.approx(load, rel=1e-6)
    stretch = result["link.q"][-1] / 0.02
    assert stretch * (1 + (n * stretch) ** 2) == pytest.approx(load, rel=2e-6)
