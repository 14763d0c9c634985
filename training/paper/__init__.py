"""The tables and figures of the FreeTalk paper, from any corpus folder."""
