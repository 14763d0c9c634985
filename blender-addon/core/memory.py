"""How much memory this process has taken."""

import sys

# Bytes in the system's unit of memory: macOS counts in bytes, others in 1024 bytes.
_UNIT = 1 if sys.platform == "darwin" else 1024


def peak_mb() -> int | None:
    """The most memory that the process has had at once, MB; None if the system does not say."""
    try:
        import resource
    except ImportError:
        # Windows has no such module.
        return None
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT / 1e6)
