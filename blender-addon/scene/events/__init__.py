"""Text strips and timeline markers that are events."""
