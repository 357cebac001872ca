"""Settings for all tests."""

import signal
import threading

import hypothesis

hypothesis.settings.register_profile("steady", deadline=None, derandomize=True, max_examples=30)
hypothesis.settings.load_profile("steady")
if threading.current_thread() is threading.main_thread():
    # A shell's background jobs ignore Ctrl-C, and so would everything that the tests start and interrupt.
    signal.signal(signal.SIGINT, signal.default_int_handler)
