"""The blind test bed: data sets with a hidden effect, from a simulator that shares no code with the package."""
