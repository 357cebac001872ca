"""How fast the correctors are on this machine, part by part: measured and printed, never judged."""
