"""Models in C with an engine of our own: steps, located events, decisions and clocks at the speed of the machine."""
