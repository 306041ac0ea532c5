"""The laws of the effects, written anew: none of them reads the package."""
