"""FaceTalk: a parametric head represented as a field (Aneja et al. 2023)."""
