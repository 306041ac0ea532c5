"""`python -m cartpend_dae` is the command line, where the command `cartpend` is not on the path."""

from cartpend_dae.cli import main

if __name__ == "__main__":
    main()
