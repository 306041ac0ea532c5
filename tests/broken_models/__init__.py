"""Models that are wrong, each with the sentence that it must produce."""
