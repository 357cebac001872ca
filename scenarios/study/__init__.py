"""Studies: many missions by one file, resumable, with the statistics and the report of their outcomes."""
