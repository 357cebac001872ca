"""Zstandard, which Python has from 3.14 on; before, the extra `ros` installs it."""

import sys

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ["zstd"]
