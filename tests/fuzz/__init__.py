"""What is read from files, under bytes of any kind."""
