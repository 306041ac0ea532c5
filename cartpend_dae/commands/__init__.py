"""What the command line does; each command is loaded when it is called."""
