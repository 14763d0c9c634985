"""How much memory this process has taken."""

import sys

# Bytes in what the system counts by; macOS counts single ones.
_UNIT = 1 if sys.platform == "darwin" else 1024


def peak_mb() -> int | None:
    """The most that the process has had at once, MB; None where the system does not say."""
    try:
        import resource
    except ImportError:
        # Windows has none.
        return None
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT / 1e6)
