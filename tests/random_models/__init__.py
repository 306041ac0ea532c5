"""Models drawn at random: linear networks with a second, independent formulation, and models with one fault each."""
