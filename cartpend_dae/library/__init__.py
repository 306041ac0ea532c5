"""Components of mechanics, circuits and signals; ordinary ones, as a user would write them."""

from cartpend_dae.library import electrical, friction, rotational, signals, translational

__all__ = ["electrical", "friction", "rotational", "signals", "translational"]
