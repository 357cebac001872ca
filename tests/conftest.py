"""Settings for all tests."""

import os

import hypothesis

from scenarios.quiet import import_noisy_libraries

os.environ.setdefault("RERUN_ANALYTICS_ENABLED", "0")
hypothesis.settings.register_profile("steady", deadline=None, derandomize=True, max_examples=30)
hypothesis.settings.load_profile("steady")
import_noisy_libraries()
