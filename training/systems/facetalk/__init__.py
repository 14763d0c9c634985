"""FaceTalk: a parametric head that is a field (Aneja et al. 2023)."""
