"""How fast the corrector is on this machine, part by part: measured and printed, never judged."""
