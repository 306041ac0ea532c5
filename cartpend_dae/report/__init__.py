"""What people get: result.json, tables, sentences, the augmented model as Python, and the files of a run."""
