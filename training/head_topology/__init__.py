"""A head of clean quads for heads made from numbers: MakeHuman's topology on ICT's mean face."""
