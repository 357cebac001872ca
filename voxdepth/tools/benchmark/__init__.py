"""Speed of the correctors on this machine: measured and printed, never judged."""
