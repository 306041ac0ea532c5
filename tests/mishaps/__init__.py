"""What can happen to a run from outside, made to happen: kills, full disks, missing tools, odd places, long use."""
